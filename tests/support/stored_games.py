"""Games of ten kinds with answers of hundreds of digits.

A game is drawn from its kind and number with exact arithmetic, equal on every machine. The file
beside this one has its delta and its answers (`reference_riccati`). Both, as they were at commit
b3dedbf27, made the file: `python tests/support/stored_games.py`.
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
    change: largest change of P and K by changes of 1 of its entries, in units in which the diagonal
        of P and the price of the inputs are 1
    delta_min: nan if no delta has a solution
    """

    game: Game
    exists: bool
    P: np.ndarray
    K: np.ndarray
    change: float
    delta_min: float


def units_of_answers(game: Game, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the units (n,) and (m,) in which the diagonal of P and the price of the inputs are 1."""
    units = (np.sqrt(np.diag(each).clip(0.0)) for each in (P, game.price(P)))
    of_states, of_inputs = (np.where(unit > 0.0, unit, 1.0) for unit in units)
    return of_states, of_inputs


def errors(stored: Stored, P: np.ndarray, K: np.ndarray) -> tuple[float, float]:
    """Return the largest errors of P and K in these units, that of K relative to K if K is large."""
    z, u = units_of_answers(stored.game, stored.P)
    of_P = np.abs((P - stored.P) / np.outer(z, z)).max()
    of_K, size = (np.abs(each * u[:, None] / z).max() for each in (K - stored.K, stored.K))
    return float(of_P), float(of_K / max(size, 1.0))


@cache
def _file() -> dict[str, np.ndarray]:
    with np.load(FILE) as loaded:
        return dict(loaded)


def stored(kind: str, number: int) -> Stored:
    """Return a stored game."""
    file = _file()
    index = KINDS.index(kind) * EACH + number
    game = drawn(kind, number).with_delta(float(file["delta"][index]))
    n, m = game.B.shape
    first = int(file["first"][index])
    P, K = np.zeros((n, n)), np.zeros((0, n))
    exists = bool(file["exists"][index])
    if exists:
        upper = np.triu_indices(n)
        P[upper] = P.T[upper] = file["answers"][first : first + len(upper[0])]
        K = file["answers"][first + len(upper[0]) :][: m * n].reshape(m, n)
    return Stored(game, exists, P, K, float(file["change"][index]), float(file["delta_min"][index]))


def drawn(kind: str, number: int) -> Game:
    """Return a game without disturbance."""
    return _KINDS[kind](np.random.default_rng((KINDS.index(kind), number)))


def _sixteenths(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.integers(-48, 49, shape) / 16.0


def _square(root: np.ndarray, finest: float = 2.0**-4) -> np.ndarray:
    """Return root' root of multiples of `finest`, rounded once."""
    whole = np.rint(root / finest).astype(object)
    return (whole.T @ whole).astype(float) * finest**2


def _ten(exponent: int) -> float:
    return float(f"1e{exponent}")


def _tens(rng: np.random.Generator, most: int, *shape: int) -> np.ndarray:
    return np.vectorize(_ten)(rng.integers(-most, most + 1, shape))


def _continuous(rng: np.random.Generator) -> Game:
    n, m, k = (int(rng.integers(1, most)) for most in (6, 4, 4))
    Q = _square(_sixteenths(rng, int(rng.integers(1, n + 1)), n))
    R = _square(_sixteenths(rng, m, m)) + np.eye(m) / 16.0
    return Game(_sixteenths(rng, n, n), _sixteenths(rng, n, m), _sixteenths(rng, n, k), Q, R)


def _discrete(rng: np.random.Generator) -> Game:
    game = _continuous(rng)
    m = len(game.R)
    R = rng.choice([1.0, 0.0]) * np.diag(rng.integers(0, 3, m) / 2.0)
    A = np.eye(len(game.A)) + game.A / 64.0 if rng.random() < 0.5 else game.A / 4.0
    return replace(game, A=A, R=R if rng.random() < 0.4 else game.R, dt=True)


def _cross(rng: np.random.Generator) -> Game:
    """Return a game with cross weights, in discrete time often with an R that is nearly singular."""
    game = _discrete(rng) if rng.random() < 0.6 else _continuous(rng)
    n, m = game.B.shape
    fine = 2.0 ** -int(rng.integers(4, 24 if game.is_discrete else 16))
    root = _sixteenths(rng, n + m, n + m)
    if rng.random() < 0.7:
        root[:, -1] = fine * root[:, -1] + (root[:, n] if m > 1 else 0.0)
    W = _square(root, min(fine, 2.0**-4) * 2.0**-4)
    return replace(game, Q=W[:n, :n], N=W[:n, n:], R=W[n:, n:])


def _disturbance(rng: np.random.Generator) -> Game:
    game = _discrete(rng) if rng.random() < 0.4 else _continuous(rng)
    n = len(game.A)
    column = np.eye(n)[:, : int(rng.integers(1, n + 1))]
    E = (game.B, column, np.eye(n), game.E * np.array(_tens(rng, 3, game.E.shape[1])))
    return replace(game, E=E[rng.integers(4)])


def _discount(rng: np.random.Generator) -> Game:
    return replace(_discrete(rng), discount=float(rng.choice([0.5, 0.9, 0.95, 0.99, 0.999])))


def _cheap(rng: np.random.Generator) -> Game:
    """Return a game with a cheap control, or with a small weight of the states."""
    game = (_discrete, _continuous)[rng.integers(2)](rng)
    small = 2.0 ** -int(rng.integers(6, 54))
    if rng.random() < 0.5:
        return replace(game, Q=game.Q * small)
    if rng.random() < 0.5:
        return replace(game, R=np.eye(len(game.R)) * small)
    return replace(game, R=game.R * small)


def _stiff(rng: np.random.Generator) -> Game:
    """Return a game with fast and slow states."""
    game = _continuous(rng)
    n = len(game.A)
    rates = np.diag(_tens(rng, 4, n) * rng.choice([-1.0, -1.0, 1.0], n))
    A = rates + (game.A - np.diag(np.diag(game.A))) * _tens(rng, 2, n, n)
    if rng.random() < 0.3:
        return replace(game, A=np.eye(n) + A * _ten(-5), dt=True)
    return replace(game, A=A)


def _weak(rng: np.random.Generator) -> Game:
    """Return a game with modes, turned by whole numbers, of which the inputs reach some barely."""
    game = _continuous(rng)
    n = len(game.A)
    T = inverse = np.eye(n)
    for _ in range(n - 1):
        i, j = rng.permutation(n)[:2]
        share = float(rng.integers(-2, 3))
        shear = np.eye(n)
        shear[i, j] = share
        T = shear @ T
        shear[i, j] = -share
        inverse = inverse @ shear
    modes = np.diag(rng.integers(-48, 49, n) / 16.0)
    B = game.B
    if rng.random() < 0.5:
        B = T @ (B * _tens(rng, 6, n).clip(max=1.0)[:, None])
    else:
        B = B * _ten(-int(rng.integers(2, 9)))
    A = T @ modes @ inverse
    return replace(game, A=A / 4.0, B=B, dt=True) if rng.random() < 0.3 else replace(game, A=A, B=B)


def _scaled(rng: np.random.Generator) -> Game:
    """Return a game of another kind in other units."""
    kind = (_continuous, _discrete, _cross, _disturbance, _discount)[rng.integers(5)]
    return in_units(kind(rng), rng, 2.0, 27)[0]  # of which the weights are exact, as all else


def in_units(game: Game, rng: np.random.Generator, base: float, most: int) -> tuple[Game, Units]:
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


def _aircraft(rng: np.random.Generator) -> Game:
    file = _file()
    number = int(rng.integers(sum(name.startswith("A_") for name in file)))
    A, B = file[f"A_{number}"], file[f"B_{number}"]
    n, m = B.shape
    Q, R = np.diag(_tens(rng, 2, n)), np.diag(_tens(rng, 2, m))
    E = np.eye(n) if rng.random() < 0.5 else B
    if rng.random() < 0.3:
        return Game(np.eye(n) + A / 128.0, B / 128.0, E / 128.0, Q, R, dt=1.0 / 128.0)
    return Game(A, B, E, Q, R)


_KINDS = dict(
    zip(
        KINDS,
        (
            _continuous,
            _discrete,
            _cross,
            _disturbance,
            _discount,
            _cheap,
            _stiff,
            _weak,
            _scaled,
            _aircraft,
        ),
        strict=True,
    )
)
