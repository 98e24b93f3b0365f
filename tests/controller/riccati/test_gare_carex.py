"""Continuous-time Riccati equations of the CAREX collection with solutions in closed form.

Source of the equations, solutions and numbers: Benner, Laub, Mehrmann, A collection of benchmark
examples for the numerical solution of algebraic Riccati equations I: continuous-time case, SPC
95_22 (1995).
"""

import math

import numpy as np
import pytest

from hfa import Game, solve

#: Largest error, relative to the largest entry of X. The scaled examples test X with a condition
#: number of about 1e16.
EXACT = 1e-14


def known_solutions():
    """Yield (number and parameter of the example, its game, its solution P)."""
    for small in (1.0, 1e-8):  # (A, B) loses stabilizability
        root = math.sqrt(1.0 + small**2)
        corner = 1.0 / (2.0 + root)
        X = np.array(
            [[(1.0 + root) / small**2, corner], [corner, 0.25 * (1.0 - (small * corner) ** 2)]]
        )
        yield f"7, {small:g}", Game(np.diag([1, -2]), [[small], [0]], Q=np.ones((2, 2)), R=[1]), X
    for size in (1e-6, 1e6):
        root = math.sqrt(1.0 + 2.0 * size)
        yield (
            f"9, {size:g}",
            Game([[0, size], [0, 0]], [[0], [1]], Q=np.eye(2), R=[1]),
            np.array([[root / size, 1], [1, root]]),
        )
    for small in (1.0, 1e-5):  # the closed loop approaches the imaginary axis
        a = small + 1.0
        x = 0.5 * (2.0 * a + math.sqrt(2.0 * a**2 + 2.0) + math.sqrt(2.0) * small)
        X = np.array([[x, x / (x - a)], [x / (x - a), x]])
        yield (
            f"10, {small:g}",
            Game([[a, 1], [1, a]], np.eye(2), Q=small**2 * np.eye(2), R=np.eye(2)),
            X,
        )
    V = np.eye(3) - 2.0 / 3.0
    for size in (1.0, 1e6):
        cost = np.array([1.0 / size, 1.0, size])
        rates = size * np.array([1.0, 2.0, 3.0])
        X = V @ np.diag(size * (rates + np.sqrt(rates**2 + cost / size))) @ V
        game = Game(V @ np.diag(rates) @ V, np.eye(3), Q=V @ np.diag(cost) @ V, R=size * np.eye(3))
        yield f"12, {size:g}", game, X


@pytest.mark.parametrize(
    ("game", "X"), [pytest.param(game, X, id=name) for name, game, X in known_solutions()]
)
def test_known_carex_solutions_are_found(game, X):
    """P agrees with the closed form."""
    assert np.abs(solve(game).P - X).max() <= EXACT * np.abs(X).max()


# Examples without a closed form: checked by their residual.
