"""The exact solution of the game, certified by a second derivation."""
