"""Exact solutions of games, each certified by two independent derivations."""
