"""Search, in double precision, for matrices H that count the eigenvalues on each side of a line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from flint import arb_mat

from hfa_prove.check.modes import least_and_most, modes_right_of
from hfa_prove.enclosure.balls import doubles
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.flight import Line

#: Condition number above which eigenvectors are treated as dependent.
_DEPENDENT = 1e12


def find_line(A: TaylorModel, rate: float = 0.0) -> tuple[int, Line] | None:
    """Return the number of eigenvalues with Re λ > -rate, and a matrix H that proves the number.

    Return None if no matrix H that proves a number is found.

    A: Taylor model of a matrix, (n, n)
    rate: 1/s
    """
    for H, turn in _candidates(A, rate):
        line = Line(H, turn, rate)
        try:
            return modes_right_of(A, line), line
        except Rejected:
            continue
    return None


def lines_near_axis(A: TaylorModel) -> list[Line]:
    """Return lines Re λ = -rate proved to contain no eigenvalue of A, with their matrices H.

    The list contains the nearest line found on each side of the imaginary axis, at most one per
    side.
    """
    abscissae = np.sort(np.linalg.eigvals(doubles(A.center)).real)
    lines = []
    for side in (-1.0, 1.0):
        between = []
        for first, second in pairwise(abscissae.tolist()):
            if second > first:
                between += [-(first + second) / 2, -(2 * first + second) / 3]
        ends = [1.0 - abscissae[0], -1.0 - abscissae[-1]]
        for rate in sorted([*between, *ends], key=abs):
            if rate * side <= 0.0:
                continue
            counted = find_line(A, rate)
            if counted is not None:
                _, line = counted
                lines.append(line)
                break
    return lines


def bounds_of_modes(A: TaylorModel) -> tuple[tuple[int, int], list[Line]]:
    """Return (lowest, highest) number of eigenvalues with positive real part, and the proof.

    The proof consists of lines with their matrices H.
    """
    on_axis = find_line(A)
    if on_axis is not None:
        count, line = on_axis
        return (count, count), [line]
    least = 0
    most = A.center.nrows()
    lines = lines_near_axis(A)
    for line in lines:
        at_least, at_most = least_and_most(A, line)
        least = max(least, at_least)
        most = min(most, at_most)
    return (least, most), lines


def _candidates(A: TaylorModel, rate: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield matrices H (n, n) for the center of a box, and coordinates T in which to test each.

    H = T⁻ᵀ diag(±h) T⁻¹, with T the eigenvectors of the center matrix. Each h > 0 tolerates a
    different set of deviations from the center matrix. N is the largest effect of the set in these
    coordinates. With G = diag|Re λ + a| - N, G x = 1 and G'y = 1, the vector is h = y/x. If G has a
    positive inverse, diag(h) G + G'diag(h) is positive definite (Berman and Plemmons 1979). The
    vector h = 1/|Re λ + a| solves Lyapunov's equation and suffices for small deviations. If the
    eigenvectors are nearly dependent, Lyapunov's equation is solved for the center matrix instead.

    A: Taylor model of the matrix on the box
    rate: a, 1/s
    """
    middle, slope, bend, remainder, *errors = A.parts
    A_middle = doubles(middle)
    values, vectors = np.linalg.eig(A_middle)
    distances = np.abs(values.real + rate)
    if np.linalg.cond(vectors) > _DEPENDENT:
        yield from _lyapunov_candidate(A_middle, rate)
        return
    inverse = np.linalg.inv(vectors)
    shares = []
    for chosen in ((slope, bend, remainder, *errors), errors):
        share = _shares(distances, vectors, inverse, chosen)
        if share is not None:
            shares.append(share)
    if distances.min() > 0.0:
        shares.insert(1, 1.0 / distances)
    signs = np.where(values.real > -rate, -1.0, 1.0)
    # Real and imaginary parts of the eigenvectors: T = X U with a unitary U.
    parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
    turn = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
    for share in shares:
        H = (inverse.conj().T @ ((signs * share)[:, None] * inverse)).real
        if np.isfinite(H).all():
            yield (H + H.T) / 2, turn


def _shares(
    distances: np.ndarray,
    vectors: np.ndarray,
    inverse: np.ndarray,
    additions: Sequence[arb_mat],
) -> np.ndarray | None:
    """Return h = y/x of `_candidates`, (n,), or None if G has no positive inverse.

    distances: |Re λ + a|
    vectors, inverse: T and T⁻¹
    additions: the deviations from the center matrix
    """
    G = np.diag(distances)
    for addition in additions:
        rows = addition.tolist()
        radii = np.array([[float(entry.rad()) for entry in row] for row in rows])
        G -= np.abs(inverse @ doubles(addition) @ vectors)
        G -= np.abs(inverse) @ radii @ np.abs(vectors)
    ones = np.ones(len(G))
    try:
        x = np.linalg.solve(G, ones)
        y = np.linalg.solve(G.T, ones)
    except np.linalg.LinAlgError:
        return None
    return y / x if min(x.min(), y.min()) > 0.0 else None


def _lyapunov_candidate(A: np.ndarray, rate: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield H of (A + a I)'H + H (A + a I) = -I with a = rate, and its eigenvectors.

    Nothing is yielded if two eigenvalues are nearly mirror images in the line Re λ = -a. The
    equation is then nearly singular.
    """
    from scipy.linalg import solve_continuous_lyapunov

    shifted = A + rate * np.eye(len(A))
    values = np.linalg.eigvals(shifted)
    if np.abs(values[:, None] + values.conj()).min() <= 1e-9 * np.abs(values).max():
        return
    H = solve_continuous_lyapunov(shifted.T, -np.eye(len(A)))
    H = (H + H.T) / 2
    yield H, np.linalg.eigh(H)[1]
