"""Relative change of the gain K of a game for a change of the last digit of every entry.

With F = A - S X, changes a, b, e, q and r of the entries of A, B, E, Q and R change the solution X
by D and the gain K = R⁻¹B'X by R⁻¹ (b'X - r K + B'D), to first order, where

  F'D + D F + G = 0,  G = a'X + X a + q + K'r K - (X b K + K'b'X) + (X e L + L'e'X).

The changes are measured in balanced units of the states and with R = I. The results do not depend
on the user's units. Source: Konstantinov, Gu, Mehrmann and Petkov, Perturbation Theory for Matrix
Equations, 2003, Chapter 5.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import norms
from controller.riccati.normal_form import NormalForm

#: Relative change of an entry by one unit in the last place.
LAST_PLACE = float(np.finfo(float).eps)
#: A gain that changes A by less than this fraction of the norm of A is compared with this fraction.
NOTICED = 1e-10
#: Largest number of entries of K whose changes are computed one by one.
MOST_ENTRIES = 64
#: Number of sums with random signs that represent more entries.
DRAWS = 16


def gain_change_bounds(
    form: NormalForm, X: np.ndarray, loop: np.ndarray, right: np.ndarray, left: np.ndarray
) -> np.ndarray:
    """Return bounds of the relative change of K for one unit in the last place, of N games, (N,).

    B'D is the integral over t > 0 of p'G q, with p = exp(F t) B and q = exp(F t). By the
    Cauchy-Schwarz inequality, it is bounded by the sizes of the rows of p, X p, K p, L p and of q,
    X q, K q, L q. These follow from two Lyapunov equations. The bound exceeds `gain_change` where
    large terms of the integral cancel.

    form: normal forms of N games
    X: (N, n, n), solutions of the games
    loop: (N, n), eigenvalues of F
    right: (N, n, n), eigenvectors of F
    left: (N, n, n), inverse of `right`
    """
    n = X.shape[-1]
    sums = loop[..., :, None] + loop[..., None, :].conj()
    unit_gain = form.B.mT @ X
    K = np.linalg.solve(form.root.T, unit_gain)
    L = form.E.mT @ X / form.delta
    rows = np.concatenate([np.broadcast_to(np.eye(n), X.shape), X, K, L], axis=-2)
    places = np.cumsum([n, n, K.shape[-2]])

    def sizes(enters: np.ndarray) -> list[np.ndarray]:
        """Return the sizes of the rows of z, X z, K z and L z, with z = exp(F t) enters."""
        driven = left @ enters
        states = (right @ (driven @ driven.mT.conj() / -sums) @ right.mT.conj()).real
        squares = np.vecdot(rows @ states, rows)
        return np.split(np.sqrt(np.maximum(squares, 0.0)), places, axis=-1)

    p, Xp, Kp, Lp = sizes(form.B)
    q, Xq, Kq, Lq = sizes(np.eye(n))
    A, B, E, Q = (np.abs(each) for each in (form.A, form.inputs, form.disturbance, form.Q))
    terms = (
        *((Xp, A, q), (Xq, A, p), (p, Q, q), (Kp, np.abs(form.R), Kq)),
        *((Xp, B, Kq), (Xq, B, Kp), (Xp, E, Lq), (Xq, E, Lp)),
    )
    integral = sum(np.vecdot(one, np.matvec(M, other)) for one, M, other in terms)
    if np.isfinite(form.delta):
        integral += 2.0 * form.delta**2 * np.vecdot(Lp, Lq)
    return LAST_PLACE * (integral + norms(_direct_change(form, X, K))) / _size(form, unit_gain)


class Columns(NamedTuple):
    """Pairs of columns p, e for which the changes p'D e of a gain are computed.

    pairs: the pairs (n,), (n,): one for each entry of K, or random sums of entries.
    are_drawn: whether the pairs are random sums.
    """

    pairs: list[tuple[np.ndarray, np.ndarray]]
    are_drawn: bool

    @classmethod
    def of(cls, rows: np.ndarray, columns: np.ndarray) -> Columns:
        """Return the pairs for the entries of a gain, or for `DRAWS` sums of many entries.

        rows: (n, m), p of each row of K
        columns: (n, n), e of each column of K
        """
        m, n = rows.shape[1], columns.shape[1]
        if m * n <= MOST_ENTRIES:
            return cls([(p, e) for p in rows.T for e in columns.T], False)
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (DRAWS, m + n))
        return cls([(rows @ each[:m], columns @ each[m:]) for each in signs], True)


def gain_change(form: NormalForm, X: np.ndarray, given: NormalForm) -> float:
    """Return the relative change of K for one unit in the last place of the entries of one game.

    Each entry of K is a linear function of a, b, e, q and r. The magnitudes of its coefficients
    are added, for the least favorable signs.

    form: normal form of the game, in the coordinates in which X is accurate
    X: (n, n), solution
    given: the game in the coordinates of its entries
    """
    into = given.T @ np.linalg.inv(form.T)
    back = np.linalg.inv(into)
    A, B, E, Q = (np.abs(each) for each in (given.A, given.inputs, given.disturbance, given.Q))
    R = np.abs(given.R)
    unit_gain = form.B.T @ X
    # K and L are multiplied in the coordinates of `form`: in those of `given`, terms may cancel.
    K = np.linalg.solve(form.root.T, unit_gain)
    L = form.E.T @ X / form.delta
    rows = back.T @ X
    direct = _direct_change(given, rows @ back, K @ back)
    columns = Columns.of(form.B, back)
    changes = []
    for Z in weighted(form.A - form.S @ X, columns):
        change = (A * np.abs(rows @ Z @ into.T)).sum() + (B * np.abs(rows @ Z @ K.T)).sum()
        change += (E * np.abs(rows @ Z @ L.T)).sum()
        if np.isfinite(form.delta):
            change += form.delta**2 * abs(np.trace(L @ Z @ L.T))
        change += 0.5 * (Q * np.abs(into @ Z @ into.T)).sum()
        change += 0.5 * (R * np.abs(K @ Z @ K.T)).sum()
        changes.append(2.0 * change)
    return relative_change(given, unit_gain @ back, direct, columns, changes)


def relative_change(
    given: NormalForm,
    unit_gain: np.ndarray,
    direct: np.ndarray,
    columns: Columns,
    changes: Sequence[float],
) -> float:
    """Return the relative change of a gain for one unit in the last place of the entries.

    For random sums of entries, twice the mean of their changes is an estimate from above of the sum
    of the norms of the changes of K by each entry of the game (Khintchine).

    given: the game in the coordinates of its entries
    unit_gain: K with R = I in these coordinates, (m, n)
    direct: bound of the change of K that is not due to the change of X, (m, n)
    columns: pairs of columns of the changes
    changes: change of K for each pair, due to the change of X
    """
    if columns.are_drawn:
        total = 2.0 * np.mean(changes) + np.linalg.norm(direct)
    else:
        total = np.linalg.norm(np.reshape(changes, unit_gain.shape) + direct)
    return float(LAST_PLACE * total / _size(given, unit_gain))


def weighted(F: np.ndarray, columns: Columns) -> Iterator[np.ndarray]:
    """Yield for each pair of columns p, e the Z with F Z + Z F' + (p e' + e p')/2 = 0.

    For every G and the D with F'D + D F + G = 0, the product p'D e is the trace of G Z.
    """
    from scipy.linalg import schur
    from scipy.linalg.lapack import dtrsyl

    T, U = schur(F)
    for p, e in columns.pairs:
        turned = np.outer(U.T @ p, U.T @ e)
        Z, scale, _ = dtrsyl(T, T, (turned + turned.T) / -2.0, tranb="T")
        yield U @ (Z / scale) @ U.T


def _direct_change(form: NormalForm, X: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Return a bound of the change b'X - r K of the gain, with R = I, (..., m, n)."""
    change = np.abs(form.inputs.mT) @ np.abs(X) + np.abs(form.R) @ np.abs(K)
    return np.abs(np.linalg.inv(form.root)) @ change


def _size(form: NormalForm, unit_gain: np.ndarray) -> np.ndarray:
    """Return the norm of the gain with R = I, but at least `NOTICED` times that of A over B."""
    least = NOTICED * norms(form.A) / _or_1(norms(form.B))
    return _or_1(np.maximum(norms(unit_gain), least))


def _or_1(sizes: np.ndarray) -> np.ndarray:
    return np.where(sizes > 0.0, sizes, 1.0)
