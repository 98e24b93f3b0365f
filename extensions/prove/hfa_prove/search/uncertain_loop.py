"""Search for proofs of a loop whose actuators have uncertain bandwidth, effectiveness and delay.

One Lyapunov function is found for all bandwidths of an interval. The condition is a matrix
inequality that is linear in H and X, at both ends of the interval. The checker proves the
inequality (`check_pieces`).
"""

from __future__ import annotations

import warnings

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.check.linear_loop import LoopBox, actuated_loop
from hfa_prove.check.modes import check_pieces
from hfa_prove.check.trims import LinearModelBox, Rejected
from hfa_prove.enclosure.balls import doubles, exact
from hfa_prove.search.loops import Loop
from hfa_prove.statements.schedule import Piece, UncertainActuators

#: Largest number of halvings of the interval of bandwidths.
_HALVINGS = 3
#: Largest multiplier, in scaled units.
_LARGEST = 100.0


def find_pieces(linear: LinearModelBox, model: Model, loop: Loop) -> list[Piece]:
    """Return Lyapunov functions that prove the loop on a box for all of its actuators.

    The list is empty if none are found.
    """
    actuators = loop.actuators
    assert isinstance(actuators, UncertainActuators)  # the caller found them
    box = actuated_loop(linear, model, loop.controller, actuators)
    return _pieces(box, actuators, actuators.bandwidth, _HALVINGS)


def _pieces(
    loop: LoopBox, actuators: UncertainActuators, bandwidth: tuple[float, float], halvings: int
) -> list[Piece]:
    """Return Lyapunov functions that together cover an interval of bandwidths.

    The interval is halved, at most `halvings` times, if no single function is found. The list is
    empty if a part is not covered.

    bandwidth: lowest and highest bandwidth, rad/s
    """
    piece = _piece(loop, actuators, bandwidth)
    low, high = bandwidth
    if piece is not None:
        return [piece]
    if halvings == 0 or low == high:
        return []
    cut = float(np.sqrt(low * high))
    below = _pieces(loop, actuators, (low, cut), halvings - 1)
    above = _pieces(loop, actuators, (cut, high), halvings - 1) if below else []
    return below + above if above else []


def _piece(
    loop: LoopBox, actuators: UncertainActuators, bandwidth: tuple[float, float]
) -> Piece | None:
    points = _points(loop, actuators, bandwidth)
    n = loop.G.nrows()
    if max(np.linalg.eigvals(rates[:, :n]).real.max() for rates, _ in points) >= 0.0:
        return None
    solution = common_lyapunov(points)
    if solution is None:
        return None
    H, X = solution
    forms = [decrease(rates, rows, H, X) for rates, rows in points]
    try:
        turn = np.linalg.inv(np.linalg.cholesky(sum(forms))).T
    except np.linalg.LinAlgError:
        return None
    piece = Piece(bandwidth, H, X, turn)
    whole = UncertainActuators(
        actuators.order, actuators.damping, bandwidth, actuators.effectiveness, actuators.delay
    )
    try:
        check_pieces(loop, whole, [piece])
    except Rejected:
        return None
    return piece


def _points(
    loop: LoopBox, actuators: UncertainActuators, bandwidth: tuple[float, float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return pairs of matrices for ζ' and for (q, z), which act on the vector (ζ, d, e).

    There is one pair for each end of the box and each end of the bandwidths.

    bandwidth: lowest and highest bandwidth, rad/s
    """
    least, most = actuators.effectiveness
    n = loop.G.nrows()
    a = loop.G.ncols()
    eye = np.eye(n + 2 * a)
    G = doubles(loop.G)
    lag = doubles(loop.lag)
    points = []
    for s in (-1.0, 1.0):
        base = doubles(loop.base.at(exact(s)).center)
        U = doubles(loop.U.at(exact(s)).center)
        heard = U @ eye[:n] + eye[n : n + a]
        v = (least + most) / 2 * heard + eye[n + a :]
        for w in sorted(set(bandwidth)):
            rates = base @ eye[:n] + w * (lag @ eye[:n] + G @ v)
            q = actuators.delay * (U @ rates)
            z = (most - least) / 2 * heard
            points.append((rates, np.vstack([q, z])))
    return points


def decrease(rates: np.ndarray, rows: np.ndarray, H: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the matrix of the quadratic form in (ζ, d, e) that must be positive definite.

    The form is -2 ζ'H ζ' + d'X_1 d + e'X_2 e - q'X_1 q - z'X_2 z, with ζ' the rates in the second
    factor.

    rates: matrix of ζ', (n, n + 2 a)
    rows: matrix of q and z, (2 a, n + 2 a)
    H: (n, n)
    X: diagonals of X_1 and X_2, (2 a,)
    """
    n, size = rates.shape
    growth = np.eye(size)[:, :n] @ H @ rates
    return np.diag([*np.zeros(n), *X]) - growth - growth.T - rows.T @ (X[:, None] * rows)


def common_lyapunov(
    points: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return H and the diagonals of X for all points, or None if none are found.

    Clarabel (Goulart and Chen, 2024) maximizes t such that the form of `decrease` minus t I is
    positive semidefinite at all points, with 0 <= H <= I and 0 <= X <= 100, in the modes of the
    mean rates. A solution needs t > 0.

    points: pairs of matrices, as returned by `_points`
    """
    n, size = points[0][0].shape
    mean = np.mean([rates for rates, _ in points], axis=0)
    values, vectors = np.linalg.eig(mean[:, :n])
    parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
    turn = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
    if np.linalg.cond(turn) > 1e12:
        return None
    back = np.linalg.inv(turn)
    scales = 1.0 / np.linalg.norm(back @ mean[:, n:], axis=0).clip(1e-12)
    S = np.zeros((size, size))
    S[:n, :n] = turn
    S[range(n, size), range(n, size)] = scales
    turned = [(back @ rates @ S, rows @ S / scales[:, None]) for rates, rows in points]
    solution = _largest_margin(turned)
    if solution is None:
        return None
    H, X = solution
    H = back.T @ H @ back
    return (H + H.T) / 2, X / scales**2


def _largest_margin(
    points: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return H (n, n) and the diagonal of X (size - n,) for the largest t, or None unless t > 0.

    The form of `decrease` minus t I is positive semidefinite at all points (rates, rows), with
    0 <= H <= I and 0 <= X <= 100.
    """
    import cvxpy as cp

    n, size = points[0][0].shape
    count = size - n
    H = cp.Variable((n, n), symmetric=True)
    X = cp.Variable(count)
    margin = cp.Variable()
    first = np.eye(size)[:, :n]
    last = np.eye(size)[:, n:]
    constraints = [H >> 0, np.eye(n) - H >> 0, X >= 0, X <= _LARGEST]
    for rates, rows in points:
        growth = first @ H @ rates
        form = last @ cp.diag(X) @ last.T - growth - growth.T - rows.T @ cp.diag(X) @ rows
        constraints.append(form - margin * np.eye(size) >> 0)
    problem = cp.Problem(cp.Maximize(margin), constraints)
    try:
        with warnings.catch_warnings():
            # An inaccurate solution is a candidate too: the checker decides.
            warnings.filterwarnings("ignore", "Solution may be inaccurate", UserWarning)
            problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return None
    if margin.value is None or not margin.value > 0.0:
        return None
    return np.array(H.value), np.clip(np.asarray(X.value), 0.0, None)
