"""Games in discrete time for tests."""

from dataclasses import replace


def in_steps(game, discount=1.0):
    """Return the game in discrete time with the same matrices, of an unknown sample time."""
    return replace(game, dt=True, discount=discount)
