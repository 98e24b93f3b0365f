"""The command `hfa`: parses, calls, prints; no arithmetic."""
