"""SimVFA's servos: the reference model, and adaptive laws compared with an independent form."""

from __future__ import annotations

from itertools import pairwise
from math import comb
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hfa import Model
from hfa.paper import level_model
from hfa_flight import Measurements
from hfa_model import INPUTS
from studies.servo.simvfa import (
    A0,
    A1,
    A2,
    ALPHAS,
    MU,
    AdaptiveDegree2,
    AdaptiveDegree3,
    AdaptivePolicy,
    ReferenceModel,
    design_model,
    reference_model,
    reference_servo,
    simvfa_design,
)

ANGLES = np.radians([0.0, 11.0, 20.0])


@pytest.mark.parametrize("order", [1, 2])
def test_error_of_the_mixed_output_is_positive_real(published_aircraft: Model, order: int) -> None:
    """The error of the mixed output is strictly positive real above 0.12 rad/s.

    H + H* is positive definite, where H = S C (iω - A + L C)⁻¹ B1. Below 0.1 rad/s, H + H* is
    positive definite for order 2 only. S C B1 is symmetric and positive definite, S is orthogonal,
    and A - L C is stable.
    """
    for angle in ANGLES:
        model = level_model(published_aircraft, angle)
        found = reference_model(
            design_model(published_aircraft, model, simvfa_design(f"simvfa-{order}"))
        )
        powers = [np.linalg.matrix_power(found.A, k) @ found.squared_up for k in range(order + 1)]
        B1 = sum(a * each for a, each in zip(ALPHAS[order], powers, strict=True))
        np.testing.assert_allclose(found.squared_up[:, :2], found.B)
        # The third input has the same relative degree as the others: no output responds before
        # derivative `order`.
        for k in range(order):
            moved = found.C @ np.linalg.matrix_power(found.A, k) @ found.squared_up
            assert np.abs(moved).max() < 1e-8 * np.linalg.norm(found.C @ powers[-1])
        mixed = found.S @ found.C @ B1
        np.testing.assert_allclose(mixed, mixed.T, atol=1e-9 * np.abs(mixed).max())
        assert np.linalg.eigvalsh(mixed).min() > 0.0
        np.testing.assert_allclose(found.S @ found.S.T, np.eye(3), atol=1e-12)
        loop = found.A - found.L @ found.C
        assert np.linalg.eigvals(loop).real.max() < 0.0

        def real_part(frequency: float) -> float:
            H = found.S @ found.C @ np.linalg.solve(1j * frequency * np.eye(len(loop)) - loop, B1)  # noqa: B023
            return float(np.linalg.eigvalsh(H + H.conj().T).min())

        assert min(real_part(frequency) for frequency in np.geomspace(0.12, 1e5, 40)) > 0.0
        assert (min(real_part(frequency) for frequency in np.logspace(-3, -1, 20)) > 0.0) == (
            order == 2
        )


