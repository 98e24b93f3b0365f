"""Proved numbers of eigenvalues on each side of the imaginary axis, or open ones."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, arb_mat

from hfa_prove.enclosure.balls import lowest_sign, matrix
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.search.lines import bounds_of_modes, find_line, lines_near_axis


def unstable_modes(A: arb_mat) -> int | None:
    proof = find_line(TaylorModel(A))
    return None if proof is None else proof[0]


def widened(A: np.ndarray, radii: np.ndarray) -> arb_mat:
    return arb_mat(
        [[arb(a, r) for a, r in zip(*rows, strict=True)] for rows in zip(A, radii, strict=True)]
    )


@pytest.mark.parametrize(("real_part", "count"), [(-1e-9, 1), (1e-9, 3), (-1.0, 1), (1.0, 3)])
def test_eigenvalues_close_to_the_axis_are_counted(real_part: float, count: int) -> None:
    """The unstable modes of a matrix with six modes are counted with a pair close to the axis.

    real_part: real part of this pair
    """
    blocks = np.diag([-3.0, -10.0, 2.0, -0.5, real_part, real_part])
    blocks[4, 5], blocks[5, 4] = 1.0, -1.0
    mixing = np.random.default_rng(1).standard_normal((6, 6))
    assert unstable_modes(matrix(mixing @ blocks @ np.linalg.inv(mixing))) == count


@pytest.mark.parametrize(
    "A",
    [
        [[-1.0, 0.0, 1.0], [0.0, -2.0, 0.0], [0.0, 0.0, 0.0]],
        [[-1.0, 0.0, 1.0], [0.0, -2.0, 0.0], [0.0, 0.0, -0.0]],
        [[0.0, 1.0], [-1.0, 0.0]],
        [[-1.0, 5.0], [0.0, 0.0]],
    ],
)
def test_an_eigenvalue_on_the_axis_is_undecided(A: list[list[float]]) -> None:
    """For a matrix with an eigenvalue on the imaginary axis, no number of unstable modes is
    returned.
    """
    assert unstable_modes(matrix(A)) is None


def test_balls_of_mixed_stability_are_left_open() -> None:
    """The number of unstable modes is left open for a ball of stable and unstable matrices.

    For a matrix with dependent eigenvectors, the number is correct or left open.
    """
    A = np.diag([-1.0, -1e-9])
    assert unstable_modes(matrix(A)) == 0
    assert unstable_modes(widened(A, np.full((2, 2), 2e-9))) is None
    assert unstable_modes(matrix(np.array([[-1.0, 1.0], [0.0, -1.0]]))) in (0, None)


def test_modes_of_a_perturbed_matrix_are_counted() -> None:
    """The unstable modes of A + E with |E| <= N are counted if the spectral radius of |Re λ|⁻¹ N is
    below 1.

    Here, the scaling |Re λ|⁻¹ alone does not prove the number.
    """
    A = np.diag([-1.0, -1.5])
    N = np.array([[0.0, 2.0], [0.3, 0.0]])
    assert unstable_modes(widened(A, N)) == 0
    worst = (A + N) / -np.diag(A)[:, None]
    assert np.linalg.eigvalsh(worst + worst.T)[-1] > 0.0


@pytest.mark.parametrize(
    ("A", "bounds"),
    [
        ([[0.0, 1.0], [0.0, 0.0]], (0, 2)),
        ([[-1.0, 0.0, 1.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]], (1, 2)),
        ([[-1.0, 1.0], [0.0, -1.0]], (0, 0)),
    ],
)
def test_modes_on_the_axis_have_two_bounds(A: list[list[float]], bounds: tuple[int, int]) -> None:
    """The number of unstable modes is bounded from both sides if modes are on the axis.

    An example is the double integrator, whose eigenvectors are dependent.
    """
    found, lines = bounds_of_modes(TaylorModel(matrix(A)))
    assert found == bounds
    assert len(lines) == 2 - (bounds[0] == bounds[1])


def test_the_nearest_line_on_each_side_of_the_axis_is_found() -> None:
    """Lines lie halfway or at a third between eigenvalues; the one nearest to the axis is used."""
    A = TaylorModel(matrix(np.diag([-2.0, 0.0, 3.0])))
    assert [line.rate for line in lines_near_axis(A)] == pytest.approx([-1.0, 1.0])
    right = TaylorModel(matrix(np.diag([0.0, 0.5])))
    assert [line.rate for line in lines_near_axis(right)] == pytest.approx([-1.0 / 6.0, 1.0])


@pytest.mark.parametrize(
    ("Q", "sign"),
    [
        (np.eye(3), 1),
        (np.diag([1e12, -0.2]), -1),
        (np.diag([1.0, 0.0]), 0),
        (np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), 0),
        (np.array([[1.0, 1.0], [1.0, np.nextafter(1.0, 0.0)]]), -1),
        (np.array([[0.0, 1e-300], [1e-300, 1.0]]), -1),
        (np.outer([1.0, 2.0, -0.5], [1.0, 2.0, -0.5]), 0),
    ],
)
def test_the_sign_of_lowest_eigenvalue_is_decided_exactly(Q: np.ndarray, sign: int) -> None:
    """The sign of the lowest eigenvalue is decided exactly."""
    assert lowest_sign(Q) == sign
