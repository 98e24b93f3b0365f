"""The games of the two printed models, on which the exact solution is tested."""

from game_samples import first, game

__all__ = ["first", "game"]
