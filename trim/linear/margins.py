"""Margins of a closed loop for simultaneous changes at all inputs, within disks.

The margins are computed from M = S - I/2, with the sensitivity S = (I + L)⁻¹ of the loop L. The
loop stays stable for all factors in a disk of size α if σ_max(D M D⁻¹) < 1/α at each frequency,
with any diagonal D there. A scalar loop l = T/S has S = M + 1/2 and T = 1 - S. It is real where M
is real, and |l| = 1 where M is imaginary. Gain margins are factors (not dB), phases are in degrees
and frequencies in rad/s. All is computed in doubles, and not proved, for a loop that is proved
stable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import LARGEST, balanced
from trim.linear.frequency_response import System, in_continuous_time, level_crossings

#: Frequencies per decade of the grid where a search begins.
PER_DECADE = 20
#: Points near a resonance: their spacing grows with the distance from the pole, up to a hundred of
#: its widths.
RESONANCE = np.linspace(-5.3, 5.3, 45)
#: Frequencies with a smaller relative difference are equal.
_EQUAL = 1e-9


def frequency_grid(eigenvalues: np.ndarray) -> np.ndarray:
    """Return frequencies that resolve every resonance, rad/s, ascending.

    The frequencies are 0, a logarithmic grid from 1 % of the smallest nonzero eigenvalue magnitude
    to 100 times the largest, and points around each resonance. The grid always includes the range
    from 0.01 to 100 rad/s. The points around a resonance begin within its width.

    eigenvalues: poles, (n,), 1/s
    """
    moduli = np.abs(eigenvalues)
    # 1 rad/s as one of the magnitudes, so that the grid includes 0.01 to 100 rad/s:
    slowest = float(moduli[moduli > 0.0].min(initial=1.0))
    fastest = float(moduli.max(initial=1.0))
    decades = math.log10(fastest / slowest) + 4.0
    grid = np.geomspace(1e-2 * slowest, 1e2 * fastest, math.ceil(decades * PER_DECADE))
    # distances from each pole, up to a hundred of its widths |Re λ|
    around = np.abs(eigenvalues.real) * np.sinh(RESONANCE)[:, None]
    resonances = np.append(np.abs(eigenvalues.imag + around), np.abs(eigenvalues.imag))
    ascending = np.unique(np.concatenate([[0.0], grid, resonances]))
    return ascending[np.append(True, np.diff(ascending) > _EQUAL * ascending[1:])]


#: Relative distance of the level above the largest bound found, the relative error of the margin.
ABOVE = 1e-8
#: For m inputs, this distance is multiplied by 10 after each MANY / m² frequencies, so that the
#: search ends: after at most 9 times as many, no gain is above the level. Twenty are usual.
MANY = 120
#: Rounds of balancing for the initial scaling, which the search at each frequency improves.
SWEEPS = 20
#: Relative distance of σ_max(D M D⁻¹) from its least value, up to a factor of m.
SETTLED = 1e-10
#: Change of A, relative to its norm, that separates equal eigenvectors.
CHANGE = 1e-13
#: Number of times in which a response is computed from the modes and corrected.
ROUNDS = 3
#: A smaller last correction, relative to the response, is followed by one of its square.
NEAR = 1e-9
#: Interval of frequencies, rad/s.
Piece = tuple[float, float]


class DiskMargin(NamedTuple):
    """Disk margin: stability for simultaneous changes of all inputs by independent complex factors.

    The loop remains stable if each input is multiplied by a factor f = (2 + αε)/(2 - αε), with any
    complex |ε| < 1.

    disk: α, a lower bound of the margin, within .1 % for up to three inputs; for more inputs the
        true margin may be slightly larger
    gain: (2 + α)/(2 - α); real factors f are between 1/gain and gain
    phase: 2 arctan(α/2), deg, the phase of factors f with |f| = 1
    frequency: rad/s, at which the margin is smallest; possibly inf
    """

    disk: float
    gain: float
    phase: float
    frequency: float


class Modes(NamedTuple):
    """Eigenvalues, (n,), and eigenvectors, (n, n), with the inverse of their matrix."""

    values: np.ndarray
    vectors: np.ndarray
    inverse: np.ndarray


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Stable closed loop M(s) = D + C (s I - A)⁻¹ B, (m, m).

    A: (n, n), stable
    B: (n, m)
    C: (m, n)
    D: (m, m), M at infinite frequency
    dt: sampling time, s, of a sampled loop with s = (z - 1) / (z + 1); 0 in continuous time
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float = 0.0

    def only(self, i: int) -> ClosedLoop:
        """Return M of loop i alone, with the other loops closed."""
        one = slice(i, i + 1)
        loop = replace(self, B=self.B[:, one], C=self.C[one], D=self.D[one, one])
        vars(loop)["modes"] = self.modes  # of the same A
        return loop

    @cached_property
    def modes(self) -> Modes:
        """Modes of A, or of `_perturbed` in its place if eigenvectors of A are nearly dependent."""
        values, vectors = np.linalg.eig(self.A)
        if not np.linalg.cond(vectors) < 1.0 / CHANGE:
            values, vectors = np.linalg.eig(self._perturbed)
        return Modes(values, vectors, np.linalg.inv(vectors))

    @property
    def _perturbed(self) -> np.ndarray:
        """A plus random numbers of the size of rounding, which separate equal eigenvectors."""
        return self.A + spread(len(self.A)) * CHANGE * np.linalg.norm(self.A)

    def at(self, frequencies: np.ndarray) -> np.ndarray:
        """Return M(jω), (N, m, m), at finite frequencies ω, (N,).

        The response x = (s I - A)⁻¹ B is computed from the modes of A, with n² operations for each
        frequency, and corrected by its residual. Where the corrections do not shrink, as where |A|
        is far above its slow poles, linear equations are solved instead.
        """
        values, vectors, inverse = self.modes
        s = 1j * np.repeat(frequencies, self.B.shape[1])  # a column of x for each ω and each input
        inputs = np.tile(self.B, len(frequencies))
        x = np.zeros(inputs.shape, dtype=complex)
        for _ in range(ROUNDS):
            residual = inputs - s * x + self.A @ x
            correction = vectors @ (inverse @ residual / (s - values[:, None]))
            x += correction
        is_inaccurate = ~(np.abs(correction).max(0) <= NEAR * np.abs(x).max(0))
        s_one = s[is_inaccurate, None, None] * np.eye(len(self.A))
        of_inputs = inputs.T[is_inaccurate, :, None]
        try:
            solved = np.linalg.solve(s_one - self.A, of_inputs)
        except np.linalg.LinAlgError:  # a mode is undamped up to rounding
            solved = np.linalg.solve(s_one - self._perturbed, of_inputs)
        x[:, is_inaccurate] = solved[:, :, 0].T
        outputs = (self.C @ x).reshape(len(self.C), len(frequencies), self.B.shape[1])
        return self.D + np.moveaxis(outputs, 1, 0)

    def rate(self, frequencies: np.ndarray) -> np.ndarray:
        """Return the physical frequencies, rad/s, that belong to frequencies ω of s = jω.

        - continuous time: the same frequencies
        - sampled loop: the angle of z, divided by dt
        """
        return 2.0 * np.arctan(frequencies) / self.dt if self.dt else frequencies


def spread(n: int) -> np.ndarray:
    """Return numbers between -1 and 1 that are as good as random, (n, n)."""
    return np.cos(np.arange(float(n * n)) ** 1.5).reshape(n, n)


def loop_of(A: np.ndarray, B: np.ndarray, C: np.ndarray, dt: float | bool | None) -> ClosedLoop:
    """Return M = S - I/2 of a stable loop, in balanced units, with the sensitivity at its inputs
    S = I + C (s I - A)⁻¹ B.

    A: (n, n), state matrix of the closed loop
    B: (n, m), effect of the inputs on the states
    C: (m, n), feedback u = C x of the loop
    dt: None in continuous time; in discrete time the sample time, s, or True if it is not known:
        frequencies are then in rad per step
    """
    A, units = balanced(A)
    B, C = B / units[:, None], C * units
    # In these units of u_i, column i of B is as large as row i of C.
    with np.errstate(all="ignore"):
        ratios = np.sqrt(np.linalg.norm(C, axis=1) / np.linalg.norm(B, axis=0))
    units_of_u = np.where((ratios > 0.0) & np.isfinite(ratios), ratios, 1.0)
    loop = System(A, B * units_of_u, C / units_of_u[:, None], 0.5 * np.eye(len(C)))
    if dt is None:
        return ClosedLoop(*loop)
    return ClosedLoop(*in_continuous_time(loop), dt=float(dt))


def disk_of(loop: ClosedLoop, near: float = 0.0) -> DiskMargin:
    """Return the disk margin of a stable closed loop M.

    Intervals of frequencies are divided until the bound min_D σ_max(D M D⁻¹) is shown to be below
    a common level on all intervals. The margin is the inverse of this level. The interval with the
    largest bound is divided first, so that most intervals are below the level soon.

    loop: M
    near: estimate of the critical frequency, rad/s, which shortens the search; 0 if unknown

    Source: Lawrence, Tits and Van Dooren, Automatica 36 (2000), 449-456.
    """
    poles = loop.modes.values
    ends = np.unique(np.concatenate([[0.0], np.abs(poles), np.abs(poles.imag)]))
    pieces = list(pairwise([*ends.tolist(), math.inf]))
    # The search begins at the largest bound of a grid: at a level next to σ_max(D), rounding hides
    # the crossings.
    grid = np.append(ends, near) if near else frequency_grid(poles)
    M_at_grid = loop.at(grid)
    scalings = _osborne_scaling(M_at_grid)
    largest = scaled_norm(M_at_grid, scalings).argmax()
    scaling = scalings[largest]
    point = float(grid[largest])
    frequency = math.inf
    highest = float(scaled_norm(loop.D, best_scaling(loop.D)))
    # The distance of the level above the largest bound is multiplied by 10 after so many steps, so
    # that the search ends.
    steps_per_decade = max(MANY // len(loop.D) ** 2, 1)
    level, count = highest, 0
    while pieces and level < LARGEST:  # it grows without bound where A rounds to a singular one
        count += 1
        M = loop.at(np.array([point]))[0]
        scaling = best_scaling(M, scaling)
        bound = float(scaled_norm(M, scaling))
        if bound > highest * (1.0 + ABOVE):
            frequency = point
        highest = max(highest, bound)
        level = highest * (1.0 + ABOVE * 10.0 ** (count // steps_per_decade))
        pieces = _pieces_above(loop, scaling, level, pieces, point)
        if pieces:
            point = _between(*pieces[-1])
    alpha = 1.0 / level
    return DiskMargin(alpha, *disk_sizes(alpha), float(loop.rate(np.array(frequency))))


def _between(low: float, high: float) -> float:
    """Return a frequency inside an interval of frequencies, rad/s."""
    if math.isinf(high):
        return 4.0 * low or 1.0
    # An interval above two octaves is halved on a logarithmic scale.
    return math.sqrt(low * high) if 0.0 < 4.0 * low < high else 0.5 * (low + high)


def _pieces_above(
    loop: ClosedLoop,
    scaling: np.ndarray,
    level: float,
    pieces: list[Piece],
    cut: float,
) -> list[Piece]:
    """Return those parts of frequency intervals in which σ_max(D M D⁻¹) is above a level.

    Between neighboring crossings of the level, σ_max is everywhere above or everywhere below it.
    The part with the largest σ_max comes last. A part without a double between its ends is left
    out.

    scaling: log D, (m,)
    cut: frequency at which the intervals are divided too
    """
    D = np.exp(scaling)
    C, feedthrough = D[:, None] * loop.C, D[:, None] * loop.D / D
    crossings = np.append(level_crossings(loop.A, loop.B / D, C, feedthrough, level), cut)
    crossings.sort()
    parts: list[Piece] = []
    for low, high in pieces:
        inside = crossings[(crossings > low) & (crossings < high)].tolist()
        parts += pairwise([low, *inside, high])
    insides = np.array([_between(*part) for part in parts])
    norms = scaled_norm(loop.at(insides), scaling)
    lows, highs = np.transpose(parts)
    is_kept = (norms > level) & (lows < insides) & (insides < highs)
    ascending = np.argsort(norms, stable=True)
    return [parts[number] for number in ascending[is_kept[ascending]]]


def best_scaling(M: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Return the scaling D > 0, as log D, (m,), that minimizes σ_max(D M D⁻¹).

    D is diagonal. The minimum is an upper bound of μ(M), exact for m <= 3. For m > 2 it is found
    by an interior-point method, also where singular values are equal: Newton steps decrease
    t log γ² - log det(1 - S'S) with S = D M D⁻¹/γ, which is convex in (log D², log γ²), and t grows
    as γ approaches the minimum.

    M: (m, m), complex
    start: initial log D, (m,); by default `_osborne_scaling`

    Sources: Packard and Doyle, Automatica 29 (1993), 71-109; Boyd and El Ghaoui, Linear Algebra and
    its Applications 188 (1993), 63-111.
    """
    m = len(M)
    if m == 1:
        return np.zeros(1)
    log_D = _osborne_scaling(M) if start is None or m == 2 else start
    if m == 2:  # σ_max is least where |M12| D1/D2 = |M21| D2/D1, as |det M| is that of D M D⁻¹
        return log_D - log_D[-1]
    gamma = 2.0 * float(scaled_norm(M, log_D)) or math.inf
    # Derivatives of γ² D² - M'D² M with respect to log D² and log γ² (columns), as multiples of the
    # m terms of γ² D² and of the m terms of M'D² M (rows).
    growth = np.block([[np.eye(m), np.ones((m, 1))], [-np.eye(m), np.zeros((m, 1))]])
    while True:
        U, sizes, V = np.linalg.svd(np.exp(log_D[:, None] - log_D) * M)
        ratios = sizes / gamma
        weights = 1.0 / ((1.0 - ratios) * (1.0 + ratios))  # of 1 / (1 - S'S)
        # The end: σ_max is γ up to SETTLED, or not a number.
        if not 1.0 <= weights[0] < 1.0 / SETTLED or math.isinf(gamma):
            return log_D - log_D[-1]
        roots = np.sqrt(weights)[:, None] * np.hstack([V, ratios[:, None] * U.conj().T])
        products = roots.conj().T @ roots

        # Derivatives by log D² and log γ², with t = Σ (1 + ratios²) weights:
        slope = np.append((np.abs(U) ** 2 - np.abs(V.T) ** 2) @ weights, weights.sum())
        curvature = growth.T @ np.abs(products) ** 2 @ growth - np.diag(slope)
        curvature[m, :m] -= products.diagonal().real[:m]
        curvature[:m, m] -= products.diagonal().real[:m]
        curvature[:m, :m] += np.diag(2.0 * slope[:m] - 1.0) + 1.0  # the mean of log D is free
        curvature += 1e-15 * curvature.max() * np.eye(m + 1)  # not singular by rounding

        step = np.linalg.solve(curvature, -slope)
        decrement = math.sqrt(max(-float(slope @ step), 0.0))
        step /= max(1.0 + decrement, float(np.abs(step).max()))  # damped Newton step
        log_D = log_D + 0.5 * step[:m]  # the step is in log D² and log γ²
        gamma *= math.exp(0.5 * step[m])


