"""Holds of a plan, chosen from the linear model, and the linear optimum over them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hfa_flight.hold import Hold, hold_of
from hfa_optimal.scaled import ScaledProblem
from hfa_support.errors import BadInputError, NoSolutionError, shown

#: Number of holds of a plan.
HOLDS = 36
#: Largest product of the sample time and the fastest pole of the aircraft.
_FASTEST = 0.7
#: Largest relative increase of the least linear cost over the usual box: by holding the inputs for
#: ever, and by the holds of a plan that ends with z'Pz.
_HOLD_PRICE = 0.005
_GRID_PRICE = 0.01
#: Largest ratio of successive holds. Largest product of the last hold and the fastest pole.
_GROWTH = 1.25
_LAST = 3.0
#: Largest horizon, in time constants of the slowest pole of the linear loop, and in those of the
#: fastest growing pole of the aircraft. A plan is an open-loop flight, and errors grow with it.
_LONG = 4.0
_GROWING = 10.0
#: Sample times, s, the longest first.
_SAMPLE_TIMES = tuple(a * 10.0**e for e in (0, -1, -2, -3, -4) for a in (5, 2, 1))


class Grid(NamedTuple):
    """Holds of a plan.

    dt: sample time, the first hold, s
    holds: durations of the holds, s, (N,)
    asked: horizon that was cut to the sum of the holds, s, or None
    """

    dt: float
    holds: np.ndarray
    asked: float | None = None

    @property
    def ends(self) -> np.ndarray:
        """Times of the nodes of a plan, s, (N + 1,). The first is 0."""
        return np.append(0.0, np.cumsum(self.holds))

    @property
    def horizon(self) -> float:
        """Duration of a plan, s."""
        return float(self.holds.sum())

    def of(self, scaled: ScaledProblem) -> list[Hold]:
        """Return the linear model and the cost of each hold."""
        lengths = self.holds.tolist()
        found = {each: hold_of(*scaled.linear, each) for each in dict.fromkeys(lengths)}
        return [found[each] for each in lengths]


def gains_of(holds: Sequence[Hold], P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear optimal gains of the holds of a plan, (N, m, n), and P at its start.

    P: matrix of the cost z'Pz at the end of the plan, (n, n)
    """
    gains = []
    for hold in reversed(holds):
        K, P = hold.back(P)
        gains.append(K)
    return np.array(gains[::-1]), P


def grid_of(scaled: ScaledProblem, dt: float | None, horizon: float | None) -> Grid:
    """Return the holds of a plan, chosen from the linear model alone.

    - dt is the longest of 1, 2, 5, 10, ... ms for which the product with the aircraft's fastest
      pole is at most 0.7, and the linear optimum with held inputs costs at most 0.5 % more than
      the optimum, over the usual box.
    - The holds grow geometrically from dt, by at most 1.25. The last is at most 3 time constants of
      the fastest pole. The linear optimum of a plan costs at most 1 % more than the optimum.
    - The horizon is at most 4 time constants of the slowest pole of the linear loop and 10 of the
      fastest growing pole of the aircraft.

    dt: sample time, s, or None for the rule
    horizon: duration of a plan, s, or None for the rule. It is cut to 10 time constants of the
      fastest growing pole, and to the longest grid of the rule

    Raises BadInputError for a horizon that is too short. Raises NoSolutionError if no sample time
    fits.
    """
    if dt is None:
        dt = sample_time(scaled)
    growing = float(scaled.poles.real.max(initial=0.0))
    longest = _GROWING / growing if growing > 0.0 else math.inf
    if horizon is not None:
        return _given_grid(dt, horizon, longest)
    longest = min(longest, _LONG / float(np.abs(scaled.loop_poles.real).min()))
    for growth in np.arange(_GROWTH, 1.0, -0.01):
        grid = _geometric(dt, HOLDS, growth)
        if grid.holds[-1] * scaled.fastest > _LAST or grid.horizon > longest:
            continue
        if scaled.price(gains_of(grid.of(scaled), scaled.P)[1]) <= _GRID_PRICE:
            return grid
    return _geometric(dt, max(1, min(HOLDS, math.floor(longest / dt + 1e-9))), 1.0)


def sample_time(scaled: ScaledProblem) -> float:
    """Return the sample time of the rule of `grid_of`, s."""
    for dt in _SAMPLE_TIMES:
        if dt * scaled.fastest > _FASTEST:
            continue
        try:
            _, P = hold_of(*scaled.linear_states, dt).forever()
        except NoSolutionError:
            continue
        if scaled.price(P) <= _HOLD_PRICE:
            return dt
    raise NoSolutionError(
        f"no sample time of at least {_SAMPLE_TIMES[-1]:g} s costs at most "
        f"{100 * _HOLD_PRICE:g} %; give dt"
    )


def _given_grid(dt: float, horizon: float, longest: float) -> Grid:
    """Return the holds of a plan of a given duration."""
    from scipy.optimize import brentq

    if not dt <= horizon < math.inf:
        raise BadInputError(
            f"the horizon is {shown(horizon)} s; with samples of {dt:g} s, give at least {dt:g} s"
        )
    longest = min(longest, _geometric(dt, HOLDS, _GROWTH).horizon)
    asked = horizon if horizon > longest * (1.0 + 1e-9) else None
    horizon = min(horizon, longest)
    if horizon <= HOLDS * dt:
        return _geometric(dt, max(1, round(horizon / dt)), 1.0)._replace(asked=asked)
    growth = brentq(lambda r: _geometric(dt, HOLDS, r).horizon - horizon, 1.0, _GROWTH + 1e-6)
    return _geometric(dt, HOLDS, growth)._replace(asked=asked)


def _geometric(dt: float, count: int, growth: float) -> Grid:
    return Grid(dt, dt * growth ** np.arange(count))
