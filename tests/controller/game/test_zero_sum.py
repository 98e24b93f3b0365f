"""The game as a value: what it refuses, and the policies that follow from a value matrix."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from game_samples import game_models

from controller import Game, published_game
from hfa_model import published_models
from hfa_support import BadInputError

SMALL: dict[str, Any] = {
    "A": [[0.0, 1.0], [-2.0, -3.0]],
    "B": [[0.0], [1.0]],
    "E": [[1.0], [0.5]],
    "Q": [[2.0, 0.0], [0.0, 1.0]],
    "R": [[4.0]],
    "delta": 2.0,
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": [[1.0, 2.0]]}, "A is 1 x 2; it must be square"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A does not consist of rows of real numbers"),
        ({"A": np.ma.masked_equal(np.eye(2), 0.0)}, "A has masked entries"),
        ({"A": [[1.0, math.nan], [0.0, 1.0]]}, r"A\[0\]\[1\] is nan; every entry must be finite"),
        ({"A": [[1e150, 0.0], [0.0, 1.0]]}, r"A\[0\]\[0\] is 1e\+150; entries must not exceed 1e\+100"),
        ({"A": np.zeros((0, 0))}, "a game needs a state and an input"),
        ({"B": [[1.0]]}, "B is 1 x 1; with this A and B it must be 2 x 1"),
        ({"Q": [[1.0, 0.1], [0.0, 1.0]]}, "Q is not symmetric"),
        ({"Q": [[1.0, 0.0], [0.0, -1.0]]}, "Q is not positive semidefinite"),
        ({"B": np.eye(2), "R": [[0.1, 0.3], [0.3, 0.9]]}, "R is not positive definite"),
        ({"B": np.eye(2), "R": [[1e20, 1e10], [1e10, 1.0]]}, "R is not positive definite"),
        ({"delta": 0.0}, "delta is 0.0; it must be a positive number"),
        ({"delta": 1e-60}, "delta is 1e-60; it must be a positive number"),
        ({"delta": 1e300}, r"delta is 1e\+300; .* from 1e-50 to 1e\+50, or inf"),
    ],
)
def test_ill_posed_games_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message) as refusal:
        Game(**(SMALL | change))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("R", [np.diag([1e-20, 1e20]), np.diag([1e-90, 1.0]), [[1.0, 1.0 - 1e-12], [1.0 - 1e-12, 1.0]]])
def test_weights_of_very_different_size_are_definite(R: Any) -> None:
    assert np.array_equal(Game(**(SMALL | {"B": np.eye(2), "R": R})).R, R)


def test_gains_are_the_extremals_of_the_hamiltonian_of_the_game() -> None:
    """u = -K z and d = L z are where z'Qz + u'Ru - δ²d'd + 2 z'P(Az + Bu + Ed) has no slope in u and d.

    There it is z' residual(P) z.
    """
    rng = np.random.default_rng(4)
    for game in (Game(**SMALL), *game_models().values()):
        n = len(game.A)
        root, z = rng.standard_normal((n, n)), rng.standard_normal(n)
        P = root @ root.T
        u, d = -game.gain(P) @ z, game.disturbance_gain(P) @ z
        np.testing.assert_allclose(game.R @ u, -game.B.T @ P @ z, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(game.delta**2 * d, game.E.T @ P @ z, rtol=1e-12)
        cost = z @ game.Q @ z + u @ game.R @ u - game.delta**2 * d @ d
        hamiltonian = cost + 2.0 * z @ P @ (game.A @ z + game.B @ u + game.E @ d)
        assert z @ game.residual(P) @ z == pytest.approx(hamiltonian, rel=1e-11)
        assert z @ P @ game.S @ P @ z == pytest.approx(u @ game.R @ u - game.delta**2 * d @ d, rel=1e-11)


def test_a_game_cannot_be_changed_from_outside() -> None:
    A = np.array(SMALL["A"])
    game = Game(**(SMALL | {"A": A}))
    A[0, 0] = 7.0
    assert game.A[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        game.A[0, 0] = 7.0
    assert game.with_delta(3.0).delta == 3.0
    assert game.delta == 2.0


def test_published_game_has_the_settings_of_the_paper() -> None:
    model = published_models()[0]
    game = published_game(model.A, model.B)
    assert np.array_equal(np.diag(game.Q), [1000.0, 1000.0, 0.01, 0.01, 1000.0, 0.01])
    assert np.array_equal(np.diag(game.R), [100.0, 400.0, 400.0, 400.0, 50.0])
    assert np.array_equal(game.E, np.eye(6))
    assert game.delta == 200.0
    with pytest.raises(BadInputError, match="Q is 6 x 6; with this A and B it must be 2 x 2"):
        published_game(np.eye(2), np.ones((2, 1)))
    with pytest.raises(BadInputError, match="A has 0 dimension"):
        published_game(np.array(3.0), model.B)
