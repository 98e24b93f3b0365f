"""L2 gain of a system, max_ω σ_max(C (jω I - A)⁻¹ B + D), from its bounded-real Hamiltonian."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import hamiltonian, norms, spectrum
from controller.riccati.bilinear import System, in_continuous_time
from hfa_support.arguments import ArrayLike
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import balanced, spectral_radius

TOLERANCE = 1e-9
#: A gain below this fraction of ‖C‖ ‖E‖ / ‖A - B K‖ is rounding: the disturbance does not affect
#: the output.
ZERO = 1e-12
#: Below this fraction, the largest gain that the search finds is rounding too.
NEGLIGIBLE = 10.0 * ZERO
#: An eigenvalue with |Re λ| up to this fraction of the largest may be on the axis.
NEAR_AXIS = 1e-6
#: Number of the least damped poles near whose frequencies the search for a gain begins.
STARTS = 2
#: Largest number of entries of the matrices that are solved at once: 64 MB.
_LARGEST = 2**22


def level_crossings(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    level: float,
    width: float = math.inf,
) -> np.ndarray:
    """Return all frequencies at which a singular value of C (jω I - A)⁻¹ B + D may equal a level.

    The frequencies, in rad/s and ascending, are |Im λ| of all eigenvalues λ of the bounded-real
    Hamiltonian with |Re λ| <= width |λ| of the largest, by default of all. The level must not be a
    singular value of D.
    Source: Zhou, Doyle and Glover, Section 4.7.
    """
    n, m = B.shape
    free = level**2 * np.eye(m) - D.T @ D
    freed = np.linalg.solve(free, np.hstack([D.T @ C, B.T]))
    by_output, into = freed[:, :n], B @ freed[:, n:]
    out = C.T @ (C + D @ by_output)
    # Every `ratio` gives the same eigenvalues. With this one, the blocks have similar size in any
    # unit of B.
    ratio = math.sqrt((np.linalg.norm(into) or 1.0) / (np.linalg.norm(out) or 1.0))
    loop = A + B @ by_output
    roots = np.linalg.eigvals(hamiltonian(loop, -into / ratio, out * ratio))
    near = (np.abs(roots.real) <= width * np.abs(roots).max()) & (roots.imag >= 0.0)
    return np.sort(roots.imag[near])


def loop_gain(loop: System, *, is_discrete: bool) -> GainBounds:
    """Return bounds of the L2 gain of a closed loop, inf for an unstable one.

    Raises NoSolutionError as `gain_bounds` does.
    """
    if not is_discrete:
        return gain_bounds(*loop)
    if not spectral_radius(loop.A) < 1.0:
        return GainBounds(math.inf, math.inf)
    # The gain at infinite frequency, z = -1, makes the search inaccurate. It is the smaller one of
    # those at z = 1 and -1 if z and A change their sign where necessary.
    one = np.eye(len(loop.A))
    ends = [
        np.linalg.norm(loop.C @ np.linalg.solve(z * one - loop.A, loop.B), 2) for z in (1.0, -1.0)
    ]
    sign = 1.0 if ends[0] >= ends[1] else -1.0
    return gain_bounds(*in_continuous_time(loop._replace(A=sign * loop.A)))


class GainBounds(NamedTuple):
    """Bounds of the L2 gain of a system.

    low: largest gain found at a frequency
    high: upper bound of the gains at all frequencies
    """

    low: float
    high: float


def gain_bounds(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> GainBounds:
    """Return bounds of the L2 gain of C (sI - A)⁻¹ B + D, which differ by `TOLERANCE`.

    Above the upper one, the bounded-real Hamiltonian has no eigenvalue on the imaginary axis.

    - A is not Hurwitz: both are inf
    - no gain exceeds rounding and the gain at infinity: both are σ_max(D), 0 without D

    Source: Bruinsma and Steinbuch, Systems and Control Letters 14 (1990), 287-293.

    Raises NoSolutionError if a pole is on the imaginary axis within rounding.
    """
    poles = spectrum(A)
    if poles[-1].real >= 0.0:  # they are sorted by Re λ
        return GainBounds(math.inf, math.inf)
    # in units of the signals in which B and C have size 1
    sizes = float(np.linalg.norm(B)), float(np.linalg.norm(C))
    at_infinity = float(np.linalg.norm(D, 2)) if D.any() else 0.0
    if 0.0 in sizes:
        return GainBounds(at_infinity, at_infinity)
    unit = sizes[0] * sizes[1]
    system = System(A, B / sizes[0], C / sizes[1], D / sizes[0] / sizes[1])
    typical = 1.0 / float(np.linalg.norm(A))
    floor = max(ZERO * typical, at_infinity / unit)  # a level must exceed rounding and σ_max(D)
    gain = _highest(system, _resonances(poles), floor)
    if gain > max(NEGLIGIBLE * typical, at_infinity / unit):
        return GainBounds(gain * unit, gain * unit * (1.0 + TOLERANCE))
    return GainBounds(at_infinity, at_infinity)


def _highest(system: System, starts: np.ndarray, floor: float) -> float:
    """Return the largest gain over all frequencies, or `floor` if no gain exceeds it.

    The largest gain at the midpoints between neighboring crossings of a level is the next level.

    starts: frequencies of the first level, rad/s
    """
    gain = max(floor, _highest_at(system, starts))
    while True:
        crossings = level_crossings(*system, gain * (1.0 + TOLERANCE), NEAR_AXIS)
        if not len(crossings):
            return gain
        midpoints = (crossings[1:] + crossings[:-1]) / 2.0 if len(crossings) > 1 else crossings
        found = _highest_at(system, midpoints)
        if not found > gain:  # these crossings are rounding
            return gain
        gain = found


def _highest_at(system: System, frequencies: np.ndarray) -> float:
    """Return the largest gain at given frequencies.

    Raises NoSolutionError as `responses` does.
    """
    A, B, C, D = system
    together = max(1, _LARGEST // max(A.size, B.size, D.size))
    parts = np.split(frequencies, range(together, len(frequencies), together))
    return max(_largest_gain(C @ responses(A, B, part) + D) for part in parts)


def _resonances(poles: np.ndarray) -> np.ndarray:
    """Return 0, and |λ| and Im λ of the least damped poles, rad/s."""
    upper = poles[poles.imag >= 0.0]
    least_damped = upper[np.argsort(-upper.real / np.abs(upper))[:STARTS]]
    return np.concatenate([[0.0], np.abs(least_damped), least_damped.imag])


def responses(loop: np.ndarray, B: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Return the response of the states to the inputs, (jω I - loop)⁻¹ B, (N, n, m), at N
    frequencies.

    loop: (n, n), state matrix of a closed loop
    B: (n, m)
    frequencies: ω, (N,), rad/s

    Raises NoSolutionError if a pole of the loop is on the imaginary axis within rounding.
    """
    resolvent = 1j * frequencies[:, None, None] * np.eye(len(loop)) - loop
    try:
        return np.linalg.solve(resolvent, B)
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(
            "the loop has a pole on the imaginary axis, within rounding; give a stabilizing gain"
        ) from error


