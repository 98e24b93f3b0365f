"""Comparison of learned critics with the exact solution of their game."""
