"""The theorem by which a policy is proved stabilizing and near the optimum of a linear game.

The plant is z' = A z + B u + E d with the cost ∫ z'Qz + 2 z'N u + u'R u - δ² d'd dt, or z⁺ with the
sum of α^k times this. P, K and L are those of the solution. The policy is u(z) = -K z + e(z), with
the equilibrium z = 0 (else all deviations count from it), and d = L z + w. F = A - B K + E L.

**Identity.** The cost rate plus the rate of z'P z is a'H a, a = (e, w), H = [R 0; 0 -δ²], in
discrete time [R 0; 0 -δ²] + α [B E]'P [B E]: the excess of the cost is the integral (sum) of a'H a.

**Lemma.** Let |e|² <= ρ² z'W z in Ω, |e|² = e'R e (in discrete time of R + α B'P B), W > 0, τ > 0,

  M(D) = F'D + D F + (1 + τ) ρ² W + D Γ V⁻¹ Γ'D < 0,  Γ = [B E],  V = [τR 0; 0 δ²],

or, with √α F and √α Γ in place of F and Γ,

  M(D) = F'D F - D + (1 + τ) ρ² W + F'D Γ (V - Γ'D Γ)⁻¹ Γ'D F < 0,
  V = [τ(R + α B'P B), -α B'P E; -α E'P B, δ² - α E'P E] > Γ'D Γ,

for a D > 0. While z is in Ω, the cost so far plus z'(P + D) z does not increase, for every d: its
rate is at most z'M z, by 2 z'D Γ a <= a'V a + ..., and by |e|² <= ρ² z'W z.

**Levels.** A network has an absolute error, which is large relative to a small z. With κ_1 > κ_2 >
..., ρ_0 < ρ_1 < ..., and |e| <= ρ_k |z|_W where z'U z > κ_(k+1), the lemma holds with D_k from the
first time at which z'U z <= κ_k. The sum over the levels gives: the excess is at most
z'D_0 z + Σ c_k κ_k, where c_k U > D_k - D_(k-1). (Where z'U z > κ_k, |e| <= ρ_k |z|_W holds, too.)

**Tube.** Without d and with d = L z, w = 0, the same lemma with Γ = [B], V = [τR], α = 1, bounds
the energy ∫ |e|² <= a. As z(t) = exp(F t) z_0 + ∫ exp(F(t - s)) B e ds,

  |z_i(t)| <= sup_t Σ_j |exp(F t)_ij| b_j + (G_ii a)^½,  F G + G F' + B R⁻¹ B' < 0,

by Cauchy and Schwarz (in discrete time F^k and F G F' - G). If the bound of e holds in this tube
Ω, no flight from the box |z_i| <= b_i leaves it: until it does, the bounds hold, and they end
inside. In Ω, z'D z of the last level decreases along both loops, so that flights come to rest.

**Conditions.** The game has a proved solution; both loops A - B K and A - B K + E L are stable
without discount; e is bounded by `BoundedFunction` in Ω. Other disturbances are covered as long as
flights stay in Ω; the plant has no other limits of inputs than those of u(z); arithmetic of the
policy is exact. Indefinite weights and cross weights N are covered: no step uses their sign.

Sources: Kleinman, IEEE Transactions on Automatic Control 13 (1968), 114-115 (identity); Basar and
Bernhard, H-infinity Optimal Control, Theorem 4.11.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import (
    BITS,
    ball_matrix,
    identity,
    is_positive_definite,
    midpoints,
    precision,
    radii,
    stacked,
    symmetric_part,
)
from controller.riccati.gare import Solution

if TYPE_CHECKING:
    from flint import arb_mat

#: Number of levels, each half as far as the one before, and the largest excess in the last one,
#: relative to the optimum there.
LEVELS = 6
_WEAKEST = 2.0
#: Multipliers τ of the lemma that are tried, and halvings in the search for the largest ρ.
_MULTIPLIERS = (0.1, 0.4)
_HALVINGS = 12
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
    """Loop with what acts on it, in balls.

    F: (n, n)
    of_a: Γ, (n, k)
    weights: τ -> V, (k, k)
    """

    F: arb_mat
    of_a: arb_mat
    weights: Mapping[float, arb_mat]


class Setting(NamedTuple):
    """A solved game in units y_i = z_i / b_i.

    is_discrete: whether the game is one in discrete time
    game_loop: the loop of the cost, with both players, discounted
    flown: loops of which the flights stay in the tube: without d, and with d = L z
    is_flown: whether both are one loop
    B, R: in balls; R of the errors, in discrete time R + α B'P B
    K: (m, n), in balls
    S, SU, T: roots of W = S'S, U = SU'SU and R <= T'T, upper triangular, exact
    reference: largest optimum Σ y_i² = 1, to which costs are relative
    """

    is_discrete: bool
    game_loop: Loop
    flown: tuple[Loop, ...]
    is_flown: bool
    B: arb_mat
    R: arb_mat
    K: arb_mat
    S: np.ndarray
    SU: np.ndarray
    T: np.ndarray
    reference: float


class _Level(NamedTuple):
    """Level of a claim: the allowed share ρ of the error, and D, proved."""

    rho: float
    D: np.ndarray


def setting_of(exact: Solution, b: np.ndarray) -> Setting:
    """Return a solved game in units of the box |z_i| <= b_i.

    Raises NotProvedError if there is no weight of the errors.
    """
    from flint import arb

    game, enclosure = exact.game, exact.enclosure
    is_discrete, n = game.is_discrete, len(b)
    alpha = arb(game.discount if is_discrete else 1.0)
    has_disturbance = math.isfinite(game.delta) and bool(np.any(game.E))
    with precision(BITS):
        unit = ball_matrix(np.diag(b))
        inverse = unit.inv()
        A, B, E = (ball_matrix(np.asarray(M, float)) for M in (game.A, game.B, game.E))
        A, B, E = inverse * A * unit, inverse * B, inverse * E
        P = symmetric_part(unit * enclosure.P * unit)
        K, L = enclosure.K * unit, enclosure.L * unit
        R, delta = ball_matrix(game.R), identity(E.ncols()) * (arb(game.delta) ** 2)
        crossed = ball_matrix(np.zeros((B.ncols(), E.ncols())))
        if is_discrete:
            ahead = P * E * alpha
            R = symmetric_part(R + B.transpose() * P * B * alpha)
            delta = symmetric_part(delta - E.transpose() * ahead)
            crossed = B.transpose() * ahead * -1
        control = A - B * K
        of_policy = {tau: R * arb(tau) for tau in _MULTIPLIERS}
        loops: tuple[Loop, ...] = (Loop(control, B, of_policy),)
        game_loop = Loop(control * alpha.sqrt(), B * alpha.sqrt(), of_policy)
        if has_disturbance:
            both = control + E * L
            loops = (*loops, Loop(both, B, of_policy))
            of_both = {
                tau: stacked([[R * arb(tau), crossed], [crossed.transpose(), delta]])
                for tau in _MULTIPLIERS
            }
            of_a = stacked([[B, E]]) * alpha.sqrt()
            game_loop = Loop(both * alpha.sqrt(), of_a, of_both)
        optimum, k, weight = midpoints(P), midpoints(K), midpoints(R)
        poles = np.linalg.eigvals(midpoints(control))
    largest = float(np.linalg.eigvalsh(optimum)[-1])
    U = optimum + _FLOOR * largest * np.eye(n)
    decay = 1.0 - np.abs(poles).max() ** 2 if is_discrete else -2.0 * poles.real.max()
    cross = b[:, None] * game.N @ k
    W = game.Q * np.outer(b, b) - cross - cross.T + k.T @ game.R @ k + _OF_DECAY * decay * U
    try:
        S, SU = np.linalg.cholesky(W).T, np.linalg.cholesky(U).T
        T = np.linalg.cholesky(weight + 1e-10 * np.diag(np.diag(weight))).T
    except np.linalg.LinAlgError:
        raise NotProvedError("the weights are indefinite, or the optimum is 0") from None
    with precision(BITS):
        root = ball_matrix(T)
        if not is_positive_definite(symmetric_part(root.transpose() * root - R)):
            raise NotProvedError("the weights of the inputs are too unequal")
    return Setting(
        is_discrete,
        game_loop,
        loops,
        not has_disturbance and float(alpha) == 1.0,
        *(B, R, K, S, SU, T),
        largest * (1.0 - 1e-12 * n),
    )


def _level(setting: Setting, loop: Loop, rho: float) -> _Level | None:
    """Return the smallest D of the lemma that is found and proved, or None."""
    from scipy.linalg import solve_continuous_are, solve_discrete_are

    solve = solve_discrete_are if setting.is_discrete else solve_continuous_are
    W, F, of_a = setting.S.T @ setting.S, midpoints(loop.F), midpoints(loop.of_a)
    found = []
    for tau, V in loop.weights.items():
        Y = (1.0 + tau) * (1.0 + _STRICT) * W
        try:  # of D / ρ², whose size does not depend on ρ
            with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
                D = solve(F, rho * of_a, Y, -(1.0 - _STRICT) * midpoints(V))
        except (np.linalg.LinAlgError, ValueError):
            continue
        D = rho**2 * (D + D.T) / 2.0
        if np.isfinite(D).all() and _is_proved(setting, loop, D, rho, tau):
            found.append(_Level(rho, D))
    return min(found, key=lambda level: float(np.trace(level.D)), default=None)


def _is_proved(setting: Setting, loop: Loop, D: np.ndarray, rho: float, tau: float) -> bool:
    """Return whether D > 0 and M(D) < 0 are proved in balls."""
    from flint import arb

    F, of_a, V = loop.F, loop.of_a, loop.weights[tau]
    with precision(BITS):
        S, X = ball_matrix(setting.S), ball_matrix(D)
        Y = S.transpose() * S * ((arb(1.0) + arb(tau)) * arb(rho) ** 2)
        back = F.transpose() * X
        if setting.is_discrete:  # the Schur complement of [X - F'X F - Y, -F'X Γ; ., V - Γ'X Γ]
            first, beside = X - back * F - Y, back * of_a * -1
            V = V - of_a.transpose() * X * of_a
        else:
            first, beside = (back + back.transpose() + Y) * -1, X * of_a * -1
        whole = symmetric_part(stacked([[first, beside], [beside.transpose(), V]]))
        return bool(is_positive_definite(X) and is_positive_definite(whole))


def _share(setting: Setting, D: np.ndarray) -> float:
    """Return c with c U > D."""
    inverse = np.linalg.inv(setting.SU)
    largest = float(np.linalg.eigvalsh(inverse.T @ D @ inverse)[-1])
    return max(largest, 0.0) * (1.0 + _STRICT) + 1e-9


class Claim(NamedTuple):
    """What a policy fulfils that is near the optimum, in units of the box.

    tube: half-widths of the tube Ω, (n,)
    thresholds: κ_k of y'U y, the first inf, (LEVELS,)
    shares: ρ_k, allowed |e| / |y|_W where y'U y is at most κ_k, (LEVELS,)
    excess: bound of the cost above the optimum, relative to `reference`
    """

    tube: np.ndarray
    thresholds: np.ndarray
    shares: np.ndarray
    excess: float

    def allowed(self, value: np.ndarray) -> np.ndarray:
        """Return the allowed |e| / |y|_W where y'U y is at most `value`, (N,)."""
        place = np.searchsorted(-self.thresholds, -value, side="right") - 1
        return np.asarray(self.shares[np.maximum(place, 0)])


