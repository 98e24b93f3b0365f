"""Proved lower bounds on the cost, compared with simulated flights."""
