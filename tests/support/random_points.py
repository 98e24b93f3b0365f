"""Seeded random states and inputs, far wider than any trim."""

from __future__ import annotations

import numpy as np

from hfa_model import Input, State

_LOWEST_STATE = State(20.0, -0.35, 0.0, -1.0, -1.0, -1.2, -1.0)
_HIGHEST_STATE = State(300.0, 0.35, 65_000.0, 1.0, 1.0, 1.2, 1.0)
_LOWEST_INPUT = Input(0.0, -0.35, -0.35, -0.5, -0.5)
_HIGHEST_INPUT = Input(200.0, 0.35, 0.35, 0.5, 0.5)


def random_points(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """States (count, 7) and inputs (count, 5), uniform between the limits above."""
    rng = np.random.default_rng(seed)
    states = rng.uniform(_LOWEST_STATE, _HIGHEST_STATE, (count, len(_LOWEST_STATE)))
    inputs = rng.uniform(_LOWEST_INPUT, _HIGHEST_INPUT, (count, len(_LOWEST_INPUT)))
    return states, inputs