def largest_share(setting: Setting) -> float:
    """Return the largest ρ of the last level. Raise NotProvedError if there is none."""
    low, high = 0.0, 2.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        levels = [_level(setting, loop, middle) for loop in _loops(setting)]
        if None in levels or levels[0] is None or _share(setting, levels[0].D) > _WEAKEST:
            high = middle
        else:
            low = middle
    if not low:
        raise NotProvedError("a loop of the exact policy is not stable, or nearly not")
    return low


def _loops(setting: Setting) -> list[Loop]:
    """Return the different loops, that of the cost first."""
    return [setting.game_loop, *([] if setting.is_flown else setting.flown)]


def claim_of(setting: Setting, excess: float, most: float, widths: np.ndarray) -> Claim:
    """Return the claim that a policy costs at most a share `excess` above the optimum.

    most: `largest_share`
    widths: half-widths of the box of starts, in units of the box, (n,)

    Raises NotProvedError if no error is small enough.
    """
    thresholds = float(np.linalg.norm(setting.SU, 2)) ** 2 * 0.25 ** np.arange(LEVELS)

    def levels_of(loop: Loop, first: float) -> list[_Level]:
        """Return the levels with errors that are constant in each half of the distance."""
        rhos = np.minimum(first * 2.0 ** np.arange(LEVELS), most).tolist()
        at = {rho: _level(setting, loop, rho) for rho in dict.fromkeys(rhos)}
        levels = [level for rho in rhos if (level := at[rho]) is not None]
        if len(levels) < LEVELS:
            raise NotProvedError("the inequality of the cost is not proved")
        return levels

    def total(levels: list[_Level]) -> float:
        above = float(np.linalg.eigvalsh(levels[0].D)[-1]) * (1.0 + 1e-9)
        return (above + _added(setting, levels, thresholds)) / setting.reference

    low, high = most * 1e-6, most
    levels = levels_of(setting.game_loop, high)
    if total(levels) > excess:
        levels = levels_of(setting.game_loop, low)
        while high > 1.01 * low:
            tried = levels_of(setting.game_loop, math.sqrt(low * high))
            if total(tried) > excess:
                high = tried[0].rho
            else:
                low, levels = tried[0].rho, tried
    if total(levels) > excess:
        raise NotProvedError("no error is small enough")
    tube = np.zeros(len(widths))
    for loop in setting.flown:
        own = levels if setting.is_flown else levels_of(loop, levels[0].rho)
        energy = float(widths @ np.abs(own[0].D) @ widths) + _added(setting, own, thresholds)
        reached = np.sqrt(_reached(setting, loop) * energy)
        tube = np.maximum(tube, _peaks(setting, loop.F, widths) + reached)
    return Claim(
        tube * (1.0 + _STRICT),
        np.append(math.inf, thresholds[1:]),
        np.array([level.rho for level in levels]),
        total(levels),
    )


