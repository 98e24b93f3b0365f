"""The adaptive law of degree 2 against the equations of its docstring, on random models at random states."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from controller.policy.policies import Seen
from hfa_model.vectors import INPUTS
from verification.servo.adaptive_degree_2 import AdaptiveDegree2
from verification.servo.reference_model import ReferenceModel

#: Memory in its order: integrals, x_m, v̄, x̄, Λ̂, Ψ1, Ψ2, ē, Ψm; matrices column by column.
SHAPES = ((2, 1), (10, 1), (2, 1), (8, 1), (2, 2), (6, 2), (8, 2), (3, 1), (3, 3))
MEASURED, R, R_RATE = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4]), np.array([7.0, 7.0])
#: Tables at 0.1 and 0.3 rad; the flight begins at 0.15 and is at 0.2 rad.
ANGLES, BEGUN, RISEN = np.array([0.1, 0.3]), 0.15, 0.05


def random_model(rng: np.random.Generator) -> ReferenceModel:
    shapes = ((10, 10), (10, 2), (3, 10), (2, 10), (10, 3), (3, 3), (3, 3), (10, 3))
    return ReferenceModel(*(rng.normal(size=shape) for shape in shapes))


def parts(y: np.ndarray) -> list[np.ndarray]:
    ends = np.cumsum([rows * columns for rows, columns in SHAPES])[:-1]
    return [each.reshape(shape, order="F") for each, shape in zip(np.split(y, ends), SHAPES, strict=True)]


def expected(y: np.ndarray, models: list[ReferenceModel]) -> tuple[np.ndarray, np.ndarray]:
    """u and y', Π f = f + f'/2 of products f with f' by a central difference, which is exact for them."""
    A, B, K, L, S, R_inverse, squared_up = (
        sum(getattr(each, name) for each in models) / 2 for name in ("A", "B", "K", "L", "S", "R_inverse", "squared_up")
    )
    integrals, x_m, v_bar, x_bar, _, _, _, e_bar, _ = parts(y)
    e_y = np.vstack([MEASURED[:1, None], integrals]) - models[0].C @ x_m
    mixed, v = S @ e_y, -K @ x_m
    rates = [
        MEASURED[1:] - R,
        np.zeros(10),  # x_m', below
        2 * (v - v_bar),
        2 * (x_m[:8] - x_bar),
        -2000 * v_bar @ mixed[:2].T,
        0.2 * x_bar[:6] @ mixed[:2].T,
        0.2 * x_bar @ mixed[:2].T,
        R_inverse @ mixed - 2 * e_bar,
        400 * e_bar @ mixed.T,
    ]

    def operated(product: Any) -> np.ndarray:
        rate = np.concatenate([each.ravel(order="F") for each in rates])
        result: np.ndarray = product(*parts(y)) + (product(*parts(y + rate)) - product(*parts(y - rate))) / 4
        return result

    u = operated(lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: effect.T @ v - psi_1.T @ x[:6] - psi_2.T @ x)
    added = squared_up @ operated(lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: psi_m.T @ e)
    rates[1] = A @ x_m + B @ v + L @ e_y + added - np.concatenate([np.zeros(8), R])[:, None]
    return u.ravel(), np.concatenate([each.ravel(order="F") for each in rates])


def test_the_law_is_what_its_equations_say() -> None:
    rng = np.random.default_rng(5)
    models = [random_model(rng), random_model(rng)]
    outputs = SimpleNamespace(names=("pitch_rate", "dihedral", "A_z"), at=lambda seen: ca.DM(MEASURED))
    commands = SimpleNamespace(at=lambda t: ca.DM(R), rate=lambda t: ca.DM(R_RATE))
    inputs = ("aileron_outer", "elevator_center")
    law = AdaptiveDegree2(commands, outputs, BEGUN, ANGLES, models, inputs)  # type: ignore[arg-type]
    states = ca.SX(6, 1)
    states[4] = RISEN
    seen, y = Seen(states, states, ca.SX(0, 1), ca.SX(0, 1)), ca.SX.sym("y", law.memory_size)
    nothing = ca.SX(0, 1)
    of = [law.control(ca.SX(0), seen, y, nothing), law.memory_rate(ca.SX(0), seen, y, nothing, nothing)]
    at = rng.normal(size=law.memory_size)
    u, rate = (np.array(each).ravel() for each in ca.Function("law", [y], of)(at))
    wanted_u, wanted_rate = expected(at, models)
    np.testing.assert_allclose(rate, wanted_rate, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(u[[INPUTS.index(name) for name in inputs]], wanted_u, rtol=1e-10)
    assert np.count_nonzero(u) == 2
    assert law.constants_size == 0


def test_it_starts_from_the_nominal_effectiveness_and_nothing_else() -> None:
    rng = np.random.default_rng(6)
    outputs = SimpleNamespace(names=("pitch_rate", "dihedral", "A_z"))
    law = AdaptiveDegree2(None, outputs, BEGUN, ANGLES, [random_model(rng), random_model(rng)], ("a", "b"))  # type: ignore[arg-type]
    start = parts(law.start)
    np.testing.assert_array_equal(start[4], np.eye(2))
    assert np.count_nonzero(law.start) == 2
