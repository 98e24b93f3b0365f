"""What is random in one member of a Monte Carlo: decided by the seed and the member's number alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.flight.gusts import Dryden
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.parameters import Parameters
from hfa_model.vectors import LINEAR_STATES

_ERRORS, _NOISE, _AIR = range(3)


class Draws(NamedTuple):
    """factors: (E,), parameter over nominal, in the order of the plan's errors. parameters: (18,), those flown.

    noise: (ticks, 6), held during each tick. air: turbulence, None when the air is calm.
    """

    factors: np.ndarray
    parameters: np.ndarray
    noise: np.ndarray
    air: Dryden | None


def draws_of(plan: MonteCarlo, member: int) -> Draws:
    """The draws of member k = 0, 1, ...: three independent streams from (seed, k), NumPy's `SeedSequence`.

    A parameter is its nominal value times exp(σ ξ - σ²/2), ξ ~ N(0, 1), σ² = ln(1 + s²): mean 1 and standard
    deviation s exactly, and it never changes its sign. Noise is N(0, s²) in each tick. One kind of randomness more or
    less leaves the draws of the others as they are.
    """
    deviations = np.array(list(plan.uncertainty.errors.values()), dtype=float)
    sigma = np.sqrt(np.log1p(deviations**2))
    factors = np.exp(sigma * _stream(plan.seed, member, _ERRORS).standard_normal(len(sigma)) - sigma**2 / 2)
    parameters = np.array(plan.parameters, dtype=float)
    parameters[[Parameters._fields.index(name) for name in plan.uncertainty.errors]] *= factors
    levels = np.array([plan.uncertainty.noise.get(name, 0.0) for name in LINEAR_STATES])
    noise = np.zeros((plan.course.ticks, len(levels)))
    if levels.any():
        noise = levels * _stream(plan.seed, member, _NOISE).standard_normal(noise.shape)
    return Draws(factors, parameters, noise, turbulence(plan, member))


def turbulence(plan: MonteCarlo, member: int) -> Dryden | None:
    """The air of a member, met at the trimmed speed."""
    if plan.uncertainty.turbulence is None:
        return None
    intensity, scale = plan.uncertainty.turbulence
    seed = int(_sequence(plan.seed, member, _AIR).generate_state(1, np.uint64)[0])
    return Dryden(intensity, scale, plan.point.states.speed, plan.course.tick, plan.course.ticks, seed)


def _stream(seed: int, member: int, kind: int) -> np.random.Generator:
    return np.random.default_rng(_sequence(seed, member, kind))


def _sequence(seed: int, member: int, kind: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(member, kind))
