"""ψ(z), its gradient, and the way between weights and matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from controller import basis
from controller.game.basis import BASES, PAPER_QUARTIC_CHANNELS, Basis
from hfa_model import LINEAR_STATES

ALL = [basis(name, 6) for name in BASES]


def taylor_slope(psi: Callable[[np.ndarray], np.ndarray], gradient: np.ndarray, z: np.ndarray) -> float:
    """Order of |ψ(z + h v) - ψ(z) - h ∂ψ v| in h: 2 for a right gradient, 1 for a wrong one."""
    v = np.random.default_rng(3).normal(size=z.shape)
    steps = np.array([1e-2, 1e-3])
    remainders = [np.linalg.norm(psi(z + h * v) - psi(z) - h * gradient @ v) for h in steps]
    return float(np.log(remainders[0] / remainders[1]) / np.log(steps[0] / steps[1]))


def test_quadratic_monomials_come_row_by_row() -> None:
    z = np.array([2.0, 3.0, 5.0])
    assert basis("quadratic", 3).psi(z).tolist() == [4.0, 6.0, 10.0, 9.0, 15.0, 25.0]
    assert basis("quadratic+linear", 3).psi(z).tolist() == [4.0, 6.0, 10.0, 9.0, 15.0, 25.0, 2.0, 3.0, 5.0]
    assert basis("quadratic+quartic", 3).psi(z)[6:].tolist() == [16.0, 81.0, 625.0]


def test_paper_basis_adds_the_stated_fourth_powers() -> None:
    z = np.arange(1.0, 7.0)
    extra = [z[LINEAR_STATES.index(name)] ** 4 for name in PAPER_QUARTIC_CHANNELS]
    assert basis("paper", 6).psi(z)[21:].tolist() == extra


@pytest.mark.parametrize("functions", ALL)
def test_gradient_has_second_order_remainder(functions: Basis) -> None:
    z = np.random.default_rng(1).normal(size=6)
    gradient = functions.gradient(z)
    assert taylor_slope(functions.psi, gradient, z) == pytest.approx(2.0, abs=0.05)
    gradient[4, 0] += 1.0
    assert taylor_slope(functions.psi, gradient, z) < 1.5


def test_many_states_at_once_are_each_state_alone() -> None:
    Z = np.random.default_rng(2).normal(size=(7, 6))
    for functions in ALL:
        assert np.array_equal(functions.psi(Z), np.array([functions.psi(z) for z in Z]))
        assert np.array_equal(functions.gradient(Z), np.array([functions.gradient(z) for z in Z]))


def test_weights_and_matrix_are_the_same_value_in_any_units() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 6))
    P, z, scales = root + root.T, rng.normal(size=6), 10.0 ** rng.uniform(-2.0, 2.0, 6)
    for functions in ALL:
        W = functions.weights(P)
        assert W @ functions.psi(z) == pytest.approx(z @ P @ z, rel=1e-13)
        assert np.array_equal(functions.matrix(W), P)
        assert np.array_equal(W[21:], np.zeros(functions.size - 21))
        W = rng.normal(size=functions.size)
        assert (functions.scaling(scales) * W) @ functions.psi(z) == pytest.approx(W @ functions.psi(scales * z))
