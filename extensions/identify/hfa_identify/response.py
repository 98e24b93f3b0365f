"""The response of a model to the inputs of a record, with its exact sensitivities.

Between samples the inputs are linear in time and the states advance by the classical Runge-Kutta
method of fourth order: x⁺ = Φ(x, u, u⁺, θ, Δt). The sensitivities S = dx/d(θ, x₀) follow from
S⁺ = Φ_x S + Φ_θ. The derivatives of the rates are CasADi's, those of the step follow by the chain
rule.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_aircraft.layout import components
from hfa_aircraft.model import Model
from hfa_identify.records import Record
from hfa_support.native.bound import RowFunction

#: A step of integration is at most this part of the fastest mode's time constant.
_STEP = 0.3
#: At most so many steps of integration between two samples.
_MOST_STEPS = 10


@dataclass(frozen=True, eq=False)
class Response:
    """A simulated record.

    y: (N, k) the measured quantities. by_parameters: (N, k, p) dy/dθ. by_start: (N, k, n) dy/dx₀.
    """

    y: np.ndarray
    by_parameters: np.ndarray
    by_start: np.ndarray


class Responses:
    """Simulates a model that has free parameters.

    model: gives the values of the others. free: names of the parameters θ.
    measured: states and outputs that records have.
    """

    def __init__(self, model: Model, free: Sequence[str], measured: Sequence[str]) -> None:
        self.model = model
        self.free = tuple(free)
        self.measured = tuple(measured)
        x, u = model.layout.symbols("x", "u")
        after = ca.SX.sym("after", u.numel())
        theta = ca.SX.sym("theta", len(self.free))
        duration = ca.SX.sym("duration")
        values = list(map(ca.SX, model.p.tolist()))
        for name, symbol in zip(self.free, components(theta), strict=True):
            values[list(model.parameters).index(name)] = symbol
        vectors = [components(x), components(u), values]
        rates, seen = model.layout.expressions(vectors, self.measured)
        f = ca.Function("f", [x, u, theta], [rates])
        unknowns = ca.vertcat(x, theta)
        moved = _runge_kutta(f, x, u, after, theta, duration)
        self._step = ca.Function("step", [x, u, after, theta, duration], ca.cse([moved]))
        slopes = ca.densify(ca.jacobian(rates, unknowns))
        self._advances: dict[int, ca.Function] = {}
        # Slopes are transposed: a row holds the columns of a matrix one after the other.
        self._rates = RowFunction(ca.Function("rates", [x, u, theta], ca.cse([rates, slopes.T])))
        seen_slopes = ca.densify(ca.jacobian(seen, unknowns))
        self._seen = RowFunction(ca.Function("seen", [x, u, theta], [seen, seen_slopes.T]))

    @cached_property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of states, free parameters and measured quantities."""
        return len(self.model.states), len(self.free), len(self.measured)

    def steps_between(self, record: Record, start: np.ndarray, theta: np.ndarray) -> int:
        """Steps of integration between two samples: as the fastest mode at the start asks."""
        _, slopes = self._rates_at(start[None], record.inputs[:1], theta)
        slope = slopes[0, :, : len(start)]
        if not np.isfinite(slope).all():
            return 1
        fastest = np.abs(np.linalg.eigvals(slope)).max()
        longest = np.diff(record.time).max()
        return int(np.clip(math.ceil(longest * fastest / _STEP), 1, _MOST_STEPS))

    def simulated(self, record: Record, start: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(N, k) the measured quantities of a simulation from a start (n,) with parameters (p,).

        FloatingPointError where it leaves the finite numbers."""
        count = self.steps_between(record, start, theta)
        states, _, _ = self._states(record, start, theta, count)
        y, _ = self._observed(states[::count], record.inputs, theta)
        if not np.isfinite(y).all():
            raise FloatingPointError("the simulation diverges")
        return y

    def of(self, record: Record, start: np.ndarray, theta: np.ndarray) -> Response:
        """The response from a start (n,) with parameters (p,).

        FloatingPointError where the simulation leaves the finite numbers."""
        n, p, _ = self.sizes
        count = self.steps_between(record, start, theta)
        states, inputs, durations = self._states(record, start, theta, count)
        with np.errstate(all="ignore"):  # what is not finite is refused
            S = self._accumulated(states[:-1], inputs, theta, durations, count)
            y, slopes = self._observed(states[::count], record.inputs, theta)
            total = slopes[:, :, :n] @ S
            total[:, :, :p] += slopes[:, :, n:]
        if not (np.isfinite(y).all() and np.isfinite(total).all()):
            raise FloatingPointError("the simulation diverges")
        return Response(y, total[:, :, :p], total[:, :, p:])

    def _states(
        self, record: Record, start: np.ndarray, theta: np.ndarray, count: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (steps + 1, n) and inputs (steps + 1, m) of the grid of integration, with its
        steps (steps,), s."""
        time, inputs = _finer(record, count)
        durations = np.diff(time)
        advance = self._advance(len(durations))
        moved = advance(start, inputs[:-1].T, inputs[1:].T, theta, durations[None])
        states = np.vstack([start, moved.full().T])
        if not np.isfinite(states).all():
            raise FloatingPointError("the simulation diverges")
        return states, inputs, durations

    def _advance(self, steps: int) -> ca.Function:
        """The states after each of so many steps; made once for a number of steps."""
        if steps not in self._advances:
            self._advances[steps] = self._step.mapaccum(steps)
        return self._advances[steps]

    def _accumulated(
        self,
        states: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        durations: np.ndarray,
        count: int,
    ) -> np.ndarray:
        """(N, n, p + n) sensitivities of the states to θ and x₀ at every `count`-th step.

        states: (steps, n) before each step. inputs: (steps + 1, m). durations: (steps,), s.
        """
        n, p, _ = self.sizes
        steps = len(states)
        before = inputs[:-1]
        after = inputs[1:]
        middle = 0.5 * (before + after)
        identity = np.zeros((steps, n, n + p))
        identity[:, :, :n] = np.eye(n)
        total = np.zeros((steps, n, n + p))
        moved = states
        within = identity
        for held, share, weight in (
            (before, 0.5, 1.0),
            (middle, 0.5, 2.0),
            (middle, 1.0, 2.0),
            (after, 0.0, 1.0),
        ):
            rates, slopes = self._rates_at(moved, held, theta)
            growth = slopes[:, :, :n] @ within
            growth[:, :, n:] += slopes[:, :, n:]
            total += weight * growth
            moved = states + share * durations[:, None] * rates
            within = identity + share * durations[:, None, None] * growth
        change = identity + durations[:, None, None] / 6.0 * total
        return _products(change[:, :, :n], change[:, :, n:], count)

    def _rates_at(
        self, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, n) rates and their (N, n, n + p) slopes by states and parameters.

        states: (N, n). inputs: (N, m)."""
        n, p, _ = self.sizes
        rates, slopes = self._rates(states, inputs, np.tile(theta, (len(states), 1)))
        return rates, slopes.reshape(-1, n, n + p)

    def _observed(
        self, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, k) the measured quantities and their (N, k, n + p) slopes by states and parameters.

        states: (N, n). inputs: (N, m)."""
        n, p, k = self.sizes
        y, slopes = self._seen(states, inputs, np.tile(theta, (len(states), 1)))
        return y, slopes.reshape(-1, k, n + p)


def _runge_kutta(
    f: ca.Function, x: ca.SX, u: ca.SX, after: ca.SX, theta: ca.SX, duration: ca.SX
) -> ca.SX:
    """The state after one step of the classical Runge-Kutta method."""
    middle = 0.5 * (u + after)
    k1 = f(x, u, theta)
    k2 = f(x + 0.5 * duration * k1, middle, theta)
    k3 = f(x + 0.5 * duration * k2, middle, theta)
    k4 = f(x + duration * k3, after, theta)
    return x + duration / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def _finer(record: Record, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and inputs of a grid with `count` steps between two samples."""
    if count == 1:
        return record.time, record.inputs
    places = np.arange(len(record.time), dtype=float)
    fine = np.linspace(0.0, places[-1], (len(places) - 1) * count + 1)
    inputs = [np.interp(fine, places, column) for column in record.inputs.T]
    return np.interp(fine, places, record.time), np.column_stack(
        [np.empty((len(fine), 0)), *inputs]
    )


def _products(by_state: np.ndarray, by_theta: np.ndarray, count: int) -> np.ndarray:
    """(N, n, p + n) of S⁺ = Φ_x S + Φ_θ at every `count`-th step, from S = (0, I).

    by_state: (steps, n, n) Φ_x. by_theta: (steps, n, p) Φ_θ."""
    steps, n, p = by_theta.shape
    S = np.zeros((n, p + n))
    S[:, p:] = np.eye(n)
    found = np.empty((steps // count + 1, n, p + n))
    found[0] = S
    for step in range(steps):
        S = by_state[step] @ S
        S[:, :p] += by_theta[step]
        if (step + 1) % count == 0:
            found[(step + 1) // count] = S
    return found
