"""Integration of one flight with step control: the Runge-Kutta pair of Dormand and Prince."""

from __future__ import annotations

import math
import sys

import casadi as ca
import numpy as np

from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction

#: Largest error of a step, relative to the size of each state. Costs are printed with six digits.
TOLERANCE = 1e-7
#: Size of a state near 0, relative to the largest deviation so far in nominal values.
_SMALL = 1e-3
#: Errors below this are rounding, in nominal values: 1e4 units in the last place.
_ROUNDING = 1e-12
#: A step is followed by one of .9 times the length that the error allows, at least a fifth and at
#: most ten times as long. The error is of order 5.
_SAFETY, _SHORTER, _LONGER, _ORDER = 0.9, 0.2, 10.0, 5.0
#: The error of a fifth of a step over a jump is about a fifth, and over a kink a 25th.
_AT_A_JUMP = 0.1
#: Number of steps since the last `RungeKutta.clear` after which `advance` pauses first, then after
#: twice, four times, ... as many, so that a flight that has left its envelope soon ends.
_PAUSE = 100
#: Largest number of steps after `RungeKutta.clear` before a pause: a flight makes fewer in 1 s.
_PAUSE_LATER = 1600
#: Largest number of these steps, about 2 s of computation.
_MOST_STEPS = 100_000

#: Coefficients of Dormand and Prince (1980): slopes within each stage, of the state after the step,
#: of its error, and of the polynomial of Shampine (1986) in a step. Those of SciPy's RK45, whose
#: import takes longer than a flight.
_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
)
_TIMES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0)
_AFTER = (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)
_ERROR = (-71 / 57600, 0.0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40)
_POLYNOMIAL = (
    (1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799),
    (0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072),
    (0.0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632),
    (0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844),
    (0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423),
)


def step_function(rate: ca.Function, nominal: np.ndarray) -> ca.Function:
    """Return the function of one step of the integration of y' = rate(t, y, held).

      (t, y, held, h, largest before) -> (y at t + h, largest, error / allowed, error, slopes)

    The largest deviation so far and the error are in nominal values, and the allowed error of each
    state is `TOLERANCE` of its size. y + h slopes [θ θ² θ³ θ⁴]' is the state at t + θ h.

    nominal: nominal value of each entry of y, or 0 for one whose error is relative to itself
    """
    t, h, before = (ca.SX.sym(name) for name in ("t", "h", "before"))
    y, held = ca.SX.sym("y", rate.numel_in(1)), ca.SX.sym("held", rate.numel_in(2))
    k = rate(t, y, held)
    for time, stage in zip(_TIMES, _STAGES, strict=True):
        inside = y + h * ca.mtimes(k, ca.DM(stage))
        k = ca.horzcat(k, rate(t + time * h, inside, held))
    after = y + h * ca.mtimes(k, ca.DM(_AFTER))
    k = ca.horzcat(k, rate(t + h, after, held))
    error = ca.fabs(h * ca.mtimes(k, ca.DM(_ERROR)))
    size = ca.fmax(ca.fabs(y), ca.fabs(after))
    units = ca.DM(nominal)
    deviating = np.flatnonzero(nominal).tolist()
    largest = ca.fmax(before, ca.mmax(size[deviating] / units[deviating]))
    allowed = TOLERANCE * (size + _SMALL * units * largest) + _ROUNDING * units
    ratio = ca.norm_2(error / (allowed + sys.float_info.min)) / math.sqrt(y.numel())
    in_units = ca.norm_2(error[deviating] / units[deviating])
    results = (after, largest, ratio, in_units, ca.mtimes(k, ca.DM(_POLYNOMIAL)))
    return ca.Function("step", [t, y, held, h, before], [ca.densify(each) for each in results])


def _step_factor(ratio: float) -> float:
    """Return the length of the next step relative to one with a ratio of error to allowed error."""
    if ratio == 0.0:
        return _LONGER
    wanted = _SAFETY * ratio ** (-1 / _ORDER)
    return min(_LONGER, max(_SHORTER, wanted))  # _SHORTER for an error that is not a number


