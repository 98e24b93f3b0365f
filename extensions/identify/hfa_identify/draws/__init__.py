"""Option `--draws`: spread of results over aircraft with randomly drawn uncertain parameters."""