def _added(setting: Setting, levels: list[_Level], thresholds: np.ndarray) -> float:
    """Return Σ c_k κ_k. Raise NotProvedError unless each c_k is proved in balls."""
    with precision(BITS):
        root = ball_matrix(setting.SU)
        U, total = root.transpose() * root, 0.0
        for before, level, threshold in zip(levels[:-1], levels[1:], thresholds[1:], strict=True):
            c = _share(setting, level.D - before.D)
            rest = U * c - ball_matrix(level.D) + ball_matrix(before.D)
            if not is_positive_definite(symmetric_part(rest)):
                raise NotProvedError("the step between two levels is not proved")
            total += c * float(threshold)
    return total


def _reached(setting: Setting, loop: Loop) -> np.ndarray:
    """Return a proved bound of G_ii, the squares that e of energy 1 reaches, (n,)."""
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    F = midpoints(loop.F)
    with precision(BITS):
        weight = symmetric_part(setting.B * setting.R.solve(setting.B.transpose()))
        middle = midpoints(weight)
        Y = middle * (1.0 + _STRICT) + _FLOOR * float(np.trace(middle)) * np.eye(len(F))
        is_discrete = setting.is_discrete
        G = solve_discrete_lyapunov(F, Y) if is_discrete else solve_continuous_lyapunov(F, -Y)
        G = (G + G.T) / 2.0
        X = ball_matrix(G)
        FX = loop.F * X
        left = FX * loop.F.transpose() - X if is_discrete else FX + FX.transpose()
        rest = symmetric_part((left + weight) * -1)
        if not (is_positive_definite(X) and is_positive_definite(rest)):
            raise NotProvedError("what errors reach is not proved")
    return np.diag(G).copy()


