"""The adaptive law of degree 3 against the equations of its docstring, on random models at random states.

A signal is the list of its derivatives, as many as are known.
"""

from __future__ import annotations

from itertools import pairwise
from math import comb

import numpy as np
from adaptive_laws import MEASURED, R_RATE, R, assert_is_what_it_says, between, law_of, parts_of, random_models

from verification.servo.adaptive_degree_3 import AdaptiveDegree3
from verification.servo.adaptive_parts import A0, A1, A2, MU
from verification.servo.reference_model import ReferenceModel

Signal = list[np.ndarray]


def tuner(rows: int, columns: int) -> tuple[tuple[int, int], ...]:
    return ((rows, columns),) * 3


#: Memory in its order: integrals, x_m; ē of two filters, Ψ4, Ψ5; ε, Ψ1; ε̄1, Λ̂2, ε̄12, Ψ6; x̄, Ψ2, Ψ3, v̄, Λ̂.
SHAPES = (
    *((2, 1), (12, 1)),
    *(*((3, 1),) * 4, *tuner(3, 3), *tuner(3, 3)),
    *((6, 1), *tuner(6, 2)),
    *((2, 1), (2, 1), (2, 2), (2, 1), (2, 1), *tuner(2, 2)),
    *((10, 1), (10, 1), *tuner(6, 2), *tuner(10, 2), (2, 1), (2, 1), *tuner(2, 2)),
)


def product(psi: Signal, x: Signal) -> Signal:
    """Ψ'x by Leibniz's rule."""
    known = range(min(len(psi), len(x)))
    return [sum(comb(n, k) * psi[k].T @ x[n - k] for k in range(n + 1)) for n in known]  # type: ignore[misc]


def operated(psi: Signal, x: Signal) -> np.ndarray:
    """Π{Ψ'x}."""
    zeroth, first, second = product(psi, x)
    result: np.ndarray = A0 * zeroth + A1 * first + A2 * second
    return result


def expected(memory: np.ndarray, models: list[ReferenceModel]) -> tuple[np.ndarray, np.ndarray]:
    """u and the rate of the memory."""
    A, B, K, L, S, R_inverse, squared_up, C = between(models)
    left, rates = iter(parts_of(memory, SHAPES)), []

    def filtered(x: np.ndarray, state: list[np.ndarray]) -> Signal:
        """1/Π x."""
        signal = [*state, (x - A0 * state[0] - A1 * state[1]) / A2]
        rates.extend(signal[1:])
        return signal

    def high(signal: Signal) -> Signal:
        """(α2 s + α1)/Π x."""
        return [A1 * one + A2 * other for one, other in pairwise(signal)]

    def tuned(gamma: float, regressor: np.ndarray, error: np.ndarray, state: list[np.ndarray]) -> Signal:
        goal, X, X_rate = state
        g = 1 + MU * float((regressor**2).sum())
        bend = (goal - g * (A0 * X + A1 * X_rate)) / A2
        rates.extend([gamma * regressor @ error.T, X_rate, bend])
        return [A0 * g * each for each in (X, X_rate, bend)]

    def low(signal: Signal) -> Signal:
        """α2/Π x."""
        return [A2 * each for each in signal]

    def take(count: int) -> list[np.ndarray]:
        return [next(left) for _ in range(count)]

    def along(B3: np.ndarray, moved: np.ndarray, still: np.ndarray) -> np.ndarray:
        result: np.ndarray = A2 * A @ B3 @ moved + A1 * B3 @ moved + A2 * B3 @ still
        return result

    integrals, x = take(2)
    e_y = np.vstack([MEASURED[:1, None], integrals]) - C @ x
    mixed, pushed, v = S @ e_y, L @ e_y, -K @ x
    error = mixed[:2]
    rates += [MEASURED[1:, None] - R[:, None], np.zeros((12, 1))]  # x_m', below

    bar = filtered(R_inverse @ mixed, take(2))
    state = take(2)
    kept, rates[4:] = rates[4:], []  # ē12 is moved by Ψ4, whose regressor it is in
    psi_4 = tuned(1000.0, high(bar)[0] + A2 * state[0], mixed, take(3))
    of_4, rates[4:] = rates[4:], kept
    moved = product(psi_4, high(bar))[1]
    bar_12 = filtered(moved, state)
    rates += of_4
    psi_5 = tuned(1000.0, low(bar)[0], mixed, take(3))
    still = A0 * psi_4[0].T @ high(bar)[0] + operated(psi_4, low(bar_12)) + operated(psi_5, low(bar))
    F_e = along(squared_up, moved, still)

    (drift,) = take(1)
    rates += [pushed[:6]]
    psi_1 = tuned(0.2, x[:6], error, take(3))
    bar_1 = high(filtered(product(psi_1, [drift, pushed[:6]])[1], take(2)))
    (effect_2,) = take(1)
    rates += [-5000.0 * bar_1[0] @ error.T]
    moved = product([effect_2, rates[-1]], bar_1)[1]
    bar_12 = low(filtered(moved, take(2)))
    psi_6 = tuned(-1000.0, bar_12[0], error, take(3))
    F_eps = along(B, moved, A0 * effect_2.T @ bar_1[0] + operated(psi_6, bar_12))

    told, told_rate = (np.vstack([np.zeros((10, 1)), -each[:, None]]) for each in (R, R_RATE))
    rates[1] = A @ x + B @ v + told + pushed + F_e - F_eps
    slow = filtered(x[:10], take(2))
    third = (rates[1][:10] - A0 * slow[1] - A1 * slow[2]) / A2
    x_1 = [each[:6] for each in high([*slow, third])]
    psi_2 = tuned(0.2, x_1[0], error, take(3))
    psi_3 = tuned(0.2, low(slow)[0], error, take(3))
    v_bar = filtered(v, take(2))
    effect = tuned(-5000.0, v_bar[0], error, take(3))
    x_p = [x[:6], (A @ x + told)[:6], (A @ (A @ x + told - pushed) + told_rate)[:6]]
    u = operated(effect, v_bar) - operated(psi_1, x_p) - operated(psi_2, x_1) - operated(psi_3, low(slow))
    u -= (A1 * psi_1[1] + A2 * psi_1[2]).T @ drift
    return u.ravel(), np.concatenate([each.ravel(order="F") for each in rates])


def test_the_law_is_what_its_equations_say() -> None:
    assert_is_what_it_says(AdaptiveDegree3, expected, random_models(7, 12), 8, of_rate=1e-9, of_input=1e-9)


def test_it_starts_from_the_nominal_effectiveness_and_nothing_else() -> None:
    begun = law_of(AdaptiveDegree3, random_models(9, 12)).start
    start = parts_of(begun, SHAPES)
    np.testing.assert_array_equal(start[-3], np.eye(2))
    np.testing.assert_array_equal(A0 * start[-2], np.eye(2))
    assert np.count_nonzero(begun) == 6  # Λ̂ of the tuner twice, and Λ̂2