def scaled_norm(M: np.ndarray, log_D: np.ndarray) -> np.ndarray:
    """Return σ_max(D M D⁻¹) of one matrix (m, m), or of each matrix of a stack (..., m, m).

    log_D: (m,) or (..., m)
    """
    scaled = np.exp(log_D[..., :, None] - log_D[..., None, :]) * M
    return np.linalg.norm(scaled, 2, axis=(-2, -1))


def _osborne_scaling(M: np.ndarray) -> np.ndarray:
    """Return log D, (..., m), for which row i and column i of D M D⁻¹ have about equal norms."""
    squares = np.abs(M) ** 2
    # An entry of 0, as in a triangular M, would have no finite D: it is replaced by a rounding.
    rounding = np.finfo(float).eps ** 2 * squares.max((-2, -1), keepdims=True)
    off = np.maximum(squares, rounding) * (1.0 - np.eye(M.shape[-1])) + np.finfo(float).tiny
    log_D = np.zeros(M.shape[:-1])
    for _ in range(SWEEPS):
        scaled = off * np.exp(2.0 * (log_D[..., :, None] - log_D[..., None, :]))
        # With the factor 1/4, the norms would become equal if D_i alone changed. All change at
        # once, so that only half of this step is taken.
        log_D += 0.125 * np.log(scaled.sum(axis=-2) / scaled.sum(axis=-1))
    return log_D