def _peaks(setting: Setting, F: arb_mat, widths: np.ndarray) -> np.ndarray:
    """Return a proved bound of sup_t Σ_j |exp(F t)_ij| b_j, in discrete time of F^t, (n,).

    X_(k+1) = X_k exp(F h) is off by rounding and by the radius of exp(F h). These defects add up to
    a share Σ ε_k of the bound itself, if each is at most ε_k b. Between two steps, a straight line
    is off by h²/8 |F² exp(F t)|, and |F² exp(F t)| <= exp(|F| h) |F² X_k|. The search ends where
    |X_k| b < b: what follows repeats all at a smaller size.
    """
    from flint import arb

    middle = midpoints(F)
    n, h = len(middle), 1.0
    step, bend = F, np.zeros((n, n))
    with precision(BITS):
        if not setting.is_discrete:
            h = 1.0 / (_STEPS_PER_RATE * float(np.abs(np.linalg.eigvals(middle)).max()))
            step = (F * arb(h)).exp()
            bend = h**2 / 8.0 * midpoints((ball_matrix(np.abs(middle)) * arb(h)).exp())
        E, E_radius = midpoints(step), radii(step)
    defect = E_radius + (n + 4) * 2.0**-52 * np.abs(E)
    squared = middle @ middle
    X, top, lost, bent = np.eye(n), widths.copy(), 0.0, np.zeros(n)
    for _ in range(_MOST_STEPS):
        bent = np.maximum(bent, bend @ (np.abs(squared @ X) @ widths))
        lost += float((defect @ (np.abs(X) @ widths) / widths).max())
        X = E @ X
        reached = np.abs(X) @ widths
        top = np.maximum(top, reached)
        if (reached < 0.9 * widths).all():
            break
    else:
        raise NotProvedError("the exact loop has both fast and slow modes")
    if not lost < 0.01:
        raise NotProvedError("rounding of the exact loop is not small")
    bent = bent * (1.0 + _STRICT) + lost * (bend @ (np.abs(squared) @ top))
    return np.asarray((top / (1.0 - lost) + bent) * (1.0 + 1e-9))
