"""The theorem by which a policy is proved stabilizing and near the optimum of a linear game.

The plant is z' = A z + B u + E d with the cost ∫ z'Qz + 2 z'N u + u'R u - δ² d'd dt. P, K and L are
those of the solution. The policy is u(z) = -K z + e(z), where all deviations count from its
equilibrium, e(0) = 0, and d = L z + w. F = A - B K + E L.

**Identity.** The cost rate plus the rate of z'P z is e'R e - δ² w'w: the excess of the cost is the
integral of it.

**Lemma.** Let |e|² = e'R e <= ρ² z'W z in Ω, W > 0, τ > 0, and

  F'D + D F + (1 + τ) ρ² W + D Γ V⁻¹ Γ'D < 0,  Γ = [B E],  V = [τR 0; 0 δ²],

for a D > 0. While z is in Ω, the cost so far plus z'(P + D) z does not increase, for every d: its
rate is at most z'M z with the left side M, by 2 z'D Γ a <= a'V a + ..., a = (e, w).

**Levels.** A network has an absolute error, which is large relative to a small z. With κ_1 > κ_2 >
..., ρ_0 <= ρ_1 <= ..., and |e| <= ρ_k |z|_W where z'U z > κ_(k+1), the lemma holds with D_k from
the first time at which z'U z <= κ_k. The sum over the levels gives: the excess is at most
z'D_0 z + Σ c_k κ_k, where c_k U > D_k - D_(k-1). (Where z'U z > κ_k, |e| <= ρ_k |z|_W holds, too.)

**Tube.** Without d and with d = L z, w = 0, the same lemma with Γ = [B], V = [τR] bounds the energy
∫ |e|² <= a. As z(t) = exp(F t) z_0 + ∫ exp(F(t - s)) B e ds,

  |z_i(t)| <= sup_t Σ_j |exp(F t)_ij| b_j + (G_ii a)^½,  F G + G F' + B R⁻¹ B' < 0,

by Cauchy and Schwarz. If the bound of e holds in this tube Ω, no flight from the box |z_i| <= b_i
leaves it: until it does, the bounds hold, and they end inside. In Ω, z'D z of the last level
decreases along both loops, so that flights come to rest.

**Conditions.** The game is one in continuous time, with a proved solution, and both loops A - B K
and A - B K + E L are stable; e is bounded by `BoundedFunction` in Ω. Other disturbances are covered
as long as flights stay in Ω; the plant has no other limits of inputs than those of u(z). Weights
may be indefinite, and N other than 0: no step uses their sign. The policy is exact up to the
rounding of doubles: a constant of this size is added, with which the computed equilibrium is one.

Sources: Kleinman, IEEE Transactions on Automatic Control 13 (1968), 114-115 (identity); Basar and
Bernhard, H-infinity Optimal Control, Theorem 4.11.
"""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import (
    BITS,
    ball_matrix,
    is_positive_definite,
    midpoints,
    precision,
    radii,
    symmetric_part,
)
from controller.riccati.gare import Solution

if TYPE_CHECKING:
    from flint import arb_mat

#: Number of levels, each half as far as the one before.
LEVELS = 6
#: Multiplier τ of the lemma: at least this times ρ, and the largest, with the largest ρ; below that
#: it falls with the square, so that there is a D for each ρ.
_MULTIPLIERS = (1.2, 1.5)
#: Number of claims of which the last one is proved.
_TRIALS = 8
#: Share of the optimum of the box by which U and W are positive where P and Q are not.
_FLOOR = 1e-6
#: Share of the decay of U in W, so that W is positive where Q is not.
_OF_DECAY = 0.05
#: Share by which inequalities are strict, far above the rounding of doubles.
_STRICT = 1e-6
#: Steps of the exact loop in time, per rate of its fastest mode, and their largest number.
_STEPS_PER_RATE = 10.0
_MOST_STEPS = 50_000


