"""Checker of a region, which proves the statement from its witness in ball arithmetic.

Theorem. S = {V <= rho} lies in the open unit ball of y and is therefore compact. S is divided into
parts, in which each input is free or at a limit. On each part V' < 0 except at the equilibrium. The
rates are Lipschitz on the ball. Hence a trajectory that begins in S exists for all time, stays in
S, and converges to the only point of S where V' = 0 (LaSalle). V > 0 elsewhere in S follows.

Sums of squares prove V' < 0 for y != 0. At y = 0, V = 0 and every deviation is 0. There either all
inputs are free and V' = 0, or the part is empty.

With disturbances, V' < 0 is proved where V = rho, with each disturbance at its lowest and at its
highest value. V' is affine in the disturbances and therefore negative for all values between.
Therefore no trajectory leaves S.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from flint import arb, ctx

from hfa_prove.check.cover import check_covered
from hfa_prove.check.loop_on_ball import LoopOnBall
from hfa_prove.check.positivity import check_positive
from hfa_prove.enclosure.balls import exact, matrix, norm
from hfa_prove.enclosure.polynomial import Polynomial, power_of_length
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.fields import Rejected
from hfa_prove.statements.evidence import Evidence
from hfa_prove.statements.loop import FREE, HIGHEST, LOWEST
from hfa_prove.statements.region import (
    ANY,
    BALL,
    EDGE,
    LEVEL,
    OUTSIDE,
    Part,
    RegionStatement,
    SquaresWitness,
)
from hfa_support.progress import Progress, with_progress

#: Command interval of an input that is free or at a limit, with 0 its lowest and 1 its highest
#: value.
_ENDS = {LOWEST: (-1.0, 0.0), FREE: (0.0, 1.0), HIGHEST: (1.0, 2.0), ANY: (-1.0, 2.0)}
#: Interval of a disturbance that is at one of its two ends.
_ENDS_OF_A_DISTURBANCE = {LOWEST: (0.0, 1.0), HIGHEST: (1.0, 2.0), ANY: (0.0, 2.0)}


@ctx.workprec(PRECISION)
def check_region(
    statement: RegionStatement, witness: SquaresWitness, progress: Progress | None = None
) -> int:
    """Prove a statement and return the number of parts of the set on which V' < 0 is proved.

    Raises Rejected unless the statement is proved.
    """
    loop = LoopOnBall(statement, witness.T, witness.order)
    one = Polynomial.constant(arb(1))
    length = power_of_length(loop.n, 2)
    inside = {LEVEL: one - loop.V, BALL: one - length}
    outside = {OUTSIDE: length - one}
    check_positive("inside", loop.V - one, outside, witness.inside, loop.n)
    if not (statement.piece.whole or all(norm(row) <= 1 for row in loop.rows)):
        raise Rejected("the set is not proved to be within |y_i| < 1")
    _check_extents(loop, witness.extents, inside)
    statement.loop.check_held()
    check_parts(loop, [part.inputs for part in (*witness.parts, *witness.empty)])
    where = dict(inside)
    if statement.loop.disturbances:
        where[EDGE] = loop.V - one
    nothing = Polynomial.constant(arb(-1))
    for part in witness.empty:
        what = f"empty {_named(part)}"
        constraints = inside | limits_of(loop, part.inputs)
        check_positive(what, nothing, constraints, part.evidence, loop.n)
    for part in with_progress(list(witness.parts), progress):
        degree = min(2 * part.evidence.main.high, loop.order + 1)
        lowest = loop.decrease(part.inputs).lowest(loop.n, degree - degree % 2)
        constraints = where | limits_of(loop, part.inputs)
        check_positive(f"decrease {_named(part)}", lowest, constraints, part.evidence, loop.n)
    return len(witness.parts)


def check_parts(loop: LoopOnBall, parts: Sequence[Mapping[str, str]]) -> None:
    """Raise Rejected unless the parts cover all conditions that may occur on the unit ball of y.

    An input is free or at a limit that it may reach. A disturbance is at its lowest or highest
    value.

    parts: name of an input or disturbance -> its condition in the part
    """
    stated = [_ENDS[FREE]]  # a coordinate of all parts, so that a loop without inputs has one
    for name in loop.statement.loop.inputs:
        reaches_lowest, reaches_highest = loop.reaches(name)
        low, _ = _ENDS[LOWEST if reaches_lowest else FREE]
        _, high = _ENDS[HIGHEST if reaches_highest else FREE]
        stated.append((low, high))
    disturbances = loop.statement.loop.disturbances
    stated += [_ENDS_OF_A_DISTURBANCE[ANY]] * len(disturbances)
    boxes = []
    for part in parts:
        box = [_ENDS[FREE]]
        for name, what in part.items():
            box.append((_ENDS_OF_A_DISTURBANCE if name in disturbances else _ENDS)[what])
        boxes.append(box)
    check_covered("the parts of the set", stated, boxes)


def limits_of(loop: LoopOnBall, inputs: Mapping[str, str]) -> dict[str, Polynomial]:
    """Return the constraints that define a part of the set, name -> polynomial in y.

    All polynomials are >= 0 exactly where the inputs are free or at limits as stated.

    inputs: input -> free, or at its lowest or highest value, or any. The last has no constraint.
    """
    constraints = {}
    for name in loop.statement.loop.inputs:
        what = inputs.get(name, ANY)
        for side, limit in zip((LOWEST, HIGHEST), loop.sides(name), strict=True):
            if limit is None:
                continue
            if what == FREE:
                constraints[f"{name} {side}"] = limit
            elif what == side:
                constraints[f"{name} {side}"] = -limit
    return constraints


def _check_extents(
    loop: LoopOnBall,
    extents: Mapping[str, tuple[Evidence, Evidence]],
    inside: Mapping[str, Polynomial],
) -> None:
    """Raise Rejected unless every state is proved to stay within its stated extent and its limits.

    extents: state -> proofs of its lowest and highest deviation
    inside: constraints that define the set
    """
    statement = loop.statement
    for index, (name, (lowest, highest)) in enumerate(statement.extents.items()):
        reach = loop.reach(index)
        low = exact(lowest)
        high = exact(highest)
        if not (low <= -reach and reach <= high):
            if name not in extents:
                raise Rejected(f"the set may exceed the bounds on {name} given in the certificate")
            _check_deviation(loop, index, (low, high), extents[name], inside)
        least, most = statement.loop.limits.get(name, (-float("inf"), float("inf")))
        at = loop.x[index]
        if not (exact(least) <= at + low and at + high <= exact(most)):
            raise Rejected(f"{name} is not proved to stay within its limits in the set")


def _check_deviation(
    loop: LoopOnBall,
    index: int,
    ends: tuple[arb, arb],
    evidence: tuple[Evidence, Evidence],
    inside: Mapping[str, Polynomial],
) -> None:
    """Raise Rejected unless a state's deviation in the set is proved to be between stated ends.

    index: index of the state
    ends: lowest and highest deviation
    evidence: proofs of the lowest and of the highest deviation
    inside: constraints that define the set
    """
    name = loop.statement.loop.states[index]
    deviation = loop.deviation(index)
    from_low = deviation - Polynomial.constant(ends[0])
    to_high = Polynomial.constant(ends[1]) - deviation
    for side, room, proof in zip((LOWEST, HIGHEST), (from_low, to_high), evidence, strict=True):
        check_positive(f"{name} {side}", room, inside, proof, loop.n)


def _named(part: Part) -> str:
    return ", ".join(part.inputs.values())


@ctx.workprec(PRECISION)
def extents_of(statement: RegionStatement, T: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return state -> lowest and highest deviation in a proved set, rounded outward.

    - V = z'P z: the extents of the ellipsoid, ±sqrt(rho P⁻¹_ii)
    - V of higher degree: the stated extents, limited to the unit ball

    T: matrix of the coordinates z = T y, (n, n). The set is in the unit ball of y.
    """
    states = statement.loop.states
    n = len(states)
    inverse = None
    if all(sum(powers) == 2 for _, powers in statement.terms):
        P = np.zeros((n, n))
        for coefficient, powers in statement.terms:
            i, j = np.repeat(np.arange(n), powers)
            P[i, j] += coefficient / 2.0
            P[j, i] += coefficient / 2.0
        back = matrix(statement.piece.M).inv()
        inverse = back * matrix(P).inv() * back.transpose()
    found = {}
    for index, name in enumerate(states):
        if inverse is not None:
            reach = _above((exact(statement.rho) * inverse[index, index]).sqrt())
            found[name] = (-reach, reach)
            continue
        reach = _above(norm(matrix(T).table()[index]))
        low, high = statement.extents[name]
        found[name] = (max(low, -reach), min(high, reach))
    return found


def _above(ball: arb) -> float:
    """Return a double above every number of the ball."""
    return float(np.nextafter(float(ball.upper()), np.inf))
