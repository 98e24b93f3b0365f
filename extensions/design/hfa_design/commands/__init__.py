"""The command `hfa design`."""
