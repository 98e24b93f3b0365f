"""The checker's part about one box: its trims, its linear model, and how many modes are unstable."""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb, arb_mat

from hfa_model.aircraft import compiled_dynamics
from hfa_model.parameters import Parameters
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from verification.checker.taylor_model import Rejected, TaylorModel, evaluate

Content = dict[str, Any]
_BALANCED = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]
_ROWS = [STATES.index(name) for name in LINEAR_STATES]
#: Control points of s² on the four quarters of [-1, 1]: their hull holds (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


def model_on(claim: Content, box: Content) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
    """A, B and the inputs on one box; Rejected unless one trim is proved near the polynomial, within the limits.

    Krawczyk: with W the box about the polynomial, -C F + (I - C F_w) W lies in the interior of W.
    """
    if "A" in claim:
        return constant(claim["A"]), constant(claim["B"]), constant([[0]])
    functions = compiled_dynamics(variant_named(claim["dynamics"]))
    low, high = map(arb, box["dihedral_deg"])
    radius, degree, reading = (high - low) / 2, arb.pi() / 180, 2.0**-51 if box["decimals"] else 0.0
    centers = {name: TaylorModel(arb(x, abs(x) * reading)) for name, x in claim["imposed"].items()}
    centers["dihedral"] = TaylorModel((low + high) / 2 * degree, radius * degree)
    for name, row in box["trim"].items():
        c0, c1, c2, *z = map(arb, row)
        centers[name] = TaylorModel(c0, c1 * radius, c2 * radius**2, arb(0), *z)
    offsets = {name: arb(0, width) for name, width in box["radius"].items()}
    around = {name: centers[name] + TaylorModel(arb(0), arb(0), arb(0), ball) for name, ball in offsets.items()}
    parameters, zeros = [], [arb(0)] * 3
    for name in Parameters._fields:
        x, width = claim["parameters"][name], claim["spread"][name]
        parameters.append(TaylorModel(arb(x, abs(x) * reading), *zeros, arb(width)))
        zeros += [arb(0)] * (width > 0)
    places = []
    for at in (centers, centers | around):
        at["pitch"] = at["alpha"] + at["gamma"]
        places.append([[at[name] for name in names] for names in (STATES, INPUTS)])
    residual = stacked([[each] for each in evaluate(functions.rates, *places[0], parameters)[0]]).range()
    _, A, B = evaluate(functions.jacobians, *places[1], parameters)
    columns = dict(zip(STATES + INPUTS, np.array(A + B, dtype=object).reshape(-1, len(STATES)), strict=True))
    steered = columns | {"gamma": columns["pitch"], "alpha": columns["alpha"] + columns["pitch"]}
    J = stacked([[steered[name][i] for name in offsets] for i in _BALANCED]).range()
    C, W = exact(np.linalg.inv(doubles(J))), arb_mat([[ball] for ball in offsets.values()])
    image = (unit(len(offsets)) - C * J) * W - C * arb_mat([[residual[i, 0]] for i in _BALANCED])
    if not all(map(arb.contains_interior, W.entries(), image.entries())):
        raise Rejected("the trim is not proved to exist")
    for name in (*INPUTS, *offsets):
        if not arb(claim["limits"][name][0]) <= at[name].range() <= arb(claim["limits"][name][1]):
            raise Rejected(f"{name} may lie beyond its limits")
    linear_A, linear_B = (
        stacked([[columns[name][i] for name in names] for i in _ROWS]) for names in (LINEAR_STATES, INPUTS)
    )
    return linear_A, linear_B, stacked([[at[name]] for name in INPUTS])


def check_modes(A: TaylorModel, box: Content, unstable: int, H: TaylorModel, moving: Any = None) -> None:
    """-(A'H + H A + 2 rate H ± moving) > 0, and H has `unstable` negative eigenvalues and no zero one."""
    low, high, rate = H.parts[0] - H.parts[1], H.parts[0] + H.parts[1], box["rate"]
    symmetric = all(end == end.transpose() for end in (low, high))
    if not (symmetric and 0.0 <= rate < float("inf") and rate * unstable == 0.0):
        raise Rejected("H is not symmetric, or the rate is none of a stable loop")
    turn = exact(box["turn"])

    def turned(part: arb_mat) -> arb_mat:
        return turn.transpose() * part * turn

    if any(sum(sign < 0 for sign in signs_of(turned(end))) != unstable for end in (low, high)):
        raise Rejected(f"H does not have {unstable} negative eigenvalues")
    half = -(H * (A + TaylorModel(unit(low.nrows()) * arb(rate))))
    decrease = (half + half.transpose()).map(turned)
    motion = turned(0 * low if moving is None else moving)
    for s, square in _HULL:
        corner = decrease.parts[0] + decrease.parts[1] * arb(s) + decrease.parts[2] * arb(square)
        rest = decrease.parts[3] + decrease.errors()
        if any(min(signs_of(corner + rest + way)) < 0 for way in (motion, -motion)):
            raise Rejected("the matrix that proves the modes is not positive definite")


def signs_of(matrix: arb_mat) -> list[int]:
    """Signs of the eigenvalues of a symmetric matrix, by the pivots of Gaussian elimination (Sylvester)."""
    rows, signs = matrix.tolist(), []
    while rows:
        head = rows[0][0]
        if not (head > 0 or head < 0):
            raise Rejected("an eigenvalue is not told from 0")
        signs.append(1 if head > 0 else -1)
        rows = [[b - row[0] / head * a for a, b in zip(rows[0][1:], row[1:], strict=True)] for row in rows[1:]]
    return signs


def linear(table: Content, key: str, box: list[float]) -> TaylorModel:
    """A table of matrices over its angles, on a box between two neighbouring ones; linear between them."""
    angles, (low, high) = table["dihedral_deg"], box
    i = max((i for i in range(len(angles) - 1) if angles[i] <= low), default=-1)
    if i < 0 or high > angles[i + 1]:
        raise Rejected("the box crosses an angle of the table")
    first, last = exact(table[key][i]), exact(table[key][i + 1])
    slope, start = (last - first) * (1 / (arb(angles[i + 1]) - arb(angles[i]))), arb(low) - arb(angles[i])
    radius = (arb(high) - arb(low)) / 2
    return TaylorModel(first + slope * (start + radius), slope * radius)


def stacked(rows: list[list[TaylorModel]]) -> TaylorModel:
    """A matrix of Taylor models as the Taylor model of a matrix."""
    count = max(len(entry.parts) for row in rows for entry in row)
    full = [[[*entry.parts, *[arb(0)] * (count - len(entry.parts))] for entry in row] for row in rows]
    return TaylorModel(*(arb_mat([[entry[k] for entry in row] for row in full]) for k in range(count)))


def exact(rows: Any) -> arb_mat:
    """Doubles, or decimals in strings, as balls."""
    return arb_mat([[arb(value) for value in row] for row in np.asarray(rows).tolist()])


def constant(rows: Any) -> TaylorModel:
    """A matrix that does not depend on the place."""
    return TaylorModel(exact(rows))


def unit(size: int) -> arb_mat:
    """The identity."""
    return exact(np.eye(size))


def doubles(matrix: arb_mat) -> np.ndarray:
    """Midpoints: to search with, not to prove."""
    return np.array([[float(entry.mid()) for entry in row] for row in matrix.tolist()])
