"""Samples that a policy uses, and those in whose place it flies on a prediction."""

from __future__ import annotations

import numpy as np

from hfa_flight.plan.commands_under_way import CommandsUnderWay
from hfa_flight.plan.hold import hold_of
from hfa_flight.plan.scaled import ScaledProblem

#: Largest difference of a sample from its prediction: share of the usual box, and share of what the
#: inputs move in one sample. Ordinary sensor noise has standard deviations of 2 to 4 % of the box.
_OF_BOX = 0.3
_OF_MOVES = 0.1
#: Least box of a state, nominal values.
_LEAST_BOX = 0.1


class SampleGate:
    """Decides whether a sample is used, or its prediction from the sample before.

    A sample is wrong if a value is not finite, or differs from its prediction by more than an
    aircraft plausibly moves in one sample without a known reason. A second sample that agrees with
    the prediction from a first wrong one is used: the aircraft has been moved.

    scaled: the problem in nominal units
    commands: commands of the samples, one each
    dt: sample time, s
    wrong: number of wrong samples since the last `clear`
    """

    def __init__(self, scaled: ScaledProblem, commands: CommandsUnderWay, dt: float) -> None:
        k, n, _ = scaled.sizes
        lowest, highest = scaled.input_limits
        ranges = np.where(np.isfinite(highest - lowest), highest - lowest, 1.0)
        moves = np.abs(hold_of(*scaled.linear_states, dt).B) @ ranges
        box = np.maximum(scaled.box, _LEAST_BOX)
        #: Largest difference of a sample from its prediction, (n,).
        self._most = np.append(_OF_BOX * box + _OF_MOVES * moves, np.ones(n - k))
        self._commands = commands
        self._dt = dt
        self.clear()

    def clear(self) -> None:
        """Begin a flight."""
        self.wrong = 0
        self._predicted: np.ndarray | None = None
        self._doubted: np.ndarray | None = None

    def used(self, z: np.ndarray) -> np.ndarray | None:
        """Return the sample, or its prediction if it is wrong, None without a prediction.

        z: measured states, (n,)
        """
        known = [each for each in (self._predicted, self._doubted) if each is not None]
        near = [bool((np.abs(z - each) <= self._most).all()) for each in known]
        if np.isfinite(z).all() and (any(near) or not near):
            return z
        self.wrong += 1
        return self._predicted

    def predict(self, used: np.ndarray, measured: np.ndarray, delay: float, w: np.ndarray) -> None:
        """Predict the next sample after the command of a sample.

        used: result of `used` for the measured states, (n,) each
        delay: time from a sample until its command acts, s
        w: winds
        """
        acting = self._commands.acting(self._commands.count - 1, delay, self._dt)
        is_doubted = used is not measured and bool(np.isfinite(measured).all())
        self._doubted = self._commands.over(measured, acting, w) if is_doubted else None
        self._predicted = self._commands.over(used, acting, w)


def wrong_samples_note(count: int) -> list[str]:
    """Return the sentence on the wrong samples of a flight, or nothing without one."""
    if not count:
        return []
    return [f"{count} samples were not finite or impossible: the prediction was used."]