class _Steps:
    """Steps of an integration: the first `count` rows of arrays, which grow when they are full.

    Stored as objects, a step would take 1 µs more, a tenth of the time of a flight in turbulence.

    count: number of steps
    begins, seconds: time at which each begins, and its duration, s
    states: state at which it begins, (n,)
    slopes: coefficients of its polynomial, (4 n,), those of θ first
    """

    def __init__(self, n: int) -> None:
        self.count = 0
        self.begins, self.seconds = np.empty(_PAUSE), np.empty(_PAUSE)
        self.states, self.slopes = np.empty((_PAUSE, n)), np.empty((_PAUSE, 4 * n))

    def append(self, begin: float, seconds: float, state: np.ndarray, slopes: np.ndarray) -> None:
        """Store a step."""
        place = self.count
        if place == len(self.begins):
            self.begins, self.seconds, self.states, self.slopes = (
                np.concatenate([stored, np.empty_like(stored)])
                for stored in (self.begins, self.seconds, self.states, self.slopes)
            )
        self.begins[place] = begin
        self.seconds[place] = seconds
        self.states[place] = state
        self.slopes[place] = slopes
        self.count = place + 1


class RungeKutta:
    """Integration of one flight by steps whose estimated errors are at most `TOLERANCE`.

    A step over a jump of the rates is made although its error is larger.

    step: `step_function` of the loop
    longest: longest step, s
    shortest: step below which a jump is assumed if the error hardly decreases with the step, s
    error: sum of the errors of the steps over jumps, relative to the largest deviation at each, in
        nominal values
    """

    def __init__(self, step: BoundFunction, longest: float, shortest: float) -> None:
        self.error = 0.0
        self._largest = 0.0
        # Error of the short step that was tried last since the last step made; inf without one.
        self._error_of_short_step = math.inf
        self._function = step
        self._longest, self._shortest = longest, shortest
        self._next = longest
        self._steps = _Steps(step.inputs[1].size)
        self._pause = _PAUSE

    def advance(
        self, begin: float, end: float, y: np.ndarray, held: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return `end` and the state at it, (n,), from y at `begin`, with constant held inputs.

        After many steps, an earlier time and its state are returned, from which to advance again.

        Raises NoSolutionError if too many steps are necessary.
        """
        t, now, held_now, h, before = self._function.inputs
        after, largest, error_ratio, error, slopes = self._function.results
        now[:], held_now[:] = y, held
        time = begin
        while time < end:
            if self._steps.count >= self._pause:
                self._pause *= 2
                break
            steps_left = max(1, math.ceil((end - time) / self._next))
            seconds = (end - time) / steps_left
            t[0], h[0], before[0] = time, seconds, self._largest
            self._function()
            ratio = float(error_ratio[0])
            if ratio <= 1.0:
                self._next = min(self._longest, _step_factor(ratio) * seconds)
            elif shorter := self._shorter_step(seconds, ratio, float(error[0])):
                self._next = shorter
                continue
            else:
                self._next = min(self._longest, self._shortest)
                if math.isfinite(ratio):
                    self.error += float(error[0]) / float(largest[0])
                else:
                    steps_left, seconds = 1, end - time  # the flight diverges
            self._error_of_short_step = math.inf
            if self._steps.count == _MOST_STEPS:
                raise NoSolutionError(
                    f"the simulation requires steps of {seconds:.2g} s at {time:.4g} s: the loop "
                    "has a fast mode, such as an actuator with a short lag; slow it down"
                )
            self._steps.append(time, seconds, now, slopes)
            now[:] = after
            self._largest = float(largest[0])
            time = end if steps_left == 1 else time + seconds
        return time, now.copy()

    def _shorter_step(self, seconds: float, ratio: float, error: float) -> float | None:
        """Return the length, s, of the next trial of a step whose error is too large.

        None for a short step over a jump of the rates, whose error hardly decreases with the step.

        ratio: error / allowed
        error: in nominal values
        """
        if seconds > self._shortest:
            return _step_factor(ratio) * seconds
        if error < _AT_A_JUMP * self._error_of_short_step:
            self._error_of_short_step = error
            return _SHORTER * seconds
        return None

    def clear(self) -> None:
        """Forget the steps made so far."""
        self._steps.count = 0
        self._pause = min(self._pause, _PAUSE_LATER)

    def rows(self, times: np.ndarray) -> np.ndarray:
        """Return the states at increasing times of the steps since `clear`, (N, n)."""
        steps = self._steps
        step = np.searchsorted(steps.begins[: steps.count], times, side="right") - 1
        late = times - steps.begins[step]
        part = (late / steps.seconds[step])[:, None]
        first, second, third, fourth = np.split(steps.slopes[step], 4, axis=1)
        with np.errstate(all="ignore"):  # a flight may diverge
            within = ((fourth * part + third) * part + second) * part + first
            return np.asarray(steps.states[step] + late[:, None] * within)
