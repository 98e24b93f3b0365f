"""Gains of systems over frequency, σ_max(C (jω I - A)⁻¹ B + D), in doubles.

They propose an L2 gain, which `l2_gain` proves, and give margins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import balanced


def hamiltonian(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian matrix [[A, -S], [-Q, -A']], (2n, 2n)."""
    rows = np.concatenate([A, -S], axis=1), np.concatenate([-Q, -A.T], axis=1)
    return np.concatenate(rows)  # half the time of np.block


def units_of(A: np.ndarray, S: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return units u, (n,), in which the Hamiltonian is balanced: states z have the numbers z / u.

    The units are powers of two, in which nothing rounds. If Q = 0, and A and S are not, the largest
    entries of S and A are also of similar size.

    A, S, Q: (n, n)

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    _, scaling = balanced(hamiltonian(A, S, Q))
    of_states, of_costates = np.split(np.log2(scaling), 2)
    # The nearest symplectic scaling: that of the costates is the inverse of that of the states.
    units = np.exp2(np.round(0.5 * (of_states - of_costates)))
    if not Q.any() and S.any() and A.any():  # balanced also in units that are f times as large
        S_in_units = S / np.outer(units, units)
        A_in_units = A * units / units[:, None]
        with np.errstate(all="ignore"):
            # They divide S by f², and leave A.
            logarithm = np.log2(np.abs(S_in_units).max()) - np.log2(np.abs(A_in_units).max())
            units = units * np.exp2(np.round(0.5 * logarithm))
    return units


class System(NamedTuple):
    """System C (s I - A)⁻¹ B + D.

    A: (n, n)
    B: (n, k)
    C: (p, n)
    D: (p, k)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def in_continuous_time(steps: System) -> System:
    """Return the system in s = (z - 1) / (z + 1) of a system in z, C (z I - A)⁻¹ B + D.

    The unit circle becomes the imaginary axis, and stable poles remain stable. A must not have the
    eigenvalue -1.

    Source: Zhou, Doyle and Glover, Section 21.2.
    """
    A, B, C, D = steps
    one = np.eye(len(A))
    inverse_B = np.linalg.solve(A + one, B)  # (A + I)⁻¹ B
    C_inverse = np.linalg.solve((A + one).T, C.T).T  # C (A + I)⁻¹
    root = math.sqrt(2.0)  # the factor 2 of the transformation, shared by B and C
    return System(
        np.linalg.solve(A + one, A - one), root * inverse_B, root * C_inverse, D - C @ inverse_B
    )


# These guide the search, and decide nothing: the gain is proved.

#: Relative distance of the next level of the search above a gain.
TOLERANCE = 1e-9
#: An eigenvalue with |Re λ| up to this fraction of the largest may be on the axis.
NEAR_AXIS = 1e-6
#: Number of the least damped poles near whose frequencies the search for a gain begins.
STARTS = 2


def level_crossings(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    level: float,
    width: float = math.inf,
) -> np.ndarray:
    """Return all frequencies at which a singular value of C (jω I - A)⁻¹ B + D may equal a level.

    The frequencies, in rad/s and ascending, are Im λ >= 0 of the eigenvalues λ of the bounded-real
    Hamiltonian that are near the imaginary axis.

    level: a number that is not a singular value of D
    width: largest |Re λ|, as a fraction of the largest |λ|; by default all λ are near

    Source: Zhou, Doyle and Glover, Section 4.7.
    """
    n, m = B.shape
    # With W = level² I - D'D, the Hamiltonian has the blocks A + B W⁻¹D'C, B W⁻¹B' and
    # C'(C + D W⁻¹D'C).
    W = level**2 * np.eye(m) - D.T @ D
    over_W = np.linalg.solve(W, np.hstack([D.T @ C, B.T]))
    D_C_over_W, B_over_W = over_W[:, :n], over_W[:, n:]
    loop, upper, lower = A + B @ D_C_over_W, B @ B_over_W, C.T @ (C + D @ D_C_over_W)
    # Every `ratio` gives the same eigenvalues. With this one, the blocks have similar size in any
    # unit of B.
    ratio = math.sqrt((np.linalg.norm(upper) or 1.0) / (np.linalg.norm(lower) or 1.0))
    roots = np.linalg.eigvals(hamiltonian(loop, -upper / ratio, lower * ratio))
    near_axis = np.abs(roots.real) <= width * np.abs(roots).max()
    return np.sort(roots.imag[near_axis & (roots.imag >= 0.0)])


def peak_frequency(system: System) -> float:
    """Return the frequency of the largest gain of a stable system in continuous time, rad/s.

    The frequency is found in doubles. It is inf if no finite frequency has a larger gain than D.

    Raises LinAlgError if a pole is on the imaginary axis within rounding.

    Source: Bruinsma and Steinbuch, Systems and Control Letters 14 (1990), 287-293.
    """
    # in units of the signals in which B and C have size 1:
    size_of_B, size_of_C = (float(np.linalg.norm(M)) or 1.0 for M in (system.B, system.C))
    A, B, C = system.A, system.B / size_of_B, system.C / size_of_C
    D = system.D / (size_of_B * size_of_C)

    # The search begins where gains are large: at 0, |λ| and Im λ of the least damped poles λ.
    poles = np.sort_complex(np.linalg.eigvals(A))
    poles = poles[poles.imag >= 0.0]
    with np.errstate(invalid="ignore"):  # λ = 0 has no damping, and is sorted last
        least_damped = poles[np.argsort(-poles.real / np.abs(poles))[:STARTS]]
    frequencies = np.concatenate([[0.0], np.abs(least_damped), least_damped.imag])

    highest, peak = float(np.linalg.norm(D, 2)), math.inf
    while len(frequencies):
        resolvents = (1j * frequency * np.eye(len(A)) - A for frequency in frequencies)
        gains = [np.linalg.norm(C @ np.linalg.solve(each, B) + D, 2) for each in resolvents]
        most = int(np.argmax(gains))
        if not gains[most] > highest:
            break
        highest, peak = float(gains[most]), float(frequencies[most])
        # Between two neighboring crossings of the highest gain so far, the gain may be higher.
        crossings = level_crossings(A, B, C, D, highest * (1.0 + TOLERANCE), NEAR_AXIS)
        frequencies = (crossings[1:] + crossings[:-1]) / 2.0 if len(crossings) > 1 else crossings
    return peak


def peak_frequency_of_steps(steps: System) -> float:
    """Return the frequency of the largest gain of a stable system in discrete time, rad/step.

    D must be 0.

    Raises LinAlgError as `peak_frequency` does.
    """
    # A large gain at infinite frequency, z = -1, makes the search inaccurate. If the gain at z = -1
    # is above that at z = 1, z and A change their sign, which leaves all gains (D = 0).
    one = np.eye(len(steps.A))
    at_plus_1, at_minus_1 = (
        np.linalg.norm(steps.C @ np.linalg.solve(z * one - steps.A, steps.B), 2)
        for z in (1.0, -1.0)
    )
    is_turned = at_plus_1 < at_minus_1
    system = in_continuous_time(steps._replace(A=-steps.A) if is_turned else steps)
    angle = 2.0 * math.atan(peak_frequency(system))
    return math.pi - angle if is_turned else angle


def scaled_root(M: np.ndarray) -> np.ndarray:
    """Return F (n, n) with F F' = M for a positive semidefinite M.

    M = diag(d) N diag(d) with d_i = sqrt(M_ii), and F = diag(d) N^½: the units of M scale the rows
    of F, and small entries of M are not lost in the rounding of large ones.
    """
    d = np.sqrt(np.diag(M).clip(0.0))
    safe = np.where(d > 0.0, d, 1.0)
    values, vectors = np.linalg.eigh(M / np.outer(safe, safe))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # values below 0 are rounding
    return np.asarray(d[:, None] * root)
