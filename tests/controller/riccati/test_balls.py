"""Balls in doubles contain what the arithmetic of FLINT computes with many bits."""

import copy
import pickle

import numpy as np
import pytest
from flint import arb, arb_mat, fmpq

from controller.riccati.balls import (
    Balls,
    DoubleBalls,
    ball_matrix,
    is_positive_definite,
    make_balls_picklable,
    midpoints,
    precision,
)

make_balls_picklable()

#: Sums of thirds cancel: only their last digits remain.
OPERATIONS = {
    "sum": lambda left, right: left + right,
    "difference": lambda left, right: left - right,
    "product": lambda left, right: left @ right,
    "transpose": lambda left, right: left.T @ right.T,
    "multiple": lambda left, right: left * (arb(1) / 3),
    "beside": lambda left, right: left.beside(right),
    "block": lambda left, right: (-left).block(slice(1, 3), slice(2)),
}


def samples(seed):
    """Return two matrices of thirds, (4, 4), whose differences and products nearly cancel."""
    rng = np.random.default_rng(seed)
    third = arb(1) / 3
    numbers = rng.integers(-9, 10, (4, 4)).astype(float)
    first = ball_matrix(numbers) * third
    second = first + ball_matrix(rng.standard_normal((4, 4)) * 2.0**-50)
    return [first.mid(), second.mid()]


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("radius", [None, 0.0, 1e-3])
def test_an_operation_contains_the_exact_result(operation, seed, radius):
    """The result contains those of exact doubles, of thirds in balls, and of corners of wide balls."""
    compute = OPERATIONS[operation]
    with precision(256):
        exact = samples(seed)
        if radius is None:
            radius, exact = 0.0, [ball_matrix(midpoints(each)) for each in exact]
            wide = [DoubleBalls.of(midpoints(each)) for each in exact]
        else:
            wide = [DoubleBalls.of(each) for each in exact]
        wide = [DoubleBalls(each.midpoint, each.radius + radius) for each in wide]
        found = compute(*wide)
        ones = ball_matrix(np.ones((4, 4)) * radius)
        for signs in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            moved = [Balls(each + ones * sign) for each, sign in zip(exact, signs, strict=True)]
            result = compute(*moved).matrix
            error = result - ball_matrix(found.midpoint)
            limits = ball_matrix(found.radius).entries()
            assert all(abs(e) <= limit for e, limit in zip(error.entries(), limits, strict=True))


@pytest.mark.parametrize("arithmetic", [Balls, DoubleBalls])
def test_norms_are_upper_bounds(arithmetic):
    """Norms of a matrix and of its inverse are at most their bounds, also beside a tiny row.

    With an undefined row, or without an inverse, there is no finite bound.
    """
    with precision(256):
        for seed in range(5):
            matrix = np.random.default_rng(seed).standard_normal((4, 4))
            values = np.linalg.svd(matrix, compute_uv=False)
            balls = arithmetic.of(matrix)
            assert balls.norm() >= arb(values[0] * (1 - 1e-12))
            assert balls.inverse_norm() >= arb((1 - 1e-9) / values[-1])
        assert arithmetic.of(np.diag([1e-300, 1e-200])).norm() >= arb(1e-200)
        for rows in ([1.0, np.nan], [np.nan, 1.0]):
            assert not arithmetic.of(np.diag(rows)).norm().is_finite()
        assert not arithmetic.of(np.ones((2, 2))).inverse_norm().is_finite()


@pytest.mark.parametrize("arithmetic", [Balls, DoubleBalls])
def test_only_positive_matrices_are_proved_positive(arithmetic):
    """A matrix of balls is positive only if every matrix in it is positive definite."""
    with precision(256):
        for seed in range(5):
            modes = np.linalg.qr(np.random.default_rng(seed).standard_normal((4, 4)))[0]
            for least, is_positive in ((0.1, True), (-1e-3, False), (-1e-13, False)):
                matrix = modes @ np.diag([least, 1.0, 2.0, 3.0]) @ modes.T
                balls = arithmetic.of((matrix + matrix.T) / 2.0)
                assert balls.is_positive_definite() == is_positive
            middle = ball_matrix((modes @ np.diag([0.1, 1.0, 2.0, 3.0]) @ modes.T).round(6))
            middle = (middle + middle.transpose()) * 0.5
            for size, is_positive in ((1e-3, True), (0.5, False)):
                around = arithmetic.around(middle.mid(), [arb(size)] * 4)
                assert around.is_positive_definite() == is_positive
        assert not arithmetic.of(np.ones((2, 2))).is_positive_definite()
        for middle, expected in ((2.0, True), (0.5, None), (-2.0, False)):
            last = arb(middle, 1.0)
            assert is_positive_definite(arb_mat([[arb(4), arb(2)], [arb(2), last + 1]])) is expected
        assert not arithmetic.of(np.diag([1.0, np.nan])).is_positive_definite()
        assert not arithmetic.of(np.diag([1.0, 0.0])).is_positive_definite()


@pytest.mark.parametrize("text", ["0.1 +/- 1e-9", "1/3 +/- 1e-70", "-2", "0", "0 +/- 3e-300"])
@pytest.mark.parametrize("again", [lambda ball: pickle.loads(pickle.dumps(ball)), copy.deepcopy])
def test_a_pickled_ball_contains_the_ball_and_hardly_more(text, again):
    """The radius is at most 2^-27 larger, and the midpoint is the same.

    The process that reads the ball may have fewer bits than the ball.
    """
    middle, _, radius = text.partition(" +/- ")
    with precision(300):
        ball = arb(fmpq(*map(int, middle.split("/")))) if "/" in middle else arb(middle)
        ball += arb(0, radius or "0")
    restored = again(arb_mat([[ball, 1]]))[0, 0]
    assert restored.mid() == ball.mid()
    assert ball.rad() <= restored.rad() <= ball.rad() * (1.0 + 2.0**-27)


def test_balls_that_are_not_finite_can_be_pickled():
    with precision(128):
        balls = [arb("inf"), arb("-inf"), arb("nan"), arb(2, "inf")]
    restored = pickle.loads(pickle.dumps(balls))
    assert restored[0] > 1e300
    assert restored[1] < -1e300
    assert [ball.is_finite() for ball in restored] == [False] * 4
    assert [repr(ball.mid()) for ball in restored] == [repr(ball.mid()) for ball in balls]


def test_both_triangles_of_a_ball_count():
    """The symmetric matrix in this ball is that with 0.8 beside the diagonal, which is indefinite:
    the midpoints of one triangle, with the radii of the other, do not prove otherwise.
    """
    beside = 0.8 * np.eye(3, k=1)
    for middle, radius in ((beside, beside.T), (beside.T, beside)):
        assert not DoubleBalls(np.eye(3) + middle, radius).is_positive_definite()
