"""The discounted game in discrete time: its exact solution by two derivations, with a certificate.

x⁺ = A x + B u + E w,  J = Σ γᵏ (x'Qx + u'Ru - δ² w'w): u minimizes, w maximizes; the value is x'P
x."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.certificate import (
    DISAGREEMENT,
    INDEFINITENESS,
    RESIDUAL,
    Certificate,
    refuse_failures,
)
from hfa_support.errors import BadInputError, NoSolutionError, is_finite, refuse_unless_positive
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.fields import Shown

#: Newton steps after the Schur form, and doublings of the horizon: 2^60 steps of time forget any
#: start.
_REFINEMENTS, _DOUBLINGS = 4, 60


@dataclass(frozen=True, eq=False, repr=False)
class DiscountedSolution(Shown):
    """The value x'P x, the policies u = -K x and w = L x, and the certificate that holds for them.

    P: (n, n); K: (m, n); disturbance_gain L: (k, n). game: A, B, E, Q, R, delta of one step of
    time. discount: γ."""

    P: np.ndarray
    K: np.ndarray
    disturbance_gain: np.ndarray
    game: Game
    discount: float
    certificate: Certificate


def sampled(game: Game, dt: float) -> Game:
    """The game of one step: u and w are held for dt seconds, and a step costs dt (x'Qx + u'Ru - δ²
    w'w) at its start.

    [A B E] of the step are those of exp([[A, B, E], [0, 0, 0]] dt); its weights Q dt and R dt, its
    delta √dt δ. Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, Section
    4.3."""
    from scipy.linalg import expm

    refuse_unless_positive("dt", dt, " s")
    n, m = game.B.shape
    moved = np.hstack([game.A, game.B, game.E])
    step = expm(dt * np.vstack([moved, np.zeros((moved.shape[1] - n, moved.shape[1]))]))[:n]
    A, B, E = np.split(step, [n, n + m], axis=1)
    return Game(A=A, B=B, E=E, Q=game.Q * dt, R=game.R * dt, delta=game.delta * math.sqrt(dt))


def solve_discounted(game: Game, discount: float, dt: float | None = None) -> DiscountedSolution:
    """P = Q + K'RK - δ² L'L + γ F'P F,  F = A - B K + E L,  [K; -L] = (W + γ G'P G)⁻¹ γ G'P A,  G =
    [B E].

    W = blkdiag(R, -δ² I). game: of one step of time, or with dt (s) a game in continuous time,
    which is `sampled`. discount γ: in (0, 1], a step. NoSolutionError names the test that fails.
    With δ² I - γ E'P E > 0 and P >= 0 the saddle point exists; √γ F must have its eigenvalues
    within the unit circle. Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 3.7, for
    √γ A, √γ B, √γ E."""
    if not (is_finite(discount) and 0.0 < discount <= 1.0):
        raise BadInputError(
            f"discount is {discount}; it must be above 0 and at most 1, the factor of one step"
        )
    step = game if dt is None else sampled(game, dt)
    units = balanced_units(step)
    alike = _undiscounted(in_units(step, units), discount)
    try:
        P = _by_schur(alike)
        for _ in range(_REFINEMENTS):
            P = P + _newton(alike, P)[1]
        apart = float(np.abs(P - _by_doubling(alike)).max()) / (float(np.abs(P).max()) or 1.0)
        reason = f"value iteration gives another P (difference {apart:.2g})"
        second = at_most("second_derivation", apart, DISAGREEMENT, reason)
        certificate = Certificate((*discounted_checks(alike, P), second))
        refuse_failures(certificate.checks)
    except (NoSolutionError, np.linalg.LinAlgError, ValueError) as failure:
        reason = f"no certified value of the discounted game: {failure}"
        raise NoSolutionError(f"{reason}; ask for a larger delta") from failure
    K, L = policies_of_step(alike, P)
    return DiscountedSolution(
        P / np.outer(units, units), K / units, L / units, step, float(discount), certificate
    )


def _undiscounted(step: Game, discount: float) -> Game:
    """The game without discount that has the same value."""
    root = math.sqrt(discount)
    return replace(step, A=root * step.A, B=root * step.B, E=root * step.E)


def policies_of_step(
    step: Game, P: np.ndarray, discount: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """K and L of u = -K x, w = L x, which the value x'P x of the next state implies; step: a game
    of one step.

    As in `solve_discounted`, with E divided by δ, so that δ = inf is no exception.
    """
    m = step.B.shape[1]
    G = np.hstack([step.B, step.E / step.delta])
    W = np.diag(np.repeat([0.0, -1.0], [m, G.shape[1] - m]))
    W[:m, :m] = step.R
    both = np.linalg.solve(W + discount * G.T @ P @ G, discount * G.T @ P @ step.A)
    return both[:m], -both[m:] / step.delta


def quick_discounted(step: Game) -> tuple[np.ndarray, np.ndarray]:
    """P and K of a step without discount, neither refined nor certified: for a search.
    NoSolutionError where there is none."""
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
            P = _by_schur(step)
            return P, policies_of_step(step, P)[0]
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError("no value of the game in discrete time") from error


def discounted_checks(game: Game, P: np.ndarray) -> tuple[Check, ...]:
    """The tests of P alone, for γ = 1: Bellman's equation, signs, both closed loops."""
    K, L = policies_of_step(game, P)
    size = float(np.abs(P).max()) or 1.0
    loop = game.A - game.B @ K
    terms = (
        np.abs(game.Q)
        + np.abs(K.T @ game.R @ K)
        + np.abs(P)
        + np.abs(loop.T) @ np.abs(P) @ np.abs(loop)
    )
    left, correction = _newton(game, P)
    residual, error = (
        float(np.abs(left).max() / (terms.max() or 1.0)),
        float(np.abs(correction).max()) / size,
    )
    smallest = float(np.linalg.eigvalsh(P)[0]) / size
    pays = np.linalg.eigvalsh(np.eye(game.E.shape[1]) - game.E.T @ P @ game.E / game.delta**2).min(
        initial=1.0
    )
    radii = [float(np.abs(np.linalg.eigvals(each)).max()) for each in (loop + game.E @ L, loop)]
    return (
        at_most(
            "residual",
            residual,
            RESIDUAL,
            f"Bellman's equation is left with a residual of {residual:.2g}",
        ),
        at_most("newton_correction", error, RESIDUAL, f"a Newton step changes P by {error:.2g}"),
        at_least(
            "positive_semidefinite",
            smallest,
            -INDEFINITENESS,
            f"P is indefinite ({smallest:.3g} of its size)",
        ),
        at_least(
            "disturbance_pays",
            float(pays),
            1e-12,
            "delta^2 I - discount E'P E is not positive definite",
        ),
        below(
            "game_loop_radius",
            radii[0],
            1.0,
            f"sqrt(discount) (A - B K + E L) has radius {radii[0]:.6g}",
        ),
        below(
            "control_loop_radius",
            radii[1],
            1.0,
            f"sqrt(discount) (A - B K) has radius {radii[1]:.6g}",
        ),
    )


