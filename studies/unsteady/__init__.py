"""Which results survive on the `unsteady` dynamics."""
