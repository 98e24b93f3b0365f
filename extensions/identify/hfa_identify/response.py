"""Response of a model to the inputs of a record, with exact sensitivities.

Between samples the inputs are linear in time or constant. The classical fourth-order Runge-Kutta
method advances the states: x⁺ = Φ(x, u, u⁺, θ, Δt). The sensitivities S = dx/d(θ, x₀) advance by
S⁺ = Φ_x S + Φ_θ. θ contains parameters of the model and errors of columns (`sensors.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.layout import components
from hfa_aircraft.march.steppers import rk4
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_identify.records import Record
from hfa_identify.sensors import SensorError, sensor_errors
from hfa_support.errors import BadInputError
from hfa_support.matrices import spectral_radius
from hfa_support.native.bound import BoundFunction, RowFunction
from hfa_support.native.machine_code import machine_code

#: Largest integration step, in time constants of the fastest mode.
STEP = 0.3
#: Largest integration step of a search that need not be accurate.
ROUGH_STEP = 0.6
#: Largest number of integration steps between two samples.
_MOST_STEPS = 10
#: Number of integration steps whose sensitivities are computed together, so that they fit into the
#: cache.
TOGETHER = 250
#: If the sampling interval exceeds this many time constants of the fastest mode, the time is not in
#: seconds.
_FAR_TOO_LONG = 60.0


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulation of a record.

    record: the record, with its times and inputs.
    theta: unknowns θ, (p,).
    y: simulated quantities, (N, k).
    at_samples: states at the samples, (N, n).
    begins: states at the start of the integration steps, (steps, n).
    inputs: inputs at the start and at the end of the steps, (steps, m) each.
    durations: durations of the steps, s, (steps,).
    count: number of steps between two samples.
    """

    record: Record
    theta: np.ndarray
    y: np.ndarray
    at_samples: np.ndarray
    begins: np.ndarray
    inputs: tuple[np.ndarray, np.ndarray]
    durations: np.ndarray
    count: int


@dataclass(frozen=True, eq=False)
class Response:
    """Simulated quantities of a record with their sensitivities.

    y: simulated quantities, (N, k)
    slopes: dy/d(θ, x₀), (N, k, p + n)
    """

    y: np.ndarray
    slopes: np.ndarray


