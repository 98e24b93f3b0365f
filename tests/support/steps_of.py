"""Games in discrete time for tests."""

from __future__ import annotations

from dataclasses import replace

from hfa import Game


def in_steps(game: Game, discount: float = 1.0) -> Game:
    """Return the game in discrete time with the same matrices, of an unknown sample time."""
    return replace(game, dt=True, discount=discount)
