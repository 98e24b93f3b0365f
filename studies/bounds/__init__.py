"""Proved lower bounds of the cost, compared with flights."""
