"""One-step predictions of a model in turbulence, with their exact sensitivities (filter error).

White noise drives the speed and the flow angles, and rotates the air (`rotating_air.py`). Gusts are
random walks. These approximate Dryden turbulence below its scale length. At each sample a
steady-state gain K corrects the states to x + K (z - y) (`filter_gain.py`). Between samples the
states advance as in `response.py`. The first unknowns are the logarithms of the turbulence and of
the sensor noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_identify.filter_gain import Gain, GainSlopes, gain_with_slopes
from hfa_identify.records import Record
from hfa_identify.response import STEP, TOGETHER, Responses, Simulation, carried, grid
from hfa_identify.rotating_air import BEGIN, LAG, LIMITS, in_rotating_air, rotations_of
from hfa_identify.search import begin_of
from hfa_identify.sensors import SensorError
from hfa_support.errors import BadInputError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code

#: Initial turbulence of the search: change of the speed in 1 s relative to the speed, and changes
#: of other states, rad.
_BEGIN = 0.02
_BEGIN_OF = {"alpha": 0.02, "beta": 0.02, "gust_roll": 0.02}
#: Largest change of the logarithms of turbulence and sensor noise during the search.
_WIDEST = 9.0


@dataclass(frozen=True, eq=False)
class Condition:
    """Flight condition at which the filter gain is computed, and initial values of the search.

    state: states, (n,).
    inputs: inputs, (m,).
    interval: time between samples, s.
    turbulence: disturbed state -> standard deviation of its random change in 1 s.
    noise: measured quantity -> standard deviation of its sensor noise.
    """

    state: np.ndarray
    inputs: np.ndarray
    interval: float
    turbulence: Mapping[str, float]
    noise: Mapping[str, float]

    @classmethod
    def of(
        cls,
        model: Model,
        records: Sequence[Record],
        measured: Sequence[str],
        held: Mapping[str, float],
    ) -> Condition:
        """Return the mean condition at the records' first samples and a guess of the noise.

        measured: names of the measured quantities
        held: input or state without a column -> value

        Raises BadInputError if the model has no state that turbulence disturbs.
        """
        state = np.mean([begin_of(model, record, held) for record in records], axis=0)
        speed = dict(zip(model.states, state.tolist(), strict=True)).get("speed", 1.0)
        sizes = {"speed": _BEGIN * speed, **_BEGIN_OF}
        moved = in_rotating_air(model).states
        turbulence = {name: size for name, size in sizes.items() if name in moved}
        if not turbulence:
            raise BadInputError(
                f"{model.name} has none of the states {', '.join(sizes)}, which turbulence "
                "disturbs; remove turbulence"
            )
        return cls(
            state,
            np.mean([record.inputs[0] for record in records], axis=0),
            float(np.median(np.concatenate([np.diff(record.time) for record in records]))),
            turbulence,
            {name: _sensor_noise(model, records, name) for name in measured},
        )


def _sensor_noise(model: Model, records: Sequence[Record], name: str) -> float:
    """Return the standard deviation of a sensor's noise, computed from second differences."""
    differences = []
    for record in records:
        values = record.measured.get(name, np.empty(0))
        differences.append(np.diff(values[np.isfinite(values)], 2))
    spread = float(np.sqrt(np.mean(np.concatenate(differences) ** 2) / 6.0))
    return max(spread, 1e-6 * model.signals[name].nominal)


@dataclass(frozen=True, eq=False)
class Prediction(Simulation):
    """One-step predictions of a record.

    y: predicted quantities, (N, k). Each is predicted from all earlier samples and from the
        preceding quantities in the same sample.
    innovations: measured values minus predictions from earlier samples alone, (N, k), 0 for a
        missing sample.
    present: 1 for a measured sample, 0 for a missing one, (N, k).
    """

    innovations: np.ndarray
    present: np.ndarray


