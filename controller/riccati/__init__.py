"""Exact solutions of games, each proved in ball arithmetic."""
