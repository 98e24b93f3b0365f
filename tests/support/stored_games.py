"""Games of ten kinds with answers of hundreds of digits, in the file beside this one.

They were drawn, and solved by the matrix sign function of their pencils in FLINT's arithmetic, by
`stored_games.py` and `reference_riccati.py` of commit b3dedbf27.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hfa import Game

FILE = Path(__file__).with_suffix(".npz")
KINDS = (
    "continuous",
    "discrete",
    "cross",
    "disturbance",
    "discount",
    "cheap",
    "stiff",
    "weak",
    "scaled",
    "aircraft",
)
EACH = 200


class Stored(NamedTuple):
    """A game with its answers.

    game: the game with its delta
    exists: whether it has a value
    P, K: its answers, empty without a value
    change: largest change of P and K by changes of 1 of its entries, in units in which the
        diagonals of P and of R + B'PB (R in continuous time) are 1
    delta_min: nan if no delta has a solution
    """

    game: Game
    exists: bool
    P: np.ndarray
    K: np.ndarray
    change: float
    delta_min: float


def units_of_answers(game, P):
    """Return the units (n,) and (m,) in which the diagonals of P and of R + B'PB are 1."""
    units = (np.sqrt(np.diag(each).clip(0.0)) for each in (P, game.suboptimality_weight(P)))
    of_states, of_inputs = (np.where(unit > 0.0, unit, 1.0) for unit in units)
    return of_states, of_inputs


def errors(stored, P, K):
    """Return the largest errors of P and K in these units, that of K relative to K if K is large."""
    z, u = units_of_answers(stored.game, stored.P)
    of_P = np.abs((P - stored.P) / np.outer(z, z)).max()
    of_K, size = (np.abs(each * u[:, None] / z).max() for each in (K - stored.K, stored.K))
    return float(of_P), float(of_K / max(size, 1.0))


@cache
def _file():
    """Return the arrays of the file by name."""
    with np.load(FILE) as loaded:
        return dict(loaded)


def stored(kind, number):
    """Return a stored game."""
    file = _file()
    index = KINDS.index(kind) * EACH + number
    game, n = _game(file, index), int(file["sizes"][index][0])
    first = int(file["first"][index])
    P, K = np.zeros((n, n)), np.zeros((0, n))
    exists = bool(file["exists"][index])
    if exists:
        upper = np.triu_indices(n)
        P[upper] = P.T[upper] = file["answers"][first : first + len(upper[0])]
        K = file["answers"][first + len(upper[0]) :][: game.B.size].reshape(-1, n)
    return Stored(game, exists, P, K, float(file["change"][index]), float(file["delta_min"][index]))


@cache
def _first_entries():
    """Return the place of the first entry of each game."""
    n, m, k = _file()["sizes"].astype(int).T
    return np.cumsum([0, *(n * (n + m + k) + (n + m) * n + m * m)])


def _game(file, index):
    """Return the game with this number in the file."""
    n, m, k = map(int, file["sizes"][index])
    shapes = {"A": (n, n), "B": (n, m), "E": (n, k), "Q": (n, n), "R": (m, m), "N": (n, m)}
    at = _first_entries()[index]
    matrices = {}
    for name, (rows, columns) in shapes.items():
        matrices[name] = file["entries"][at : at + rows * columns].reshape(rows, columns)
        at += rows * columns
    dt = float(file["dt"][index])  # 0 in continuous time, -1 of steps of unknown length
    time = {"dt": True if dt < 0.0 else dt or None, "discount": float(file["discount"][index])}
    return Game(**matrices, delta=float(file["delta"][index]), **time)


def in_units(game, rng, base, most):
    """Return a game in other units of states, inputs, disturbance, time and cost, and the units.

    The units are powers of a base from `base`^-`most` to `base`^`most`.
    """
    n, m = game.B.shape
    z, u, (d, t, cost) = (base ** rng.integers(-most, most + 1, k) for k in (n, m, 3))
    if game.is_discrete:
        t = 1.0
    other = replace(
        game,
        A=game.A * z[:, None] / z / t,
        B=game.B * z[:, None] / u / t,
        E=game.E * z[:, None] / d / t,
        Q=game.Q / np.outer(z, z) * cost / t,
        R=game.R / np.outer(u, u) * cost / t,
        N=game.N / np.outer(z, u) * cost / t,
        delta=game.delta / d * math.sqrt(cost / t),
    )
    return other, Units(z, u, d, t, cost)


class Units(NamedTuple):
    """Numbers of the new units in one old unit of the states, inputs, disturbance, time and cost."""

    z: np.ndarray
    u: np.ndarray
    d: float
    t: float
    cost: float
