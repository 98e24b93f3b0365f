"""Vector functions of time that are sums of a constant, a ramp and sinusoids."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import Result


class Harmonic(NamedTuple):
    """Harmonic signal sine sin(ω t) + cosine cos(ω t).

    frequency: ω, rad/s
    sine, cosine: amplitudes, (n,)
    """

    frequency: float
    sine: np.ndarray
    cosine: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Waveform(Result, Reported):
    """Signal s(t) = constant + slope t + Σ_i (sine_i sin ω_i t + cosine_i cos ω_i t), (n,).

    constant: (n,)
    slope: (n,), per s
    harmonics: ω_i, sine_i and cosine_i

    Raises BadInputError if the parts differ in length or are not finite.
    """

    constant: np.ndarray
    slope: np.ndarray
    harmonics: tuple[Harmonic, ...] = ()

    def __post_init__(self) -> None:
        """Raise BadInputError unless the parts are finite vectors of equal length."""
        size = np.shape(self.constant)
        amplitudes = [row for h in self.harmonics for row in (h.sine, h.cosine)]
        for part in (self.constant, self.slope, *amplitudes):
            if len(size) != 1 or np.shape(part) != size:
                raise BadInputError(
                    f"the parts of a waveform have shapes {size} and {np.shape(part)}; give "
                    "vectors of equal length"
                )
            if not np.all(np.isfinite(part)):
                raise BadInputError(
                    "a waveform has an entry that is not finite; give finite numbers"
                )

    @property
    def size(self) -> int:
        """Number of channels."""
        return len(self.constant)

    @property
    def until(self) -> float:
        """Time at which the harmonics end, s: inf with harmonics, 0 without."""
        return math.inf if self.harmonics else 0.0

    def at(self, t: Any) -> Any:
        """Return s(t): an array (n,) for a number t, a CasADi column for an expression t."""
        # Arrays and columns have no common type.
        if not isinstance(t, ca.SX | ca.MX):
            return self.sampled(np.array([t]))[0]
        value: Any = ca.DM(self.constant) + ca.DM(self.slope) * t
        for h in self.harmonics:
            value = (
                value
                + ca.DM(h.sine) * ca.sin(h.frequency * t)
                + ca.DM(h.cosine) * ca.cos(h.frequency * t)
            )
        return value

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Return s at the times (N,), as (N, n)."""
        value = self.constant + np.outer(times, self.slope)
        for h in self.harmonics:
            value = value + np.outer(np.sin(h.frequency * times), h.sine)
            value = value + np.outer(np.cos(h.frequency * times), h.cosine)
        return np.asarray(value)

    @property
    def varies(self) -> np.ndarray:
        """Whether each channel changes with time, (n,)."""
        return np.asarray((self.slope != 0.0) | self.oscillates)

    @property
    def oscillates(self) -> np.ndarray:
        """Whether each channel has a sine or cosine, (n,)."""
        waves = np.zeros(len(self.constant), dtype=bool)
        for h in self.harmonics:
            waves |= (h.sine != 0.0) | (h.cosine != 0.0)
        return waves

    def __add__(self, other: Waveform) -> Waveform:
        """Return the sum of two waveforms of equal length. Equal frequencies are one harmonic."""
        waves = {h.frequency: h for h in self.harmonics}
        for h in other.harmonics:
            own = waves.get(h.frequency)
            if own is not None:
                h = Harmonic(h.frequency, own.sine + h.sine, own.cosine + h.cosine)
            waves[h.frequency] = h
        return Waveform(
            self.constant + other.constant, self.slope + other.slope, tuple(waves.values())
        )

    def moments(self, duration: float) -> np.ndarray:
        """Return the mean of s(t) s(t)' from 0 to a duration in s, (n, n), by its closed form."""
        # s = sum of c t^p exp(jωt); (c, p, ω), with a pair of conjugate terms for each harmonic
        terms: list[tuple[Any, int, float]] = [(self.constant, 0, 0.0), (self.slope, 1, 0.0)]
        for h in self.harmonics:
            phasor = 0.5 * (h.cosine - 1j * h.sine)
            terms += [(phasor, 0, h.frequency), (phasor.conj(), 0, -h.frequency)]
        total = np.zeros((self.size, self.size))
        for one, p, rate in terms:
            for other, q, other_rate in terms:
                mean = _mean_of_wave(p + q, (rate - other_rate) * duration)
                total += (np.outer(one, other.conj()) * mean * duration ** (p + q)).real
        return total

    def through(self, matrix: np.ndarray) -> Waveform:
        """Return the waveform M s(t), (m,).

        matrix: M, (m, n)
        """
        waves = tuple(
            Harmonic(h.frequency, matrix @ h.sine, matrix @ h.cosine) for h in self.harmonics
        )
        return Waveform(matrix @ self.constant, matrix @ self.slope, waves)

    def rate(self) -> Waveform:
        """Return the waveform s'(t), (n,), per s."""
        waves = tuple(
            Harmonic(h.frequency, -h.frequency * h.cosine, h.frequency * h.sine)
            for h in self.harmonics
        )
        return Waveform(self.slope, np.zeros(len(self.slope)), waves)


