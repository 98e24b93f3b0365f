"""Response of a model to the inputs of a record, with exact sensitivities.

Between samples the inputs are linear in time or constant. The classical fourth-order Runge-Kutta
method advances the states: x⁺ = Φ(x, u, u⁺, θ, Δt). The sensitivities S = dx/d(θ, x₀) advance by
S⁺ = Φ_x S + Φ_θ. θ contains parameters of the model and biases of columns (`biases`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import rk4
from hfa_aircraft.layout import column
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_identify.records import Record
from hfa_support.matrices import spectral_radius
from hfa_support.native.bound import BoundFunction, RowFunction
from hfa_support.native.row_code import machine_code


def biases(model: Model, columns: Iterable[str]) -> dict[str, str]:
    """Return the name of each column's bias, such as "bias_alpha" -> the column.

    A name that is also a parameter of the model is omitted.
    """
    named = {f"bias_{column}": column for column in columns}
    return {name: column for name, column in named.items() if name not in model.parameters}


#: Largest integration step, in time constants of the fastest mode.
STEP = 0.3
#: Largest number of integration steps between two samples.
_MOST_STEPS = 10
#: Number of integration steps whose sensitivities are computed together, so that they fit into the
#: cache.
TOGETHER = 250


class Grid(NamedTuple):
    """Integration steps of a record.

    before, after: inputs at the start and at the end of each step, (steps, m)
    durations: durations of the steps, s, (steps,)
    """

    before: np.ndarray
    after: np.ndarray
    durations: np.ndarray


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulation of a record.

    record: the record, with its times and inputs.
    theta: unknowns θ, (p,).
    y: simulated quantities, (N, k).
    at_samples: states at the samples, (N, n).
    begins: states at the start of the integration steps, (steps, n).
    grid: inputs and durations of the integration steps.
    count: number of steps between two samples.
    """

    record: Record
    theta: np.ndarray
    y: np.ndarray
    at_samples: np.ndarray
    begins: np.ndarray
    grid: Grid
    count: int


