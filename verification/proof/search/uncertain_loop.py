"""A loop whose actuators have bandwidths, effectiveness and delays within intervals: one Lyapunov
function for all.

With d_i = u_i(t - τ_i) - u_i and v_i = λ_0 (u_i + d_i) + e_i the loop is ζ' = R (ζ, d, e). d_i is
minus the integral of u_i' over the delay: by the inequality of Cauchy and Schwarz d_i² is at most τ
times the integral of u_i'² over the last τ seconds, however the delay changes within [0, τ] (Kao
and Lincoln, Automatica 40, 2004), and |e_i| <= |z_i| with z = r (u + d), r the half width of the
effectiveness. Let q = τ u' = τ U R (ζ, d, e). Where

    V' + q'X_1 q - d'X_1 d + z'X_2 z - e'X_2 e < 0,  V = ζ'H ζ,  H > 0,  X_1, X_2 >= 0 diagonal,

V + Σ X_1i/τ ∫∫ q_i² (over the last τ seconds, twice) decreases. The left side is convex in R, q and
z, which are affine in the bandwidth: its two ends decide. No approximation of the delay is used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from verification.proof.arithmetic.balls import (
    TaylorModel,
    doubles,
    exact,
    is_positive_definite,
    matrix,
)
from verification.proof.enclosures.matrix_balls import is_positive
from verification.proof.enclosures.trim_branch import ModelForms
from verification.proof.search.scheduled_loop import LoopTable, closed_loop

Rows = np.ndarray
#: The interval of bandwidths is halved at most so often.
_HALVINGS = 3
#: Steps of Newton's method at most, and the factor by which the weight of the barrier falls.
_STEPS, _FALL = 250, 20.0
#: Largest multiplier, in scaled units.
_LARGEST = 100.0


class Piece(NamedTuple):
    """From one bandwidth to the other V = ζ'H ζ proves the loop, with the multipliers X = (X_1,
    X_2).

    turn: coordinates of (ζ, d, e) in which that is proved.
    """

    bandwidth: tuple[float, float]
    H: Rows
    X: Rows
    turn: Rows


def proved_pieces(
    table: LoopTable, forms: ModelForms, bandwidth: tuple[float, float], halvings: int = _HALVINGS
) -> list[Piece]:
    """What proves the loop on a box for all of its actuators of these bandwidths; empty when that
    is not found."""
    piece, (low, high) = _piece(table, forms, bandwidth), bandwidth
    if piece is not None or halvings == 0 or low == high:
        return [] if piece is None else [piece]
    cut = float(np.sqrt(low * high))
    below = proved_pieces(table, forms, (low, cut), halvings - 1)
    above = proved_pieces(table, forms, (cut, high), halvings - 1) if below else []
    return below + above if above else []


def _piece(table: LoopTable, forms: ModelForms, bandwidth: tuple[float, float]) -> Piece | None:
    loops = [_loop(table, forms, w) for w in sorted(set(bandwidth))]
    points = [
        tuple(doubles(c0 + s * c1 + c2) for c0, c1, c2, *_ in (each.parts for each in loop))
        for loop in loops
        for s in (-1.0, 1.0)
    ]
    n = table.K.shape[2]
    if max(np.linalg.eigvals(R[:, :n]).real.max() for R, _, _ in points) >= 0.0:
        return None
    search = common_lyapunov(points)
    if search is None:
        return None
    H, X = search
    forms_of_V = [_decrease(*loop, H, X) for loop in loops]
    try:
        turn = np.linalg.inv(
            np.linalg.cholesky(sum(doubles(each.parts[0]) for each in forms_of_V))
        ).T
    except np.linalg.LinAlgError:
        return None
    proved = (
        is_positive_definite(matrix(H))
        and min(X) >= 0.0
        and all(is_positive(each, turn) for each in forms_of_V)
    )
    return Piece(bandwidth, H, X, turn) if proved else None


def _loop(
    table: LoopTable, forms: ModelForms, bandwidth: float
) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
    """R, q and z at a bandwidth."""
    actuators, affine = table.actuators, table.at(forms.box)
    assert actuators is not None
    n, a = actuators.G.shape
    low, high = map(exact, actuators.effectiveness)
    zeta, d, e = (
        matrix(np.eye(n + 2 * a)[rows]) for rows in (slice(n), slice(n, n + a), slice(n + a, None))
    )
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
    squares = [
        each.transpose() * (weight * each) for each, weight in zip((q, z), weights, strict=True)
    ]
    return (
        TaylorModel(matrix(np.diag([*np.zeros(n), *X])))
        - half
        - half.transpose()
        - squares[0]
        - squares[1]
    )


def common_lyapunov(points: list[tuple[Rows, ...]]) -> tuple[Rows, Rows] | None:
    """H and X that serve all of the points (R, q, z), in doubles; None when there are none.

    The smallest t with S = F(H, X) + t I > 0 at all points, 0 < H < I, 0 < X < 100, in the modes of
    their mean, by a barrier and Newton's method (Boyd and Vandenberghe, Convex Optimization, 2004,
    Section 11.8); t < 0 is sought."""
    n, wide = points[0][0].shape
    mean = np.mean([R for R, _, _ in points], axis=0)
    values, vectors = np.linalg.eig(mean[:, :n])
    parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
    turn = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
    if np.linalg.cond(turn) > 1e12:
        return None
    back, S = np.linalg.inv(turn), np.zeros((wide, wide))
    scales = 1.0 / np.linalg.norm(back @ mean[:, n:], axis=0).clip(1e-12)
    S[:n, :n], S[range(n, wide), range(n, wide)] = turn, scales
    turned = [(back @ R @ S, np.vstack([q, z]) @ S / scales[:, None]) for R, q, z in points]
    found = _barrier(turned)
    if found is None:
        return None
    H = back.T @ found[0] @ back
    return (H + H.T) / 2, found[1] / scales**2


def _barrier(points: list[tuple[Rows, Rows]]) -> tuple[Rows, Rows] | None:
    """H and X of `common_lyapunov` for points (R, rows), rows those of q and z; None when none is
    found.

    F = -(J'H R + R'H J) + Σ X_j (e_j e_j' - r_j r_j'), J the rows of ζ, e_j those of d and e, r_j
    of the rows."""
    (n, wide), k = points[0][0].shape, len(points[0][1])
    eye, (i, j) = np.eye(wide), np.triu_indices(n)
    size, half = len(i), np.where(i == j, 0.5, 1.0)

    def halves(M: Rows) -> Rows:
        """tr(E M) for the symmetric unit matrices E; M: (.., n, n)."""
        return np.asarray(half * (M[..., i, j] + M[..., j, i]))

    def sums(H: Rows, X: Rows, t: float) -> list[Rows]:
        """What is to be positive definite."""
        first = [eye[:, :n] @ H @ R for R, _ in points]
        more = [
            np.diag([*np.zeros(n), *X]) - rows.T @ (X[:, None] * rows) + t * eye
            for _, rows in points
        ]
        return [b - a - a.T for a, b in zip(first, more, strict=True)] + [H, np.eye(n) - H]

    def matrices(at: Rows) -> tuple[Rows, Rows, float]:
        H = np.zeros((n, n))
        H[i, j] = H[j, i] = at[:size]
        return H, at[size:-1], float(at[-1])

    def barrier(at: Rows) -> float:
        try:
            logs = sum(np.log(np.diag(np.linalg.cholesky(S))).sum() for S in sums(*matrices(at)))
        except np.linalg.LinAlgError:
            return np.inf
        X = at[size:-1]
        inside = X.min() > 0.0 and X.max() < _LARGEST
        return (
            float(at[-1] / weight - 2.0 * logs - np.log(X * (_LARGEST - X)).sum())
            if inside
            else np.inf
        )

    at = np.concatenate([half * (i == j), np.full(k, 0.5), [0.0]])
    at[-1] = (
        1.5 * max(0.0, -min(np.linalg.eigvalsh(S)[0] for S in sums(*matrices(at))[: len(points)]))
        + 1e-3
    )
    count = wide * len(points) + 2 * n + 2 * k
    weight = 3.0 * at[-1] / count
    for _ in range(_STEPS):
        (H, X, _), gradient, curvature = (
            matrices(at),
            np.zeros(len(at)),
            np.zeros((len(at), len(at))),
        )
        inverses = [np.linalg.inv(S) for S in sums(*matrices(at))]
        gradient[-1] = 1.0 / weight
        gradient[size:-1] = 1.0 / (_LARGEST - X) - 1.0 / X
        curvature[range(size, size + k), range(size, size + k)] = (
            1.0 / (_LARGEST - X) ** 2 + 1.0 / X**2
        )
        gradient[:size] = halves(inverses[-1] - inverses[-2])
        first, second = [inverses[-2], inverses[-1]], [inverses[-2], inverses[-1]]
        for (R, rows), Z in zip(points, inverses, strict=False):
            RZ, b = R @ Z, R @ Z[:, :n]
            first += [2.0 * b, 2.0 * RZ @ R.T]
            second += [b, Z[:n, :n]]
            both = [(1.0, eye[n:]), (-1.0, rows)]  # e_j, r_j
            gradient[:size] += 2.0 * halves(b)
            gradient[size:-1] -= sum(sign * np.einsum("ij,jk,ik->i", g, Z, g) for sign, g in both)
            gradient[-1] -= np.trace(Z)
            mixed = [
                sign * np.einsum("ia,ja->jia", Z[:n] @ g.T, RZ @ g.T).transpose(2, 1, 0)
                for sign, g in both
            ]
            curvature[size:-1, :size] -= 2.0 * halves(mixed[0] + mixed[1])
            curvature[-1, :size] -= 2.0 * halves(RZ @ Z[:, :n])
            for sign, g in both:
                curvature[size:-1, size:-1] += sum(
                    sign * other * (g @ Z @ h.T) ** 2 for other, h in both
                )
                curvature[-1, size:-1] += sign * np.einsum("ij,jk,ik->i", g, Z @ Z, g)
            curvature[-1, -1] += np.sum(Z * Z)
        # tr(E M E' N), summed over pairs M, N of matrices.
        T = (np.reshape(first, (-1, n * n)).T @ np.reshape(second, (-1, n * n))).reshape(n, n, n, n)
        p, q = i[:, None], j[:, None]
        curvature[:size, :size] = (
            half[:, None] * (T[q, i, j, p] + T[p, i, j, q] + T[q, j, i, p] + T[p, j, i, q]) * half
        )
        curvature[:size, size:], curvature[size:-1, -1] = (
            curvature[size:, :size].T,
            curvature[-1, size:-1],
        )
        step = -np.linalg.solve(
            curvature + 1e-14 * np.trace(curvature) / len(at) * np.eye(len(at)), gradient
        )
        gain, share, now = float(-gradient @ step), 1.0, barrier(at)
        while barrier(at + share * step) > now - 0.1 * share * gain and share > 1e-6:
            share /= 2.0
        at = at + share * step
        if gain < 1.0:
            if weight * count < 0.3 * abs(at[-1]):
                break
            if at[-1] > 2.0 * weight * count:  # the least t is positive
                return None
            weight /= _FALL
    H, X, t = matrices(at)
    return (H, X) if t < 0.0 else None
