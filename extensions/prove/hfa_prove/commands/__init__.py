"""The commands `hfa prove`."""
