"""Options of the commands and the objects that they make; a command adds what it needs."""
