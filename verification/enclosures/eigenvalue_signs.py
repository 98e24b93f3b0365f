"""How many eigenvalues lie on each side of the axis Re λ = -a, for every matrix of a Taylor model.

If H is symmetric and -(A'H + H A + 2 a H) is positive definite, A has as many eigenvalues with Re λ < -a as H has
positive ones, as many with Re λ > -a as H has negative ones, and none between: Ostrowski and Schneider (J. Math. Anal.
Appl. 4, 1962); with H > 0 it is Lyapunov's theorem. For a fixed H the matrix is affine in A, and positive definite
matrices form a convex cone: one H serves a whole box when it serves the corners of the box.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from flint import arb_mat

from verification.arithmetic.balls import doubles, is_positive_definite, matrix, pivots, radii
from verification.arithmetic.taylor_model import TaylorModel

#: What a remainder is widened by.
_ROOM = 6


class ProvedModes(NamedTuple):
    """How many eigenvalues of every matrix have Re λ > -a, with what proves it: H (n, n) in the coordinates turn."""

    unstable: int
    H: np.ndarray
    turn: np.ndarray


def counted(A: TaylorModel | arb_mat, rate: float = 0.0) -> ProvedModes | None:
    """Eigenvalues right of the line Re λ = -a, of every matrix; None when one may lie on it."""
    whole = TaylorModel.of(A)
    middle, *additions = whole.parts
    for H, turn in candidates(doubles(middle), rate, additions, additions[3:]):
        T, weight = matrix(turn), matrix(H)
        signs, half = pivots(T.transpose() * weight * T), -(weight * (whole + matrix(rate * np.eye(len(H)))))
        if signs is not None and is_positive(half + half.transpose(), turn):
            return ProvedModes(sum(1 for pivot in signs if pivot < 0), H, turn)
    return None


def candidates(A: np.ndarray, rate: float, *additions: Sequence[arb_mat]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """H (n, n) for a matrix and what may be added to it, found in doubles, and coordinates T in which to prove it.

    H = T⁻ᵀ diag(±h) T⁻¹ with the eigenvectors T of A, in which A is normal. For all of some additions h = y/x with
    G x = 1, G'y = 1, G = diag|Re λ + a| - N, N what they do at most in these coordinates: where G has a positive
    inverse, diag(h) G + G' diag(h) is positive definite (Berman and Plemmons 1979). h = 1/|Re λ + a|: Lyapunov's
    equation, for additions that do less than their entries could. None when the eigenvectors are dependent.
    """
    values, vectors = np.linalg.eig(A)
    distances, shares = np.abs(values.real + rate), []
    try:
        inverse = np.linalg.inv(vectors)
        for each in additions:
            G = np.diag(distances)
            for E in each:
                G -= np.abs(inverse @ doubles(E) @ vectors) + np.abs(inverse) @ radii(E) @ np.abs(vectors)
            x, y = (np.linalg.solve(own, np.ones(len(A))) for own in (G, G.T))
            if min(x.min(), y.min()) > 0.0:
                shares.append(y / x)
    except np.linalg.LinAlgError:
        return
    with np.errstate(divide="ignore"):
        shares.insert(1, 1.0 / distances)
    # Real and imaginary parts: T = X U with a unitary U.
    parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
    congruence = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
    for h in shares:
        H = (inverse.conj().T @ ((np.where(values.real > -rate, -1.0, 1.0) * h)[:, None] * inverse)).real
        if np.isfinite(H).all():
            yield (H + H.T) / 2, congruence


def is_positive(form: TaylorModel, turn: np.ndarray) -> bool:
    """Every symmetric matrix of the form is positive definite, with room: tested in the coordinates `turn`."""
    T = matrix(turn)
    turned = form.map(lambda part: T.transpose() * part * T)
    return all(map(is_positive_definite, roomy(turned).corners()))


def roomy(model: TaylorModel) -> TaylorModel:
    """The same with a remainder `_ROOM` times as large: a checker may enclose it less tightly."""
    c0, c1, c2, rest, *errors = model.parts
    return TaylorModel(c0, c1, c2, _ROOM * rest, *errors)
