"""Vectors that vary with time in a known way: references, disturbances, measurement noise, feedforward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown

if TYPE_CHECKING:
    import casadi as ca


class TimeVector(Protocol):
    """A vector that is known at every time: what a loop asks of its reference, disturbance and noise."""

    @property
    def size(self) -> int:
        """Number of channels."""

    def at(self, t: ca.SX) -> ca.SX:
        """The value, (n,), at a number or a CasADi expression."""


class Harmonic(NamedTuple):
    """sine sin(ω t) + cosine cos(ω t): frequency ω in rad/s, amplitudes (n,)."""

    frequency: float
    sine: np.ndarray
    cosine: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Signal(Shown):
    """s(t) = constant + slope t + Σ_i (sine_i sin ω_i t + cosine_i cos ω_i t), (n,).

    BadInputError when the parts differ in length or are not finite.
    """

    constant: np.ndarray
    slope: np.ndarray
    harmonics: tuple[Harmonic, ...] = ()

    def __post_init__(self) -> None:
        """Check the shapes once."""
        size = np.shape(self.constant)
        for part in (self.constant, self.slope, *(row for h in self.harmonics for row in (h.sine, h.cosine))):
            if len(size) != 1 or np.shape(part) != size:
                raise BadInputError(f"a signal has parts of shape {size} and {np.shape(part)}; make them one length")
            if not np.all(np.isfinite(part)):
                raise BadInputError("a signal has an entry that is not finite; give numbers")

    @property
    def size(self) -> int:
        """Number of channels."""
        return len(self.constant)

    # NumPy's answer to a number and CasADi's to an expression have no type in common.
    def at(self, t: Any) -> Any:
        """s(t): (n,) at a number, a CasADi column at a CasADi expression."""
        import casadi as ca

        symbolic = isinstance(t, (ca.SX, ca.MX))
        parts = (ca.DM(self.constant), ca.DM(self.slope)) if symbolic else (self.constant, self.slope)
        value = parts[0] + parts[1] * t
        for harmonic in self.harmonics:
            phase = harmonic.frequency * t
            value = value + (_column(harmonic.sine, symbolic) * ca.sin(phase))
            value = value + (_column(harmonic.cosine, symbolic) * ca.cos(phase))
        return value

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """s at many times, (N, n)."""
        value = self.constant + np.outer(times, self.slope)
        for h in self.harmonics:
            value = value + np.outer(np.sin(h.frequency * times), h.sine)
            value = value + np.outer(np.cos(h.frequency * times), h.cosine)
        return np.asarray(value)

    def rate(self) -> Signal:
        """ds/dt."""
        turned = tuple(Harmonic(h.frequency, -h.frequency * h.cosine, h.frequency * h.sine) for h in self.harmonics)
        return Signal(self.slope, np.zeros(self.size), turned)

    def through(self, matrix: np.ndarray) -> Signal:
        """M s(t), for a constant matrix M."""
        turned = tuple(Harmonic(h.frequency, matrix @ h.sine, matrix @ h.cosine) for h in self.harmonics)
        return Signal(matrix @ self.constant, matrix @ self.slope, turned)

    def plus(self, other: Signal) -> Signal:
        """s(t) + other(t); BadInputError when they differ in length."""
        if other.size != self.size:
            raise BadInputError(
                f"signals of {self.size} and {other.size} channels cannot be added; make them one length"
            )
        return Signal(self.constant + other.constant, self.slope + other.slope, self.harmonics + other.harmonics)

    def to_dict(self) -> dict[str, Any]:
        """The formula as data for JSON."""
        return {
            "constant": self.constant,
            "slope": self.slope,
            "harmonics": [harmonic._asdict() for harmonic in self.harmonics],
        }


def zero(size: int) -> Signal:
    """The zero signal."""
    return Signal(np.zeros(size), np.zeros(size))


def _column(values: np.ndarray, symbolic: bool) -> Any:
    import casadi as ca

    return ca.DM(values) if symbolic else values
