"""Bounds by balls hold for all matrices in the balls, and balls are stored."""

import multiprocessing
import threading
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from flint import arb, arb_mat

from controller.riccati.balls import (
    BITS,
    Near,
    Pair,
    ball_matrix,
    is_positive_definite,
    norm,
    precision,
    radii,
    symmetric,
)
from hfa import Game, solve


def test_norms_are_upper_bounds():
    """The norm of a matrix is at most its bound, for all matrices in the balls.

    With an undefined row, there is no finite bound.
    """
    with precision(256):
        for seed in range(5):
            matrix = np.random.default_rng(seed).standard_normal((4, 4))
            corner = matrix + 0.1 * np.sign(matrix)
            wide = ball_matrix(matrix) + ball_matrix(np.full((4, 4), 0.1)) * arb(0, 1)
            assert norm(wide) >= arb(np.linalg.norm(corner))
        assert norm(ball_matrix(np.diag([1e-300, 1e-200]))) >= arb(1e-200)
        assert norm(ball_matrix(np.zeros((1, 1))) + arb_mat([[arb(0, 1e-300)]])) >= arb(1e-300)
        for rows in ([1.0, np.nan], [np.nan, 1.0]):
            assert not norm(ball_matrix(np.diag(rows))).is_finite()


def test_radii_are_rounded_up():
    """Radii below the smallest double are not 0, and those of exact numbers are."""
    with precision(256):
        found = radii(arb_mat([[arb(1), arb(1, arb("3e-300")), arb(1, arb("1e-400"))]]))
    assert found[0, 0] == 0.0
    assert 3e-300 <= found[0, 1] <= 3.1e-300
    assert found[0, 2] == 5e-324


def test_only_positive_matrices_are_proved_positive():
    """A matrix of balls is positive only if every symmetric matrix in it is positive definite."""
    with precision(256):
        modes = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
        for least, size, expected in (
            (0.1, 0.0, True),
            (-1e-13, 0.0, False),
            (0.1, 1e-3, True),
            (0.1, 0.5, None),
        ):
            middle = symmetric(ball_matrix(modes @ np.diag([least, 1.0, 2.0, 3.0]) @ modes.T))
            around = middle + ball_matrix(np.full((4, 4), size)) * arb(0, 1)
            assert is_positive_definite(around) is expected
        for middle, expected in ((2.0, True), (0.5, None), (-2.0, False)):
            last = arb(middle, 1.0)
            assert is_positive_definite(arb_mat([[arb(4), arb(2)], [arb(2), last + 1]])) is expected
        for last in (np.nan, 0.0):
            assert is_positive_definite(ball_matrix(np.diag([1.0, last]))) is None


def test_balls_about_doubles_contain_all_results():
    """The sum, product and inverse of matrices of doubles are in the balls."""
    rng = np.random.default_rng(4)
    for scale in (1.0, 1e-160, 1e-320):
        A, B = (rng.standard_normal((4, 4)) for _ in range(2))
        left, right = Near(A), Near(scale * B)
        with precision(600):
            a, b = ball_matrix(A), ball_matrix(scale * B)
            for found, exact in (
                (left + right, a + b),
                (left * right, a * b),
                (left * 0.3, a * 0.3),
                (left.inv(), a.inv()),
                (Near.of(a / 3), a / 3),
            ):
                assert norm(exact - ball_matrix(found.middle)) <= arb(found.error)


