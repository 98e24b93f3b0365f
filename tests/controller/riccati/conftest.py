"""Fixtures with the games of the two printed models."""

from game_samples import game

__all__ = ["game"]