class NotProvedError(Exception):
    """Something is not proved; the message says why."""


class Loop(NamedTuple):
    """Loop with what acts on it, in units y_i = z_i / b_i.

    F: (n, n), in balls
    disturbance: δ⁻²E E' of a disturbance w beside the errors, in balls, or 0
    peaks: bound of sup_t Σ_j |exp(F t)_ij| b_j, (n,)
    reached: bound of G_ii, the squares that e of energy 1 reaches, (n,)
    """

    F: arb_mat
    disturbance: arb_mat
    peaks: np.ndarray
    reached: np.ndarray


class Setting(NamedTuple):
    """A solved game in units y_i = z_i / b_i.

    widths: half-widths of the box of starts, (n,)
    loops: that of the cost, with both players, and those of flights in the tube: without d and with
        d = L z
    K: (m, n), in balls
    S, SU, T: roots of W = S'S, U = SU'SU and R <= T'T, upper triangular, exact
    errors: BR⁻¹B', in balls
    reference: largest optimum Σ y_i² = 1, to which costs are relative
    thresholds: κ_k of y'U y, the first inf, (LEVELS,)
    """

    widths: np.ndarray
    loops: tuple[Loop, ...]
    K: arb_mat
    S: np.ndarray
    SU: np.ndarray
    T: np.ndarray
    errors: arb_mat
    reference: float
    thresholds: np.ndarray

    def level(self, value: np.ndarray) -> np.ndarray:
        """Return the last level whose κ_k is at least y'U y, (N,)."""
        return np.searchsorted(-self.thresholds, -value, side="right") - 1


def setting_of(exact: Solution, b: np.ndarray, center: np.ndarray) -> Setting:
    """Return a solved game in units of the box |z_i| <= b_i, about an equilibrium (n,).

    Raises NotProvedError for a game in discrete time, and if there is no weight of the errors.
    """
    from flint import arb

    game, enclosure = exact.game, exact.enclosure
    if game.is_discrete:
        raise NotProvedError("the theorem is one of continuous time")
    widths = (1.0 + np.abs(center) / b) * (1.0 + _STRICT)
    with precision(BITS):
        unit = ball_matrix(np.diag(b))
        A, B, E = (unit.inv() * ball_matrix(M) for M in (game.A, game.B, game.E))
        K, R = enclosure.K * unit, ball_matrix(game.R)
        errors = symmetric_part(B * R.solve(B.transpose()))
        F = A * unit - B * K
        loops = [Loop(F, errors * 0, _peaks(F, widths), _reached(F, errors))]
        if math.isfinite(game.delta) and np.any(game.E):
            F = F + E * (enclosure.L * unit)
            both = Loop(F, errors * 0, _peaks(F, widths), _reached(F, errors))
            disturbance = symmetric_part(E * E.transpose() / arb(game.delta) ** 2)
            loops = [both._replace(disturbance=disturbance), *loops, both]
        optimum = midpoints(symmetric_part(unit * enclosure.P * unit))
        poles = np.linalg.eigvals(midpoints(F))
        largest = float(np.linalg.eigvalsh(optimum)[-1])
        U = optimum + _FLOOR * largest * np.eye(len(b))
        policy = np.vstack([np.diag(b), -midpoints(K)])
        W = policy.T @ game.weights @ policy - 2.0 * _OF_DECAY * poles.real.max() * U
        try:
            S, SU = np.linalg.cholesky(W).T, np.linalg.cholesky(U).T
            T = np.linalg.cholesky(game.R).T * (1.0 + _STRICT)
        except np.linalg.LinAlgError:
            raise NotProvedError("the weights are indefinite, or the optimum is 0") from None
        root = ball_matrix(T)
        if not is_positive_definite(symmetric_part(root.transpose() * root - R)):
            raise NotProvedError("the weights of the inputs are too unequal")
    thresholds = float(np.linalg.norm(SU, 2)) ** 2 * 0.25 ** np.arange(LEVELS)
    thresholds[0] = math.inf
    reference = largest * (1.0 - 1e-12 * len(b))
    return Setting(widths, tuple(loops), K, S, SU, T, errors, reference, thresholds)


