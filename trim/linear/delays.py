"""Sampled linear loops whose commands act late, and the delay that makes them unstable."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import spectral_radius

#: A time this close to a whole number of samples, in samples, is that number, if it is not 0.
_SAMPLES_TOLERANCE = 1e-6


class Delay(NamedTuple):
    """A delay of `whole` samples and `rest` seconds, with 0 <= rest < sample time.

    The command of sample k acts from `rest` after sample k + whole on; until then the one before it
    acts.
    """

    whole: int
    rest: float


def in_samples(delay: float, dt: float) -> Delay:
    """Return a delay in samples.

    delay, dt: delay and sample time, s
    """
    samples = delay / dt
    nearest = round(samples)
    # Below one sample the tolerance is relative to the delay: else a short one is rounded to 0.
    if abs(samples - nearest) <= _SAMPLES_TOLERANCE * min(samples, 1.0):
        return Delay(nearest, 0.0)
    whole = math.floor(samples)
    return Delay(whole, delay - whole * dt)


def samples_under_way(delay: float, dt: float) -> int:
    """Return the number of earlier commands that act after a sample."""
    whole, rest = in_samples(delay, dt)
    return whole + (rest > 0.0)


class ActingCommand(NamedTuple):
    """A delayed command that acts for a time after a sample.

    samples_ago: number of samples since that of the command, 0 for the command of the sample
    seconds: time for which it acts, s
    """

    samples_ago: int
    seconds: float


def acting_commands(delay: float, dt: float, seconds: float) -> list[ActingCommand]:
    """Return the commands that act in some seconds after a sample, the earliest first.

    delay, dt: delay and sample time, s
    """
    # The oldest command ends after the rest of the delay, and each later one a sample later.
    whole, end_of_command = in_samples(delay, dt)
    acting = []
    begin = 0.0
    for samples_ago in range(whole + 1, -1, -1):
        end = min(end_of_command, seconds)
        if end - begin > _SAMPLES_TOLERANCE * dt:
            acting.append(ActingCommand(samples_ago, end - begin))
            begin = end
        end_of_command += dt
    return acting


def step_count(seconds: float, step: float) -> int:
    """Return the least number of steps, at least 1, that last as long as a time, up to rounding."""
    return max(1, math.ceil(seconds / step - _SAMPLES_TOLERANCE))


#: Largest delay that is searched, s, and in samples unless told.
MOST_SECONDS = 3.0
LONGEST = 30


@dataclass(frozen=True, eq=False)
class Chain:
    """Sampled loop s⁺ = F s + G v with the command u = C s, closed by v = u.

    F: (N, N).
    G: (N, m).
    C: (m, N).
    states: number of aircraft states, the first entries of s.
    dt: sample time, s.
    """

    F: np.ndarray
    G: np.ndarray
    C: np.ndarray
    states: int
    dt: float

    @property
    def closed(self) -> np.ndarray:
        """Closed-loop matrix F + G C."""
        return self.F + self.G @ self.C

    @property
    def modes(self) -> np.ndarray:
        """Eigenvalues of the closed loop, ln(z) / dt, 1/s, without z = 0: it ends in a sample."""
        of_samples = np.linalg.eigvals(self.closed)
        return np.log(of_samples[of_samples != 0.0].astype(complex)) / self.dt

    @cached_property
    def radius(self) -> float:
        """Spectral radius of the closed loop, inf if its matrix is not finite."""
        closed = self.closed
        return spectral_radius(closed) if np.isfinite(closed).all() else math.inf


def zero_order_hold(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices of a plant with held inputs, x⁺ = Φ x + Γ u.

    Φ = exp(A dt), and Γ = ∫ exp(A t) dt B over [0, dt].
    """
    from scipy.linalg import expm

    n, m = B.shape
    transition = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return transition[:n, :n], transition[:n, n:]