class Responses:
    """Simulation of a model with free parameters.

    model: the model. Parameters that are not free keep their values.
    free: names of the unknowns θ: parameters and column errors.
    measured: names of the measured states and outputs.
    """

    def __init__(self, model: Model, free: Sequence[str], measured: Sequence[str]) -> None:
        self.model = model
        self.free = tuple(free)
        self.measured = tuple(measured)
        known = sensor_errors(model, (*model.inputs, *self.measured))
        self._errors = {name: known[name] for name in self.free if name in known}
        # Index of a column -> index of its delay in θ.
        self._late_inputs = self._delays(list(model.inputs))
        self._late_outputs = self._delays(list(self.measured))
        x, u = model.layout.symbols("x", "u")
        slope = ca.SX.sym("slope", u.numel() if self._late_inputs else 0)
        driven = ca.vertcat(u, slope)
        after = ca.SX.sym("after", driven.numel())
        theta = ca.SX.sym("theta", len(self.free))
        duration = ca.SX.sym("duration")
        values = list(map(ca.SX, model.p.tolist()))
        symbols = dict(zip(self.free, components(theta), strict=True))
        for place, name in enumerate(model.parameters):
            values[place] = symbols.get(name, values[place])
        true_inputs = self._true_inputs(components(u), components(slope), symbols)
        rates, seen = model.layout.expressions([components(x), true_inputs, values], self.measured)
        seen = self._recorded(components(seen), symbols)
        f = ca.Function("f", [x, driven, theta], [rates])
        unknowns = ca.vertcat(x, theta)
        driven_at = {0.0: driven, 0.5: 0.5 * (driven + after), 1.0: after}
        moved = rk4(lambda x, c: f(x, driven_at[c], theta), x, duration)
        self._step = ca.Function(
            "step", [x, driven, after, theta, duration], ca.cse([ca.densify(moved)])
        )
        slopes = ca.densify(ca.jacobian(rates, unknowns))
        self._advances: dict[Any, BoundFunction] = {}
        # Slopes are transposed, so that a row contains the columns of a matrix in succession.
        arguments = [x, driven, theta]
        self._rates = RowFunction(ca.Function("rates", arguments, ca.cse([rates, slopes.T])))
        self._seen = RowFunction(ca.Function("seen", arguments, [seen]))
        seen_slopes = ca.densify(ca.jacobian(seen, unknowns))
        self._seen_slopes = RowFunction(ca.Function("seen_slopes", arguments, [seen_slopes.T]))

    def compile(self) -> None:
        """Compile derivatives and integration steps, if a C compiler is available."""
        self._rates = RowFunction(machine_code(self._rates.function))
        self._step = machine_code(self._step)
        self._advances = {}

    @cached_property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers (n, p, k) of states, unknowns and measured quantities."""
        return len(self.model.states), len(self.free), len(self.measured)

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Unknown -> its unit, limits and value at the start of the search."""
        signals = {}
        for name in self.free:
            if name in self._errors:
                signals[name] = self._errors[name].signal(self.model)
            else:
                signals[name] = self.model.parameters[name]
        return signals

    # Errors of columns.

    def _delays(self, columns: list[str]) -> dict[int, int]:
        """Return the delays that are unknowns, as index in `columns` -> index in θ."""
        return {
            columns.index(error.column): self.free.index(name)
            for name, error in self._errors.items()
            if error.kind == "delay" and error.column in columns
        }

    def _true_inputs(
        self, recorded: list[ca.SX], slopes: list[ca.SX], symbols: dict[str, ca.SX]
    ) -> list[ca.SX]:
        """Return the true inputs as expressions of recorded inputs and unknown column errors."""
        # Bias and scale error are corrected exactly, a delay to first order.
        true = []
        for place, name in enumerate(self.model.inputs):
            value = recorded[place]
            if place in self._late_inputs:
                value = value + symbols[SensorError("delay", name).name] * slopes[place]
            value = value - self._symbol("bias", name, symbols)
            true.append(value / (1.0 + self._symbol("scale", name, symbols)))
        return true

    def _recorded(self, true: list[ca.SX], symbols: dict[str, ca.SX]) -> ca.SX:
        """Return the measured quantities with their bias and scale error as expressions."""
        rows = [
            (1.0 + self._symbol("scale", name, symbols)) * value
            + self._symbol("bias", name, symbols)
            for name, value in zip(self.measured, true, strict=True)
        ]
        return ca.densify(ca.vertcat(ca.SX(0, 1), *rows))

    def _symbol(self, kind: str, column: str, symbols: dict[str, ca.SX]) -> ca.SX | float:
        """Return the symbol of a column error, or 0 if this error is not an unknown."""
        name = SensorError(kind, column).name
        return symbols[name] if name in self._errors else 0.0

    def _driven(self, record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the inputs of a record without their unknown delays, and the other unknowns."""
        # The inputs are (N, m), or (N, 2m) with their time derivatives if a delay is an unknown. In
        # the returned unknowns (p,), these delays are 0.
        # theta (p,)
        if not self._late_inputs:
            return record.inputs, theta
        inputs = record.inputs.copy()
        slopes = np.zeros_like(inputs)
        rest = theta.copy()
        for column, place in self._late_inputs.items():
            later = record.time + theta[place]
            inputs[:, column] = np.interp(later, record.time, record.inputs[:, column])
            slopes[:, column] = self.input_slopes(record, column, later)
            rest[place] = 0.0
        return np.hstack([inputs, slopes]), rest

    def input_slopes(self, record: Record, column: int, times: np.ndarray) -> np.ndarray:
        """Return the time derivatives of an input at given times, (N,).

        A derivative is a difference over the sampling interval centered at the time.

        column: index of the input
        times: s, (N,)
        """
        interval = float(np.median(np.diff(record.time)))
        ends = times + 0.5 * interval
        recorded = record.inputs[:, column]
        rise = np.interp(ends, record.time, recorded)
        rise -= np.interp(ends - interval, record.time, recorded)
        return rise / interval

    def _delayed(self, record: Record, theta: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the simulated quantities with their delays applied, (N, k)."""
        # theta (p,), y (N, k)
        from scipy.interpolate import CubicSpline

        later = y.copy()
        for column, place in self._late_outputs.items():
            curve = CubicSpline(record.time, y[:, column])
            later[:, column] = curve(_earlier(record, theta[place]))
        return later

    def _delay_slopes(
        self, record: Record, theta: np.ndarray, y: np.ndarray, slopes: np.ndarray
    ) -> None:
        """Shift the sensitivities by the delays, and enter those to the delays, in place."""
        # theta (p,), y (N, k), slopes (N, k, p + n)
        from scipy.interpolate import CubicSpline

        for column, place in self._late_outputs.items():
            at = _earlier(record, theta[place])
            slopes[:, column] = CubicSpline(record.time, slopes[:, column])(at)
            slopes[:, column, place] = -CubicSpline(record.time, y[:, column])(at, 1)

    # Simulation.

    def refuse_other_time(self, record: Record, start: np.ndarray, theta: np.ndarray) -> None:
        """Raise BadInputError if the sampling intervals are too long for a time in seconds.

        The limit is `_FAR_TOO_LONG` time constants of the fastest mode at the initial state.

        start: initial state, (n,)
        theta: unknowns, (p,)
        """
        longest = float(np.diff(record.time).max())
        fastest = self._fastest(record, start, theta)
        if longest * fastest > _FAR_TOO_LONG:
            raise BadInputError(
                f"{record.name}: samples are up to {longest:g} s apart, but the fastest mode of "
                f"the model has a time constant of {1.0 / fastest:.2g} s; give the time in s, or "
                'name its column in a CSV file "time [ms]"'
            )

    def steps_between(
        self, record: Record, start: np.ndarray, theta: np.ndarray, step: float = STEP
    ) -> int:
        """Return the number of integration steps between two samples, at most `_MOST_STEPS`.

        start: initial state, (n,)
        theta: unknowns, (p,)
        step: largest step, in time constants of the fastest mode at the initial state
        """
        longest = float(np.diff(record.time).max())
        steps = math.ceil(longest * self._fastest(record, start, theta) / step)
        return int(np.clip(steps, 1, _MOST_STEPS))

    def samples_in_step(self, record: Record, start: np.ndarray, theta: np.ndarray) -> int:
        """Return the number of sampling intervals within the longest integration step, at least 1.

        The longest step is `ROUGH_STEP` time constants of the fastest mode at the initial state.

        start: initial state, (n,)
        theta: unknowns, (p,)
        """
        usual = float(np.median(np.diff(record.time)))
        fastest = self._fastest(record, start, theta)
        return max(1, int(ROUGH_STEP / max(usual * fastest, 1e-3)))

    def _fastest(self, record: Record, start: np.ndarray, theta: np.ndarray) -> float:
        """Return the largest magnitude of an eigenvalue of ∂f/∂x at the initial state, 1/s."""
        # The result is 0 if the Jacobian is not finite.
        # start (n,), theta (p,)
        driven, rest = self._driven(record.part(0, 2), theta)
        _, slopes = self._rates_at(start[None], driven[:1], rest[None])
        slope = slopes[0, :, : len(start)]
        if not np.isfinite(slope).all():
            return 0.0
        return spectral_radius(slope)

    def simulated(
        self, record: Record, start: np.ndarray, theta: np.ndarray, step: float = STEP
    ) -> Simulation:
        """Return the simulation of a record.

        start: initial state, (n,)
        theta: unknowns, (p,)
        step: largest integration step, in time constants of the fastest mode

        Raises FloatingPointError if the simulation is not finite.
        """
        count = self.steps_between(record, start, theta, step)
        driven, rest = self._driven(record, theta)
        before, after, durations = grid(record, driven, count)
        states = self._states(start, before, after, durations, rest)
        y = self._outputs(states[::count], driven, rest)
        if self._late_outputs:
            y = self._delayed(record, theta, y)
        if not np.isfinite(y).all():
            raise FloatingPointError("the simulation diverges")
        inputs = before, after
        return Simulation(record, theta, y, states[::count], states[:-1], inputs, durations, count)

    def slopes(self, simulated: Simulation) -> np.ndarray:
        """Return the sensitivities dy/d(θ, x₀) of a simulation, (N, k, p + n).

        Raises FloatingPointError if they are not finite.
        """
        n, p, k = self.sizes
        record, theta, count = simulated.record, simulated.theta, simulated.count
        driven, rest = self._driven(record, theta)
        at_samples = simulated.at_samples
        total = np.empty((len(at_samples), k, p + n))
        samples = max(1, TOGETHER // count)
        # Sensitivities at the first sample of a part of the record.
        S = np.hstack([np.zeros((n, p)), np.eye(n)])
        with np.errstate(all="ignore"):  # results that are not finite raise an error
            for first in range(0, len(at_samples), samples):
                rows = slice(first, first + samples)
                steps = slice(first * count, (first + samples) * count)
                change = self._step_slopes(simulated, rest, steps)
                reached = carried(change, count, S)
                S = reached[-1]
                slopes = self._observed_slopes(at_samples[rows], driven[rows], rest)
                total[rows] = slopes[:, :, :n] @ reached[: len(slopes)]
                total[rows, :, :p] += slopes[:, :, n:]
        if not np.isfinite(total).all():
            raise FloatingPointError("the simulation diverges")
        if self._late_outputs:
            y = self._outputs(at_samples, driven, rest)
            self._delay_slopes(record, theta, y, total)
        return total

    def of(self, record: Record, start: np.ndarray, theta: np.ndarray) -> Response:
        """Return the simulated quantities of a record with their sensitivities.

        start: initial state, (n,)
        theta: unknowns, (p,)

        Raises FloatingPointError if the simulation or a sensitivity is not finite.
        """
        simulated = self.simulated(record, start, theta)
        return Response(simulated.y, self.slopes(simulated))

    def _states(
        self,
        start: np.ndarray,
        before: np.ndarray,
        after: np.ndarray,
        durations: np.ndarray,
        theta: np.ndarray,
    ) -> np.ndarray:
        """Return the states before the first and after each integration step, (steps + 1, n)."""
        # Raises FloatingPointError if a state is not finite.
        # before, after (steps, m), durations (steps,), theta (p,)
        advance = self._advance(len(durations))
        unknowns = np.tile(theta, len(durations))
        (moved,) = advance.at(start, before.ravel(), after.ravel(), unknowns, durations)
        states = np.vstack([start, moved.reshape(len(durations), -1)])
        if not np.isfinite(states).all():
            raise FloatingPointError("the simulation diverges")
        return states

    def _advance(self, steps: int) -> BoundFunction:
        """Return the function from a state to the states after several integration steps."""
        if steps not in self._advances:
            self._advances[steps] = BoundFunction(self._step.mapaccum(steps))
        return self._advances[steps]

    def _step_slopes(self, simulated: Simulation, theta: np.ndarray, part: slice) -> np.ndarray:
        """Return the derivatives of the states after each integration step, (steps, n, n + p)."""
        # The derivatives are with respect to the states before the step and to θ.
        # theta (p,)
        n, _, _ = self.sizes
        before, after = (inputs[part] for inputs in simulated.inputs)
        durations = simulated.durations[part]
        states = simulated.begins[part]
        middle = 0.5 * (before + after)
        thetas = np.tile(theta, (len(states), 1))
        diagonal = np.arange(n)
        rates, growth = self._rates_at(states, before, thetas)
        total = growth.copy()
        for held, share, weight in ((middle, 0.5, 2.0), (middle, 0.5, 2.0), (after, 1.0, 1.0)):
            ahead = share * durations[:, None]
            within = ahead[:, :, None] * growth
            within[:, diagonal, diagonal] += 1.0
            rates, slopes = self._rates_at(states + ahead * rates, held, thetas)
            growth = slopes[:, :, :n] @ within
            growth[:, :, n:] += slopes[:, :, n:]
            total += np.multiply(weight, growth, out=within)
        total *= durations[:, None, None] / 6.0
        total[:, diagonal, diagonal] += 1.0
        return total

    def _rates_at(
        self, states: np.ndarray, inputs: np.ndarray, thetas: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the state derivatives x' (N, n), and dx'/d(x, θ) (N, n, n + p)."""
        # states (N, n), inputs (N, m), thetas (N, p)
        n, p, _ = self.sizes
        rates, slopes = self._rates(states, inputs, thetas)
        return rates, slopes.reshape(-1, n, n + p)

    def _outputs(self, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Return the measured quantities without delays, (N, k)."""
        # states (N, n), inputs (N, m), theta (p,)
        return self._seen(states, inputs, np.tile(theta, (len(states), 1)))[0]

    def _observed_slopes(
        self, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray
    ) -> np.ndarray:
        """Return the derivatives of the measured quantities by x and θ, (N, k, n + p)."""
        # states (N, n), inputs (N, m), theta (p,)
        n, p, k = self.sizes
        (slopes,) = self._seen_slopes(states, inputs, np.tile(theta, (len(states), 1)))
        return slopes.reshape(-1, k, n + p)


def _earlier(record: Record, delay: float) -> np.ndarray:
    """Return the times of a record minus a delay, clipped to the duration of the record, (N,)."""
    return np.clip(record.time - delay, record.time[0], record.time[-1])


def grid(
    record: Record, driven: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the inputs at the start and at the end of each integration step, and its duration.

    The shapes are (steps, m), (steps, m) and (steps,). Durations are in s.

    driven: inputs at the samples, (N, m)
    count: steps between two samples
    """
    durations = np.repeat(np.diff(record.time) / count, count)
    if record.has_steps:
        held = np.repeat(driven[:-1], count, axis=0)
        return held, held, durations
    rise = np.diff(driven, axis=0)[:, None, :]
    part = (np.arange(count + 1) / count)[None, :, None]
    ramps = driven[:-1, None, :] + part * rise
    m = driven.shape[1]
    return ramps[:, :-1].reshape(-1, m), ramps[:, 1:].reshape(-1, m), durations


def carried(change: np.ndarray, count: int, S: np.ndarray) -> np.ndarray:
    """Return sensitivities of the states to θ and x₀ at every `count`-th step, (N + 1, n, p + n).

    The first entry is S itself.

    change: derivatives of the states after a step with respect to the states before it and to θ,
        (steps, n, n + p)
    S: sensitivities before the first step, (n, p + n)
    """
    n = change.shape[1]
    p = change.shape[2] - n
    reached = [S]
    for number, of_step in enumerate(change, start=1):
        S = of_step[:, :n] @ S
        S[:, :p] += of_step[:, n:]
        if number % count == 0:
            reached.append(S)
    return np.array(reached)
