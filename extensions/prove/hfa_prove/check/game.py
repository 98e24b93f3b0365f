"""Checker of the exact solution of a game, for every linear model of a box.

    A'P + P A + Q - P S P = 0,   S = B R⁻¹ B' - E E' / delta²,   K = R⁻¹ B' P.

At most one solution P makes A - S P Hurwitz. The game has a value if and only if this solution
exists and is positive semidefinite. The values of delta for which the game has a value form an
interval up to infinity (Basar and Bernhard, H-infinity-Optimal Control, 1995, Theorem 4.11).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx

from hfa_prove.check.equilibrium import root_offsets
from hfa_prove.check.modes import check_runs, eigenvalue_signs, least_and_most, modes_right_of
from hfa_prove.check.trims import check_branches, linear_model_on
from hfa_prove.enclosure.balls import doubles, matrix, norm, symmetric
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.flight import Line, TrimBox
from hfa_prove.statements.game import (
    SAME_GAIN,
    GameStatement,
    GameWitness,
    Plant,
    SolutionBox,
    Weights,
)
from hfa_prove.statements.schedule import Run


class Solution(NamedTuple):
    """Enclosure of the solution of the Riccati equation on a box.

    P: (n, n)
    K: (m, n)
    """

    P: TaylorModel
    K: TaylorModel


def solution_on(
    weights: Weights, A: TaylorModel, B: TaylorModel, box: SolutionBox, lowest: int
) -> Solution:
    """Return the proved enclosure of the solution P for which A - S P is Hurwitz, and its K.

    F(P) = A'P + P A + Q - P S P has the derivative E -> (A - S P)'E + E (A - S P) at a symmetric P.
    The only root near a symmetric P(s) is symmetric, because its transpose is a root too.

    box: stated P(s), its radius and the line for the eigenvalues of A - S P
    lowest: sign that the lowest eigenvalue of P must have

    Raises Rejected unless a solution near P(s), A - S P Hurwitz and the sign are proved.
    """
    units = matrix(np.diag(box.units))
    n = len(box.units)
    S = riccati_S(weights, B)
    A = units.inv() * A * units
    S = units.inv() * S * units.inv()
    Q = units * matrix(weights.Q) * units
    P = box.P
    zero = matrix(np.zeros((n, n)))
    near = P + TaylorModel(zero, zero, zero, arb_mat(n, n, [symmetric(box.reach)] * n**2))
    loop = (A - S * near).range()
    half = (A - S * P * 0.5).transpose() * P
    residual = half + half.transpose() + Q
    column = residual.map(lambda part: arb_mat(n * n, 1, part.entries()))
    offsets = root_offsets(column.range(), lyapunov_operator(loop), [box.reach] * n**2)
    P = P + TaylorModel(zero, zero, zero, arb_mat(n, n, offsets.entries()))
    if modes_right_of(A - S * P, box.line) != 0:
        raise Rejected("A - S P is not proved Hurwitz")
    axes = matrix(np.linalg.eigh(doubles(P.center))[1])
    if min(eigenvalue_signs(P.range(), axes)) != lowest:
        raise Rejected(
            "the sign of the lowest eigenvalue of the solution differs from the sign in the "
            "certificate"
        )
    P = units.inv() * P * units.inv()
    return Solution(P, gain_matrix(weights, B) * P)


def lyapunov_operator(loop: arb_mat) -> arb_mat:
    """Return the operator L(E) = A_c'E + E A_c as a matrix (n², n²) that acts on E row by row.

    (L E)_ij = Σ A_c,ki E_kj + E_im A_c,mj.
    """
    entries = [divmod(entry, loop.nrows()) for entry in range(loop.nrows() ** 2)]
    return arb_mat(
        [[loop[k, i] * (j == m) + loop[m, j] * (i == k) for k, m in entries] for i, j in entries]
    )


def gain_matrix(weights: Weights, B: TaylorModel) -> TaylorModel:
    """Return the matrix R⁻¹ B' of a game, from which the gain is K = R⁻¹ B' P."""
    return matrix(weights.R).inv() * B.transpose()


def riccati_S(weights: Weights, B: TaylorModel) -> TaylorModel:
    """Return the matrix S = B R⁻¹ B' - E E' / delta² of the Riccati equation."""
    E = matrix(weights.E)
    return B * gain_matrix(weights, B) - E * E.transpose() * (1 / arb(weights.delta) ** 2)


def check_axis(
    weights: Weights, A: TaylorModel, B: TaylorModel, frequencies: Sequence[float]
) -> None:
    """Raise Rejected unless H = [[A, -S], [-Q, -A']] is proved to have an eigenvalue j ω.

    With such an eigenvalue, the game has no stabilizing solution. The spectrum of H is symmetric
    about the imaginary axis, and det(j ω I - H) is therefore real. H has an eigenvalue j ω between
    two frequencies at which the determinant has opposite signs.

    frequencies: frequencies ω at which the sign is computed, rad/s
    """
    rows = hamiltonian_rows(A.range(), riccati_S(weights, B).range(), matrix(weights.Q))
    H = acb_mat(rows)
    identity = acb_mat(matrix(np.eye(len(rows))))
    values = [(identity * acb(0, arb(frequency)) - H).det().real for frequency in frequencies]
    if not (any(value > 0 for value in values) and any(value < 0 for value in values)):
        raise Rejected("no eigenvalue of the Hamiltonian is proved to be on the imaginary axis")


def hamiltonian_rows(A: arb_mat, S: arb_mat, Q: arb_mat) -> list[list[arb]]:
    """Return the rows of the Hamiltonian matrix [[A, -S], [-Q, -A']]."""
    upper = [[*a, *s] for a, s in zip(A.tolist(), (-S).tolist(), strict=True)]
    lower = [[*q, *a] for q, a in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    return upper + lower


def weights_of_basis(P: arb_mat, size: int) -> arb_mat:
    """Return the weights W (size, 1) of the quadratic form z'P z in a basis, W'ψ(z) = z'P z.

    W contains P_ii and 2 P_ij of the upper triangle row by row, followed by zeros.
    """
    n = P.nrows()
    entries = [P[i, j] if i == j else 2 * P[i, j] for i in range(n) for j in range(i, n)]
    return arb_mat(size, 1, entries + [arb(0)] * (size - len(entries)))


def matrix_of_weights(W: np.ndarray, n: int) -> np.ndarray:
    """Return P (n, n) of the quadratic part of W'ψ(z).

    The result is exact, because halves of doubles are exact.

    W: weights, whose first n (n + 1) / 2 entries are those of the quadratic part
    """
    P = np.zeros((n, n))
    upper = np.triu_indices(n)
    P[upper] = np.asarray(W, dtype=float).ravel()[: len(upper[0])] / 2.0
    return P + P.T


def check_gain(weights: Weights, B: TaylorModel, critic: Mapping[str, np.ndarray]) -> None:
    """Raise Rejected unless the gain K of a critic equals R⁻¹ B' P within `SAME_GAIN`.

    P is the critic's P, and also the P of the quadratic part of the critic's W. A part that the
    critic does not have is not tested.

    critic: name -> matrix, with the names K, P and W
    """
    K = matrix(critic["K"])
    values = [critic["P"]] if "P" in critic else []
    if "W" in critic:
        values.append(matrix_of_weights(critic["W"], K.ncols()))
    for P in values:
        own = gain_matrix(weights, B) * matrix(P)
        _, away = distance_bounds(own - K, None)
        if not away <= arb(SAME_GAIN) * norm(own.range().entries()):
            raise Rejected("K is not the gain of the critic's P or W")


def distance_bounds(differences: TaylorModel, sizes: Sequence[arb] | None) -> tuple[arb, arb]:
    """Return a lower and an upper bound on the Frobenius norm of a matrix of differences.

    differences: the matrix on the box
    sizes: entries of a matrix to whose norm the bounds are relative, or None for absolute bounds
    """
    whole = arb(1) if sizes is None else norm(sizes)
    least = norm(differences.range().entries()) / whole
    norms = [norm(corner.entries()) for corner in differences.corners()]
    most = reduce(arb.max, norms) / whole
    return least.lower(), most.upper()


def critic_distances(
    critic: Mapping[str, np.ndarray], exact: Solution
) -> dict[str, tuple[arb, arb]]:
    """Return name -> (lower, upper) bound of the relative distance of a part of a critic.

    The distance is |X - X*| / |X*| for each part X = K, P or W.

    exact: enclosure of the exact solution X*
    """
    targets = {"K": exact.K, "P": exact.P}
    if "W" in critic:
        targets["W"] = TaylorModel(weights_of_basis(exact.P.range(), len(critic["W"])))
    bounds = {}
    for name, values in critic.items():
        target = targets[name]
        bounds[name] = distance_bounds(target - matrix(values), target.range().entries())
    return bounds


#: Bits of a midpoint.
_PRECISION = 256


@ctx.workprec(_PRECISION)
def check_game(statement: GameStatement, witness: GameWitness) -> int:
    """Prove the claims about a game and return the number of boxes in the proof, 1.

    The claims, as far as they are stated, are:
    - the distances of the critic from the exact solution
    - the gain of the critic's P and W
    - the numbers of unstable modes of the loop and of the plant
    - the lower and upper bound of delta_min

    Raises Rejected unless all claims are proved.
    """
    weights = statement.weights
    doubles = _plant(statement, witness, decimals=False)
    wide = _plant(statement, witness, decimals=True) if statement.decimals else doubles
    exact = solution_on(weights, *wide, witness.solution, lowest=1)
    bounds = critic_distances(statement.critic, exact)
    for name, (least, most) in statement.distances.items():
        lowest, highest = bounds[name]
        if not (highest <= arb(most) and (least == 0.0 or lowest >= arb(least))):
            raise Rejected(f"the stated distance of {name} is not proved")
    A, B = wide
    if statement.gain_of_value:
        check_gain(weights, B, statement.critic)
    n = A.center.nrows()
    loop = A - B * matrix(statement.critic["K"])
    check_runs("loop", [Run(0.0, 0.0, *statement.loop)], _line_bounds(loop, witness.loop), n)
    if statement.delta_min is None:
        return 1
    assert statement.modes is not None  # read with delta_min
    A, B = doubles
    check_runs("modes", [Run(0.0, 0.0, *statement.modes)], _line_bounds(A, witness.modes), n)
    refused, value = statement.delta_min
    assert witness.value is not None  # as above
    solution_on(replace(weights, delta=value), A, B, witness.value, lowest=1)
    below = replace(weights, delta=refused)
    if isinstance(witness.refused, SolutionBox):
        solution_on(below, A, B, witness.refused, lowest=-1)
    else:
        check_axis(below, A, B, witness.refused or [])
    return 1


def _plant(
    statement: GameStatement, witness: GameWitness, *, decimals: bool
) -> tuple[TaylorModel, TaylorModel]:
    """Return the matrices A and B of the plant of a game.

    The trim of the doubles is within its radii about the center. The larger radii for all decimals
    contain these radii, and each trim in them is unique. All trims are therefore on one branch.

    decimals: whether the matrices enclose those of every decimal number that rounds to the stored
        doubles, instead of those of the doubles alone
    """
    plant = statement.plant
    if isinstance(plant, Plant):
        return TaylorModel(matrix(plant.A)), TaylorModel(matrix(plant.B))
    assert witness.trim is not None  # read with a flight
    radii = witness.trim.wide_radii if decimals else witness.trim.radii
    trim = TrimBox(plant.low, plant.high, witness.trim.center, radii)
    linear = linear_model_on(plant, trim, decimals=decimals)
    check_branches(plant, [linear])
    return linear.A, linear.B


def _line_bounds(A: TaylorModel, lines: Sequence[Line]) -> list[Run]:
    return [Run(0.0, 0.0, *least_and_most(A, line)) for line in lines]
