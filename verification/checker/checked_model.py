"""What the checker proves of one box: its trims, its linear model, and how many modes are unstable."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from flint import arb, arb_mat

from hfa_model.aircraft import compiled_dynamics
from hfa_model.parameters import Parameters
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from verification.checker.taylor_model import Rejected, TaylorModel, evaluate

Content = dict[str, Any]
_BALANCED = ("speed", "alpha", "pitch_rate", "dihedral_rate")


def model_on(claim: Content, box: Content) -> dict[str, TaylorModel]:
    """A, B and the inputs; Rejected unless one trim is proved near the stated polynomial, within the limits."""
    if "A" in claim:
        return {key: constant(claim[key]) for key in "AB"}
    functions, reading = compiled_dynamics(variant_named(claim["dynamics"])), 2.0**-51 if box["decimals"] else 0.0
    low, high, degree = *map(arb, box["dihedral_deg"]), arb.pi() / 180
    at, free, arguments = {}, list(box["trim"]), []
    for name, x in (claim["imposed"] | {name: claim["parameters"][name] for name in Parameters._fields}).items():
        errors = [arb(width * (name == other)) for other, width in claim["spread"].items()]
        at[name] = TaylorModel(arb(x, abs(x) * reading), arb(0), arb(0), arb(0), *errors)
    if at.keys() & {"dihedral", *free} or not claim["spread"].keys() <= at.keys():
        raise Rejected("an unknown of the trim is imposed, or what has an error is none of the parameters")
    at["dihedral"] = TaylorModel((low + high) / 2 * degree, (high - low) / 2 * degree)
    for size in (0, 1):  # along the polynomials, and all about them
        for name, (c0, c1, c2, radius, *z) in box["trim"].items():
            at[name] = TaylorModel(*map(arb, (c0, c1, c2)), arb(0, size * radius), *map(arb, z))
        at["pitch"] = at["alpha"] + at["gamma"]
        arguments.append([[at[name] for name in names] for names in (STATES, INPUTS, Parameters._fields)])
    (rates,), (_, A, B) = evaluate(functions.rates, *arguments[0]), evaluate(functions.jacobians, *arguments[1])
    derivatives, balance = stacked(A + B, len(STATES)), constant(chosen(_BALANCED, STATES).T)
    moved = chosen(free) + np.outer(chosen(["pitch"]), [name in ("alpha", "gamma") for name in free])
    radii = [arb(box["trim"][name][3]) for name in free]
    check_root(balance * stacked(rates, len(STATES)), balance * derivatives * constant(moved), radii)
    for name in (*INPUTS, *free):
        if not arb(claim["limits"][name][0]) <= at[name].range() <= arb(claim["limits"][name][1]):
            raise Rejected(f"{name} may lie beyond its limits")
    rows = constant(chosen(LINEAR_STATES, STATES).T)
    linear = {key: rows * derivatives * constant(chosen(names)) for key, names in (("A", LINEAR_STATES), ("B", INPUTS))}
    return linear | {"inputs": stacked([at[name] for name in INPUTS], len(INPUTS))}


def check_root(residual: TaylorModel, derivative: TaylorModel, radii: list[arb]) -> arb_mat:
    """One root of F lies about x̂ at every place: with |e| = |(e_i / r_i)|, |C F| + |I - C F'| < 1 (Krawczyk).

    residual: F along x̂, a column. derivative: F' where |e_i| <= r_i. Returns where about x̂ the root is.
    """
    J, step = derivative.range(), residual.range()
    C = J.mid().inv().mid()
    step, slope = C * step, (exact(np.eye(len(radii))) - C * J).tolist()
    weighed = [[entry * r / radii[i] for entry, r in zip(row, radii, strict=True)] for i, row in enumerate(slope)]
    contraction = norm(arb_mat(weighed))
    if not norm(arb_mat([[step[i, 0] / r] for i, r in enumerate(radii)])) + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
    return arb_mat([[arb(0, 1) * contraction * r - step[i, 0]] for i, r in enumerate(radii)])


def check_modes(A: TaylorModel, box: Content, H: TaylorModel, moving: arb_mat) -> None:
    """-(A'H + H A + 2 rate H ± moving) > 0, and H has `unstable` negative eigenvalues and no zero one.

    Ostrowski and Schneider: A has as many eigenvalues right of -rate. Tested in the coordinates `turn`.
    """
    turn, rate, unstable = exact(box["turn"]), box["rate"], box["unstable"]
    ends = [H.parts[0] - H.parts[1], H.parts[0] + H.parts[1]]
    if not (all(end == end.transpose() for end in ends) and 0.0 <= rate < float("inf") and rate * unstable == 0.0):
        raise Rejected("H is not symmetric, or the rate is none of a stable loop")
    if any(signs(turn.transpose() * end * turn).count(-1) != unstable for end in ends):
        raise Rejected(f"H does not have {unstable} negative eigenvalues")
    half = -(H * (A + constant(rate * np.eye(turn.nrows()))))
    decrease = (half + half.transpose()).map(lambda part: turn.transpose() * part * turn)
    motion = turn.transpose() * moving * turn
    for corner in decrease.corners():
        if -1 in signs(corner + motion) + signs(corner - motion):
            raise Rejected("the matrix that proves the modes is not positive definite")


def signs(matrix: arb_mat) -> list[int]:
    """Signs of the eigenvalues of a symmetric matrix, by the pivots of Gaussian elimination (Sylvester)."""
    rows, found = matrix.tolist(), []
    while rows:
        (head, *first), *others = rows
        if not (head > 0 or head < 0):
            raise Rejected("an eigenvalue is not told from 0")
        found.append(1 if head > 0 else -1)
        rows = [[b - row[0] / head * a for a, b in zip(first, row[1:], strict=True)] for row in others]
    return found


def between(table: Content, key: str, box: list[float]) -> TaylorModel:
    """A table of matrices, linear between its angles, on a box between two of them; without angles it is constant."""
    if "dihedral_deg" not in table:
        return constant(table[key])
    angles = table["dihedral_deg"]
    i = next((i for i, (a, b) in enumerate(pairwise(angles)) if a <= box[0] and box[1] <= b), None)
    if i is None:
        raise Rejected("the box crosses an angle of the table")
    first, last, low, high = exact(table[key][i]), exact(table[key][i + 1]), arb(angles[i]), arb(angles[i + 1])
    ends = [first + (last - first) * ((arb(end) - low) / (high - low)) for end in box]
    return TaylorModel((ends[0] + ends[1]) * 0.5, (ends[1] - ends[0]) * 0.5)


def stacked(entries: list[TaylorModel], height: int) -> TaylorModel:
    """A matrix of Taylor models, given column by column, as the Taylor model of a matrix."""
    parts = zip_longest(*(entry.parts for entry in entries), fillvalue=arb(0))
    return TaylorModel(*(arb_mat(len(entries) // height, height, part).transpose() for part in parts))


def chosen(names: Sequence[str], among: Sequence[str] = STATES + INPUTS) -> np.ndarray:
    """Columns of the identity that choose the names."""
    return np.array([[row == name for name in names] for row in among], dtype=float)


def exact(rows: Any) -> arb_mat:
    """Doubles, or decimals in strings, as balls."""
    return arb_mat([[arb(value) for value in row] for row in np.asarray(rows).tolist()])


def constant(rows: Any) -> TaylorModel:
    """A matrix that does not depend on the place."""
    return TaylorModel(exact(rows))


def norm(matrix: arb_mat) -> arb:
    """A ball that holds the Frobenius norm."""
    entries = matrix.entries()
    low, high = (sum((end(entry) ** 2 for entry in entries), arb(0)) for end in (arb.abs_lower, arb.abs_upper))
    return low.sqrt().union(high.sqrt())