def _excess(
    setting: Setting, loop: Loop, rho: float, tau: float, *, is_tried: bool = False
) -> np.ndarray:
    """Return the smallest D of the lemma, (n, n). Raise NotProvedError if none is proved.

    is_tried: whether no proof is required
    """
    from flint import arb
    from scipy.linalg import solve_continuous_are

    with precision(BITS):
        acting = setting.errors * (arb(1.0) / tau) + loop.disturbance  # Γ V⁻¹ Γ'
        sizes, directions = np.linalg.eigh(midpoints(acting))
        root = directions * np.sqrt(np.maximum(sizes, 0.0))
        Y = (1.0 + tau) * (1.0 + _STRICT) * setting.S.T @ setting.S
        unit = (_STRICT - 1.0) * np.eye(len(Y))
        try:  # of D / ρ², whose size does not depend on ρ
            with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
                D = solve_continuous_are(midpoints(loop.F), rho * root, Y, unit)
        except (np.linalg.LinAlgError, ValueError):
            raise NotProvedError("the inequality of the cost has no solution") from None
        D = rho**2 * (D + D.T) / 2.0
        if is_tried:
            return D
        S, X = ball_matrix(setting.S), ball_matrix(D)
        back = loop.F.transpose() * X
        M = back + back.transpose() + S.transpose() * S * (1.0 + arb(tau)) * arb(rho) ** 2
        M = symmetric_part(M + X * acting * X)
        if not (is_positive_definite(X) and is_positive_definite(M * -1)):
            raise NotProvedError("the inequality of the cost is not proved")
    return D


class Claim(NamedTuple):
    """What a policy fulfils that is near the optimum, in units of the box.

    tube: half-widths of the tube Ω, (n,)
    shares: ρ_k, allowed |e| / |y|_W where y'U y is at most κ_k, (LEVELS,)
    excess: bound of the cost above the optimum, relative to `reference`
    """

    tube: np.ndarray
    shares: np.ndarray
    excess: float


def _share(root: np.ndarray, D: np.ndarray) -> float:
    """Return c with c M > D, M = root'root. Raise NotProvedError unless this is proved."""
    inverse = np.linalg.inv(root)
    c = float(np.abs(np.linalg.eigvalsh(inverse.T @ D @ inverse)).max()) * (1.0 + _STRICT)
    with precision(BITS):
        M = ball_matrix(root)
        if not is_positive_definite(symmetric_part(M.transpose() * M * c) - ball_matrix(D)):
            raise NotProvedError("the step between two levels is not proved")
    return c


def largest_share(setting: Setting) -> float:
    """Return the largest ρ of the last level, within 1 %. Raise NotProvedError if there is none."""

    low, high = 0.0, 2.0
    while high > max(1.01 * low, 1e-3):
        middle = 0.5 * (low + high)
        try:
            _excess(setting, setting.loops[0], middle, _MULTIPLIERS[1])
            low = middle
        except NotProvedError:
            high = middle
    if not low:
        raise NotProvedError("a loop of the exact policy is not stable, or nearly")
    return low


