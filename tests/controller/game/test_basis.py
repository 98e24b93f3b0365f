"""Bases of critics: ψ(z) and its gradient, the weights of P, and the order of the monomials."""

import numpy as np
import pytest
from cli import refused

from controller import basis
from controller.game.basis import BASES, bases_of_size
from hfa_model import LINEAR_STATES

#: States with fourth powers in the paper's basis.
QUARTIC = ("speed", "alpha", "pitch_rate", "dihedral")


def test_quadratic_monomials_come_first_row_by_row():
    """The quadratic monomials of a basis come first, row by row, and the other monomials follow."""
    z = np.array([2.0, 3.0, 5.0])
    squares = [4.0, 6.0, 10.0, 9.0, 15.0, 25.0]
    cubes = [8.0, 12.0, 20.0, 18.0, 30.0, 50.0, 27.0, 45.0, 75.0, 125.0]
    assert basis("quadratic+linear", 3).psi(z).tolist() == [*squares, *z]
    assert basis("quadratic+quartic", 3).psi(z).tolist() == [*squares, 16.0, 81.0, 625.0]
    assert basis("cubic", 3).psi(z).tolist() == [*squares, *cubes]
    z = np.arange(1.0, 7.0)
    extra = [z[LINEAR_STATES.index(name)] ** 4 for name in QUARTIC]
    assert basis("paper", 6).psi(z)[21:].tolist() == extra
    for name, states, said in (("paper", 4, "6 states"), ("quadratic", 0, "at least 1 state")):
        assert said in refused(basis, name, states)


@pytest.mark.parametrize("name", BASES)
def test_a_basis_is_that_of_its_exponents(name):
    """ψ, its gradient by differences, weights of P, scales, and the names of bases of this size."""
    n = 6 if name == "paper" else 3
    psi, random = basis(name, n), np.random.default_rng(1)
    z, scales = random.normal(size=(4, n)), random.uniform(0.5, 2.0, n)
    z[0, 0] = 0.0
    np.testing.assert_allclose(psi.psi(z), np.prod(z[:, None] ** psi.exponents, axis=2))
    for i, step in enumerate(1e-6 * np.eye(n)):
        slope = (psi.psi(z + step) - psi.psi(z - step)) / 2e-6
        np.testing.assert_allclose(psi.gradient(z)[..., i], slope, atol=1e-7)
    P = random.normal(size=(n, n))
    P += P.T
    weights = psi.weights(P)
    np.testing.assert_allclose(psi.psi(z) @ weights, np.einsum("ji,ik,jk->j", z, P, z))
    np.testing.assert_allclose(psi.matrix(weights), P)
    np.testing.assert_allclose(psi.psi(scales * z), psi.scaling(scales) * psi.psi(z))
    assert (psi.size, psi.states) == psi.exponents.shape
    assert name in bases_of_size(psi.size, n)
    assert name not in bases_of_size(psi.size + 1, n)
