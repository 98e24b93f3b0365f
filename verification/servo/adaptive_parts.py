"""What adaptive laws are made of: a memory in parts, second-order filters, tuners, products that are differentiated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from verification.servo.reference_model import ALPHAS

#: Gain of the tuners' speed with the size of their regressor.
MU = 0.02
#: α0, α1, α2 of Π = α0 + α1 d/dt + α2 d²/dt².
A0, A1, A2 = ALPHAS[2]


class Part(NamedTuple):
    """A part of the memory: its place and its value."""

    place: int
    now: ca.SX


class MemoryParts:
    """The memory in parts, each with its start and its rate. memory: None to find out the starts alone."""

    def __init__(self, memory: ca.SX | None = None) -> None:
        self._memory, self._begin = memory, 0
        self._starts: list[np.ndarray] = []
        self._rates: dict[int, ca.SX] = {}

    def take(self, rows: int, columns: int = 1, start: np.ndarray | None = None) -> Part:
        """The next (rows, columns); it begins at 0 unless said."""
        size = rows * columns
        self._starts.append(np.zeros(size) if start is None else start.ravel(order="F"))
        flat = ca.SX.zeros(size) if self._memory is None else self._memory[self._begin : self._begin + size]
        self._begin += size
        return Part(len(self._starts) - 1, ca.reshape(flat, rows, columns))

    def move(self, part: Part, rate: ca.SX) -> None:
        """The rate of a part."""
        self._rates[part.place] = ca.vec(rate)

    @property
    def rate(self) -> ca.SX:
        """Of the whole memory."""
        return ca.vertcat(*(self._rates[place] for place in range(len(self._starts))))

    @property
    def start(self) -> np.ndarray:
        """Of the whole memory."""
        return np.concatenate(self._starts)


class Filter:
    """α2 ξ'' + α1 ξ' + α0 ξ = x."""

    def __init__(self, memory: MemoryParts, size: int) -> None:
        self._memory, self._parts = memory, (memory.take(size), memory.take(size))

    @property
    def low_now(self) -> ca.SX:
        """α2 / Π x, which needs no x."""
        return A2 * self._parts[0].now

    def drive(self, x: ca.SX) -> Filter:
        """With its input x."""
        xi, xi_rate = self._parts
        bend = (x - A0 * xi.now - A1 * xi_rate.now) / A2
        self._memory.move(xi, xi_rate.now)
        self._memory.move(xi_rate, bend)
        self.plain = xi.now, xi_rate.now, bend
        return self

    @property
    def low(self) -> tuple[ca.SX, ...]:
        """α2 / Π x, with two derivatives."""
        return tuple(A2 * each for each in self.plain)

    def high(self, x_rate: ca.SX | None = None) -> tuple[ca.SX, ...]:
        """(α2 s + α1) / Π x, with one derivative, or two where x' is given."""
        xi, xi_rate, bend = self.plain
        found = A1 * xi + A2 * xi_rate, A1 * xi_rate + A2 * bend
        return found if x_rate is None else (*found, x_rate - A0 * xi_rate)


class Tuner:
    """Ψ = α0 g X,  α2 X'' = Φ - g (α0 X + α1 X'),  Φ' = γ ν e',  g = 1 + μ ν'ν of the regressor ν."""

    def __init__(self, memory: MemoryParts, rows: int, columns: int, start: np.ndarray | None = None) -> None:
        begun = None if start is None else start / A0
        self._memory = memory
        self._goal, self._X = memory.take(rows, columns, start), memory.take(rows, columns, begun)
        self._X_rate = memory.take(rows, columns)

    def drive(self, gamma: float, regressor: ca.SX, error: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Ψ with two derivatives."""
        g = 1 + MU * ca.dot(regressor, regressor)
        X, X_rate = self._X.now, self._X_rate.now
        bend = (self._goal.now - g * (A0 * X + A1 * X_rate)) / A2
        self._memory.move(self._goal, gamma * ca.mtimes(regressor, error.T))
        self._memory.move(self._X, X_rate)
        self._memory.move(self._X_rate, bend)
        return A0 * g * X, A0 * g * X_rate, A0 * g * bend


def product_rate(psi: Sequence[ca.SX], x: Sequence[ca.SX]) -> ca.SX:
    """(Ψ'x)'."""
    return ca.mtimes(psi[1].T, x[0]) + ca.mtimes(psi[0].T, x[1])


def operated(psi: Sequence[ca.SX], x: Sequence[ca.SX]) -> ca.SX:
    """Π{Ψ'x}."""
    second = ca.mtimes(psi[2].T, x[0]) + 2 * ca.mtimes(psi[1].T, x[1]) + ca.mtimes(psi[0].T, x[2])
    return A2 * second + A1 * product_rate(psi, x) + A0 * ca.mtimes(psi[0].T, x[0])
