"""The sum-of-squares solver, on problems with known solutions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from hfa_prove.search.squares import Degrees, Group, Matrix, Terms, minimized, positive, products_of


def _correlations(diagonal: float) -> Group:
    """Return the three equations of Q = [diagonal, t; t, 1] for the unknowns t and Q, (2, 2)."""
    products = products_of(2, 1, 1)
    assert products.keys.tolist() == [2, 17, 32]  # x², x y, y²
    shares = np.array([[1, 0, 0], [0, 0, 1], [0, 0.5, 0]], dtype=float)
    E = np.array([[0.0], [0.0], [-1.0]])
    return Group(E, np.array([diagonal, 1.0, 0.0]), [Matrix(products, sp.csr_matrix(shares))])


def test_the_largest_semidefinite_entry_is_found() -> None:
    """The solver finds the largest entry for which a matrix is positive semidefinite."""
    point = minimized([_correlations(4.0)], np.array([-1.0]))
    assert point is not None
    assert point.f[0] == pytest.approx(2.0, abs=1e-7)
    assert np.allclose(point.matrices[0][0], [[4.0, 2.0], [2.0, 1.0]], atol=1e-7)


def test_free_variables_satisfy_both_groups() -> None:
    """The free variable satisfies the constraints of both groups."""
    point = minimized([_correlations(4.0), _correlations(0.25)], np.array([-1.0]))
    assert point is not None
    assert point.f[0] == pytest.approx(0.5, abs=1e-7)


def test_infeasible_problems_have_no_point() -> None:
    """For an infeasible problem, None is returned."""
    assert minimized([_correlations(-1.0)], np.array([-1.0])) is None


def test_a_search_ends_when_enough_returns_true() -> None:
    """The search ends in the iteration in which `enough` returns True."""
    group = _correlations(4.0)
    asked: list[float] = []

    def enough(cost: float, bound: float) -> bool:
        asked.append(bound)
        return len(asked) == 2

    minimized([group], np.array([-1.0]), enough=enough)
    assert len(asked) == 2


def test_margin_of_sum_of_squares_is_smallest_eigenvalue() -> None:
    """The margin of a sum of squares is its smallest eigenvalue.

    A polynomial with negative values has none.
    """
    # x² - 2 c x + 1 in the monomials 1 and x: eigenvalues 1 + c and 1 - c.
    target = Terms(np.array([0, 1, 2]), np.array([1.0, -1.9998, 1.0]) / 1.9998)
    found = positive(target, [], Degrees(0, 1), 1)
    assert found is not None
    assert found[0] == pytest.approx(1e-4 / 1.9998, abs=2e-8)
    refused = positive(Terms(np.array([0, 1, 2]), np.array([1.0, -2.1, 1.0])), [], Degrees(0, 1), 1)
    assert refused is None or refused[0] < 0.0


@pytest.mark.parametrize("highest", [2, 5])
def test_the_schur_matrix_equals_its_trace_formula(highest: int) -> None:
    """The Schur matrix, computed by degrees and blocks, has the entries tr(H_i Z⁻¹ H_j Q)."""
    products = products_of(3, 0, highest)
    n = products.size
    assert (len(products.blocks) > 2 * highest + 1) == (highest == 5)  # blocks of one degree
    half = np.random.default_rng(0).normal(size=(2, n, n))
    Q, inverse = half @ half.mT
    H = products.sums.toarray().reshape(-1, n, n)
    expected = np.einsum("iab,bc,jcd,da->ij", H, inverse, H, Q, optimize=True)
    assert np.allclose(products.schur(Q, inverse), expected, rtol=1e-12)
