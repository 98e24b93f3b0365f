"""Discrete-time games: normal form, exact solution and implied policy."""