class Plant(NamedTuple):
    """Linear plant x' = A x + B u with samples of dt seconds."""

    A: np.ndarray
    B: np.ndarray
    dt: float

    def later(
        self, x: np.ndarray, commands: list[np.ndarray], delay: float, time: float
    ) -> np.ndarray:
        """Return the states some time after a sample, by the commands that act in it.

        commands: of the samples until this one, the latest first
        delay, time: s
        """
        for samples_ago, seconds in acting_commands(delay, self.dt, time):
            Phi, Gamma = zero_order_hold(self.A, self.B, seconds)
            x = Phi @ x + Gamma @ commands[samples_ago]
        return x


def chain_of(
    A: np.ndarray,
    B: np.ndarray,
    command: Callable[[np.ndarray, list[np.ndarray]], np.ndarray],
    dt: float,
    delay: float,
) -> Chain:
    """Return the sampled loop of a plant x' = A x + B u.

    command: linear function of x and the commands of earlier samples, the latest first, up to the
        one that acts just before the sample
    dt, delay: sample time and delay, s
    """
    n, m = B.shape
    size = n + (in_samples(delay, dt).whole + 1) * m
    # Each row is a linear form of s and of the command u of the sample. s are the states, then the
    # commands of earlier samples, the latest first.
    x, *earlier, u = np.split(np.eye(size + m), range(n, size + m, m))
    after = Plant(A, B, dt).later(x, [u, *earlier], delay, dt)
    F, G = np.split(np.vstack([after, u, *earlier[:-1]]), [size], axis=1)
    return Chain(F, G, command(x, earlier)[:, :size], n, dt)


class Delays(NamedTuple):
    """Effect of delays on a loop.

    radii: spectral radius with delays of 0, 1, 2, ... samples, up to `searched`.
    limit: first unstable delay, s, not below the deployed delay, or None if none was found up to
        `searched`.
    searched: longest delay that was examined, s.
    """

    radii: tuple[float, ...]
    limit: float | None
    searched: float


#: Number of delays that are examined in each of the first samples, and number of these samples.
_PARTS, _EARLY = 4, 10
#: Number of bisections of the interval with the first unstable delay.
_BISECTIONS = 20


def searched_delays(
    loop: Callable[[float], Chain], dt: float, deployed_delay: float, longest: int = LONGEST
) -> Delays:
    """Return the effect of delays up to the first unstable one, which is bisected.

    Examined are whole samples, and parts of the first ones. The first unstable delay is not below
    the deployed delay. With a longer delay, the loop may be stable again. If no delay is unstable,
    the delays reach `longest` samples, `MOST_SECONDS` or the deployed delay.

    loop: function delay, s -> loop
    dt, deployed_delay: s
    """
    first = samples_under_way(deployed_delay, dt)  # whole samples, not below the deployed delay
    most = max(first, min(longest, math.ceil(MOST_SECONDS / dt)))
    parts = {part / _PARTS for part in range(_PARTS * min(_EARLY, most))}
    examined = sorted({*parts, *map(float, range(most + 1)), deployed_delay / dt})

    def radius(samples: float) -> float:
        """Return the spectral radius with a delay in samples."""
        return loop(samples * dt).radius

    radii: list[float] = []
    stable = 0.0
    for samples in examined:
        now = radius(samples)
        if samples.is_integer():
            radii.append(now)
        if samples * dt < deployed_delay or now < 1.0:
            stable = samples
            continue
        unstable = samples
        for _ in range(_BISECTIONS if samples * dt > deployed_delay else 0):
            middle = 0.5 * (stable + unstable)
            stable, unstable = (middle, unstable) if radius(middle) < 1.0 else (stable, middle)
        return Delays(tuple(radii), limit=unstable * dt, searched=samples * dt)
    return Delays(tuple(radii), limit=None, searched=most * dt)


def text_of_further_delay(limit: float | None, searched: float) -> str:
    """Return the first delay found that makes a loop unstable, and those examined, as a sentence.

    limit, searched: those of `Delays`, s
    """
    which = "further delay of all inputs, unknown to the policy,"
    examined = f"(whole samples, and quarters of the first {_EARLY})"
    if limit is None:
        most = f"{1e3 * searched:.4g} ms"
        return f"No {which} examined up to {most} {examined} makes the linear loop unstable."
    found = f"A {which} of {1e3 * limit:.3g} ms makes the linear loop unstable"
    return f"{found}; no shorter one examined does {examined}."