def test_the_controller_consists_of_model_and_correction(published_aircraft: Model) -> None:
    """The controller consists of the reference model with gain, correction and integrals."""
    controller = reference_servo(published_aircraft, "simvfa-1", ANGLES[1:])
    model = level_model(published_aircraft, ANGLES[1])
    built = design_model(published_aircraft, model, simvfa_design("simvfa-1"))
    found = reference_model(built)
    A, B, C, D = controller.at(ANGLES[1])
    rng = np.random.default_rng(4)
    e, x, q, z, r = (rng.normal(size=size) for size in (2, 10, 1, 2, 2))
    rate = A @ np.concatenate([e, x]) + B @ np.concatenate([q, z, r])
    off = np.concatenate([q, e]) - found.C @ x
    expected = (
        found.A @ x - found.B @ found.K @ x + found.L @ off - np.concatenate([np.zeros(8), r])
    )
    np.testing.assert_allclose(rate, np.concatenate([z - r, expected]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(C @ np.concatenate([e, x]), -found.K @ x, atol=1e-12)
    assert not D.any()
    assert controller.command_filter == (0.5, 2.0)


MEASURED = np.array([0.3, -0.2, 0.5])
R = np.array([0.1, 0.4])
R_RATE = np.array([7.0, 7.0])
#: Breakpoints at 0.1 and 0.3 rad. The trim is at 0.15 rad, and the flight is at 0.2 rad, the mean
#: of both.
_ANGLES = np.array([0.1, 0.3])
_BEGUN = 0.15
_RISEN = 0.05
_INPUTS = ("aileron_outer", "elevator_center")


def random_models(seed: int, states: int) -> list[ReferenceModel]:
    rng = np.random.default_rng(seed)
    n = states
    shapes = ((n, n), (n, 2), (3, n), (2, n), (n, 3), (3, 3), (3, 3), (n, 3))
    return [ReferenceModel(*(rng.normal(size=shape) for shape in shapes)) for _ in range(2)]


def between(models: list[ReferenceModel]) -> tuple[np.ndarray, ...]:
    """Return A, B, K, L, S, R⁻¹ and squared-up B halfway between two reference models, and C.

    C is that of the first model.
    """
    names = ("A", "B", "K", "L", "S", "R_inverse", "squared_up")
    return (*(sum(getattr(each, name) for each in models) / 2 for name in names), models[0].C)


def law_of(kind: type[AdaptivePolicy], models: list[ReferenceModel]) -> AdaptivePolicy:
    outputs = SimpleNamespace(
        names=("pitch_rate", "dihedral", "A_z"), at=lambda seen: ca.DM(MEASURED)
    )
    commands = SimpleNamespace(at=lambda t: ca.DM(R), rate=lambda t: ca.DM(R_RATE))
    return kind("adaptive", commands, outputs, _BEGUN, _ANGLES, models, _INPUTS)  # type: ignore[arg-type]


def evaluated(law: AdaptivePolicy, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the inputs u that an adaptive law controls, and the time derivative of its memory."""
    states = ca.SX(6, 1)
    nothing = ca.SX(0, 1)
    states[4] = _RISEN
    seen = Measurements(states, states, nothing, nothing)
    y = ca.SX.sym("y", len(memory))
    of = [
        law.control(ca.SX(0), seen, y, nothing),
        law.memory_rate(ca.SX(0), seen, y, nothing, nothing),
    ]
    u, rate = (np.array(each).ravel() for each in ca.Function("law", [y], of)(memory))
    assert np.count_nonzero(u) == len(_INPUTS)
    return u[[INPUTS.index(name) for name in _INPUTS]], rate


def parts_of(memory: np.ndarray, shapes: tuple[tuple[int, int], ...]) -> list[np.ndarray]:
    """Return the parts of a memory as matrices of these shapes.

    The memory stores each matrix by columns.
    """
    ends = np.cumsum([rows * columns for rows, columns in shapes])[:-1]
    return [
        each.reshape(shape, order="F")
        for each, shape in zip(np.split(memory, ends), shapes, strict=True)
    ]


#: Shapes of the memory: integrals, x_m, v̄, x̄, Λ̂, Ψ1, Ψ2, ē, Ψm; matrices are stored by columns.
SHAPES_2 = ((2, 1), (10, 1), (2, 1), (8, 1), (2, 2), (6, 2), (8, 2), (3, 1), (3, 3))


def by_equations_2(y: np.ndarray, models: list[ReferenceModel]) -> tuple[np.ndarray, np.ndarray]:
    """Return u and the time derivative of the memory for the adaptive law of degree 2.

    They follow from the equations. Π f = f + f'/2, where f' is a central difference. The difference
    is exact, because f is a product of two factors.

    y: the memory
    """
    A, B, K, L, S, R_inverse, squared_up, C = between(models)
    integrals, x_m, v_bar, x_bar, _, _, _, e_bar, _ = parts_of(y, SHAPES_2)
    e_y = np.vstack([MEASURED[:1, None], integrals]) - C @ x_m
    mixed = S @ e_y
    v = -K @ x_m
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
            value: np.ndarray = product(*parts_of(y, SHAPES_2))
            return value

        result: np.ndarray = at(y) + (at(y + rate) - at(y - rate)) / 4
        return result

    u = operated(
        lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: (
            effect.T @ v - psi_1.T @ x[:6] - psi_2.T @ x
        )
    )
    added = squared_up @ operated(lambda i, m, v, x, effect, psi_1, psi_2, e, psi_m: psi_m.T @ e)
    rates[1] = A @ x_m + B @ v + L @ e_y + added - np.concatenate([np.zeros(8), R])[:, None]
    return u.ravel(), np.concatenate([each.ravel(order="F") for each in rates])


Signal = list[np.ndarray]


def tuner(rows: int, columns: int) -> tuple[tuple[int, int], ...]:
    return ((rows, columns),) * 3


#: Shapes of the memory: integrals, x_m; ē of two filters, Ψ4, Ψ5; ε, Ψ1; ε̄1, Λ̂2, ε̄12, Ψ6; x̄,
#: Ψ2, Ψ3, v̄, Λ̂.
SHAPES_3 = (
    *((2, 1), (12, 1)),
    *(*((3, 1),) * 4, *tuner(3, 3), *tuner(3, 3)),
    *((6, 1), *tuner(6, 2)),
    *((2, 1), (2, 1), (2, 2), (2, 1), (2, 1), *tuner(2, 2)),
    *((10, 1), (10, 1), *tuner(6, 2), *tuner(10, 2), (2, 1), (2, 1), *tuner(2, 2)),
)


def product(psi: Signal, x: Signal) -> Signal:
    """Return Ψ'x and its derivatives by Leibniz's rule.

    psi, x: a matrix and a vector, each with its derivatives
    """
    known = range(min(len(psi), len(x)))
    return [sum(comb(n, k) * psi[k].T @ x[n - k] for k in range(n + 1)) for n in known]  # type: ignore[misc]


def operated(psi: Signal, x: Signal) -> np.ndarray:
    """Return Π{Ψ'x} = α0 Ψ'x + α1 (Ψ'x)' + α2 (Ψ'x)''."""
    zeroth, first, second = product(psi, x)
    result: np.ndarray = A0 * zeroth + A1 * first + A2 * second
    return result


def by_equations_3(
    memory: np.ndarray, models: list[ReferenceModel]
) -> tuple[np.ndarray, np.ndarray]:
    """Return u and the time derivative of the memory for the adaptive law of degree 3.

    They follow from the equations.
    """
    A, B, K, L, S, R_inverse, squared_up, C = between(models)
    left = iter(parts_of(memory, SHAPES_3))
    rates = []

    def filtered(x: np.ndarray, state: list[np.ndarray]) -> Signal:
        """Return 1/Π x and its first two derivatives."""
        signal = [*state, (x - A0 * state[0] - A1 * state[1]) / A2]
        rates.extend(signal[1:])
        return signal

    def high(signal: Signal) -> Signal:
        """Return (α2 s + α1)/Π x and its derivatives, from 1/Π x and its derivatives."""
        return [A1 * one + A2 * other for one, other in pairwise(signal)]

    def tuned(
        gamma: float, regressor: np.ndarray, error: np.ndarray, state: list[np.ndarray]
    ) -> Signal:
        goal, X, X_rate = state
        g = 1 + MU * float((regressor**2).sum())
        bend = (goal - g * (A0 * X + A1 * X_rate)) / A2
        rates.extend([gamma * regressor @ error.T, X_rate, bend])
        return [A0 * g * each for each in (X, X_rate, bend)]

    def low(signal: Signal) -> Signal:
        """Return α2/Π x and its derivatives, from 1/Π x and its derivatives."""
        return [A2 * each for each in signal]

    def take(count: int) -> list[np.ndarray]:
        return [next(left) for _ in range(count)]

    def along(B3: np.ndarray, moved: np.ndarray, still: np.ndarray) -> np.ndarray:
        result: np.ndarray = A2 * A @ B3 @ moved + A1 * B3 @ moved + A2 * B3 @ still
        return result

    integrals, x = take(2)
    e_y = np.vstack([MEASURED[:1, None], integrals]) - C @ x
    mixed = S @ e_y
    pushed = L @ e_y
    v = -K @ x
    error = mixed[:2]
    rates += [MEASURED[1:, None] - R[:, None], np.zeros((12, 1))]  # x_m', below

    bar = filtered(R_inverse @ mixed, take(2))
    state = take(2)
    kept, rates[4:] = rates[4:], []  # ē12 is driven by Ψ4 and is part of its regressor
    psi_4 = tuned(1000.0, high(bar)[0] + A2 * state[0], mixed, take(3))
    of_4, rates[4:] = rates[4:], kept
    moved = product(psi_4, high(bar))[1]
    bar_12 = filtered(moved, state)
    rates += of_4
    psi_5 = tuned(1000.0, low(bar)[0], mixed, take(3))
    still = (
        A0 * psi_4[0].T @ high(bar)[0] + operated(psi_4, low(bar_12)) + operated(psi_5, low(bar))
    )
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

    commanded, commanded_rate = (
        np.vstack([np.zeros((10, 1)), -each[:, None]]) for each in (R, R_RATE)
    )
    rates[1] = A @ x + B @ v + commanded + pushed + F_e - F_eps
    slow = filtered(x[:10], take(2))
    third = (rates[1][:10] - A0 * slow[1] - A1 * slow[2]) / A2
    x_1 = [each[:6] for each in high([*slow, third])]
    psi_2 = tuned(0.2, x_1[0], error, take(3))
    psi_3 = tuned(0.2, low(slow)[0], error, take(3))
    v_bar = filtered(v, take(2))
    effect = tuned(-5000.0, v_bar[0], error, take(3))
    x_p = [x[:6], (A @ x + commanded)[:6], (A @ (A @ x + commanded - pushed) + commanded_rate)[:6]]
    u = (
        operated(effect, v_bar)
        - operated(psi_1, x_p)
        - operated(psi_2, x_1)
        - operated(psi_3, low(slow))
    )
    u -= (A1 * psi_1[1] + A2 * psi_1[2]).T @ drift
    return u.ravel(), np.concatenate([each.ravel(order="F") for each in rates])


@pytest.mark.parametrize(
    ("kind", "expected", "states", "ones"),
    [(AdaptiveDegree2, by_equations_2, 10, 2), (AdaptiveDegree3, by_equations_3, 12, 6)],
)
def test_an_adaptive_law_agrees_with_its_equations(
    kind: Any, expected: Any, states: int, ones: int
) -> None:
    """An adaptive law agrees with its equations at a random memory and for random models.

    In its initial memory, only the nominal effectiveness is nonzero.
    """
    models = random_models(5, states)
    law = law_of(kind, models)
    start = law.nominal_memory()
    at = np.random.default_rng(8).normal(size=len(start))
    for found, wanted in zip(evaluated(law, at), expected(at, models), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    assert np.count_nonzero(start) == ones
