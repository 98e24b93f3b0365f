"""Equivalent copies of a problem, for tests that the verdict does not depend on the representation.

Copies differ in the last bits of the numbers, the order of the states, the units of the states
(powers of two), or by an orthogonal change of coordinates. The orthogonal change is applied in
units in which the states have similar magnitudes. Otherwise small entries would be lost by
rounding.

A problem is any dataclass with the matrices of a game, a discrete-time game or a generalized plant.
The matrices of a critic can be converted too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import matrix_balance

from hfa import BadInputError

KINDS = ("bits", "order", "units", "turn")
#: Matrices with a row for each state, T M, and with a column for each state, M T⁻¹, if y = T z.
OF_ROWS = {"A", "A_low", "B", "E", "B1", "B2"}
OF_COLUMNS = {"A", "A_low", "C1", "C2", "K", "L"}
#: Weights of states, T⁻ᵀ M T⁻¹, and cross weights of states and inputs, T⁻ᵀ M.
WEIGHTS = {"Q", "P"}
CROSS_WEIGHTS = {"N"}
#: Matrices that stay symmetric.
SYMMETRIC = {"Q", "P", "R"}
#: Largest power of two by which the units of states differ.
LARGEST_POWER = 12
#: Largest number of attempts, because rounding may make Q indefinite.
MOST_DRAWS = 20


class Copy(NamedTuple):
    """An equivalent copy of a problem and of a critic.

    kind: kind of the change, one of `KINDS`
    """

    kind: str
    problem: Any
    critic: dict[str, np.ndarray]


def copies(
    problem: Any, seed: int, count: int, critic: Mapping[str, np.ndarray] | None = None
) -> Iterator[Copy]:
    """Yield `count` copies of a problem, with the kinds of `KINDS` in turn.

    critic: matrices P, K or L to convert to the coordinates of the copy
    """
    rng = np.random.default_rng([seed, 44])
    A = problem.step.A if hasattr(problem, "step") else problem.A
    for index in range(count):
        kind = KINDS[index % len(KINDS)]
        for _ in range(MOST_DRAWS):
            change = _change(kind, A, rng)
            try:
                copy = _copy(problem, change, rng)
            except BadInputError:  # rounding made a semidefinite Q indefinite
                continue
            break
        matrices = {
            name: _changed(name, matrix, change, rng) for name, matrix in (critic or {}).items()
        }
        yield Copy(kind, copy, matrices)


def in_units(problem: Any, units: np.ndarray) -> Any:
    """Return the problem with states y, where z_i = u_i y_i.

    units: u, (n,)
    """
    change = _Change(np.diag(1.0 / units), np.diag(units))
    return _copy(problem, change, np.random.default_rng())


class _Change(NamedTuple):
    """Change of coordinates y = T z and its inverse.

    If T is None, only the last bits are changed.
    """

    T: np.ndarray | None
    inverse: np.ndarray | None


def _change(kind: str, A: np.ndarray, rng: np.random.Generator) -> _Change:
    n = len(A)
    if kind == "bits":
        return _Change(None, None)
    if kind == "order":
        T = np.eye(n)[rng.permutation(n)]
        return _Change(T, T.T)
    if kind == "units":
        units = np.exp2(rng.integers(-LARGEST_POWER, LARGEST_POWER + 1, n).astype(float))
        return _Change(np.diag(units), np.diag(1.0 / units))
    _, (units, _) = matrix_balance(A, permute=False, separate=True)  # powers of two
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return _Change(turn / units, units[:, None] * turn.T)


def _copy(problem: Any, change: _Change, rng: np.random.Generator) -> Any:
    changes = {}
    for field in fields(problem):
        value = getattr(problem, field.name)
        if isinstance(value, np.ndarray):
            changes[field.name] = _changed(field.name, value, change, rng)
        elif is_dataclass(value) and hasattr(value, "A"):
            changes[field.name] = _copy(value, change, rng)
    return replace(problem, **changes)


def _changed(
    name: str, matrix: np.ndarray, change: _Change, rng: np.random.Generator
) -> np.ndarray:
    if change.T is None or change.inverse is None:
        factors = 1.0 + rng.integers(-2, 3, matrix.shape) * np.finfo(float).eps
        matrix = matrix * factors
    if change.T is not None and name in OF_ROWS:
        matrix = change.T @ matrix
    if change.inverse is not None and name in OF_COLUMNS | WEIGHTS:
        matrix = matrix @ change.inverse
    if change.inverse is not None and name in WEIGHTS | CROSS_WEIGHTS:
        matrix = change.inverse.T @ matrix
    if name in SYMMETRIC:
        matrix = np.triu(matrix) + np.triu(matrix, 1).T
    return matrix
