"""The command `hfa optimize`."""
