"""Number of eigenvalues on each side of a line, for every matrix of a box.

Let H be symmetric and -(A'H + H A + 2 a H) positive definite. Then A has as many eigenvalues with
Re λ > -a as H has negative eigenvalues, and none with Re λ = -a (Ostrowski and Schneider, J. Math.
Anal. Appl. 4, 1962). For H > 0 this is Lyapunov's theorem. For a fixed H the matrix is affine in A,
and positive definite matrices form a convex cone. The test at the corners of a box is therefore
sufficient.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from flint import arb, arb_mat

from hfa_prove.check.cover import check_covered
from hfa_prove.check.linear_loop import LoopBox
from hfa_prove.enclosure.balls import is_positive_definite, matrix, pivots
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.flight import Line
from hfa_prove.statements.schedule import Piece, Run, UncertainActuators


def modes_right_of(A: TaylorModel, line: Line) -> int:
    """Return the number of eigenvalues with Re λ > -rate, proved equal for every A of the box.

    Raises Rejected unless the number is proved. The proof excludes eigenvalues with Re λ = -rate.
    """
    H = matrix(line.H)
    turn = matrix(line.turn)
    n = A.center.nrows()
    rate = matrix(line.rate * np.eye(n))
    half = -(H * (A + rate))
    check_positive(half + half.transpose(), turn)
    return eigenvalue_signs(H, turn).count(-1)


def least_and_most(A: TaylorModel, line: Line) -> tuple[int, int]:
    """Return bounds on the number of eigenvalues with positive real part, for every A of the box.

    n is the number of all eigenvalues.

    - rate < 0: the lower bound is proved, the upper bound is n
    - rate > 0: the upper bound is proved, the lower bound is 0
    - rate = 0: both bounds are the proved number
    """
    count = modes_right_of(A, line)
    least = count if line.rate <= 0.0 else 0
    most = count if line.rate >= 0.0 else A.center.nrows()
    return least, most


def check_motion(
    loop: TaylorModel, P: TaylorModel, growth: arb_mat, turn_of_box: np.ndarray
) -> None:
    """Raise Rejected unless V = ζ'P ζ decreases while the scheduling variable moves.

    The proved conditions are P > 0 and A'P + P A ± growth < 0 on the box.

    loop: matrix A of the closed loop
    growth: (n, n), change of P per second at the largest rate of the scheduling variable
    turn_of_box: (n, n), coordinates in which definiteness is tested
    """
    turn = matrix(turn_of_box)
    for end in (P.center - P.slope, P.center + P.slope):
        if -1 in eigenvalue_signs(end, turn):
            raise Rejected(
                "the Lyapunov function for the moving scheduling variable is not proved positive"
            )
    half = -(P * loop)
    decrease = half + half.transpose()
    check_positive(decrease + growth, turn)
    check_positive(decrease - growth, turn)


def check_positive(form: TaylorModel, turn: arb_mat) -> None:
    """Raise Rejected unless every symmetric matrix in a Taylor model is proved positive definite.

    form: the Taylor model
    turn: (n, n), coordinates for the test, in which errors of the parameters are small
    """
    turned = form.map(lambda part: turn.transpose() * part * turn)
    if not all(is_positive_definite(corner) for corner in turned.corners()):
        raise Rejected("the matrix that bounds the modes is not proved positive definite")


def eigenvalue_signs(symmetric: arb_mat, turn: arb_mat) -> list[int]:
    """Return the signs 1 or -1 of the eigenvalues of a symmetric matrix of balls.

    turn: (n, n), coordinates of the test (Sylvester's law of inertia)

    Raises Rejected if an eigenvalue may be 0 or `turn` may be singular.
    """
    diagonal = pivots(turn.transpose() * symmetric * turn)
    if diagonal is None:
        raise Rejected("the sign of an eigenvalue is not proved")
    return [1 if pivot > 0 else -1 for pivot in diagonal]


def check_pieces(loop: LoopBox, actuators: UncertainActuators, pieces: list[Piece]) -> None:
    """Raise Rejected unless a loop with uncertain actuators is proved stable.

    The loop is ζ' = base ζ + ω (lag ζ + G v), v_i = λ_i(t) u_i(t - τ_i(t)), u = U ζ. The proof
    covers each constant ω in the interval, all λ_i(t) in the interval of the effectiveness, and all
    delays 0 <= τ_i(t) <= τ, where τ is the stated delay.

    Write v = λ_0 (u + d) + e, with λ_0 the center and r the half-width of the effectiveness. Then
    |e| <= |z| with z = r (u + d). d_i = u_i(t - τ_i) - u_i(t) is minus the integral of u_i' over
    the last τ_i seconds. With q = τ u', the integral of d_i² is at most the integral of q_i² (Kao
    and Lincoln, Automatica 40, 2004). V = ζ'H ζ, together with the integrals of q², decreases if
    for all ζ, d, e that are not all 0

        2 ζ'H ζ' + q'X_1 q - d'X_1 d + z'X_2 z - e'X_2 e < 0,   H > 0,  X_1, X_2 >= 0 diagonal.

    The left side is convex in ω. The test at the ends of a piece is therefore sufficient.
    """
    bandwidths = [[piece.bandwidth] for piece in pieces]
    check_covered("the pieces", [actuators.bandwidth], bandwidths)
    least, most = map(arb, actuators.effectiveness)
    n = loop.G.nrows()
    a = loop.G.ncols()
    eye = np.eye(n + 2 * a)
    zeta = matrix(eye[:n])
    d = matrix(eye[n : n + a])
    e = matrix(eye[n + a :])
    heard = loop.U * zeta + d
    z = heard * ((most - least) / 2)
    v = heard * ((least + most) / 2) + e
    for piece in pieces:
        H = matrix(piece.H)
        if min(piece.X) < 0.0 or not is_positive_definite(H):
            raise Rejected("a Lyapunov function or a multiplier is not proved positive")
        X_1, X_2 = (matrix(np.diag(weights)) for weights in np.split(piece.X, 2))
        for bandwidth in map(arb, piece.bandwidth):
            rates = loop.base * zeta + (loop.lag * zeta + loop.G * v) * bandwidth
            q = loop.U * rates * arb(actuators.delay)
            growth = zeta.transpose() * H * rates
            form = -growth - growth.transpose()
            form += d.transpose() * X_1 * d - q.transpose() * (X_1 * q)
            form += e.transpose() * X_2 * e - z.transpose() * (X_2 * z)
            check_positive(form, matrix(piece.turn))


def check_runs(name: str, runs: Sequence[Run], bounds: Sequence[Run], size: int) -> None:
    """Raise Rejected unless the boxes prove the stated numbers of unstable modes.

    name: subject of the runs in messages, "loop" or "modes"
    runs: stated lowest and highest numbers over ranges of the scheduling variable
    bounds: lowest and highest numbers that each box proves
    size: number of eigenvalues
    """
    for run in runs:
        ends = [(run.low, run.high)]
        if run.least > 0:
            enough = [[(each.low, each.high)] for each in bounds if each.least >= run.least]
            what = f"the boxes of {name} with {run.least} or more unstable modes"
            check_covered(what, ends, enough)
        if run.most < size:
            enough = [[(each.low, each.high)] for each in bounds if each.most <= run.most]
            what = f"the boxes of {name} with at most {run.most} unstable modes"
            check_covered(what, ends, enough)
