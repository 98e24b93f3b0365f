"""Many games at once: exact solutions with a certificate each, all in stacked matrices.

The route is another than that of `gare.py` (eigenvectors of the Hamiltonian instead of its ordered Schur form), and the
second opinion is cheaper: the last Newton step, which solves a Lyapunov equation, must leave P alone. For one game
whose answer must be beyond doubt, use `gare.solve_game`.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units
from controller.riccati.certificate import AXIS_DISTANCE, DISAGREEMENT, INDEFINITENESS, RESIDUAL, relative_residuals
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown

_NEWTON_STEPS = 2


@dataclass(frozen=True, eq=False, repr=False)
class GameBatch(Shown):
    """N solutions. P: (N, n, n), K: (N, m, n), nan where not certified. certified: (N,).

    The tests, each (N,), with the limits of `certificate`: axis_distance, min |Re λ| / max |λ| of the Hamiltonian;
    stable, its number of stable eigenvalues; residual, relative; smallest, smallest eigenvalue of P over its
    largest entry; game_abscissa, control_abscissa, of A - S P and A - B K; newton, relative size of the last
    Newton-Lyapunov step.
    """

    P: np.ndarray
    K: np.ndarray
    certified: np.ndarray
    axis_distance: np.ndarray
    stable: np.ndarray
    residual: np.ndarray
    smallest: np.ndarray
    game_abscissa: np.ndarray
    control_abscissa: np.ndarray
    newton: np.ndarray


def solve_games(A: np.ndarray, B: np.ndarray, like: Game) -> GameBatch:
    """A'P + P A + Q - P S P = 0 for every plant (A (N, n, n), B (N, n, m)); E, Q, R, delta of `like`.

    The plants should be of similar scale: units of state are chosen once, for `like`. BadInputError when an entry is
    not finite.
    Source: Zhou, Doyle and Glover, Section 13.2 (stable subspace); Kleinman, IEEE TAC 13 (1968) (Newton).
    """
    broken = np.flatnonzero(~(np.isfinite(A).all(axis=(1, 2)) & np.isfinite(B).all(axis=(1, 2))))
    if broken.size:
        raise BadInputError(f"model {broken[0]} of the batch has an entry that is not finite; leave it out")
    units = balanced_units(like)
    scaled_A = A * units / units[:, None]
    scaled_B = B / units[:, None]
    scaled_E = like.E / units[:, None]
    Q = like.Q * np.outer(units, units)
    gain = np.linalg.solve(like.R, np.swapaxes(scaled_B, 1, 2))
    S_control = scaled_B @ gain
    S = S_control - scaled_E @ scaled_E.T / like.delta**2
    with np.errstate(all="ignore"):
        P, stable, distance = _stable_subspace(scaled_A, S, Q)
        newton = np.full(len(A), np.inf)
        for _ in range(_NEWTON_STEPS):
            step = _newton_step(scaled_A, S, Q, P)
            newton = _largest(step) / _largest(P)
            P = P + step
        residual, smallest, game_abscissa, control_abscissa = _tests(scaled_A, scaled_B, S, S_control, Q, P, gain @ P)
    certified = (
        (stable == A.shape[1])
        & (distance >= AXIS_DISTANCE)
        & (residual <= RESIDUAL)
        & (smallest >= -INDEFINITENESS)
        & (game_abscissa < 0.0)
        & (control_abscissa < 0.0)
        & (newton <= DISAGREEMENT)
    )
    P[~certified] = np.nan
    K = gain @ P / units
    return GameBatch(
        P / np.outer(units, units),
        K,
        certified,
        distance,
        stable,
        residual,
        smallest,
        game_abscissa,
        control_abscissa,
        newton,
    )


def _tests(
    A: np.ndarray, B: np.ndarray, S: np.ndarray, S_control: np.ndarray, Q: np.ndarray, P: np.ndarray, K: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Relative residual, smallest eigenvalue of P, abscissas of A - S P and A - B K; nan, which fails every limit,
    where P is not finite."""
    residual = relative_residuals(A, S_control, S_control - S, Q, P)
    bad = ~np.isfinite(P).all(axis=(1, 2))
    safe_P, safe_K = (np.where(bad[:, None, None], 0.0, matrix) for matrix in (P, K))
    smallest = np.linalg.eigvalsh(safe_P)[:, 0] / _largest(P)
    game_abscissa = np.linalg.eigvals(A - S @ safe_P).real.max(axis=1)
    control_abscissa = np.linalg.eigvals(A - B @ safe_K).real.max(axis=1)
    for test in (smallest, game_abscissa, control_abscissa):
        test[bad] = np.nan
    return residual, smallest, game_abscissa, control_abscissa


