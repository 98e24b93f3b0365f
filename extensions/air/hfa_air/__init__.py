"""Air with mass and memory: the `unsteady` dynamics of the highly flexible aircraft."""
