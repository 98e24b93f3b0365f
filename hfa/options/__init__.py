"""Options that several commands share, and the objects made of them."""
