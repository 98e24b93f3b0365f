"""Model of the aircraft over holds of its inputs, in nominal units, as machine code."""

from __future__ import annotations

from functools import cached_property
from itertools import groupby
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import rk4
from hfa_flight.plan.scaled import ScaledProblem, hold_of
from hfa_flight.plan.smooth import smooth_rates
from hfa_support.native.bound import BoundFunction
from hfa_support.native.row_code import machine_code
from trim.linear.delays import acting_commands, in_samples

#: Largest error of the fastest mode over a hold, x^5 / 120 for each Runge-Kutta step of x time
#: constants. The gradient of a plan at the trim is then exact to 1e-5.
_LARGEST_ERROR = 2.5e-6


class HeldModel:
    """Smooth equations z' = f(z, v) over successive holds of v, in nominal units.

    z (n,) are the followed states and v (m,) the moving inputs. S (n, n + m) are the derivatives of
    z by the states and inputs at the start of a hold.

    scaled: the problem in nominal units
    holds: durations of the holds, s, (N,), or the largest ones, if calls give others
    """

    def __init__(self, scaled: ScaledProblem, holds: np.ndarray) -> None:
        self.scaled = scaled
        self.holds = holds
        self._rates = smooth_rates(scaled.problem)

    def __reduce__(self) -> tuple[type[HeldModel], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return HeldModel, (self.scaled, self.holds)

    @cached_property
    def _steps_of_holds(self) -> list[int]:
        """Number of Runge-Kutta steps in each hold."""
        # With c time constants in a hold, N steps have the error N (c/N)^5 / 120 = _LARGEST_ERROR.
        time_constants = self.holds * self.scaled.fastest
        steps = np.ceil((time_constants**5 / (120.0 * _LARGEST_ERROR)) ** 0.25)
        return np.maximum(1, steps).astype(int).tolist()

    @cached_property
    def slopes(self) -> ca.Function:
        """Function (z, v) -> rates, and their derivatives by (z, v)."""
        _, n, m = self.scaled.counts
        z_and_v = ca.SX.sym("z_and_v", n + m)
        rates = self._rates(z_and_v)
        slopes = ca.densify(ca.jacobian(rates, z_and_v))
        return ca.Function("slopes", [z_and_v], [rates, slopes], {"cse": True})

    @cached_property
    def _step(self) -> ca.Function:
        """Function (z, v, h) -> z after one Runge-Kutta step of h seconds."""
        z, v, h = self._symbols()
        after = rk4(lambda x, _: self._rates(ca.vertcat(x, v)), z, h)
        return ca.Function("step", [z, v, h], [after])

    @cached_property
    def _step_slopes(self) -> ca.Function:
        """Function ([z, S], v, h) -> [z, S] after one Runge-Kutta step."""
        _, v, h = self._symbols()
        _, n, m = self.scaled.counts
        columns = ca.MX.sym("columns", n, 1 + n + m)

        def rates(columns: Any, _: float) -> Any:
            """Return the rates of z and S: f, and ∂f/∂z S + [0 ∂f/∂v]."""
            rate, jacobian = self.slopes(ca.vertcat(columns[:, 0], v))
            of_inputs = ca.horzcat(ca.DM.zeros(n, n), jacobian[:, n:])
            return ca.horzcat(rate, jacobian[:, :n] @ columns[:, 1:] + of_inputs)

        after = ca.densify(rk4(rates, columns, h))
        return ca.Function("step_slopes", [columns, v, h], [after])

    def _held(self, step: ca.Function, count: int) -> ca.Function:
        """Return the function (z or [z, S], v, seconds) -> z or [z, S] after a hold.

        step: function of one step, `_step` or `_step_slopes`
        count: number of steps in the hold
        """
        begin = ca.MX.sym("begin", *step.size_in(0))
        _, v, seconds = self._symbols()
        repeated = (ca.repmat(column, 1, count) for column in (v, seconds / count))
        after = step.fold(count)(begin, *repeated)
        return ca.Function(f"{step.name()}_{count}", [begin, v, seconds], [after])

    def _symbols(self) -> list[ca.MX]:
        """Return new symbols of states (n,), inputs (m,) and a duration, s."""
        _, n, m = self.scaled.counts
        return [*map(ca.MX.sym, ("z", "v", "seconds"), (n, m, 1))]

    @cached_property
    def _flown(self) -> BoundFunction:
        """Machine code of (z, v (m, N)) -> states after each hold, (n, N)."""
        _, n, m = self.scaled.counts
        start, inputs = ca.MX.sym("start", n), ca.MX.sym("inputs", m, len(self.holds))
        seconds = ca.DM(self.holds).T
        last, nodes = start, []
        for steps, run in self._runs():
            flown = self._held(self._step, steps).mapaccum(len(run))
            nodes.append(flown(last, inputs[:, run], seconds[:, run]))
            last = nodes[-1][:, -1]
        function = ca.Function("flown", [start, inputs], [ca.horzcat(*nodes)])
        return BoundFunction(machine_code(function))

    @cached_property
    def _slopes(self) -> BoundFunction:
        """Machine code of (z (n, N), v (m, N), seconds) -> [z, S] after each hold, side by side."""
        _, n, m = self.scaled.counts
        count = len(self.holds)
        before = ca.MX.sym("before", n, count)
        inputs = ca.MX.sym("inputs", m, count)
        seconds = ca.MX.sym("seconds", 1, count)
        slopes = []
        for steps, run in self._runs():
            held = self._held_slopes(steps).map(len(run))
            slopes.append(held(before[:, run], inputs[:, run], seconds[:, run]))
        function = ca.Function("slopes", [before, inputs, seconds], [ca.horzcat(*slopes)])
        return BoundFunction(machine_code(function))

    def _held_slopes(self, count: int) -> ca.Function:
        """Return the function (z, v, seconds) -> [z, S] (n, 1 + n + m) after `count` steps."""
        z, v, seconds = self._symbols()
        _, n, m = self.scaled.counts
        begin = ca.horzcat(z, ca.DM.eye(n), ca.DM.zeros(n, m))
        after = self._held(self._step_slopes, count)(begin, v, seconds)
        return ca.Function(f"slopes_{count}", [z, v, seconds], [ca.densify(after)])

    def _runs(self) -> list[tuple[int, list[int]]]:
        """Return the runs of successive holds with equal numbers of Runge-Kutta steps: this number,
        and the indices of the holds.
        """
        steps = self._steps_of_holds
        return [(same, list(run)) for same, run in groupby(range(len(steps)), steps.__getitem__)]

    @cached_property
    def sample(self) -> ca.Function:
        """Function (z, v, seconds) -> z after a hold that is not longer than the first one."""
        return self._held(self._step, self._steps_of_holds[0])

    @cached_property
    def _sample_code(self) -> BoundFunction:
        """Machine code of `sample`."""
        return BoundFunction(machine_code(self.sample))

    def after(self, z: np.ndarray, v: np.ndarray, seconds: float) -> np.ndarray:
        """Return the states after a hold, (n,), with the integration steps of the first hold.

        seconds: duration of the hold, at most that of the first one, for which the steps suffice
        """
        (moved,) = self._sample_code.at(z, v, seconds)
        return moved

    def flown(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the states at the ends of the holds, (N + 1, n), the initial states first.

        z: initial states, (n,)
        v: inputs during the holds, (N, m)
        """
        (after,) = self._flown.at(z, v.ravel())
        return np.vstack([z[None], after.reshape(len(v), -1)])

    def moved_along(
        self, z: np.ndarray, v: np.ndarray, seconds: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each hold, (N, n), and their derivatives by those before it and
        by the inputs, (N, n, n + m).

        z: states before each hold, (N, n)
        v: inputs during the holds, (N, m)
        seconds: durations of the holds, s, (N,), by default the largest
        """
        lengths = self.holds if seconds is None else seconds
        (columns,) = self._slopes.at(z.ravel(), v.ravel(), lengths)
        # CasADi stores the columns one after the other: of each hold z, then those of S.
        after = columns.reshape(len(v), -1, z.shape[1]).transpose(0, 2, 1)
        return after[:, :, 0], after[:, :, 1:]


#: Fraction of the distance from trim to limit within which the next state must stay.
WITHIN = 0.96
#: Largest number of Newton steps.
_NEWTON_STEPS = 4


class NearestInputs:
    """Inputs nearest to those of one sample, with which some states are within their limits next.

    The states are those that the inputs can move by a tenth of the range in one sample, such as a
    pitch rate. The change is least in fractions of the inputs' ranges.

    The states have the indices `_kept` and the limits `_limits`.

    scaled: the problem in nominal units
    dt: sample time, s
    within: fraction of the distances from trim to limits that the next states keep
    """

    def __init__(self, scaled: ScaledProblem, dt: float, within: float = WITHIN) -> None:
        self.model = HeldModel(scaled, np.array([dt]))
        k = scaled.counts.linear
        lowest, highest = scaled.input_limits
        below, above = (limit[:k] for limit in scaled.state_limits)
        ranges = 0.5 * (highest - lowest)
        self._kept = np.flatnonzero(scaled.reached(dt))
        self._within = within
        self._limits = within * below[self._kept], within * above[self._kept]
        #: Squares of the inputs' ranges, which weigh their changes.
        self._squared_ranges = np.where(np.isfinite(ranges), ranges, 1.0) ** 2

    def __reduce__(self) -> tuple[type[NearestInputs], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return NearestInputs, (self.model.scaled, float(self.model.holds[0]), self._within)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states whose limits are kept."""
        return tuple(self.model.scaled.problem.states[place] for place in self._kept)

    def __call__(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return v itself if the next states stay within the limits, else the nearest such inputs.

        z: states, (n,)
        v: inputs, (m,)
        """
        lowest, highest = self.model.scaled.input_limits
        n = len(z)
        for _ in range(_NEWTON_STEPS):
            after, slopes = self.model.moved_along(z[None], v[None])
            kept = after[0, self._kept]
            excess = kept - np.clip(kept, *self._limits)
            if not np.any(excess):
                return v
            v = np.clip(v, lowest, highest)
            # Of each state in turn, the least change of the inputs that removes its excess: they
            # move against `beyond * by_inputs`, except those that are at the limit on that side.
            for by_inputs, beyond in zip(slopes[0, self._kept, n:], excess, strict=True):
                can_move = np.where(beyond * by_inputs > 0.0, v > lowest, v < highest)
                direction = self._squared_ranges * by_inputs * can_move
                if direction @ by_inputs > 0.0:
                    v = v - direction * beyond / (direction @ by_inputs)
                    v = np.clip(v, lowest, highest)
        return v


#: Largest difference of a sample from its prediction: share of the usual box, and share of what the
#: inputs move in one sample. Ordinary sensor noise has standard deviations of 2 to 4 % of the box.
_SHARE_OF_BOX = 0.3
_SHARE_OF_MOVES = 0.1
#: Least box of a state, nominal values.
_LEAST_BOX = 0.1


class Measured:
    """Samples of a flight: states when the next command acts, predicted from the measured ones.

    The command of a sample acts from the delay after this sample until the next command acts.
    Before the first command, the inputs are at trim.

    A sample is wrong if a value is not finite, or differs from its prediction by more than an
    aircraft plausibly moves in one sample without a known reason. Its prediction from the sample
    before is used instead. A second sample that agrees with the prediction from a first wrong one
    is used: the aircraft has been moved.

    model: the model, whose first hold is a sample
    delay: time from a sample until its command acts, s
    wrong_count: number of wrong samples of the flight
    """

    def __init__(self, model: HeldModel, delay: float) -> None:
        k, n, _ = model.scaled.counts
        self._model = model
        self._delay = delay
        self._dt = float(model.holds[0])
        lowest, highest = model.scaled.input_limits
        ranges = np.where(np.isfinite(highest - lowest), highest - lowest, 1.0)
        moved = np.abs(hold_of(*model.scaled.linear_states, self._dt).B) @ ranges
        box = np.maximum(model.scaled.box, _LEAST_BOX)
        #: Largest difference of a sample from its prediction, (n,). It is a nominal value for
        #: carried states, which have no box.
        self._largest_difference = np.append(
            _SHARE_OF_BOX * box + _SHARE_OF_MOVES * moved, np.ones(n - k)
        )
        self.wrong_count = 0
        #: Commands that may act yet, (m,) each, and number of all commands of the flight.
        self._commands: list[np.ndarray] = []
        self._command_count = 0
        #: States of the last sample: the used ones, then those that were measured in doubt.
        self._last_states: list[np.ndarray] = []

    def checked(self, z: np.ndarray) -> np.ndarray | None:
        """Return the states of this sample, or their prediction if it is wrong, (n,).

        The result is None if the sample is wrong and no sample before predicts it. A wrong but
        finite z is kept as a second hypothesis, from which the next sample is predicted too.

        z: measured states, (n,)
        """
        acting = self._acting(self._command_count - 1, self._dt)  # since the sample before
        predictions = [self._moved(states, acting) for states in self._last_states]
        agrees = [
            bool((np.abs(z - states) <= self._largest_difference).all()) for states in predictions
        ]
        used: np.ndarray | None = z
        if not np.isfinite(z).all() or (predictions and not any(agrees)):
            self.wrong_count += 1
            used = predictions[0] if predictions else None
        hypotheses = (used,) if used is z else (used, z)
        self._last_states = [x for x in hypotheses if x is not None and np.isfinite(x).all()]
        return used

    def when_acting(self, z: np.ndarray) -> np.ndarray:
        """Return the states when the command of this sample acts, (n,), from those now."""
        return self._moved(z, self._acting(self._command_count, self._delay))

    def command(self, v: np.ndarray) -> None:
        """Add the command of this sample, (m,), and forget those that have acted before it."""
        whole = in_samples(self._delay, self._dt).whole  # samples of the delay
        # The oldest command that still acts is that of `whole` + 1 samples before this one.
        self._commands = [*self._commands, v][-whole - 2 :]
        self._command_count += 1

    def _acting(self, sample: int, seconds: float) -> list[tuple[np.ndarray, float]]:
        """Return the inputs that act in some seconds after a sample, each with its duration, s."""
        acting = acting_commands(self._delay, self._dt, seconds)
        return [(self._command(sample - since), duration) for since, duration in acting]

    def _command(self, number: int) -> np.ndarray:
        """Return the command of a sample, 0 before the flight, (m,)."""
        if number < 0:
            return np.zeros(self._model.scaled.counts.inputs)
        # The last entry is the command of sample `_command_count` - 1; the index is negative.
        return self._commands[number - self._command_count]

    def _moved(self, z: np.ndarray, acting: list[tuple[np.ndarray, float]]) -> np.ndarray:
        """Return the states z after inputs that act in turn, each with its duration, (n,)."""
        for v, seconds in acting:
            z = self._model.after(z, v, seconds)
        return z


def wrong_samples_note(count: int) -> list[str]:
    """Return the sentence on the wrong samples of a flight, or nothing without one."""
    if not count:
        return []
    return [f"{count} samples were not finite or impossible: the prediction was used."]
