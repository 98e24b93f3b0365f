"""Exact solution of games, certified by two independent derivations."""
