"""Distance of a matrix from the nearest one with an eigenvalue on the boundary of stability.

The boundary is the imaginary axis, and in discrete time the unit circle. Unlike an eigenvalue, the
distance is reliable where eigenvalues are ill-conditioned: of a double eigenvalue on the axis, the
computed |Re λ| is about 1e-8 of the norm, but the computed distance is about 1e-16.

Sources: Byers, SIAM J. Scientific and Statistical Computing 9 (1988), 875-881; Boyd and
Balakrishnan, Systems and Control Letters 15 (1990), 1-7.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import hamiltonian
from hfa_support.matrices import balanced

#: The search begins at the frequencies of so many eigenvalues nearest to the boundary.
STARTS = 4
#: Relative accuracy of the least singular value over all frequencies,
SHARP = 1e-6
#: unless it is below this fraction of the norm, where it is only rounding.
ROUNDING = 1e-14
#: Largest number of levels; three are usual.
MOST_LEVELS = 20
#: An eigenvalue up to this distance from the boundary, relative to the norm, may be on it.
MAYBE_ON_BOUNDARY = 1e-6


class Nearest(NamedTuple):
    """Smallest change of a matrix M that puts an eigenvalue on the boundary of stability.

    distance: norm of the change, relative to the norm of M
    frequency: of the eigenvalue, rad/s, in discrete time rad a step
    """

    distance: float
    frequency: float


def hamiltonian_axis_distance(H: np.ndarray, eigenvalues: np.ndarray) -> Nearest:
    """Return min_ω σ_min(H - jω I) / ‖H‖₂ of a Hamiltonian H, and this frequency ω >= 0.

    With J = [[0, I], [-I, 0]], H J - jω J is Hermitian, and the magnitudes of its eigenvalues are
    the singular values of H - jω I. One of them equals a level only where jω is an eigenvalue of
    the Hamiltonian H + level J or H - level J.

    H: (2n, 2n)
    eigenvalues: of H, (2n,)
    """
    one = np.eye(len(H) // 2)
    J = hamiltonian(0.0 * one, -one, one)
    symmetric = H @ J
    symmetric = (symmetric + symmetric.T) / 2.0
    norm = float(np.abs(np.linalg.eigvalsh(symmetric)).max())

    def singular_values(frequencies: np.ndarray) -> np.ndarray:
        values = np.linalg.eigvalsh(symmetric - 1j * frequencies[:, None, None] * J)
        return np.asarray(np.abs(values).min(axis=1))

    def crossings(level: float) -> np.ndarray:
        values = np.concatenate([np.linalg.eigvals(H + sign * level * J) for sign in (-1.0, 1.0)])
        return _on_axis(values, norm)

    return _least_singular_value(
        singular_values=singular_values,
        crossings=crossings,
        starts=_nearest_to_axis(eigenvalues),
        norm=norm,
    )


def distance_to_instability(loop: np.ndarray, *, is_discrete: bool) -> Nearest:
    """Return the distance of a stable loop, in balanced units, from the boundary of stability.

    loop: (n, n)
    """
    M, _ = balanced(loop)
    return _distance_from_circle(M) if is_discrete else _distance_from_axis(M)


def _distance_from_axis(M: np.ndarray) -> Nearest:
    """Return min_ω σ_min(M - jω I) / ‖M‖₂ and this ω, for M (n, n).

    A singular value equals a level only where jω is an eigenvalue of the Hamiltonian
    [[M, -level I], [level I, -M']] (Byers).
    """
    norm = float(np.linalg.norm(M, 2))
    one = np.eye(len(M))

    def singular_values(frequencies: np.ndarray) -> np.ndarray:
        return _smallest(M - 1j * frequencies[:, None, None] * one)

    def crossings(level: float) -> np.ndarray:
        return _on_axis(np.linalg.eigvals(hamiltonian(M, level * one, -level * one)), norm)

    return _least_singular_value(
        singular_values=singular_values,
        crossings=crossings,
        starts=_nearest_to_axis(np.linalg.eigvals(M)),
        norm=norm,
    )


def _distance_from_circle(M: np.ndarray) -> Nearest:
    """Return min_ω σ_min(M - e^jω I) / ‖M‖₂ and this ω, for M (n, n).

    A singular value equals a level only where e^jω is an eigenvalue of a symplectic pencil.
    """
    from scipy.linalg import eigvals

    norm = float(np.linalg.norm(M, 2))
    one, zero = np.eye(len(M)), np.zeros_like(M)

    def singular_values(frequencies: np.ndarray) -> np.ndarray:
        return _smallest(M - np.exp(1j * frequencies)[:, None, None] * one)

    def crossings(level: float) -> np.ndarray:
        left = np.block([[M, -level * one], [zero, one]])
        right = np.block([[one, zero], [-level * one, M.T]])
        values = eigvals(left, right)
        on_circle = values[np.abs(np.abs(values) - 1.0) <= MAYBE_ON_BOUNDARY]
        return np.concatenate([np.abs(np.angle(on_circle)), [0.0, np.pi]])

    values = np.linalg.eigvals(M)
    upper = values[values.imag >= 0.0]
    nearest = upper[np.argsort(np.abs(np.abs(upper) - 1.0))[:STARTS]]
    starts = np.concatenate([np.angle(nearest), [0.0, np.pi]])
    return _least_singular_value(
        singular_values=singular_values, crossings=crossings, starts=starts, norm=norm
    )


def _smallest(matrices: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.svd(matrices, compute_uv=False)[:, -1])


def _on_axis(eigenvalues: np.ndarray, norm: float) -> np.ndarray:
    """Return the frequencies of the eigenvalues that may be on the imaginary axis, and 0, or none
    without such eigenvalues.
    """
    on_axis = np.abs(eigenvalues.real) <= MAYBE_ON_BOUNDARY * norm
    found = np.abs(eigenvalues.imag[on_axis])
    return np.append(found, 0.0) if len(found) else found


def _nearest_to_axis(eigenvalues: np.ndarray) -> np.ndarray:
    """Return 0 and the frequencies of the stable eigenvalues nearest to the imaginary axis."""
    stable = eigenvalues[(eigenvalues.real <= 0.0) & (eigenvalues.imag >= 0.0)]
    return np.append(stable.imag[np.argsort(-stable.real)[:STARTS]], 0.0)


def _least_singular_value(
    *,
    singular_values: Callable[[np.ndarray], np.ndarray],
    crossings: Callable[[float], np.ndarray],
    starts: np.ndarray,
    norm: float,
) -> Nearest:
    """Return the least singular value over all frequencies, relative to a norm, and where it is.

    Between two neighboring crossings, the singular value is everywhere above the level or
    everywhere below. The least value at their midpoints gives the next level.

    singular_values: frequencies (N,) -> smallest singular value at each, (N,)
    crossings: level -> frequencies at which the singular value may equal it, with the ends of the
        range
    starts: frequencies at which the search begins
    norm: of the matrix
    """

    def least(frequencies: np.ndarray) -> tuple[float, float]:
        sizes = singular_values(frequencies)
        place = int(sizes.argmin())
        return float(sizes[place]), float(frequencies[place])

    if norm == 0.0:
        return Nearest(0.0, 0.0)
    distance, frequency = least(starts)
    for _ in range(MOST_LEVELS):
        if distance <= ROUNDING * norm:
            break
        level = (1.0 - SHARP) * distance
        ends = np.sort(crossings(level))
        if not len(ends):
            break
        lower, place = least(np.append((ends[1:] + ends[:-1]) / 2.0, ends[-1]))
        if not lower < level:
            break
        distance, frequency = lower, place
    return Nearest(distance / norm, frequency)
