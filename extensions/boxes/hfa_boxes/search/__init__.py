"""The search for what the checker proves."""