@pytest.mark.parametrize("n", [1, 5, 64, 65])
def test_balls_about_pairs_of_doubles_have_twice_the_digits(n):
    """Sums and products of pairs are in their balls, whose radius is below 1e-28 of the factors.

    The entries are all nearly as large as possible, random, or of very different size.
    """
    rng = np.random.default_rng(n)
    nearly_1 = 1.0 - 2.0**-12 * rng.random((n, n))
    units = 10.0 ** rng.uniform(-40.0, 40.0, n)
    for A in (nearly_1, rng.standard_normal((n, n)), rng.standard_normal((n, n)) * units):
        right = rng.standard_normal((n, n)) / units[:, None] if A is not nearly_1 else nearly_1
        with precision(700):
            third = ball_matrix(A) / 3
            for a, left in ((ball_matrix(A), Pair.of(A)), (third, Pair.of(third))):
                b, other = ball_matrix(right), Pair.of(right)
                for found, exact, size in (
                    (left * other, a * b, norm(a) * norm(b)),
                    (left + other, a + b, norm(a) + norm(b)),
                    (left - other * left, a - b * a, norm(a) * (1 + norm(b))),
                ):
                    middle = ball_matrix(found.high) + ball_matrix(found.low)
                    assert norm(exact - middle) <= arb(found.error) <= arb("1e-28") * size
            wide = Pair(A, 0.0 * A, float(np.linalg.norm(A)))
            for found, exact in (
                (wide * other, ball_matrix(1.9 * A) * b),
                (other * wide, b * ball_matrix(1.9 * A)),
            ):
                assert norm(exact - ball_matrix(found.high)) <= arb(found.error)


@pytest.mark.parametrize("kind", [Near, Pair])
def test_wide_balls_contain_the_results_at_their_ends(kind):
    """The ball of a result contains that of the ends of wide balls, in which no bound has room."""
    with precision(200):
        for a, b in product((3.0, -0.2, 1.0 / 3.0), repeat=2):
            left, right = (kind.of(Near(np.array([[each]]), 0.0)) for each in (a, b))
            wide_left, wide_right = (replace(each, error=0.5) for each in (left, right))
            tall = Pair(np.array([[a]]), np.array([[b]]), 0.5)
            for s, t in product((-0.5, 0.0, 0.5), repeat=2):
                pair = (wide_left, wide_right) if s or t else (left, right)
                x, y = arb(a) + s, arb(b) + t
                for found, exact in (
                    (pair[0] + pair[1], x + y),
                    (pair[0] - pair[1], x - y),
                    (pair[0] * pair[1], x * y),
                    (tall, x + b),
                ):
                    near = Near.of(found)
                    assert ball_matrix(found)[0, 0].contains(exact)
                    assert ball_matrix(near)[0, 0].contains(exact)
                    assert arb(near.size) >= abs(exact)
        for middle in (2.0, -0.3):
            wide = Near(np.array([[middle]]), 0.49 * abs(middle))
            for end in (-0.49, 0.49):
                assert ball_matrix(wide.inv())[0, 0].contains(1 / (arb(middle) * (1 + arb(end))))
                assert ball_matrix(wide * 0.3)[0, 0].contains(arb(middle) * (1 + arb(end)) * 0.3)
            with pytest.raises(ZeroDivisionError):
                Near(np.array([[middle]]), abs(middle)).inv()


def test_a_product_of_tiny_and_large_pairs_is_in_its_ball():
    """The ball of a product contains it where the squares of the entries of a factor underflow."""
    with precision(700):
        tiny, large = (
            Pair.of(ball_matrix(np.array([[size]])) / 3).mid() for size in (1e-170, 1e140)
        )
        for found in (tiny * large, large * tiny):
            exact = ball_matrix(tiny) * ball_matrix(large)
            assert norm(exact - ball_matrix(found.mid())) <= arb(found.error)


GAME = Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0])


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_does_not_wait_for_a_thread_of_its_parent():
    """A process that is forked while another thread computes with balls solves a game."""
    begun, ended = threading.Event(), threading.Event()

    def compute():
        with precision(BITS):
            begun.set()
            ended.wait()

    threading.Thread(target=compute, daemon=True).start()
    assert begun.wait(timeout=10.0)
    process = multiprocessing.get_context("fork").Process(target=solve, args=(GAME,), daemon=True)
    process.start()
    process.join(timeout=20.0)
    ended.set()
    assert process.exitcode == 0
