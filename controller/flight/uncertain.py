"""What is random in a flight, and its draws: decided by a seed and the number of a member alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from controller.flight.gusts import Dryden
from hfa_model.parameters import Parameters
from hfa_model.vectors import LINEAR_STATES
from hfa_support.errors import BadInputError, is_finite, refuse_unknown, shown

_ERRORS, _NOISE, _AIR = range(3)


@dataclass(frozen=True)
class Uncertainty:
    """What is drawn anew for each member; nothing unless given.

    errors: parameter -> relative standard deviation of the flown aircraft's about the nominal value. noise: state of
    the linear model -> standard deviation of what its sensor adds, drawn anew every tick and held. turbulence:
    (intensity, ft/s, scale, ft[, time over which it fades in, s]) of Dryden turbulence, or None. BadInputError when a
    name or a number is wrong.

    The draws of member k = 0, 1, ... are three independent streams from (seed, k), NumPy's `SeedSequence`: one kind of
    randomness more or less leaves the draws of the others as they are.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    turbulence: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Name what is wrong before the simulation."""
        for what, given, names in (
            ("parameter", self.errors, Parameters._fields),
            ("noise of state", self.noise, LINEAR_STATES),
        ):
            for name, value in given.items():
                refuse_unknown(f"unknown {what}", name, names)
                if not (is_finite(value) and value >= 0.0):
                    raise BadInputError(
                        f"the standard deviation of {name} is {shown(value)}; it must be a number that is not negative"
                    )
        for value in self.turbulence or ():
            if not (is_finite(value) and value > 0.0):
                raise BadInputError(f"the turbulence has {shown(value)}; intensity and scale must be positive numbers")

    def factors(self, seed: int, member: int) -> np.ndarray:
        """Parameter over nominal, (E,), in the order of `errors`: exp(σ ξ - σ²/2), ξ ~ N(0, 1), σ² = ln(1 + s²).

        Mean 1 and standard deviation s exactly, and never a change of sign.
        """
        sigma = np.sqrt(np.log1p(np.array(list(self.errors.values()), dtype=float) ** 2))
        drawn: np.ndarray = np.exp(sigma * _stream(seed, member, _ERRORS).standard_normal(len(sigma)) - sigma**2 / 2)
        return drawn

    def samples(self, seed: int, member: int, ticks: int) -> np.ndarray | None:
        """Noise N(0, s²) of each tick, (ticks, 6); None without any."""
        levels = np.array([self.noise.get(name, 0.0) for name in LINEAR_STATES])
        if not levels.any():
            return None
        return levels * _stream(seed, member, _NOISE).standard_normal((ticks, len(levels)))

    def air(self, seed: int, member: int, speed: float, tick: float, ticks: int) -> Dryden | None:
        """The turbulence of a member, met at `speed`, ft/s; None when the air is calm."""
        if self.turbulence is None:
            return None
        own_seed = int(_sequence(seed, member, _AIR).generate_state(1, np.uint64)[0])
        intensity, scale, *fade = self.turbulence
        return Dryden(intensity, scale, speed, tick, ticks, own_seed, *fade)


def _stream(seed: int, member: int, kind: int) -> np.random.Generator:
    return np.random.default_rng(_sequence(seed, member, kind))


def _sequence(seed: int, member: int, kind: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(member, kind))
