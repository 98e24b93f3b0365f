"""Commands under way, and the states at the time at which the next command acts."""

from __future__ import annotations

from collections import deque

import numpy as np

from hfa_flight.air.delay import WHOLE, in_samples
from hfa_flight.plan.held_model import HeldModel


class CommandsUnderWay:
    """Commands of the samples of a flight, each of which acts after a delay.

    The command of a sample acts from the delay after its sample until the next one acts. Before the
    first command, the inputs are at trim. Commands that have acted are forgotten, so the delay of a
    flight is constant.

    model: the model, whose first hold is a sample
    """

    def __init__(self, model: HeldModel) -> None:
        self._model = model
        self.clear()

    def clear(self) -> None:
        """Begin a flight."""
        #: Number of commands of the flight, and the last of them, (m,) each.
        self.count = 0
        self._commands: deque[np.ndarray] = deque()

    def append(self, v: np.ndarray) -> None:
        """Add the command of a sample, (m,)."""
        self._commands.append(v)
        self.count += 1

    def acting(self, sample: int, delay: float, seconds: float) -> list[tuple[np.ndarray, float]]:
        """Return the inputs that act during some time after a sample, each with its duration, s.

        sample: number of the sample
        delay: s
        seconds: duration, s
        """
        dt = float(self._model.holds[0])
        late, until = in_samples(delay, dt)
        first = sample - late - 1
        while len(self._commands) > self.count - first:
            self._commands.popleft()
        begin = 0.0
        acting = []
        for number in range(first, sample + 1):
            end = min(until, seconds)
            if end - begin > WHOLE * dt:
                acting.append((self._command(number), end - begin))
                begin = end
            until += dt
        return acting

    def _command(self, number: int) -> np.ndarray:
        if number < 0:
            return np.zeros(self._model.scaled.sizes[2])
        return self._commands[number - self.count]

    def moved(self, z: np.ndarray, delay: float, w: np.ndarray) -> np.ndarray:
        """Return the states when the command of the next sample acts, (n,).

        z: states now, (n,)
        w: winds
        """
        return self.over(z, self.acting(self.count, delay, delay), w)

    def over(
        self, z: np.ndarray, acting: list[tuple[np.ndarray, float]], w: np.ndarray
    ) -> np.ndarray:
        """Return the states after some inputs have acted, (n,)."""
        for v, seconds in acting:
            z = self._model.after(z, v, w, seconds)
        return z
