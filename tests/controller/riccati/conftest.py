"""Fixtures with the games of the two printed models."""

from game_samples import first, game

__all__ = ["first", "game"]
