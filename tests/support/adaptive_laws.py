"""The adaptive laws of `hfa servo` on random models, evaluated at one random memory."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import casadi as ca
import numpy as np

from controller.policy.policies import Seen
from hfa_model import INPUTS
from verification.servo.adaptive_policy import AdaptivePolicy
from verification.servo.reference_model import ReferenceModel

MEASURED, R, R_RATE = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4]), np.array([7.0, 7.0])
#: Tables at 0.1 and 0.3 rad; the flight begins at 0.15 and is at 0.2 rad, the mean of both.
_ANGLES, _BEGUN, _RISEN = np.array([0.1, 0.3]), 0.15, 0.05
_INPUTS = ("aileron_outer", "elevator_center")


def random_models(seed: int, states: int) -> list[ReferenceModel]:
    rng, n = np.random.default_rng(seed), states
    shapes = ((n, n), (n, 2), (3, n), (2, n), (n, 3), (3, 3), (3, 3), (n, 3))
    return [ReferenceModel(*(rng.normal(size=shape) for shape in shapes)) for _ in range(2)]


def between(models: list[ReferenceModel]) -> tuple[np.ndarray, ...]:
    """A, B, K, L, S, R⁻¹ and the squared-up B where the flight is, and C of the first."""
    names = ("A", "B", "K", "L", "S", "R_inverse", "squared_up")
    return (*(sum(getattr(each, name) for each in models) / 2 for name in names), models[0].C)


def law_of(kind: type[AdaptivePolicy], models: list[ReferenceModel]) -> AdaptivePolicy:
    outputs = SimpleNamespace(names=("pitch_rate", "dihedral", "A_z"), at=lambda seen: ca.DM(MEASURED))
    commands = SimpleNamespace(at=lambda t: ca.DM(R), rate=lambda t: ca.DM(R_RATE))
    return kind(commands, outputs, _BEGUN, _ANGLES, models, _INPUTS)  # type: ignore[arg-type]


def evaluated(law: AdaptivePolicy, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u of its inputs, those of the others being 0, and the rate of its memory."""
    states, nothing = ca.SX(6, 1), ca.SX(0, 1)
    states[4] = _RISEN
    seen, y = Seen(states, states, nothing, nothing), ca.SX.sym("y", law.memory_size)
    of = [law.control(ca.SX(0), seen, y, nothing), law.memory_rate(ca.SX(0), seen, y, nothing, nothing)]
    u, rate = (np.array(each).ravel() for each in ca.Function("law", [y], of)(memory))
    assert np.count_nonzero(u) == len(_INPUTS)
    return u[[INPUTS.index(name) for name in _INPUTS]], rate


def assert_is_what_it_says(
    kind: type[AdaptivePolicy],
    expected: Callable[[np.ndarray, list[ReferenceModel]], tuple[np.ndarray, np.ndarray]],
    models: list[ReferenceModel],
    seed: int,
    *,
    of_rate: float,
    of_input: float,
) -> None:
    """u and the rate of a law at a random memory are those `expected` of it, within these shares."""
    law = law_of(kind, models)
    at = np.random.default_rng(seed).normal(size=law.memory_size)
    u, rate = evaluated(law, at)
    wanted_u, wanted_rate = expected(at, models)
    np.testing.assert_allclose(rate, wanted_rate, rtol=of_rate, atol=of_rate)
    np.testing.assert_allclose(u, wanted_u, rtol=of_input)
    assert law.constants_size == 0


def parts_of(memory: np.ndarray, shapes: tuple[tuple[int, int], ...]) -> list[np.ndarray]:
    """The memory in its parts, matrices column by column."""
    ends = np.cumsum([rows * columns for rows, columns in shapes])[:-1]
    return [each.reshape(shape, order="F") for each, shape in zip(np.split(memory, ends), shapes, strict=True)]
