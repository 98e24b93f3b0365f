"""A loop whose actuators have bandwidths, effectiveness and delays within intervals: one Lyapunov function for all.

With d_i = u_i(t - τ_i) - u_i and v_i = λ_0 (u_i + d_i) + e_i the loop is ζ' = R (ζ, d, e). d_i is minus the integral of
u_i' over the delay: by the inequality of Cauchy and Schwarz d_i² is at most τ times the integral of u_i'² over the
last τ seconds, however the delay changes within [0, τ] (Kao and Lincoln, Automatica 40, 2004), and |e_i| <= |z_i| with
z = r (u + d), r the half width of the effectiveness. Let q = τ u' = τ U R (ζ, d, e). Where

    V' + q'X_1 q - d'X_1 d + z'X_2 z - e'X_2 e < 0,  V = ζ'H ζ,  H > 0,  X_1, X_2 >= 0 diagonal,

V + Σ X_1i/τ ∫∫ q_i² (over the last τ seconds, twice) decreases. The left side is convex in R, q and z, which are affine
in the bandwidth: its two ends decide. No approximation of the delay is used.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from verification.arithmetic.balls import doubles, exact, is_positive_definite, matrix
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import roomy
from verification.enclosures.trim_branch import ModelForms
from verification.proof.scheduled_loop import LoopTable, closed_loop

Rows = np.ndarray
#: The interval of bandwidths is halved at most so often.
_HALVINGS = 3
#: Steps of Newton's method at most, and the factor by which the weight of the barrier falls.
_STEPS, _FALL = 80, 5.0
#: Largest multiplier, in scaled units.
_LARGEST = 100.0


class Piece(NamedTuple):
    """From one bandwidth to the other V = ζ'H ζ proves the loop, with the multipliers X = (X_1, X_2).

    turn: coordinates of (ζ, d, e) in which that is proved.
    """

    bandwidth: tuple[float, float]
    H: Rows
    X: Rows
    turn: Rows


def proved_pieces(table: LoopTable, forms: ModelForms) -> tuple[Piece, ...] | None:
    """What proves the loop on a box for all of its actuators; None when that is not found."""
    actuators = table.actuators
    assert actuators is not None
    waiting, found = [(actuators.bandwidth, 0)], list[Piece]()
    while waiting:
        (low, high), depth = waiting.pop()
        piece = _piece(table, forms, (low, high))
        if piece is not None:
            found.append(piece)
        elif depth == _HALVINGS or low == high:
            return None
        else:
            cuts = (low, float(np.sqrt(low * high)), high)
            waiting += [(ends, depth + 1) for ends in pairwise(cuts)][::-1]
    return tuple(found)


def _piece(table: LoopTable, forms: ModelForms, bandwidth: tuple[float, float]) -> Piece | None:
    loops = [_loop(table, forms, w) for w in sorted(set(bandwidth))]
    points = [tuple(_at(each, s) for each in loop) for loop in loops for s in (-1.0, 1.0)]
    n = table.K.shape[2]
    if max(np.linalg.eigvals(R[:, :n]).real.max() for R, _, _ in points) >= 0.0:
        return None
    search = common_lyapunov(points)
    if search is None:
        return None
    H, X = search
    forms_of_V = [_decrease(*loop, H, X) for loop in loops]
    try:
        turn = np.linalg.inv(np.linalg.cholesky(sum(doubles(each.parts[0]) for each in forms_of_V))).T
    except np.linalg.LinAlgError:
        return None
    T = matrix(turn)
    turned = [each.map(lambda part: T.transpose() * part * T) for each in forms_of_V]
    held = is_positive_definite(matrix(H)) and min(X) >= 0.0
    proved = held and all(is_positive_definite(corner) for each in turned for corner in roomy(each).corners())
    return Piece(bandwidth, H, X, turn) if proved else None


def _loop(table: LoopTable, forms: ModelForms, bandwidth: float) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
    """R, q and z at a bandwidth."""
    actuators, affine = table.actuators, table.at(forms.box)
    assert actuators is not None
    n, a = actuators.G.shape
    low, high = map(exact, actuators.effectiveness)
    zeta, d, e = (matrix(np.eye(n + 2 * a)[rows]) for rows in (slice(n), slice(n, n + a), slice(n + a, None)))
    U = affine(actuators.U)
    asked = U * zeta + d
    moved = matrix(actuators.own) * zeta + matrix(actuators.G) * (asked * ((low + high) / 2) + e)
    R = closed_loop(table, forms) * zeta + moved * exact(bandwidth)
    return R, U * R * exact(actuators.delay), asked * ((high - low) / 2)


def _decrease(R: TaylorModel, q: TaylorModel, z: TaylorModel, H: Rows, X: Rows) -> TaylorModel:
    """The form in (ζ, d, e) that is to be positive: minus the left side."""
    n, wide = H.shape[0], H.shape[0] + len(X)
    half = matrix(np.eye(wide, n)) * (matrix(H) * R)
    weights = [matrix(np.diag(each)) for each in np.split(X, 2)]
    squares = [each.transpose() * (weight * each) for each, weight in zip((q, z), weights, strict=True)]
    return TaylorModel(matrix(np.diag([*np.zeros(n), *X]))) - half - half.transpose() - squares[0] - squares[1]


def _at(form: TaylorModel, s: float) -> Rows:
    return doubles(form.parts[0] + s * form.parts[1] + form.parts[2])


def common_lyapunov(points: list[tuple[Rows, ...]]) -> tuple[Rows, Rows] | None:
    """H and X that serve all of the points (R, q, z), in doubles; None when there are none.

    The smallest t with F(H, X) + t I > 0 at all points, 0 < H < I, 0 < X < 100, in the modes of their mean, by a
    barrier and Newton's method (Boyd and Vandenberghe, Convex Optimization, 2004, Section 11.8); t < 0 is sought.
    """
    n, wide = points[0][0].shape
    mean = np.mean([R for R, _, _ in points], axis=0)
    values, vectors = np.linalg.eig(mean[:, :n])
    turn = np.where(
        values.imag == 0.0, vectors.real, np.sqrt(2.0) * np.where(values.imag > 0.0, vectors.real, vectors.imag)
    )
    if np.linalg.cond(turn) > 1e12:
        return None
    back = np.linalg.inv(turn)
    scales = 1.0 / np.linalg.norm(back @ mean[:, n:], axis=0).clip(1e-12)
    S = np.zeros((wide, wide))
    S[:n, :n], S[range(n, wide), range(n, wide)] = turn, scales
    upper, size = np.transpose(np.triu_indices(n)), n * (n + 1) // 2
    basis = np.zeros((size + wide - n, n, n))
    basis[range(size), upper[:, 0], upper[:, 1]] = basis[range(size), upper[:, 1], upper[:, 0]] = 1.0
    forms = []
    for R, q, z in points:
        F = np.zeros((len(basis), wide, wide))
        F[:, :n] -= basis @ (back @ R @ S)
        F += F.transpose(0, 2, 1)
        rows = (np.vstack([q, z]) @ S) / scales[:, None]
        F[size:] -= rows[:, :, None] * rows[:, None, :]
        F[range(size, len(F)), range(n, wide), range(n, wide)] += 1.0
        forms.append(F)
    eye, several = np.eye(n), np.zeros((wide - n, len(basis)))
    several[:, size:] = np.eye(wide - n)
    bounds = [(0.0 * eye, basis), (eye, -basis)]
    y = _barrier(forms, bounds, several, np.array([*(0.5 * (i == j) for i, j in upper.tolist()), *[0.5] * (wide - n)]))
    if y is None:
        return None
    H = back.T @ np.tensordot(y[:size], basis[:size], 1) @ back
    return (H + H.T) / 2, y[size:] / scales**2


def _barrier(forms: list[Rows], bounds: list[tuple[Rows, Rows]], positive: Rows, y: Rows) -> Rows | None:
    """y with Σ y F > 0 for every F of the forms, and within the bounds; None when none is found."""
    blocks = [(np.zeros(F.shape[1:]), np.concatenate([F, np.eye(F.shape[1])[None]])) for F in forms]
    blocks += [(C, np.concatenate([F, 0.0 * C[None]])) for C, F in bounds]
    rows = np.pad(np.vstack([positive, -positive]), ((0, 0), (0, 1)))
    offsets = np.repeat([0.0, _LARGEST], len(positive))
    lowest = min(np.linalg.eigvalsh(np.tensordot(y, F, 1))[0] for F in forms)
    at = np.append(y, 1.5 * max(0.0, -lowest) + 1e-3)
    sizes = sum(len(F) for F, _ in blocks) + len(rows)
    weight = 3.0 * at[-1] / sizes

    def barrier(at: Rows) -> float:
        try:
            sums = [np.log(np.diag(np.linalg.cholesky(C + np.tensordot(at, F, 1)))).sum() for C, F in blocks]
        except np.linalg.LinAlgError:
            return np.inf
        slack = offsets + rows @ at
        return float(at[-1] / weight - 2.0 * sum(sums) - np.log(slack).sum()) if slack.min() > 0.0 else np.inf

    for _ in range(_STEPS):
        slopes = rows / (offsets + rows @ at)[:, None]
        gradient, curvature = -slopes.sum(axis=0), slopes.T @ slopes
        gradient[-1] += 1.0 / weight
        for C, F in blocks:
            root = np.linalg.inv(np.linalg.cholesky(C + np.tensordot(at, F, 1)))
            W = root @ F @ root.T
            gradient -= np.trace(W, axis1=1, axis2=2)
            W = W.reshape(len(W), -1)
            curvature += W @ W.T
        step = -np.linalg.solve(curvature + 1e-14 * np.trace(curvature) / len(at) * np.eye(len(at)), gradient)
        gain, share, now = float(-gradient @ step), 1.0, barrier(at)
        while barrier(at + share * step) > now - 0.1 * share * gain and share > 1e-6:
            share /= 2.0
        at = at + share * step
        if gain < 1.0:
            if weight * sizes < 0.3 * abs(at[-1]):
                break
            weight /= _FALL
    return at[:-1] if at[-1] < 0.0 else None