class Responses:
    """Simulation of a model with free parameters.

    model: the model. Parameters that are not free keep their values.
    free: names of the unknowns θ: parameters and biases of columns.
    measured: names of the measured states and outputs.
    """

    def __init__(self, model: Model, free: Sequence[str], measured: Sequence[str]) -> None:
        self.model = model
        self.free = tuple(free)
        self.measured = tuple(measured)
        known = biases(model, (*model.inputs, *self.measured))
        self._biases = {name: known[name] for name in self.free if name in known}
        x, u = model.layout.symbols("x", "u")
        theta = ca.SX.sym("theta", len(self.free))
        rates, recorded = self._expressions(x, u, theta)
        arguments = [x, u, theta]
        self._step = _runge_kutta_step(ca.Function("f", arguments, [rates]))
        # Number of integration steps -> function from a state to the states after these steps.
        self._advances: dict[int, BoundFunction] = {}
        of_step = self._step.sx_in()
        self._step_slopes = _slopes(of_step, self._step(*of_step), of_step[0], of_step[3])
        self._rate_slopes = _slopes(arguments, rates, x)
        self._recorded = RowFunction(ca.Function("recorded", arguments, [recorded]))
        self._recorded_slopes = _slopes(arguments, recorded, x, theta)

    def _expressions(self, x: ca.SX, u: ca.SX, theta: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the rates and the recorded quantities, of recorded inputs u and unknowns θ."""
        model = self.model
        # recorded = true + bias: subtracted from recorded inputs, added to simulated quantities
        unknowns = dict(zip(self.free, ca.vertsplit(theta), strict=True))
        bias_of = {column: unknowns[name] for name, column in self._biases.items()}
        parameters = [
            unknowns.get(name, ca.SX(signal.start)) for name, signal in model.parameters.items()
        ]
        true_inputs = [
            recorded_input - bias_of.get(name, 0.0)
            for name, recorded_input in zip(model.inputs, ca.vertsplit(u), strict=True)
        ]
        rates, true_outputs = model.layout.expressions((x, true_inputs, parameters), self.measured)
        recorded = [
            true_output + bias_of.get(name, 0.0)
            for name, true_output in zip(self.measured, ca.vertsplit(true_outputs), strict=True)
        ]
        return rates, ca.densify(column(recorded))

    def compile(self) -> None:
        """Compile integration steps and their derivatives, if a C compiler is available."""
        self._step_slopes = RowFunction(machine_code(self._step_slopes.function))
        self._step = machine_code(self._step)
        self._advances = {}

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Unknown -> its unit, limits and value at the start of the search."""
        signals = {}
        for name in self.free:
            if name in self._biases:
                declared = self.model.signals[self._biases[name]]
                signals[name] = Signal(declared.unit, declared.nominal)
            else:
                signals[name] = self.model.parameters[name]
        return signals

    def steps_between(self, record: Record, start: np.ndarray, theta: np.ndarray) -> int:
        """Return the number of integration steps between two samples, at most `_MOST_STEPS`.

        A step is at most `STEP` time constants of the fastest mode at the initial state, if its
        Jacobian is finite.

        start: initial state, (n,)
        theta: unknowns, (p,)
        """
        (slopes,) = self._rate_slopes(start[None], record.inputs[:1], theta[None])
        if not np.isfinite(slopes).all():
            return 1
        fastest = spectral_radius(slopes.reshape(len(start), -1))
        steps = math.ceil(float(np.diff(record.time).max()) * fastest / STEP)
        return int(np.clip(steps, 1, _MOST_STEPS))

    def simulated(self, record: Record, start: np.ndarray, theta: np.ndarray) -> Simulation:
        """Return the simulation of a record.

        start: initial state, (n,)
        theta: unknowns, (p,)

        Raises FloatingPointError if the simulation is not finite.
        """
        count = self.steps_between(record, start, theta)
        grid = integration_grid(record, count)
        states = self._states(start, grid, theta)
        at_samples = states[::count]
        thetas = np.tile(theta, (len(at_samples), 1))
        (y,) = self._recorded(at_samples, record.inputs, thetas)
        if not np.isfinite(y).all():
            raise FloatingPointError("the simulation diverges")
        return Simulation(
            record, theta, y, at_samples=at_samples, begins=states[:-1], grid=grid, count=count
        )

    def slopes(self, simulated: Simulation) -> np.ndarray:
        """Return the sensitivities dy/d(θ, x₀) of a simulation, (N, k, p + n)."""
        n, p, k = len(self.model.states), len(self.free), len(self.measured)
        record, theta, count = simulated.record, simulated.theta, simulated.count
        at_samples = simulated.at_samples
        total = np.empty((len(at_samples), k, p + n))
        samples = max(1, TOGETHER // count)
        # Sensitivities at the first sample of a part of the record.
        S = np.hstack([np.zeros((n, p)), np.eye(n)])
        with np.errstate(all="ignore"):  # `OutputError.normal` refuses what is not finite
            for first in range(0, len(at_samples), samples):
                rows = slice(first, first + samples)
                steps = slice(first * count, (first + samples) * count)
                before, after, durations = (columns[steps] for columns in simulated.grid)
                begins = simulated.begins[steps]
                thetas = np.tile(theta, (len(begins), 1))
                change = self._step_slopes(begins, before, after, thetas, durations[:, None])[0]
                of_states = sensitivities_at_samples(change.reshape(-1, n, n + p), count, S)
                S = of_states[-1]  # at the first sample of the next part
                samples_at = (at_samples[rows], record.inputs[rows])
                thetas = np.tile(theta, (len(samples_at[0]), 1))
                slopes = self._recorded_slopes(*samples_at, thetas)[0].reshape(-1, k, n + p)
                total[rows] = slopes[:, :, :n] @ of_states[: len(slopes)]
                total[rows, :, :p] += slopes[:, :, n:]
        return total

    def _states(self, start: np.ndarray, grid: Grid, theta: np.ndarray) -> np.ndarray:
        """Return the states before the first and after each integration step, (steps + 1, n)."""
        count = len(grid.durations)
        before, after, unknowns = grid.before.ravel(), grid.after.ravel(), np.tile(theta, count)
        (ends,) = self._advance(count).at(start, before, after, unknowns, grid.durations)
        states = np.vstack([start, ends.reshape(count, -1)])
        if not np.isfinite(states).all():
            raise FloatingPointError("the simulation diverges")
        return states

    def _advance(self, steps: int) -> BoundFunction:
        """Return the function from a state to the states after several integration steps."""
        if steps not in self._advances:
            self._advances[steps] = BoundFunction(self._step.mapaccum(steps))
        return self._advances[steps]


def _slopes(arguments: list[ca.SX], values: ca.SX, *unknowns: ca.SX) -> RowFunction:
    """Return the function from arguments to the derivatives of values by unknowns, row by row."""
    # CasADi stores matrices column by column.
    slopes = ca.densify(ca.jacobian(values, ca.vertcat(*unknowns)))
    return RowFunction(ca.Function("slopes", arguments, [ca.cse(slopes.T)]))


def _runge_kutta_step(rates: ca.Function) -> ca.Function:
    """Return Φ: (x, u, u⁺, θ, Δt) -> x⁺ of x' = rates(x, u, θ), with u linear over the step."""
    x, u, theta = rates.sx_in()
    after = ca.SX.sym("after", u.numel())
    duration = ca.SX.sym("duration")
    inputs_at = {0.0: u, 0.5: 0.5 * (u + after), 1.0: after}
    moved = rk4(lambda x, c: rates(x, inputs_at[c], theta), x, duration)
    return ca.Function("step", [x, u, after, theta, duration], ca.cse([ca.densify(moved)]))


def integration_grid(record: Record, count: int) -> Grid:
    """Return the integration steps of a record.

    count: steps between two samples
    """
    durations = np.repeat(np.diff(record.time) / count, count)
    inputs = record.inputs
    if record.has_steps:
        held = np.repeat(inputs[:-1], count, axis=0)
        return Grid(held, held, durations)
    rise = np.diff(inputs, axis=0)[:, None, :]
    part = (np.arange(count + 1) / count)[None, :, None]
    ramps = inputs[:-1, None, :] + part * rise  # (samples - 1, count + 1, m)
    m = inputs.shape[1]
    return Grid(ramps[:, :-1].reshape(-1, m), ramps[:, 1:].reshape(-1, m), durations)


def sensitivities_at_samples(change: np.ndarray, count: int, S: np.ndarray) -> np.ndarray:
    """Return sensitivities of the states to θ and x₀ after every `count`-th step, (N, n, p + n).

    The first entry is S itself. A step has S⁺ = Φ_x S + Φ_θ.

    change: derivatives of the states after a step with respect to the states before it and to θ,
        (steps, n, n + p)
    S: sensitivities before the first step, (n, p + n)
    """
    n = change.shape[1]
    p = change.shape[2] - n
    at_samples = [S]
    for number, of_step in enumerate(change, start=1):
        S = of_step[:, :n] @ S
        S[:, :p] += of_step[:, n:]
        if number % count == 0:
            at_samples.append(S)
    return np.array(at_samples)
