"""Many short flights in one compiled function: does the loop come back, and which state leaves first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop, CompiledLoop
from controller.flight.envelope import Envelope
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.watched_loop import WatchedLoop
from controller.policy.policies import Memoryless, Seen, gain_constants
from controller.policy.signals import zero
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATE_SCALES, STATES
from hfa_support.native.bound import BoundFunction
from trim.point.operating_point import OperatingPoint

#: Step of the trials, s: the fastest closed loop of the paper's weights (45 rad/s) is followed to 1e-5 of itself.
STEP = 0.005
#: A trial is lost, and ends, this many envelope widths away or below this part of the slowest speed: seen never to
#: come back from there.
_LOST_WIDTHS, _LOST_SPEED = 100.0, 0.1
_CHUNK_SECONDS = 1.0
#: A flight has come to rest on its target when each state is this close to it, as a fraction of its scale.
CLOSE = 0.01
_N, _M = len(LINEAR_STATES), len(INPUTS)


class _CommandedGain(Memoryless):
    """u = -K (z - c): the gain K and a constant command c (6,) are handed over for each trial."""

    constants_size = _M * _N + _N

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        return -ca.mtimes(ca.reshape(p[: _M * _N], _M, _N), seen.error - p[_M * _N :])


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
        error = np.abs(self.final[:, LINEAR_ROWS] - commands) / np.array(STATE_SCALES)[LINEAR_ROWS]
        with np.errstate(invalid="ignore"):
            return np.asarray(self.settled & (error <= CLOSE).all(axis=1))


def _at_every_tick(p: np.ndarray, tick: int) -> np.ndarray:
    return p


class TrialLoop:
    """A plant under u = -K (x - c), flown a second at a time, wherever it goes."""

    def __init__(self, plant: NonlinearPlant | LinearizedAircraft, point: OperatingPoint, envelope: Envelope) -> None:
        nothing = zero(_N)
        loop = ClosedLoop(plant, _CommandedGain(), nothing, nothing, nothing)
        self._watched = WatchedLoop(
            loop,
            point,
            envelope,
            step=STEP,
            steps_per_tick=round(_CHUNK_SECONDS / STEP),
            stops=False,
            compile_code=True,
        )
        self._rate = BoundFunction(CompiledLoop(loop).rate)
        offsets = np.array(point.states)
        lowest, highest = np.array(envelope.lowest) - offsets, np.array(envelope.highest) - offsets
        self._far_below = lowest - _LOST_WIDTHS * (highest - lowest)
        self._far_above = highest + _LOST_WIDTHS * (highest - lowest)
        speed = STATES.index("speed")
        self._far_below[speed] = _LOST_SPEED * envelope.lowest.speed - offsets[speed]

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
        flat, rounded = gain_constants(gain), _CHUNK_SECONDS * np.ceil(seconds / _CHUNK_SECONDS - 1e-9)
        for index in range(count):
            p = np.concatenate([flat, commands[index]])
            trial = self._watched.fly(starts[index], partial(_at_every_tick, p), rounded, self._lost)
            final[index] = np.nan if self._lost(trial.final) else trial.final
            if trial.left >= 0:
                left[index], when[index] = trial.left, trial.flown
            settled[index] = self._at_rest(final[index], p)
            if progress is not None:
                progress()
        return Trials(left, when, final, settled)

    def _lost(self, x: np.ndarray) -> bool:
        return not bool(((x >= self._far_below) & (x <= self._far_above)).all())

    def _at_rest(self, x: np.ndarray, p: np.ndarray) -> bool:
        t, y, constants = self._rate.inputs
        t[:], y[:], constants[:] = 0.0, x, p
        self._rate()
        rates = np.abs(self._rate.results[0][LINEAR_ROWS]) / np.array(STATE_SCALES)[LINEAR_ROWS]
        with np.errstate(invalid="ignore"):
            return bool((rates <= CLOSE).all())