def _newton(game: Game, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q + K'RK - δ² L'L + F'P F - P, in which errors of K and L count by their squares only, and
    Newton's correction of P: Z = F'Z F + this."""
    from scipy.linalg import solve_discrete_lyapunov

    K, L = policies_of_step(game, P)
    F, price = game.A - game.B @ K + game.E @ L, 0.0 if math.isinf(game.delta) else game.delta**2
    residual = game.Q - P + K.T @ game.R @ K - price * L.T @ L + F.T @ P @ F
    with warnings.catch_warnings(
        action="ignore"
    ):  # of a loop near the unit circle, whose correction is judged
        found = solve_discrete_lyapunov(F.T, (residual + residual.T) / 2.0)
    return residual, np.asarray(found + found.T) / 2.0


def _by_schur(game: Game) -> np.ndarray:
    """First derivation. Source: Arnold and Laub, Proc. IEEE 72 (1984), as implemented in SciPy."""
    from scipy.linalg import block_diag, solve_discrete_are

    G, W = game.B, game.R
    if math.isfinite(game.delta):
        G, W = np.hstack([G, game.E / game.delta]), block_diag(W, -np.eye(game.E.shape[1]))
    P = solve_discrete_are(game.A, G, game.Q, W)
    return np.asarray(P + P.T) / 2.0


def _by_doubling(game: Game) -> np.ndarray:
    """Second derivation: value iteration from 0, each pass of which doubles the horizon: H is its
    value.

    M = (I + G H)⁻¹:  A <- A M A,  G <- G + A M G A',  H <- H + A'H M A, from A, B R⁻¹B' - δ⁻² E E',
    Q. Source: Chu, Fan, Lin and Wang, Int. J. Control 77 (2004), 767-788 (structured doubling)."""
    A, G, H = game.A, game.S, game.Q
    for _ in range(_DOUBLINGS):
        M = np.linalg.inv(np.eye(len(A)) + G @ H)
        step = A.T @ H @ M @ A
        A, G, H = A @ M @ A, G + A @ M @ G @ A.T, H + (step + step.T) / 2.0
        if not np.isfinite(H).all():
            raise NoSolutionError("value iteration grows without end")
        if np.abs(step).max() <= 1e-17 * np.abs(H).max():
            break
    return H
