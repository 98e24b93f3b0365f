"""Critics with one planted mistake each, and the words that must name the mistake."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from planted_critics import gain, other_root, solved, value, weights_of
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from hfa import Critic, Game, NoSolutionError, from_gain, from_value, from_weights

#: Radians in a degree.
DEGREE = math.pi / 180.0
Plant = Callable[[Game], np.ndarray]


def changed(matrix: np.ndarray, factor: float, *places: tuple[int, int]) -> np.ndarray:
    wrong = matrix.copy()
    for place in places:
        wrong[place] *= factor
    return wrong


def in_order(game: Game, order: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the exact weights of a quadratic basis in another order.

    order: function from row and column of each weight to indices
    """
    row, column = np.triu_indices(len(game.A))
    return weights_of(value(game))[order(row, column)]


def swapped(game: Game) -> np.ndarray:
    weights = weights_of(value(game))
    weights[[3, 7]] = weights[[7, 3]]
    return weights


def without_the_factor(game: Game) -> np.ndarray:
    return value(game)[np.triu_indices(len(game.A))]


def recorded_policy(game: Game) -> np.ndarray:
    """Return the value matrix of the policies that belong to another P."""
    P = solve_continuous_are(game.A, game.B, 1000.0 * np.eye(len(game.A)), game.R)
    return solve_continuous_lyapunov((game.A - game.S @ P).T, -(game.Q + P @ game.S @ P))


def lqr(game: Game) -> np.ndarray:
    return value(game.with_delta(math.inf))


def value_in_degrees(game: Game, degrees: np.ndarray) -> np.ndarray:
    """Return the exact P for states of which some are in degrees.

    degrees: mask of the states in degrees
    """
    units = np.where(degrees, DEGREE, 1.0)
    return value(game) * np.outer(units, units)


ANGLES = np.array([False, True, True, True, True, True])
FLIPPED = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
ORDER = [0, 2, 1, 3, 5, 4]

