"""The commands `hfa fly` and `hfa export`."""
