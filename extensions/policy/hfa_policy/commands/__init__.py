"""The command `hfa assess`."""
