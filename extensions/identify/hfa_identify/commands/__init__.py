"""The command `hfa identify`."""