def disk_sizes(alpha: float) -> tuple[float, float]:
    """Return the gain (a factor) and the phase (deg) that belong to the disk margin α.

    The gain is inf for α >= 2.
    """
    gain = (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf
    return gain, math.degrees(2.0 * math.atan(alpha / 2.0))


#: Where |T| is below this fraction of its largest value, half of its digits may be lost: the loop
#: gain |l| = |T/S| is 0 there, up to rounding.
_T_IS_ZERO = math.sqrt(np.finfo(float).eps)
#: Where |S| is below this, three of its digits may be left: the loop gain is infinite there.
_S_IS_ZERO = 1e3 * np.finfo(float).eps
#: Largest number of alternating secant and bisection steps for a crossover.
_ROUNDS = 17
#: A crossover has converged if two secants agree to this relative accuracy.
_SETTLED = 1e-15

#: Function ω (N,) -> -T of one loop, (N,).
Locus = Callable[[np.ndarray], np.ndarray]


class LoopMargin(NamedTuple):
    """Margins of one loop, with the other loops closed.

    gain_low, gain_high: the loop remains stable if its gain is multiplied by a factor between these
        limits
    phase: largest tolerated phase shift, deg; inf if every phase shift is tolerated
    crossover: frequency at which this phase shift makes the loop unstable, rad/s; the loop gain is
        1 there, |l| = 1; nan if |l| is never 1
    delay: largest tolerated delay of the signal, s; inf if every delay is tolerated
    disk: α of `DiskMargin`, for simultaneous changes of gain and phase
    """

    gain_low: float
    gain_high: float
    phase: float
    crossover: float
    delay: float
    disk: float

    @property
    def gain(self) -> float:
        """Gain margin, dB: the smaller of the gain increase and decrease that make the loop
        unstable.
        """
        with np.errstate(divide="ignore"):
            return float(20.0 * np.abs(np.log10([self.gain_low, self.gain_high])).min())


def named_margins(
    inputs: Sequence[str], loops: Sequence[LoopMargin]
) -> dict[str, dict[str, float]]:
    """Return the stability margins by name, input -> name of the margin -> value.

    The names are the fields of `LoopMargin`, `disk_gain` (a factor) and `disk_phase` (deg).

    inputs: names of the inputs
    loops: margins at each input, in the same order
    """
    found = {}
    for name, loop in zip(inputs, loops, strict=True):
        gain, phase = disk_sizes(loop.disk)
        found[name] = {**loop._asdict(), "disk_gain": gain, "disk_phase": phase}
    return found


def single_margin(loop: ClosedLoop, i: int) -> LoopMargin:
    """Return the stability margins of loop i, with all other loops closed.

    The gain margins follow from the frequencies at which M is real, the phase and delay margins
    from those at which it is imaginary. These frequencies are searched for wherever Im M or Re M
    changes its sign on a grid that resolves every resonance and every zero of Re M and Im M.

    loop: the closed loop, M at all inputs

    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    single = loop.only(i)
    zeros = np.unique(np.concatenate([_zeros(single, sign) for sign in (-1.0, 1.0)]))
    between = (zeros[1:] + zeros[:-1]) / 2.0
    resonances = frequency_grid(loop.modes.values)
    grid = np.unique(np.concatenate([zeros, between, resonances]))

    # -T = M - 1/2 and S = 1 - T. A subtraction of 1/2 from M would round a small T.
    minus_T_loop = replace(single, D=single.D - 0.5)

    def locus(frequencies: np.ndarray) -> np.ndarray:
        return minus_T_loop.at(frequencies)[:, 0, 0]

    on_grid = locus(grid)
    where_real = _crossings(np.imag, locus, grid, on_grid)
    where_imaginary = _crossings(lambda minus_T: np.real(minus_T) + 0.5, locus, grid, on_grid)

    # A gain f > 0 brings the loop to f l = -1 where l = T/S is real: f = S / -T.
    at_zero, at_infinity = on_grid[grid == 0.0].real, minus_T_loop.D.ravel()
    real_values = np.concatenate([at_zero, where_real.minus_T.real, at_infinity])
    real_values = real_values[~_is_rounding(real_values, on_grid)]
    gains = (1.0 + real_values) / real_values
    gains = gains[gains > 0.0]

    # Where |l| = 1, the angle of -l = -T/S is the phase lag that brings the loop to -1.
    frequencies = single.rate(where_imaginary.frequencies)
    angles = np.angle(where_imaginary.minus_T / (1.0 + where_imaginary.minus_T))
    phases = np.degrees(np.abs(angles))
    with np.errstate(divide="ignore"):  # no delay changes the phase at 0
        delays = np.mod(angles, 2.0 * np.pi) / frequencies

    at_largest_M = float(grid[np.abs(on_grid + 0.5).argmax()])
    return LoopMargin(
        gain_low=float(gains[gains < 1.0].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        crossover=float(frequencies[phases.argmin()]) if phases.size else math.nan,
        delay=float(delays.min(initial=math.inf)),
        disk=disk_of(single, at_largest_M).disk,
    )


def _zeros(loop: ClosedLoop, sign: float) -> np.ndarray:
    """Return all frequencies at which Re M of one loop may be 0, or Im M, rad/s.

    They are |Im λ| of the zeros λ of M(s) + M(-s), or of M(s) - M(-s), the eigenvalues of the
    pencil (system, mass).

    sign: 1 for Re M, -1 for Im M
    """
    n = len(loop.A)
    unit = float(np.linalg.norm(loop.A)) or 1.0  # of frequencies
    size_of_B = float(np.linalg.norm(loop.B)) or 1.0
    B, C = loop.B / size_of_B, loop.C * (size_of_B / unit)
    zero = np.zeros((n, n))
    A = loop.A / unit
    # M(s) + sign M(-s) has the state matrices A and -A.
    system = np.block([[A, zero, B], [zero, -A, -sign * B], [C, C, loop.D * (1.0 + sign)]])
    mass = np.diag(np.repeat([1.0, 0.0], [2 * n, 1]))
    # (system - shift mass)⁻¹ mass has the eigenvalues 1 / (λ - shift), 0 for infinite λ.
    shift = 0.37  # any real number that is not an eigenvalue; it leaves Im λ
    try:
        inverses = np.linalg.eigvals(np.linalg.solve(system - shift * mass, mass))
    except np.linalg.LinAlgError:  # every number is a zero, as where the loop gain is 0
        return np.zeros(0)
    return unit * np.abs((1.0 / inverses[inverses != 0.0]).imag)


def _is_rounding(minus_T: np.ndarray, on_grid: np.ndarray) -> np.ndarray:
    """Return whether the loop gain |T/S| is 0 or infinite up to rounding, at values of -T.

    on_grid: -T at the grid
    """
    is_zero = np.abs(minus_T) <= _T_IS_ZERO * np.abs(on_grid).max()
    is_infinite = np.abs(1.0 + minus_T) < _S_IS_ZERO  # S = 1 - T
    return np.asarray(is_zero | is_infinite)


class _Crossings(NamedTuple):
    """Frequencies at which Re M or Im M changes its sign, rad/s, (J,), and -T = M - 1/2 there."""

    frequencies: np.ndarray
    minus_T: np.ndarray


def _crossings(
    part: Callable[[np.ndarray], np.ndarray], locus: Locus, grid: np.ndarray, on_grid: np.ndarray
) -> _Crossings:
    """Return the frequencies between points of a grid at which Re M or Im M changes its sign.

    The frequencies are found by secants and bisections in turn.

    part: function -T -> Re M or Im M
    locus: function ω -> -T = M - 1/2
    on_grid: -T at the grid, (N,)
    """
    # Where the loop gain is 0 or infinite up to rounding, the sign of Im M is that of a rounding.
    is_rounding = _is_rounding(on_grid, on_grid)
    is_positive = part(on_grid) > 0.0
    changes = is_positive[1:] != is_positive[:-1]
    (where,) = np.nonzero(changes & ~(is_rounding[1:] & is_rounding[:-1]))
    low, high = grid[where], grid[where + 1]
    at_low, at_high = on_grid[where], on_grid[where + 1]
    last_secant = low
    for number in range(_ROUNDS):
        is_secant = number % 2 == 0
        share = part(at_low) / (part(at_low) - part(at_high)) if is_secant else 0.5
        point = low + share * (high - low)
        at_point = locus(point)
        is_low = (part(at_point) > 0.0) == is_positive[where]
        low, at_low = np.where(is_low, point, low), np.where(is_low, at_point, at_low)
        high, at_high = np.where(is_low, high, point), np.where(is_low, at_high, at_point)
        if is_secant:
            if np.all(np.abs(point - last_secant) <= _SETTLED * point):
                break
            last_secant = point
    return _Crossings(point, at_point)
