"""The adaptive law of degree 2 against the equations of its docstring, on random models at random states."""

from __future__ import annotations

from typing import Any

import numpy as np
from adaptive_laws import MEASURED, R, assert_is_what_it_says, between, law_of, parts_of, random_models

from verification.servo.adaptive_degree_2 import AdaptiveDegree2
from verification.servo.reference_model import ReferenceModel

#: Memory in its order: integrals, x_m, v̄, x̄, Λ̂, Ψ1, Ψ2, ē, Ψm; matrices column by column.
SHAPES = ((2, 1), (10, 1), (2, 1), (8, 1), (2, 2), (6, 2), (8, 2), (3, 1), (3, 3))


def expected(y: np.ndarray, models: list[ReferenceModel]) -> tuple[np.ndarray, np.ndarray]:
    """u and y', Π f = f + f'/2 of products f with f' by a central difference, which is exact for them."""
    A, B, K, L, S, R_inverse, squared_up, C = between(models)
    integrals, x_m, v_bar, x_bar, _, _, _, e_bar, _ = parts_of(y, SHAPES)
    e_y = np.vstack([MEASURED[:1, None], integrals]) - C @ x_m
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

        def at(y: np.ndarray) -> np.ndarray:
            value: np.ndarray = product(*parts_of(y, SHAPES))
            return value

        result: np.ndarray = at(y) + (at(y + rate) - at(y - rate)) / 4
        return result

    u = operated(lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: effect.T @ v - psi_1.T @ x[:6] - psi_2.T @ x)
    added = squared_up @ operated(lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: psi_m.T @ e)
    rates[1] = A @ x_m + B @ v + L @ e_y + added - np.concatenate([np.zeros(8), R])[:, None]
    return u.ravel(), np.concatenate([each.ravel(order="F") for each in rates])


def test_the_law_is_what_its_equations_say() -> None:
    assert_is_what_it_says(AdaptiveDegree2, expected, random_models(5, 10), 5, of_rate=1e-11, of_input=1e-10)


def test_it_starts_from_the_nominal_effectiveness_and_nothing_else() -> None:
    begun = law_of(AdaptiveDegree2, random_models(6, 10)).start
    np.testing.assert_array_equal(parts_of(begun, SHAPES)[4], np.eye(2))
    assert np.count_nonzero(begun) == 2
