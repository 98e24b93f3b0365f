"""Many short flights in one compiled function: does the loop come back, and which state leaves first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop, CompiledLoop
from controller.flight.envelope import Envelope
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.policies import gain_constants
from controller.flight.signals import zero
from hfa_model.native.bound import BoundFunction
from hfa_model.native.machine_code import machine_code
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATE_SCALES, STATES
from trim.point.operating_point import OperatingPoint

#: Step of the trials, s: the fastest closed loop of the paper's weights (45 rad/s) is followed to 1e-5 of itself.
STEP = 0.005
#: A trial is lost, and ends, this many envelope widths away or below this part of the slowest speed: seen never to
#: come back from there.
_LOST_WIDTHS, _LOST_SPEED = 100.0, 0.1
_CHUNK_SECONDS = 1.0
#: A flight has come to rest on its target when each state is this close to it, in parts of its scale.
CLOSE = 0.01
_ROWS = [STATES.index(name) for name in LINEAR_STATES]
_N, _M = len(LINEAR_STATES), len(INPUTS)


class _CommandedGain:
    """u = -K (z - c): the gain K and a constant command c (6,) are handed over for each trial."""

    memory_size = 0
    constants_size = _M * _N + _N

    def control(self, t: Any, z: Any, memory: Any, p: Any) -> Any:
        return -ca.mtimes(ca.reshape(p[: _M * _N], _M, _N), z - p[_M * _N :])

    def memory_rate(self, t: Any, z: Any, memory: Any, p: Any) -> Any:
        return ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class Trials:
    """Outcomes of N flights.

    left: (N,), index into `STATES` of the state that left the envelope first, -1 when none did. when: (N,), s, inf
    when none did. final: (N, 7), the last deviation from trim; not finite when the flight was lost. settled: (N,),
    whether the rates of the six controlled states had died out at the end.
    """

    left: np.ndarray
    when: np.ndarray
    final: np.ndarray
    settled: np.ndarray

    @property
    def held(self) -> np.ndarray:
        """Which flights stayed inside the envelope."""
        return self.left < 0

    def arrived(self, dihedrals: np.ndarray) -> np.ndarray:
        """Which flights ended at rest nearer to their dihedral command, (N,), rad, than to trim.

        Feedback alone leaves an offset from a command; but rest at another equilibrium is no arrival.
        """
        off = np.abs(self.final[:, STATES.index("dihedral")] - dihedrals)
        with np.errstate(invalid="ignore"):
            return np.asarray(self.settled & (off <= np.maximum(np.abs(dihedrals) / 2, CLOSE * STATE_SCALES.dihedral)))

    def returned(self, commands: np.ndarray) -> np.ndarray:
        """Which flights ended at rest within `CLOSE` of the command, wherever they went in between."""
        error = np.abs(self.final[:, _ROWS] - commands) / np.array(STATE_SCALES)[_ROWS]
        with np.errstate(invalid="ignore"):
            return np.asarray(self.settled & (error <= CLOSE).all(axis=1))


class TrialLoop:
    """A plant under u = -K (x - c) as one function that flies a second at a time and watches the envelope."""

    def __init__(
        self,
        plant: NonlinearPlant | LinearizedAircraft,
        point: OperatingPoint,
        envelope: Envelope,
        *,
        compile_code: bool = True,
    ) -> None:
        nothing = zero(_N)
        self._rate = CompiledLoop(ClosedLoop(plant, _CommandedGain(), nothing, nothing, nothing)).rate
        offsets = np.array(point.states)
        self._lowest, self._highest = np.array(envelope.lowest) - offsets, np.array(envelope.highest) - offsets
        width = self._highest - self._lowest
        self._far_below, self._far_above = self._lowest - _LOST_WIDTHS * width, self._highest + _LOST_WIDTHS * width
        speed = STATES.index("speed")
        self._far_below[speed] = _LOST_SPEED * envelope.lowest.speed - offsets[speed]
        steps = round(_CHUNK_SECONDS / STEP)
        fold = self._watched_step().fold(steps)
        y, p = ca.MX.sym("y", fold.numel_in(0)), ca.MX.sym("p", self._rate.numel_in(2))
        chunk = ca.Function("trial", [y, p], [fold(y, ca.repmat(p, 1, steps))])
        self._chunk = BoundFunction(machine_code(chunk) if compile_code else chunk)
        self._plant_rate = BoundFunction(self._rate)

    def fly(
        self,
        gain: np.ndarray,
        starts: np.ndarray,
        commands: np.ndarray,
        seconds: float,
        progress: Callable[[], None] | None = None,
    ) -> Trials:
        """N flights of `seconds` (rounded up to whole seconds).

        gain: K (5, 6). starts: (N, 7), deviations from trim. commands: (N, 6), deviations of `LINEAR_STATES`.
        progress: called after each flight.
        """
        count = len(starts)
        left, when = np.full(count, -1), np.full(count, np.inf)
        final, settled = np.empty((count, len(STATES))), np.zeros(count, dtype=bool)
        flat = gain_constants(gain)
        for index in range(count):
            p = np.concatenate([flat, commands[index]])
            y = self._trial(starts[index], p, int(np.ceil(seconds / _CHUNK_SECONDS - 1e-9)))
            final[index] = y[: len(STATES)]
            if y[-2] >= 0:
                left[index], when[index] = int(y[-2]), y[-1]
            settled[index] = self._at_rest(final[index], p)
            if progress is not None:
                progress()
        return Trials(left, when, final, settled)

    def _trial(self, start: np.ndarray, p: np.ndarray, chunks: int) -> np.ndarray:
        """[x; t; first state that left or -1; when] after the chunks, or when the flight is lost."""
        y, constants = self._chunk.inputs
        y[:], constants[:] = np.concatenate([start, [0.0, -1.0, 0.0]]), p
        for _ in range(chunks):
            self._chunk()
            y[:] = self._chunk.results[0]
            with np.errstate(invalid="ignore"):
                lost = ~((y[: len(STATES)] >= self._far_below) & (y[: len(STATES)] <= self._far_above))
            if lost.any():
                y[: len(STATES)] = np.nan
                break
        return y.copy()

    def _at_rest(self, x: np.ndarray, p: np.ndarray) -> bool:
        t, y, constants = self._plant_rate.inputs
        t[:], y[:], constants[:] = 0.0, x, p
        self._plant_rate()
        rates = np.abs(self._plant_rate.results[0][_ROWS]) / np.array(STATE_SCALES)[_ROWS]
        with np.errstate(invalid="ignore"):
            return bool((rates <= CLOSE).all())

    def _watched_step(self) -> ca.Function:
        """One Runge-Kutta step of [x; t; first; when]: `first` is set once, to the state with the largest excess."""
        n = len(STATES)
        y, p = ca.SX.sym("y", n + 3), ca.SX.sym("p", self._rate.numel_in(2))
        x, t, first, when = y[:n], y[n], y[n + 1], y[n + 2]
        k1 = self._rate(t, x, p)
        k2 = self._rate(t, x + STEP / 2 * k1, p)
        k3 = self._rate(t, x + STEP / 2 * k2, p)
        k4 = self._rate(t, x + STEP * k3, p)
        after = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        width = ca.DM(self._highest - self._lowest)
        excess = ca.fmax(after - ca.DM(self._highest), ca.DM(self._lowest) - after) / width
        worst, which = excess[0], ca.SX(0)
        for index in range(1, n):
            which = ca.if_else(excess[index] > worst, index, which)
            worst = ca.fmax(worst, excess[index])
        leaves = ca.logic_and(first < 0, worst > 0)
        marked = ca.vertcat(ca.if_else(leaves, which, first), ca.if_else(leaves, t + STEP, when))
        return ca.Function("watched_step", [y, p], [ca.vertcat(after, t + STEP, marked)], {"cse": True})