class Predictions(Responses):
    """Predictor from sample to sample with a steady-state filter gain.

    The unknowns are, in this order, the turbulence, the sensor noise, the lag of the air's rotation
    if the air rotates, and the free parameters and column errors.

    Raises BadInputError if the delay of a measured quantity is free.
    """

    # A controller reacts to gusts, so that the next sample of an input depends on the innovation.
    _looks_ahead = False

    def __init__(
        self, model: Model, free: Sequence[str], measured: Sequence[str], condition: Condition
    ) -> None:
        self.condition = condition
        self._still = model
        in_gusts = in_rotating_air(model)
        names = [f"turbulence_{name}" for name in condition.turbulence]
        names += [f"noise_{name}" for name in condition.noise]
        if in_gusts is not model:
            names.append(LAG)
        self._turbulent = len(names)
        super().__init__(in_gusts, (*names, *free), measured)
        self._moves = _moved_states(in_gusts, tuple(condition.turbulence))
        if self._late_outputs:
            name = self.free[next(iter(self._late_outputs.values()))]
            raise BadInputError(
                f"{name} cannot be free with turbulence, which is estimated from sample to "
                "sample; shift the column, or remove turbulence"
            )
        self._gains: tuple[bytes, Gain, GainSlopes] | None = None
        self._update = self._correction()

    @property
    def turbulent(self) -> int:
        """Number of leading unknowns that describe turbulence and sensor noise."""
        return self._turbulent

    @cached_property
    def calm(self) -> Responses:
        """Simulation in calm air, without the unknowns of turbulence and sensor noise."""
        return Responses(self._still, self.free[self.calm_part], self.measured)

    def wider(self, names: Sequence[str]) -> Predictions:
        """Return the predictor with additional unknowns: parameters or column errors."""
        free = (*self.free[self.calm_part], *names)
        return Predictions(self._still, free, self.measured, self.condition)

    def has_error(self, error: SensorError) -> bool:
        """Return whether a column error can be an unknown. Delays of measured quantities cannot."""
        return error.kind != "delay" or error.column in self.model.inputs

    def compile(self) -> None:
        """Compile derivatives, integration steps and corrections, if a C compiler is available."""
        super().compile()
        self._update = machine_code(self._update)

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Unknown -> its unit, limits and value at the start of the search."""
        sizes = [*self.condition.turbulence.values(), *self.condition.noise.values()]
        signals = {
            name: Signal("1", 1.0, start - _WIDEST, start + _WIDEST, start)
            for name, start in zip(self.free, np.log(sizes).tolist(), strict=False)
        }
        if self.turbulent > len(sizes):
            least, most = map(math.log, LIMITS)
            signals[LAG] = Signal("1", 1.0, least, most, math.log(BEGIN))
        return signals | self.calm.signals

    # Filter gain.

    def variances(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the variances of the innovations and the derivatives of their logarithms.

        The shapes are (k,) and (k, p).
        """
        gain, slopes = self._gain(theta)
        return gain.variances, slopes.logarithms

    def _gain(self, theta: np.ndarray) -> tuple[Gain, GainSlopes]:
        """Return the Kalman gain at the mean flight condition of the records."""
        # The derivatives of the gain with respect to the unknowns are also returned.
        # theta (p,)
        key = theta.tobytes()
        if self._gains is None or self._gains[0] != key:
            sizes = np.array([each.nominal for each in self.signals.values()])
            part = self.calm_part
            sizes[part] = np.maximum(np.abs(theta[part]), 1e-2 * sizes[part])
            found = gain_with_slopes(self._linear, theta, sizes, self.condition.interval)
            self._gains = (key, *found)
        return self._gains[1:]

    def _linear(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the matrices A, C, W and the vector R of N linear models for the filter."""
        # A: (N, n, n) C: (N, k, n) W: power of the turbulence, (N, n, n) R: variances of the sensor
        # noise, (N, k)
        # theta (N, p)
        n, p, k = self.sizes
        count = len(theta)
        states = np.zeros((count, n))
        states[:, : len(self.condition.state)] = self.condition.state
        inputs = np.zeros((count, self._step.numel_in(1)))
        inputs[:, : len(self.condition.inputs)] = self.condition.inputs
        _, slopes = self._rates(states, inputs, theta)
        A = slopes.reshape(count, n, n + p)[:, :, :n]
        (seen,) = self._seen_slopes(states, inputs, theta)
        C = seen.reshape(count, k, n + p)[:, :, :n]
        sources = len(self._moves)
        powers = np.exp(2.0 * theta[:, : sources + k])
        W = np.einsum("Ns,si,sj->Nij", powers[:, :sources], self._moves, self._moves)
        return A, C, W, powers[:, sources:]

    # Predictions.

    def _correction(self) -> ca.Function:
        """Return the function that corrects a predicted state x with the measured quantities z."""
        # The function is (x, inputs, θ, z, present, K) -> (x + K (z - y), z - y), with z - y = 0
        # for a missing sample.
        n, _, k = self.sizes
        x = ca.SX.sym("x", n)
        u = ca.SX.sym("u", self._step.numel_in(1))
        theta = ca.SX.sym("theta", len(self.free))
        z = ca.SX.sym("z", k)
        present = ca.SX.sym("present", k)
        K = ca.SX.sym("K", n, k)
        innovation = present * (z - self._seen.function(x, u, theta))
        corrected = x + ca.mtimes(K, innovation)
        arguments = [x, u, theta, z, present, K]
        return ca.Function("correction", arguments, [ca.densify(corrected), ca.densify(innovation)])

    def _advance_samples(self, count: int, intervals: int) -> ca.Function:
        """Return a function that advances over successive sampling intervals."""
        # Its arguments are x, the inputs at the start and at the end of the integration steps, the
        # durations of the steps, θ, z, present and K. Its results are x at the next sample, x at
        # the start of the steps, and z - y.
        n, _, k = self.sizes
        m = self._step.numel_in(1)
        x = ca.MX.sym("x", n)
        before = ca.MX.sym("before", m, count)
        after = ca.MX.sym("after", m, count)
        durations = ca.MX.sym("durations", count)
        theta = ca.MX.sym("theta", len(self.free))
        z = ca.MX.sym("z", k)
        present = ca.MX.sym("present", k)
        K = ca.MX.sym("K", n, k)
        moved, innovation = self._update(x, before[:, 0], theta, z, present, K)
        begins = []
        for step in range(count):
            begins.append(moved)
            moved = self._step(moved, before[:, step], after[:, step], theta, durations[step])
        arguments = [x, before, after, durations, theta, z, present, K]
        one = ca.Function("interval", arguments, [moved, ca.horzcat(*begins), innovation])
        return one.mapaccum(intervals)

    def simulated(
        self, record: Record, start: np.ndarray, theta: np.ndarray, step: float = STEP
    ) -> Prediction:
        """Return the predictions of a record.

        start: state before the first sample, (n,)
        theta: unknowns, (p,)
        step: largest integration step, in time constants of the fastest mode

        Raises FloatingPointError if a prediction is not finite.
        """
        gain, _ = self._gain(theta)
        count = self.steps_between(record, start, theta, step)
        driven, rest = self._driven(record, theta)
        before, after, durations = grid(record, driven, count)
        table = record.table(self.measured)
        present = np.isfinite(table)
        z = np.where(present, table, 0.0)
        intervals = len(record.time) - 1
        key = (count, intervals)
        if key not in self._advances:
            self._advances[key] = BoundFunction(self._advance_samples(*key))
        moved, begins, _ = self._advances[key].at(
            start,
            before.ravel(),
            after.ravel(),
            durations,
            np.tile(rest, intervals),
            z[:-1].ravel(),
            present[:-1].ravel(),
            np.tile(gain.K.T.ravel(), intervals),
        )
        at_samples = np.vstack([start, moved.reshape(intervals, -1)])
        innovations = np.where(present, z - self._outputs(at_samples, driven, rest), 0.0)
        if not np.isfinite(innovations).all():
            raise FloatingPointError("the simulation diverges")
        return Prediction(
            record,
            theta,
            z - innovations @ gain.whiten.T,
            at_samples,
            begins.reshape(intervals * count, -1),
            (before, after),
            durations,
            count,
            innovations,
            present.astype(float),
        )

    def slopes(self, simulated: Simulation) -> np.ndarray:
        """Return the sensitivities dy/d(θ, x₀) of predictions, (N, k, p + n).

        Raises FloatingPointError if a sensitivity is not finite.
        """
        assert isinstance(simulated, Prediction)  # what `simulated` of this class returns
        n, p, k = self.sizes
        driven, rest = self._driven(simulated.record, simulated.theta)
        gain, by_theta = self._gain(simulated.theta)
        count = simulated.count
        at_samples = simulated.at_samples
        total = np.empty((len(at_samples), k, p + n))
        samples = max(1, TOGETHER // count)
        S = np.hstack([np.zeros((n, p)), np.eye(n)])
        with np.errstate(all="ignore"):  # results that are not finite raise an error
            for first in range(0, len(at_samples), samples):
                rows = slice(first, first + samples)
                seen = self._observed_slopes(at_samples[rows], driven[rows], rest)
                present = simulated.present[rows]
                innovations = simulated.innovations[rows]
                steps = slice(first * count, (first + samples) * count)
                change = _over_intervals(self._step_slopes(simulated, rest, steps), count)
                corrected = -gain.K @ (seen * present[:, :, None])
                corrected[:, :, :n] += np.eye(n)
                corrected[:, :, n:] += np.einsum("nkp,Nk->Nnp", by_theta.K, innovations)
                corrected = corrected[: len(change)]
                moved = change[:, :, :n] @ corrected
                moved[:, :, n:] += change[:, :, n:]
                reached = carried(moved, 1, S)
                S = reached[-1]
                slopes = seen[:, :, :n] @ reached[: len(seen)]
                slopes[:, :, :p] += seen[:, :, n:]
                slopes *= present[:, :, None]
                slopes = gain.whiten @ slopes
                slopes[:, :, :p] -= np.einsum("jkp,Nk->Njp", by_theta.whiten, innovations)
                total[rows] = slopes
        if not np.isfinite(total).all():
            raise FloatingPointError("the simulation diverges")
        return total


def _moved_states(model: Model, sources: Sequence[str]) -> np.ndarray:
    """Return a table (sources, n), 1 where a source of white noise drives a state, else 0."""
    # A noise drives the state of its name, and the rotation of the air that follows this state.
    states = list(model.states)
    moves = np.zeros((len(sources), len(states)))
    for row, name in zip(moves, sources, strict=True):
        row[states.index(name)] = 1.0
        for each in rotations_of(model).values():
            if each.of == name:
                row[states.index(each.state)] = 1.0
    return moves


def _over_intervals(change: np.ndarray, count: int) -> np.ndarray:
    """Return sensitivities over intervals of `count` integration steps, (N, n, n + p)."""
    # The derivatives are with respect to the states before the interval and to θ.
    # change (N count, n, n + p)
    n = change.shape[1]
    total = change[::count]
    for step in range(1, count):
        part = change[step::count]
        moved = part[:, :, :n] @ total
        moved[:, :, n:] += part[:, :, n:]
        total = moved
    return total