def claim_of(setting: Setting, excess: float, most: float, shape: np.ndarray) -> Claim:
    """Return the claim that a policy costs at most a share `excess` above the optimum, or less.

    most: `largest_share`
    shape: of ρ_k where they are far below it, which does not decrease, (LEVELS,)

    Raises NotProvedError if no error is small enough.
    """

    def levels_of(loop: Loop, *, is_tried: bool = False) -> tuple[np.ndarray, float]:
        """Return D_0 and Σ c_k κ_k."""
        taus = np.maximum(_MULTIPLIERS[0] * rhos, _MULTIPLIERS[1] * (rhos / most) ** 2)
        pairs = zip(rhos.tolist(), taus.tolist(), strict=True)
        levels = [_excess(setting, loop, *pair, is_tried=is_tried) for pair in pairs]
        steps = zip(np.diff(levels, axis=0), setting.thresholds[1:].tolist(), strict=True)
        added = [_share(setting.SU, D) * at for D, at in steps if D.any()]
        return levels[0], sum(added)

    first = most * math.sqrt(excess)
    for left in reversed(range(_TRIALS)):
        rhos = first * shape / shape[0]
        rhos = rhos / np.sqrt(1.0 + (rhos / most) ** 2)
        D, added = levels_of(setting.loops[0], is_tried=left > 0)
        total = (_share(np.eye(len(D)), D) + added) / setting.reference
        # The cost grows with the square of the error.
        first *= math.sqrt(0.98 * excess / total)
    if not total <= excess:
        raise NotProvedError("no error is small enough")
    tube = np.zeros(len(setting.widths))
    for loop in setting.loops[1:] or setting.loops:
        D, added = levels_of(loop)
        energy = float(setting.widths @ np.abs(D) @ setting.widths) + added
        tube = np.maximum(tube, loop.peaks + np.sqrt(loop.reached * energy))
    return Claim(tube * (1.0 + _STRICT), rhos, total)


def _reached(F: arb_mat, errors: arb_mat) -> np.ndarray:
    """Return a proved bound of G_ii, the squares that e of energy 1 reaches, (n,).

    errors: BR⁻¹B'
    """
    from scipy.linalg import solve_continuous_lyapunov

    middle = midpoints(errors)
    Y = middle * (1.0 + _STRICT) + _FLOOR * float(np.trace(middle)) * np.eye(len(middle))
    G = solve_continuous_lyapunov(midpoints(F), -Y)
    G = (G + G.T) / 2.0
    X = ball_matrix(G)
    FX = F * X
    rest = symmetric_part((FX + FX.transpose() + errors) * -1)
    if not (is_positive_definite(X) and is_positive_definite(rest)):
        raise NotProvedError("what errors reach is not proved")
    return np.diag(G)


def _peaks(F: arb_mat, widths: np.ndarray) -> np.ndarray:
    """Return a proved bound of sup_t Σ_j |exp(F t)_ij| b_j, (n,).

    X_(k+1) = X_k exp(F h) is off by rounding and by the radius of exp(F h). These defects add up to
    a share Σ ε_k of the bound itself, if each is at most ε_k b. Between two steps, a straight line
    is off by h²/8 |F² exp(F t)|, at most h²/8 exp(|F| h) |F²| of the bound. The search ends where
    |X_k| b < b: what follows repeats all at a smaller size.
    """
    middle = midpoints(F)
    n, h = len(middle), 1.0 / (_STEPS_PER_RATE * np.abs(np.linalg.eigvals(midpoints(F))).max())
    step = (F * float(h)).exp()
    bend = h**2 / 8.0 * midpoints((ball_matrix(np.abs(middle)) * float(h)).exp())
    E = midpoints(step)
    defect = radii(step) + (n + 4) * 2.0**-52 * np.abs(E)
    X, top, lost = np.eye(n), widths, 0.0
    for _ in range(_MOST_STEPS):
        lost += float((defect @ (np.abs(X) @ widths) / widths).max())
        X = E @ X
        reached = np.abs(X) @ widths
        top = np.maximum(top, reached)
        if (reached < 0.9 * widths).all():
            break
    top = top / (1.0 - lost)
    if not (lost < 0.5 and (reached + lost * top < widths).all()):
        raise NotProvedError("the exact loop has both fast and slow modes")
    square = np.abs(middle @ middle) + _STRICT * np.abs(middle) @ np.abs(middle)
    return np.asarray(top + bend @ (square @ top))
