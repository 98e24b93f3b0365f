"""Eigenvalues counted on both sides of the axis, proved."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb

from verification.arithmetic import flint_or_refusal
from verification.arithmetic.balls import exact, filled, matrix, symmetric
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import roomy
from verification.enclosures.game_balls import is_hurwitz, unstable_modes


def plant(real_part: float) -> np.ndarray:
    """Six modes, the slowest a pair with this real part, in coordinates that mix them."""
    blocks = np.diag([-3.0, -10.0, 2.0, -0.5, real_part, real_part])
    blocks[4, 5], blocks[5, 4] = 1.0, -1.0
    mixing = np.random.default_rng(1).standard_normal((6, 6))
    return mixing @ blocks @ np.linalg.inv(mixing)


@pytest.mark.parametrize(("real_part", "count"), [(-1e-9, 1), (1e-9, 3), (-1.0, 1), (1.0, 3)])
def test_eigenvalues_close_to_the_axis_are_counted(real_part: float, count: int) -> None:
    flint_or_refusal()
    assert unstable_modes(matrix(plant(real_part))) == count


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_an_eigenvalue_at_zero_is_left_open(zero: float) -> None:
    flint_or_refusal()
    A = np.diag([-1.0, -2.0, zero])
    A[0, 2] = 1.0
    assert unstable_modes(matrix(A)) is None
    oscillator = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert unstable_modes(matrix(oscillator)) is None


@pytest.mark.parametrize(("value", "expected"), [(-1e-9, True), (1e-9, False), (0.0, False)])
def test_one_real_eigenvalue_decides(value: float, expected: bool) -> None:
    flint_or_refusal()
    assert is_hurwitz(matrix(np.array([[-1.0, 5.0], [0.0, value]]))) is expected


def test_a_ball_that_holds_both_is_left_open() -> None:
    flint_or_refusal()
    A = matrix(np.diag([-1.0, -1e-9]))
    assert unstable_modes(A) == 0
    assert unstable_modes(A + filled(2, 2, symmetric(exact(2e-9)))) is None


def test_dependent_eigenvectors_are_left_open() -> None:
    flint_or_refusal()
    assert unstable_modes(matrix(np.array([[-1.0, 1.0], [0.0, -1.0]]))) in (0, None)


def test_additions_that_do_less_than_their_entries_could_are_counted() -> None:
    """|E| <= N with a spectral radius of |Re λ|⁻¹ N below 1, though |Re λ|⁻¹ does not prove it."""
    flint_or_refusal()
    A, N = np.diag([-1.0, -1.5]), np.array([[0.0, 2.0], [0.3, 0.0]])
    balls = matrix(A)
    for (i, j), size in np.ndenumerate(N):
        balls[i, j] += symmetric(exact(size))
    assert unstable_modes(balls) == 0
    worst = (A + N) / -np.diag(A)[:, None]
    assert np.linalg.eigvalsh(worst + worst.T)[-1] > 0.0


def test_a_roomy_model_is_the_same_but_for_a_larger_rest() -> None:
    model = TaylorModel(arb(1), arb(2), arb(3), arb(0, 0.25), arb(4))
    c0, c1, c2, rest, error = roomy(model).parts
    assert (c0, c1, c2, error) == (arb(1), arb(2), arb(3), arb(4))
    assert rest.contains(model.parts[3])
    assert float(rest.rad()) == pytest.approx(1.5)
