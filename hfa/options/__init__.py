"""Options of the commands and the objects that they make; each command adds its own."""
