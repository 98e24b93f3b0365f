"""Measured states of the samples of a flight, and the states when the next command acts."""

from __future__ import annotations

import numpy as np

from hfa_flight.air.delay import acting_commands, in_samples
from hfa_flight.plan.held_model import HeldModel
from hfa_flight.plan.hold import hold_of

#: Largest difference of a sample from its prediction: share of the usual box, and share of what the
#: inputs move in one sample. Ordinary sensor noise has standard deviations of 2 to 4 % of the box.
_OF_BOX = 0.3
_OF_MOVES = 0.1
#: Least box of a state, nominal values.
_LEAST_BOX = 0.1


class Measured:
    """Samples of a flight: states when the next command acts, predicted from the measured ones.

    The command of a sample acts from the delay after its sample until the next one acts. Before the
    first command, the inputs are at trim.

    A sample is wrong if a value is not finite, or differs from its prediction by more than an
    aircraft plausibly moves in one sample without a known reason. Its prediction from the sample
    before is used instead. A second sample that agrees with the prediction from a first wrong one
    is used: the aircraft has been moved.

    model: the model, whose first hold is a sample
    delay: time from a sample until its command acts, s
    wrong: number of wrong samples of the flight
    """

    def __init__(self, model: HeldModel, delay: float) -> None:
        k, n, _ = model.scaled.sizes
        self._model = model
        self._delay = delay
        self._dt = float(model.holds[0])
        lowest, highest = model.scaled.input_limits
        ranges = np.where(np.isfinite(highest - lowest), highest - lowest, 1.0)
        moved = np.abs(hold_of(*model.scaled.linear_states, self._dt).B) @ ranges
        box = np.maximum(model.scaled.box, _LEAST_BOX)
        #: Largest difference of a sample from its prediction, (n,).
        self._most = np.append(_OF_BOX * box + _OF_MOVES * moved, np.ones(n - k))
        self.wrong = 0
        #: Commands that may act yet, (m,) each, and number of all commands of the flight.
        self._commands: list[np.ndarray] = []
        self._count = 0
        #: States of the last sample: the used ones, then those that were measured in doubt.
        self._last: list[np.ndarray] = []

    def checked(self, z: np.ndarray) -> np.ndarray | None:
        """Return the states of this sample, or their prediction if it is wrong, (n,).

        The result is None if the sample is wrong and no sample before predicts it. A wrong but
        finite z is kept as a second hypothesis, from which the next sample is predicted too.

        z: measured states, (n,)
        """
        acting = self._acting(self._count - 1, self._dt)
        predictions = [self._moved(states, acting) for states in self._last]
        agrees = [bool((np.abs(z - states) <= self._most).all()) for states in predictions]
        used: np.ndarray | None = z
        if not np.isfinite(z).all() or (predictions and not any(agrees)):
            self.wrong += 1
            used = predictions[0] if predictions else None
        hypotheses = (used,) if used is z else (used, z)
        self._last = [z for z in hypotheses if z is not None and np.isfinite(z).all()]
        return used

    def when_acting(self, z: np.ndarray) -> np.ndarray:
        """Return the states when the command of this sample acts, (n,), from those now."""
        return self._moved(z, self._acting(self._count, self._delay))

    def command(self, v: np.ndarray) -> None:
        """Add the command of this sample, (m,), and forget those that have acted before it."""
        late = in_samples(self._delay, self._dt).whole
        self._commands = [*self._commands, v][-late - 2 :]
        self._count += 1

    def _acting(self, sample: int, seconds: float) -> list[tuple[np.ndarray, float]]:
        """Return the inputs that act in some seconds after a sample, each with its duration, s."""
        acting = acting_commands(self._delay, self._dt, seconds)
        return [(self._command(sample - since), duration) for since, duration in acting]

    def _command(self, number: int) -> np.ndarray:
        """Return the command of a sample, 0 before the flight, (m,)."""
        if number < 0:
            return np.zeros(self._model.scaled.sizes[2])
        return self._commands[number - self._count]

    def _moved(self, z: np.ndarray, acting: list[tuple[np.ndarray, float]]) -> np.ndarray:
        """Return the states after inputs that act in turn, each with its duration, (n,)."""
        for v, seconds in acting:
            z = self._model.after(z, v, seconds)
        return z


def wrong_samples_note(count: int) -> list[str]:
    """Return the sentence on the wrong samples of a flight, or nothing without one."""
    if not count:
        return []
    return [f"{count} samples were not finite or impossible: the prediction was used."]
