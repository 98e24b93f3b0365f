"""Options shared by several commands, and the objects constructed from them."""
