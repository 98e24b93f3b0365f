"""Simulation of the linear model under given policies, with the integrated cost of the game."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from hfa import Game

#: A policy or a forcing: (t, z) -> vector.
Feedback = Callable[[float, np.ndarray], np.ndarray]


class LinearFlight(NamedTuple):
    """Time history of the linear model.

    times: (N,), s
    states: (N, n)
    controls: (N, m)
    disturbances: (N, k)
    cost: (N,), cost integrated from the start
    """

    times: np.ndarray
    states: np.ndarray
    controls: np.ndarray
    disturbances: np.ndarray
    cost: np.ndarray


def simulate(
    game: Game,
    control: Feedback,
    disturbance: Feedback,
    initial: np.ndarray,
    times: np.ndarray,
    forcing: Callable[[float], np.ndarray] | None = None,
) -> LinearFlight:
    """Integrate z' = A z + B u + E d + r(t) and the cost J' = z'Qz + u'Ru - δ² d'd.

    SciPy's LSODA is used with a tolerance of 1e-13.

    control: (t, z) -> u
    disturbance: (t, z) -> d
    initial: z at times[0], (n,)
    forcing: r, t -> (n,); by default 0
    """
    price = (
        0.0 if math.isinf(game.delta) else game.delta**2
    )  # no disturbance, no pay-off: inf * 0 is 0

    def rate(t: float, augmented: np.ndarray) -> np.ndarray:
        z = augmented[:-1]
        u = control(t, z)
        d = disturbance(t, z)
        change = game.A @ z + game.B @ u + game.E @ d + (0.0 if forcing is None else forcing(t))
        return np.append(change, z @ game.Q @ z + u @ game.R @ u - price * d @ d)

    size = 1e-13 * max(float(np.abs(initial).max()), 1.0)
    found = solve_ivp(
        rate,
        (times[0], times[-1]),
        np.append(initial, 0.0),
        method="LSODA",
        t_eval=times,
        rtol=1e-13,
        atol=size,
    )
    assert found.success, found.message
    states = found.y[:-1].T
    controls, disturbances = (
        np.array([policy(t, z) for t, z in zip(times, states, strict=True)])
        for policy in (control, disturbance)
    )
    return LinearFlight(times, states, controls, disturbances, found.y[-1])
