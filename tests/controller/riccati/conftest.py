"""The games that the exact solution is tested on: those of the two printed models."""

from game_samples import first, game

__all__ = ["first", "game"]
