"""Search for what the checkers prove."""
