"""Many games at once: a stacked solution certified by the rules of `certificate`; what it leaves
goes one by one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.game.zero_sum import LARGEST, Game
from controller.riccati.balancing import MODERATE, balanced
from controller.riccati.certificate import (
    AXIS_DISTANCE,
    DISAGREEMENT,
    INDEFINITENESS,
    RESIDUAL,
    relative_residuals,
)
from controller.riccati.gare import solve_certified
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.fields import Shown

#: Games of one stack: enough to forget the cost of a call, few enough for the cache.
TOGETHER = 256
#: Newton's correction of P that stacked double precision must reach; above it the single solution
#: has more digits.
SETTLED = 1e-12
#: Newton steps after the eigenvectors, and for the matrix sign (10 are usual, one more for each
#: halving of |Re λ|).
_STEPS, _SIGN_STEPS = 3, 25


@dataclass(frozen=True, eq=False, repr=False)
class GameBatch(Shown):
    """N solutions. P: (N, n, n), K: (N, m, n), nan where not certified. certified: (N,). reasons: N
    lines, or ""."""

    P: np.ndarray
    K: np.ndarray
    certified: np.ndarray
    reasons: tuple[str, ...]


def solve_games(A: np.ndarray, B: np.ndarray, like: Game) -> GameBatch:
    """`solve_game` of every plant (A (N, n, n), B (N, n, m)); E, Q, R, delta of `like`.

    Most are solved in stacks of matrices; one that does not pass every test there is solved alone,
    and what that refuses gets the test that failed as its reason. BadInputError names the model
    that is none."""
    A, B = np.asarray(A, dtype=float), np.asarray(B, dtype=float)
    sound = [(np.abs(each) <= LARGEST).all(axis=(1, 2)) for each in (A, B)]
    for i in (*[0] * bool(len(A)), *np.flatnonzero(~(sound[0] & sound[1]))[:1]):
        try:
            replace(like, A=A[i], B=B[i])
        except BadInputError as error:
            raise BadInputError(f"model {i} of the batch: {error}") from error
    P, K = np.full_like(A, np.nan), np.full(np.swapaxes(B, 1, 2).shape, np.nan)
    reasons = [""] * len(A)
    for first in range(0, len(A), TOGETHER):
        part = slice(first, first + TOGETHER)
        with np.errstate(all="ignore"):  # what overflows is not certified
            P[part], K[part] = _stacked(A[part], B[part], like)
    for i in np.flatnonzero(np.isnan(K).any(axis=(1, 2))):
        try:
            found = solve_certified(replace(like, A=A[i], B=B[i]))
            P[i], K[i] = found.P, found.K
        except NoSolutionError as failure:
            reasons[i] = str(failure)
    return GameBatch(P, K, np.array([not reason for reason in reasons]), tuple(reasons))


def _stacked(A: np.ndarray, B: np.ndarray, like: Game) -> tuple[np.ndarray, np.ndarray]:
    """P and K, nan where a test fails; each game in its balanced units, in which everything is
    measured.

    First derivation: eigenvectors [V1; V2] of the Hamiltonian, then Newton steps. V1 has the
    eigenvectors of A - S P, so that they solve the Lyapunov equation of a step too. Second
    derivation: the matrix sign of the Hamiltonian. Source: Zhou, Doyle and Glover, Section 13.2;
    Roberts, Int. J. Control 32 (1980), 677-687."""
    count, n, _ = A.shape
    gain = np.linalg.solve(like.R, B.mT)
    S_control, S_disturbance = (
        B @ gain,
        np.broadcast_to(like.S_disturbance / like.delta**2, A.shape),
    )
    Q = np.broadcast_to(like.Q, A.shape)
    scaling = np.array(
        [balanced(each)[1] for each in np.block([[A, S_disturbance - S_control], [-Q, -A.mT]])]
    )
    units = np.exp2(np.round(0.5 * np.log2(scaling[:, :n] / scaling[:, n:])))
    squared = units[:, :, None] * units[:, None, :]
    A, Q = A * units[:, None, :] / units[:, :, None], Q * squared
    S_control, S_disturbance = S_control / squared, S_disturbance / squared
    S = S_control - S_disturbance
    H = np.block([[A, -S], [-Q, -A.mT]])

    values, vectors = np.linalg.eig(H)
    order = np.argsort(values.real, axis=1)
    values, vectors = (
        np.take_along_axis(values, order, 1),
        np.take_along_axis(vectors, order[:, None, :], 2),
    )
    V1, stable = vectors[:, :n, :n], values[:, :n]
    inverse = _inverse(V1)
    P = (vectors[:, n:, :n] @ inverse).real
    P = (P + P.mT) / 2.0
    rates = stable[:, :, None] + stable[:, None, :]
    correction = np.full(count, np.inf)
    for _ in range(_STEPS):
        once = P @ A
        residual = once + once.mT + Q - P @ S @ P
        step = inverse.mT @ ((V1.mT @ residual @ V1) / -rates) @ inverse
        P, correction = P + (step + step.mT).real / 2.0, _largest(step) / _largest(P)

    size = _largest(P)
    # Bauer and Fike: σ_min(H - jω I) >= min |λ - jω| / cond V, which is at most the distance of the
    # certificate.
    condition = np.linalg.norm(vectors, axis=(1, 2)) * np.linalg.norm(
        _inverse(vectors), axis=(1, 2)
    )
    distance = np.abs(values.real).min(axis=1) / condition / np.linalg.norm(H, axis=(1, 2))
    good = (distance >= AXIS_DISTANCE) & ((values.real < 0.0).sum(axis=1) == n)
    good &= (correction <= SETTLED) & (size <= 1.0 / MODERATE) & np.isfinite(P).all(axis=(1, 2))
    P = np.where(good[:, None, None], P, np.nan)
    safe = np.where(good[:, None, None], P, 0.0)
    good &= relative_residuals(A, S_control, S_disturbance, Q, safe) <= RESIDUAL
    good &= np.linalg.eigvalsh(safe)[:, 0] >= -INDEFINITENESS * size
    good &= np.linalg.eigvals(A - S @ safe).real.max(axis=1) < 0.0
    good &= np.linalg.eigvals(A - S_control @ safe).real.max(axis=1) < 0.0
    good &= _largest(P - _by_sign(H)) <= DISAGREEMENT * size
    P = np.where(good[:, None, None], P / squared, np.nan)
    return P, gain @ P


def _by_sign(H: np.ndarray) -> np.ndarray:
    """P of (W + I) [I; P] = 0, W = sign(H): H <- (c H + (c H)⁻¹) / 2, c = |det H|^(-1/2n) until it
    settles."""
    W, n = H, H.shape[1] // 2
    for _ in range(_SIGN_STEPS):
        c = np.exp(-np.linalg.slogdet(W)[1] / (2 * n))[:, None, None]
        last, W = W, (c * W + _inverse(c * W)) / 2.0
        if not (_largest(W - last) > 1e-14 * _largest(W)).any():
            break
    left, right = W[:, :, n:] + np.eye(2 * n)[:, n:], -W[:, :, :n] - np.eye(2 * n)[:, :n]
    return _inverse(left.mT @ left) @ (left.mT @ right)


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Stacked inverses; nan where a matrix is singular to the last bit, which must not stop the
    others."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        found = np.full_like(matrices, np.nan)
        found[regular] = np.linalg.inv(matrices[regular])
        return found


def _largest(matrices: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(matrices).max(axis=(1, 2)))