#: Name -> (kind of critic, function from the game to the critic, words of the reason).
NAMED: dict[str, tuple[str, Plant, str]] = {
    "another factor": (
        "K",
        lambda game: 0.913 * gain(game),
        "every entry of K is 0.913 times the exact one",
    ),
    "upper triangle": ("P", lambda game: np.triu(value(game)), "P is not symmetric: the value"),
    "weights in a triangle": (
        "P",
        lambda game: np.triu(value(game)) + np.triu(value(game), 1),
        "P is not symmetric; its symmetric part is exact",
    ),
    "gain per radian": (
        "K",
        lambda game: gain(game) * np.where(np.arange(6) == 2, 1 / DEGREE, 1.0),
        "state 3 is off by 180/pi",
    ),
    "inputs per radian": (
        "K",
        lambda game: np.array([[1.0], [1.0], [1.0], [1.0], [DEGREE]]) * gain(game),
        "input 5 is off by pi/180",
    ),
    "sign of P": ("P", lambda game: -value(game), "the value has the wrong sign"),
    "sign of W": ("W", lambda game: -weights_of(value(game)), "the value has the wrong sign"),
    "sign of K": (
        "K",
        lambda game: -gain(game),
        "the gain has the wrong sign: the policy is u = -K z",
    ),
    "swapped weights": ("W", swapped, "weights 4 and 8 are interchanged"),
    "no factor 2": ("W", without_the_factor, "the weights lack the factor 2 of products z_i z_j"),
    "half cost, P": ("P", lambda game: value(game) / 2, "the value is half the exact one"),
    "half cost, W": (
        "W",
        lambda game: weights_of(value(game)) / 2,
        "the value is half the exact one",
    ),
    "twice, W": ("W", lambda game: weights_of(value(game)) * 2, "the value is twice the exact one"),
    "half cost, K": ("K", lambda game: gain(game) / 2, "the gain is half the exact one"),
    "twice, K": ("K", lambda game: gain(game) * 2, "the gain is twice the exact one"),
    "thousandfold": (
        "P",
        lambda game: 1000.0 * value(game),
        "every entry of P is 1000 times the exact one",
    ),
    "weights as P": (
        "P",
        lambda game: value(game) * (2.0 - np.eye(len(game.A))),
        "are twice too large",
    ),
    "column order": (
        "W",
        lambda game: in_order(game, lambda row, column: np.lexsort((row, column))),
        "the weights are stored column by column",
    ),
    "states, P": (
        "P",
        lambda game: value(game)[ORDER][:, ORDER],
        "the states are in the order 1, 3, 2, 4, 6, 5",
    ),
    "states, W": (
        "W",
        lambda game: weights_of(value(game)[ORDER][:, ORDER]),
        "the order 1, 3, 2, 4, 6, 5",
    ),
    "states, K": (
        "K",
        lambda game: gain(game)[:, ORDER],
        "the states are in the order 1, 3, 2, 4, 6, 5",
    ),
    "inputs, K": (
        "K",
        lambda game: gain(game)[[0, 2, 1, 4, 3]],
        "the inputs are in the order 1, 3, 2, 5, 4",
    ),
    "degrees, P": (
        "P",
        lambda game: value_in_degrees(game, ANGLES),
        "states 2, 3, 4, 5 and 6 are in degrees",
    ),
    "degrees, W": (
        "W",
        lambda game: weights_of(value_in_degrees(game, ANGLES)),
        "states 2, 3, 4, 5 and 6 are in degrees",
    ),
    "one angle in degrees": (
        "P",
        lambda game: value_in_degrees(game, np.arange(6) == 4),
        "state 5 is in degrees",
    ),
    "gain per degree": (
        "K",
        lambda game: gain(game) * np.where(ANGLES, DEGREE, 1.0),
        "states 2, 3, 4, 5 and 6 are in",
    ),
    "speed in metres": (
        "K",
        lambda game: gain(game) * np.where(np.arange(6) == 0, 1.0 / 0.3048, 1.0),
        "state 1 is in metres in place of feet",
    ),
    "sign and degrees, K": (
        "K",
        lambda game: -gain(game) * np.where(ANGLES, DEGREE, 1.0),
        "the gain has the wrong sign, and states 2, 3, 4, 5 and 6 are in degrees",
    ),
    "inputs in degrees": (
        "K",
        lambda game: np.array([[1.0], [1.0], [1.0], [1 / DEGREE], [1 / DEGREE]]) * gain(game),
        "inputs 4 and 5 are in degrees",
    ),
    "sign of a state, P": (
        "P",
        lambda game: value(game) * np.outer(FLIPPED, FLIPPED),
        "states 5 and 6 have the wrong sign",
    ),
    "sign of a state, K": (
        "K",
        lambda game: gain(game) * np.where(np.arange(6) == 2, -1, 1),
        "state 3 has the wrong",
    ),
    "signs of states, K": (
        "K",
        lambda game: gain(game) * FLIPPED,
        "states 5 and 6 have the wrong sign",
    ),
    "column by column, K": (
        "K",
        lambda game: gain(game).T.reshape(5, 6),
        "but its entries are stored column by column",
    ),
    "sign of an input, K": (
        "K",
        lambda game: (gain(game).T * [1, 1, 1, -1, 1]).T,
        "input 4 has the wrong sign",
    ),
    "no inverse of R": ("K", lambda game: game.B.T @ value(game), "R⁻¹ is missing: this is B'P"),
    "column order, no factor 2": (
        "W",
        lambda game: value(game).T[np.tril_indices(len(game.A))],
        "the weights are stored column by column and lack the factor 2 of products z_i z_j",
    ),
    "squares first": (
        "W",
        lambda game: in_order(game, lambda row, column: np.argsort(row != column, kind="stable")),
        "the weights are stored with the squares first",
    ),
    "half cost, no factor 2": (
        "W",
        lambda game: without_the_factor(game) / 2,
        "the weights lack the factor 2 of products z_i z_j and are of half the cost",
    ),
    "sign of an entry, P": (
        "P",
        lambda game: changed(value(game), -1, (1, 4), (4, 1)),
        "P(2, 5) has the wrong sign",
    ),
    "one entry of K": (
        "K",
        lambda game: changed(gain(game), 1.1, (1, 2)),
        "only K(2, 3) differs",
    ),
    "sign of an entry, K": (
        "K",
        lambda game: changed(gain(game), -1, (3, 0)),
        "K(4, 1) has the wrong sign",
    ),
    "slip, P": (
        "P",
        lambda game: changed(value(game), 10, (2, 5), (5, 2)),
        "only P(3, 6) differs",
    ),
    "slip, K": (
        "K",
        lambda game: changed(gain(game), 0.01, (4, 4)),
        "only K(5, 5) differs",
    ),
}
#: Mistakes that cannot be recognized.
UNNAMED: dict[str, tuple[str, Plant]] = {
    "LQR value": ("P", lqr),
    "another root": ("P", other_root),
    "weak E": ("P", lambda game: value(replace(game, E=game.E[:, 1:2]))),
    "recorded policy": ("P", recorded_policy),
    "Q and R doubled": ("P", lambda game: value(replace(game, Q=2.0 * game.Q, R=2.0 * game.R))),
    "stable before": ("P", lambda game: value(replace(game, A=game.A * 1.01))),
    "three digits": (
        "K",
        lambda game: np.vectorize(lambda entry: float(f"{entry:.3g}"))(gain(game)),
    ),
    "another delta": ("P", lambda game: value(game.with_delta(4e4))),
    "no gain": ("K", lambda game: np.zeros_like(game.B.T)),
    "no value": ("P", lambda game: np.zeros_like(game.A)),
}