#: Phase, rad, below which the mean of a wave is summed as a power series.
_SMALL_PHASE = 1.0


def _mean_of_wave(power: int, phase: float) -> complex:
    """Return ∫ s^p exp(j φ s) ds from 0 to 1, for p = 0, 1 or 2."""
    if abs(phase) < _SMALL_PHASE:
        return sum((1j * phase) ** k / (math.factorial(k) * (k + power + 1)) for k in range(20))
    end, mean = complex(math.cos(phase), math.sin(phase)), 0j
    for order in range(power + 1):  # by parts
        mean = (end - order * mean - (order == 0)) / (1j * phase)
    return mean


#: A number without sign, as people write it: 7, .5, 1e-3.
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
#: A term of a channel: sign, and `2`, `0.01t`, `2sin(0.5t)` or `2cos(0.5t)`, with or without `*`.
_TERM = re.compile(
    rf"(?P<sign>[+-]?)(?P<amplitude>{_NUMBER})?\*?"
    rf"(?:(?P<ramp>t)|(?P<wave>sin|cos)\((?P<frequency>{_NUMBER})?\*?t\))?"
)


def channel(text: str) -> Waveform:
    """Return the waveform with one channel that a text describes, such as 7+0.01t+2sin(0.5t).

    The terms are numbers, multiples of the time t in s, and multiples of sin(ω t) and cos(ω t)
    with ω in rad/s.

    Raises BadInputError for another text.
    """
    # Spaces between two digits remain, and are refused: "7 8" is not 78.
    packed = re.sub(r"(?<![\d.])\s+|\s+(?![\d.])", "", text.strip())
    constant = 0.0
    slope = 0.0
    waves = []
    begin = 0
    while begin < len(packed):
        term = _TERM.match(packed, begin)
        is_empty = term is None or not (term["amplitude"] or term["ramp"] or term["wave"])
        if term is None or is_empty or (begin > 0 and not term["sign"]):
            raise BadInputError(
                f"{packed[begin:]!r} is no term of a signal; write sums of terms such as 7, 0.01t, "
                "2sin(0.5t), 2cos(0.5t)"
            )
        amplitude = float(f"{term['sign']}{term['amplitude'] or 1}")
        if term["ramp"]:
            slope += amplitude
        elif term["wave"]:
            frequency = float(term["frequency"] or 1)
            sine, cosine = (amplitude, 0.0) if term["wave"] == "sin" else (0.0, amplitude)
            if frequency == 0.0:
                constant += cosine
                begin = term.end()
                continue
            waves.append(Harmonic(frequency, np.array([sine]), np.array([cosine])))
        else:
            constant += amplitude
        begin = term.end()  # the text of each term follows that of the last
    if not packed:
        raise BadInputError("a signal is empty; write terms such as 7, 0.01t, 2sin(0.5t)")
    return Waveform(np.array([constant]), np.array([slope]), tuple(waves))


def stacked(channels: Mapping[str, Waveform], names: Sequence[str]) -> Waveform:
    """Return the waveform (n,) with the given channels, and 0 in the others.

    channels: name -> waveform (1,)
    names: names of all n channels
    """
    total = zero(len(names))
    for name, wave in channels.items():
        into_its_channel = np.array([[float(other == name)] for other in names])
        total = total + wave.through(into_its_channel)
    return total


def constant(values: np.ndarray) -> Waveform:
    """Return the waveform with constant values, (n,)."""
    return Waveform(values, np.zeros(len(values)))


def zero(size: int) -> Waveform:
    """Return the waveform with `size` channels that is always 0."""
    return constant(np.zeros(size))
