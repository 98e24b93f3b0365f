"""Boxes of initial conditions, and draws from them."""

from __future__ import annotations

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.plan.problem import FlightProblem
from trim.point.operating_point import OperatingPoint
from verification.box import ordinary_box

#: Factor on a box that reaches beyond the limits.
_INSIDE = 0.9


def start_box(model: Model, point: OperatingPoint) -> np.ndarray:
    """Return the half-widths (k,) of the initial-condition box in the linear states about a trim.

    - Angles and angular rates: the nominal value.
    - Other states with a trim value of at least half the nominal value in magnitude: 10 % of the
      nominal value.
    - Other states: the nominal value.

    A half-width is at most half the distance to a limit.
    """
    widths = []
    for name in model.linear:
        signal = model.states[name]
        value = float(getattr(point.states, name))
        width = signal.nominal
        if not signal.unit.startswith("rad") and abs(value) >= 0.5 * signal.nominal:
            width = 0.1 * signal.nominal
        room = min(value - signal.min, signal.max - value)
        widths.append(min(width, 0.5 * max(room, 0.0)))
    return np.array(widths)


def usual_box(problem: FlightProblem) -> np.ndarray:
    """Return the half-widths of the default box of initial deviations, (k,), within the limits.

    For the HFA, the box contains its typical deviations. For other aircraft, the box is that of
    `hfa assess`.
    """
    states = problem.states
    box = ordinary_box(states, tuple(problem.model.inputs), problem.model.units(states))
    half = start_box(problem.model, problem.point) if box is None else box.half_widths
    return _inside(problem, half)


def _inside(problem: FlightProblem, half: np.ndarray) -> np.ndarray:
    """Return half-widths, (k,), reduced where the box would exceed limits of states."""
    lowest, highest = (limit[: len(half)] for limit in problem.state_limits)
    return np.minimum(half, _INSIDE * np.minimum(-lowest, highest))


def drawn_starts(
    problem: FlightProblem, count: int, seed: int, box: np.ndarray | None = None
) -> np.ndarray:
    """Return random initial conditions in a box, as deviations from trim, (count, k).

    With the same seed, a larger count returns the same initial conditions first.

    box: half-widths, (k,), reduced to fit in the limits. The default is `usual_box`.
    """
    rng = np.random.default_rng(seed)
    half = usual_box(problem) if box is None else _inside(problem, box)
    return half * rng.uniform(-1.0, 1.0, (count, len(problem.states)))