def exchanged(size: int) -> np.ndarray:
    """Return the indices 1, 0, 2, 3, ..., in which the first two are exchanged, (size,)."""
    order = np.arange(size)
    order[:2] = [1, 0]
    return order


def second_in_degrees(game: Game) -> np.ndarray:
    return value_in_degrees(game, np.arange(len(game.A)) == 1)


def second_flipped(game: Game) -> np.ndarray:
    return np.where(np.arange(len(game.A)) == 1, -1.0, 1.0)


#: The same for games of any size, for critics with noise.
OF_ANY_GAME: dict[str, tuple[str, Plant, str]] = {
    name: NAMED[name]
    for name in (
        "no factor 2",
        "weights as P",
        "sign of P",
        "sign of W",
        "sign of K",
        "half cost, P",
        "half cost, W",
        "half cost, K",
        "twice, W",
        "twice, K",
        "thousandfold",
        "column order",
        "squares first",
    )
} | {
    "states, P": (
        "P",
        lambda game: value(game)[np.ix_(*[exchanged(len(game.A))] * 2)],
        "the states are in the order 2, 1, 3",
    ),
    "states, K": (
        "K",
        lambda game: gain(game)[:, exchanged(len(game.A))],
        "the states are in the order 2, 1, 3",
    ),
    "degrees, P": ("P", second_in_degrees, "state 2 is in degrees"),
    "degrees, W": (
        "W",
        lambda game: weights_of(second_in_degrees(game)),
        "state 2 is in degrees",
    ),
    "degrees, K": (
        "K",
        lambda game: gain(game) * np.where(np.arange(len(game.A)) == 1, DEGREE, 1.0),
        "state 2 is in degrees",
    ),
    "sign of a state, P": (
        "P",
        lambda game: value(game) * np.outer(second_flipped(game), second_flipped(game)),
        "state 2 has the wrong sign",
    ),
    "sign of a state, K": (
        "K",
        lambda game: gain(game) * second_flipped(game),
        "state 2 has the wrong sign",
    ),
}


def random_game(rng: np.random.Generator) -> Game:
    """Return a random game with 3 to 6 states and 1 to 3 inputs that has a solution."""
    while True:
        n = int(rng.integers(3, 7))
        m = int(rng.integers(1, 4))
        game = Game(
            rng.normal(size=(n, n)),
            rng.normal(size=(n, m)),
            0.3 * rng.normal(size=(n, 2)),
            np.diag(rng.uniform(0.2, 3.0, n)),
            np.diag(rng.uniform(0.3, 3.0, m)),
            float(rng.uniform(3.0, 10.0)),
        )
        with contextlib.suppress(NoSolutionError):
            solved(game)
            return game


def noisy(kind: str, right: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """Return a matrix with relative noise in each entry, symmetric for P.

    kind: "P" or another kind
    size: standard deviation of the noise
    """
    noise = rng.standard_normal(right.shape)
    if kind == "P":
        noise = np.triu(noise) + np.triu(noise, 1).T
    return right * (1.0 + size * noise)


_KINDS = {"W": from_weights, "P": from_value, "K": from_gain}


def candidate_of(game: Game, kind: str, plant: Plant) -> Critic:
    return _KINDS[kind](game, plant(game))