def _stable_subspace(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P = V2 V1⁻¹ of the Hamiltonian's eigenvectors with the n smallest real parts, how many are stable, and the
    relative distance of the spectrum to the axis."""
    count, n, _ = A.shape
    top = np.concatenate([A, -S], axis=2)
    bottom = np.concatenate([np.broadcast_to(-Q, A.shape), -np.swapaxes(A, 1, 2)], axis=2)
    values, vectors = np.linalg.eig(np.concatenate([top, bottom], axis=1))
    order = np.argsort(values.real, axis=1)[:, None, :n]
    chosen = np.take_along_axis(vectors, np.broadcast_to(order, (count, 2 * n, n)), axis=2)
    V1, V2 = chosen[:, :n], chosen[:, n:]
    P = _solve(np.swapaxes(V1, 1, 2), np.swapaxes(V2, 1, 2)).real
    distance = np.abs(values.real).min(axis=1) / np.abs(values).max(axis=1)
    return (P + np.swapaxes(P, 1, 2)) / 2, (values.real < 0.0).sum(axis=1), distance


def _newton_step(A: np.ndarray, S: np.ndarray, Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """X with F'X + X F = -residual, F = A - S P, as n (n + 1) / 2 linear equations; nan where they are singular."""
    count, n, _ = A.shape
    equations, rows, columns = _lyapunov_equations(n)
    operator = ((A - S @ P).reshape(count, n * n) @ equations).reshape(count, len(rows), len(rows))
    found = _solve(operator, -_riccati(A, S, Q, P)[:, rows, columns, None])[:, :, 0]
    X = np.empty_like(A)
    X[:, rows, columns] = X[:, columns, rows] = found
    return X


@lru_cache(maxsize=8)
def _lyapunov_equations(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The matrix of F'X + X F as an operator on the entries x of X with row <= column, linear in F, and their places.

    Returns (n², s²) with s = n (n + 1) / 2, from F row by row to the operator row by row, and rows, columns, (s,).
    """
    rows, columns = np.triu_indices(n)
    units = np.zeros((len(rows), n, n))
    units[np.arange(len(rows)), rows, columns] = units[np.arange(len(rows)), columns, rows] = 1.0
    entries = np.eye(n * n).reshape(n * n, 1, n, n)
    images = np.swapaxes(entries, 2, 3) @ units + units @ entries
    return np.swapaxes(images[:, :, rows, columns], 1, 2).reshape(n * n, -1), rows, columns


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Stacked linear equations; nan where a matrix is singular, which must not stop the others."""
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        result = np.full(right.shape, np.nan, dtype=right.dtype)
        for i, matrix in enumerate(matrices):
            with contextlib.suppress(np.linalg.LinAlgError):
                result[i] = np.linalg.solve(matrix, right[i])
        return result


def _riccati(A: np.ndarray, S: np.ndarray, Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """A'P + P A + Q - P S P, symmetric to the last bit: near delta_min what rounding leaves between (i, j) and (j, i)
    is most of the error of a Newton step."""
    half = np.swapaxes(A, 1, 2) @ P
    quadratic = P @ S @ P
    return half + np.swapaxes(half, 1, 2) + Q - (quadratic + np.swapaxes(quadratic, 1, 2)) / 2


def _largest(matrices: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(matrices).max(axis=(1, 2)))
