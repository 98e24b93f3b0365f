"""Continuous-time Riccati equations of the CAREX collection with solutions in closed form.

Source of the equations, solutions and numbers: Benner, Laub, Mehrmann, A collection of benchmark
examples for the numerical solution of algebraic Riccati equations I: continuous-time case, SPC
95_22 (1995).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from hfa import Game, solve


def equation(A: object, B: object, Q: object, R: object) -> Game:
    A = np.array(A, float)
    return Game(
        A=A,
        B=np.array(B, float),
        Q=np.array(Q, float),
        R=np.array(R, float),
        E=np.eye(len(A)),
        delta=math.inf,
    )


# Examples without a closed form: checked by their residual.

#: Examples contained as files in SciPy's tests.
_FILES = (6, 15, 18, 19)


def remainder(game: Game, P: np.ndarray) -> float:
    """Return |A'P + P A + Q - P S P| divided by its largest term, in extended precision."""
    A, Q, S, X = (each.astype(np.longdouble) for each in (game.A, game.Q, game.S, P))
    terms = [A.T @ X, X @ A, Q, -X @ S @ X]
    return float(np.abs(sum(terms)).max() / max(np.abs(each).max() for each in terms))


def filed(number: int) -> Game:
    file = Path(scipy.linalg.__file__).parent / f"tests/data/carex_{number}_data.npz"
    if not file.exists():
        pytest.skip("this SciPy comes without its tests")
    with np.load(file) as data:
        return equation(*(np.atleast_2d(data[name]) for name in "ABQR"))


@pytest.mark.slow
@pytest.mark.parametrize("number", _FILES)
def test_large_games_satisfy_their_riccati_equations(number: int) -> None:
    """P of a game with 30 to 100 states satisfies its Riccati equation to 1e-12 and stabilizes."""
    game = filed(number)
    P = solve(game).P
    assert remainder(game, P) <= 1e-12
    assert np.linalg.eigvals(game.A - game.S @ P).real.max() < 0.0
