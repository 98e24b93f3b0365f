"""A flight of the linear model under given policies, with the cost of the game integrated alongside."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import LARGEST, Game
from hfa_support.errors import BadInputError, NoSolutionError

#: A policy or a forcing: (t, z) -> vector.
Feedback = Callable[[float, np.ndarray], np.ndarray]

RELATIVE_TOLERANCE = 1e-13


class LinearFlight(NamedTuple):
    """A simulation: times (N,), states (N, n), controls (N, m), disturbances (N, k), running cost (N,)."""

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
    """z' = A z + B u + E d + r(t),  J' = z'Qz + u'Ru - δ² d'd, integrated by LSODA to 1e-13.

    initial: (n,) at times[0]; times: (N,) increasing, s; forcing r: t -> (n,), none when absent.
    Raises NoSolutionError when the state grows beyond 1e100, or the integrator gives up.
    Source: Petzold, SIAM J. Sci. Stat. Comput. 4 (1983), as implemented in SciPy.
    """
    from scipy.integrate import solve_ivp
    from scipy.linalg import block_diag

    if np.ndim(times) != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise BadInputError("the times of a flight must be at least two numbers that increase")

    price = 0.0 if math.isinf(game.delta) else game.delta**2  # no disturbance, no pay-off: inf * 0 is 0
    # z' = [A B E] y and J' = y'D y with y = (z, u, d): thousands of calls a flight.
    motion = np.hstack([game.A, game.B, game.E])
    D = block_diag(game.Q, game.R, -price * np.eye(game.E.shape[1]))

    def rate(t: float, augmented: np.ndarray) -> np.ndarray:
        z = augmented[:-1]
        if not z @ z < LARGEST**2:
            raise NoSolutionError(f"the flight leaves every bound near t = {t:.4g} s: the policies do not stabilize it")
        y = np.concatenate((z, control(t, z), disturbance(t, z)))
        change = np.empty_like(augmented)
        change[:-1] = motion @ y
        change[-1] = y @ D @ y
        if forcing is not None:
            change[:-1] += forcing(t)
        return change

    result = solve_ivp(
        rate,
        (times[0], times[-1]),
        np.append(initial, 0.0),
        method="LSODA",
        t_eval=times,
        rtol=RELATIVE_TOLERANCE,
        atol=RELATIVE_TOLERANCE * max(float(np.abs(initial).max()), 1.0),
    )
    if not result.success:
        raise NoSolutionError(f"the flight could not be integrated beyond t = {result.t[-1]:.4g} s: {result.message}")
    states, cost = result.y[:-1].T, result.y[-1]
    controls = np.array([control(t, z) for t, z in zip(times, states, strict=True)])
    disturbances = np.array([disturbance(t, z) for t, z in zip(times, states, strict=True)])
    return LinearFlight(times, states, controls, disturbances, cost)
