"""Validity of results on the `unsteady` dynamics."""