def _largest_gain(matrices: np.ndarray) -> float:
    """Return the largest singular value of N matrices (N, p, m).

    Only matrices whose Frobenius norm, an upper bound, reaches the largest value are decomposed.
    """
    if not matrices.size:
        return 0.0
    size = float(np.abs(matrices).max()) or 1.0
    scaled = matrices / size
    bounds = norms(scaled)

    def largest_of(some: np.ndarray) -> float:
        wide = some.shape[-2] < some.shape[-1]
        gram = some @ some.mT.conj() if wide else some.mT.conj() @ some
        return math.sqrt(max(float(np.linalg.eigvalsh(gram)[:, -1].max(initial=0.0)), 0.0))

    first = bounds.argmax()
    gain = largest_of(scaled[[first]])
    bounds[first] = 0.0
    return size * max(gain, largest_of(scaled[bounds > gain]))


def bounded_real_gain(game: Game, K: ArrayLike) -> float:
    """Return the L2 gain sup ‖y‖₂/‖d‖₂ of the closed loop with u = -K z, ‖y‖² = ∫ z'Qz + 2z'Nu +
    u'Ru.

    In discrete time, signals are weighted by α^(k/2), as their squares are in the cost. The result
    is inf if the loop is not stable.

    K: (m, n)

    Raises BadInputError if K is not a real m x n matrix, and NoSolutionError as `loop_gain` does.
    """
    K = game.checked_gain(K)
    root = math.sqrt(game.discount)
    loop, units = balanced(root * (game.A - game.B @ K))
    outputs = scaled_root(game.weights).T @ np.vstack([np.eye(len(loop)), -K]) * units
    E = root * game.E / units[:, None]
    system = System(loop, E, outputs, np.zeros((len(outputs), E.shape[1])))
    return loop_gain(system, is_discrete=game.is_discrete).high


def scaled_root(M: np.ndarray) -> np.ndarray:
    """Return F (n, n) with F F' = M for a positive semidefinite M.

    M = diag(d) N diag(d) with d_i = sqrt(M_ii), and F = diag(d) N^½. A change of units scales the
    rows of F. Small entries of M are not lost in the rounding of large entries.
    """
    d = np.sqrt(np.diag(M).clip(0.0))
    safe = np.where(d > 0.0, d, 1.0)
    values, vectors = np.linalg.eigh(M / np.outer(safe, safe))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # values below 0 are rounding
    return np.asarray(d[:, None] * root)
