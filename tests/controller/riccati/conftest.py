"""The games that the exact solution is tested on: those of the two printed models."""

from printed_games import first, game

__all__ = ["first", "game"]
