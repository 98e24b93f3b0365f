"""A collection of games that are hard in nine ways, with one to ten states each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller import Game
from hfa_support import NoSolutionError
from verification import minimum_delta


class Sample(NamedTuple):
    """A game of the collection, and how it was made."""

    structure: str
    number: int
    game: Game


def dense(rng: np.random.Generator, n: int, rank: int | None = None) -> Game:
    """Any number of inputs and disturbances, entries of size one, Q of the given rank."""
    m, k = int(rng.integers(1, n + 1)), int(rng.integers(1, n + 1))
    A, B, E = (rng.standard_normal((n, columns)) for columns in (n, m, k))
    C, root = rng.standard_normal((rank or n, n)), rng.standard_normal((m, m))
    delta = math.inf if rng.random() < 0.05 else math.exp(rng.uniform(math.log(0.3), math.log(1000.0)))
    return Game(A, B, E, _symmetric(C.T @ C), _symmetric(root @ root.T + 0.1 * np.eye(m)), delta)


def chain(rng: np.random.Generator, n: int) -> Game:
    """Integrators in a row, the input and as often as not the disturbance at their end."""
    B = np.eye(n)[:, [-1]]
    E = B if rng.random() < 0.5 else np.eye(n)
    Q = np.eye(n) if rng.random() < 0.7 else np.diag(np.eye(n)[0])
    return Game(np.eye(n, k=1), B, E, Q, [[10.0 ** rng.uniform(-2.0, 2.0)]], 1000.0)


def low_rank(rng: np.random.Generator, n: int) -> Game:
    """Q of any rank below n."""
    return dense(rng, n, rank=int(rng.integers(1, max(n, 2))))


def unseen(rng: np.random.Generator, n: int) -> Game:
    """Unstable modes that Q does not see, in a basis that hides them."""
    game, blind = dense(rng, n), int(rng.integers(1, n + 1))
    A = np.triu(game.A)
    rates = rng.uniform(0.05, 2.0, n)
    A[np.arange(n), np.arange(n)] = np.where(np.arange(n) < blind, rates, -rates)
    A[:blind, blind:] = 0.0
    C = np.hstack([np.zeros((n, blind)), rng.standard_normal((n, n - blind))])
    basis = np.linalg.qr(rng.standard_normal((n, n)))[0]
    C = C @ basis.T
    return replace(game, A=basis @ A @ basis.T, Q=_symmetric(C.T @ C))


def ill_scaled(rng: np.random.Generator, n: int) -> Game:
    """Units of state between 1e-8 and 1e8, of input between 1e-3 and 1e3."""
    return in_other_units(rng, dense(rng, n))


def lightly_damped(rng: np.random.Generator, n: int) -> Game:
    """Oscillators of 0.1 to 100 rad/s with damping ratios of 1e-5 to 0.1, a third of them negative."""
    A = np.zeros((n, n))
    for i in range(0, n - 1, 2):
        frequency, damping = 10.0 ** rng.uniform(-1.0, 2.0), 10.0 ** rng.uniform(-5.0, -1.0) * rng.choice([1, 1, -1])
        A[i : i + 2, i : i + 2] = [[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]]
    if n % 2:
        A[-1, -1] = -(10.0 ** rng.uniform(-3.0, 0.0))
    return replace(dense(rng, n), A=A)


def nilpotent(rng: np.random.Generator, n: int) -> Game:
    """A with nothing on and below its diagonal: one eigenvalue, 0, whose numerical copies lie far from it."""
    game = dense(rng, n)
    return replace(game, A=np.triu(game.A, 1))


def barely_reached(rng: np.random.Generator, n: int) -> Game:
    """One unstable mode, or two, that the inputs reach by 1e-11 to 1e-5 of their size, in a basis that hides them."""
    few = 2 if n > 2 and rng.random() < 0.4 else 1
    A = np.triu(rng.standard_normal((n, n)), 1) * (rng.random() < 0.5) - np.diag(rng.uniform(0.1, 3.0, n))
    A[:few] = 0.0
    rate = rng.uniform(0.05, 2.0)
    A[:few, :few] = np.array([[rate, 1.0], [-1.0, rate]])[:few, :few]
    B = rng.standard_normal((n, int(rng.integers(1, n + 1))))
    B[:few] *= 10.0 ** rng.uniform(-11.0, -5.0)
    basis, size = np.linalg.qr(rng.standard_normal((n, n)))[0], B.shape[1]
    E = rng.standard_normal((n, 1)) * (rng.random() < 0.5)
    return Game(basis @ A @ basis.T, basis @ B, basis @ E, np.eye(n), np.eye(size), math.inf)


def marginal(rng: np.random.Generator, n: int) -> Game:
    """Any of the others; `collection` gives it a delta between a thousandth and a hundredth above the smallest."""
    return list(STRUCTURES.values())[int(rng.integers(0, 7))](rng, n)


STRUCTURES: dict[str, Callable[[np.random.Generator, int], Game]] = {
    make.__name__: make for make in (dense, chain, low_rank, unseen, ill_scaled, lightly_damped, nilpotent, marginal)
}
#: One structure more, in a collection of its own: the numbers of the others are published.
BARELY_REACHED: dict[str, Callable[[np.random.Generator, int], Game]] = {"barely_reached": barely_reached}


def in_other_units(rng: np.random.Generator, game: Game) -> Game:
    """The same game in units of state that differ by up to 1e16, and of input by up to 1e6."""
    states, inputs = 10.0 ** rng.uniform(-8.0, 8.0, len(game.A)), 10.0 ** rng.uniform(-3.0, 3.0, game.B.shape[1])
    return replace(
        game,
        A=game.A * states[:, None] / states,
        B=game.B * states[:, None] * inputs,
        E=game.E * states[:, None],
        Q=_symmetric(game.Q / np.outer(states, states)),
        R=_symmetric(game.R * np.outer(inputs, inputs)),
    )


def collection(count: int, seed: int, structures: dict[str, Callable[..., Game]] = STRUCTURES) -> Iterator[Sample]:
    """Game after game: structures in turn, then sizes; a third in absurd units; deltas on both sides of the smallest.

    delta is 1e-3 to 1e3 above delta_min in three games of five, relative, and 1e-5 to 1e-1 below in one.
    """
    names = list(structures)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        name, n = names[number % len(names)], 1 + (number + number // len(names)) % 10
        game = structures[name](rng, n)
        if rng.random() < 0.3:
            game = in_other_units(rng, game)
        yield Sample(name, number, _with_telling_delta(rng, name, game))


def _with_telling_delta(rng: np.random.Generator, name: str, game: Game) -> Game:
    try:
        smallest = minimum_delta(game).value
    except NoSolutionError:
        return game
    above, below, kind = 10.0 ** rng.uniform(-2.9, 3.0), 10.0 ** rng.uniform(-5.0, -1.0), rng.random()
    if name == "marginal":
        above, kind = 10.0 ** rng.uniform(-2.9, -2.0), 0.0
    if smallest == 0.0 or kind > 0.8:
        return game
    return game.with_delta(smallest * (1.0 + above if kind < 0.6 else 1.0 - below))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return (matrix + matrix.T) / 2.0
