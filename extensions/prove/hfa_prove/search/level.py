"""Search for the largest proved level of a given V, and the proof of this level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import nnls

from hfa_prove.check.loop_on_ball import LoopOnBall
from hfa_prove.check.region_squares import check_region, limits_of
from hfa_prove.enclosure.polynomial import Polynomial, key_of, power_of_length
from hfa_prove.enclosure.series import TaylorOnBall
from hfa_prove.fields import Fields
from hfa_prove.monomials import PolynomialFunction, edge_points, ellipsoid
from hfa_prove.search.clock import Clock
from hfa_prove.search.squares import BASE, ONE, Constraint, Degrees, Terms, positive
from hfa_prove.statements.loop import FREE, HIGHEST, LOWEST, Loop
from hfa_prove.statements.region import (
    ANY,
    BALL,
    LEVEL,
    OUTSIDE,
    RegionStatement,
    SquaresWitness,
    read_region_witness,
)
from hfa_support.errors import NoSolutionError

#: Least margin of a sum of squares, relative to the largest coefficient. The check adds errors
#: of the solver, about 1e-8, to the Gram matrices.
MARGIN = 2e-7
#: Margin at which the solver stops during the search for the largest level.
_ENOUGH = 10.0 * MARGIN
#: Relative enlargement of the ball around the set, and of extents.
_SLACK = 1e-7
#: Largest number of reductions of a level because an output may leave its limits on the ball.
_SMALLER = 25
#: Least share of the level that is tried.
_LEAST = 1e-5
#: Ratio of shares at which the bisection ends.
_NEAR = 1.0003
#: Increasing enlargements of an ellipsoid around a set of points that are tried.
_INFLATIONS = (1.001, 1.01, 1.03, 1.07, 1.15, 1.3)


@dataclass(frozen=True, eq=False)
class Setting:
    """Settings of a proof by sums of squares.

    order: highest degree of the Taylor polynomials
    half: highest degree of the monomials in the Gram matrices of V'
    degree: highest degree of V
    seconds: processor time that must remain for the attempt, s
    reaches: factors on the radius of the ball up to which the set of the next V may extend, tried
        in order
    """

    order: int
    half: int
    degree: int = 2
    seconds: float = 0.0
    reaches: tuple[float, ...] = (1.35, 1.1)


@dataclass(frozen=True, eq=False)
class ProvedLevel:
    """A statement with its witness that the checker has accepted.

    statement: V, rho and the loop
    witness: data for the proof, as stored in a certificate
    parts: number of parts of the set on which V' < 0 is proved
    """

    statement: RegionStatement
    witness: dict[str, Any]
    parts: int


def ball_of(P: np.ndarray, rho: float) -> np.ndarray:
    """Return T (n, n) of coordinates z = T y with {z'P z <= rho} just inside the unit ball."""
    L = np.linalg.cholesky(P)
    return np.asarray(np.sqrt(rho) * np.linalg.inv(L).T * (1.0 + _SLACK))


class LevelSearch:
    """Search for proved levels of one V in one ball.

    loop: the saturated loop
    V: the polynomial V
    rho: highest level. The set {V <= rho} lies in the unit ball of y.
    T: matrix of the coordinates z = T y, (n, n)
    setting: degrees of the proof
    clock: time limit, at which every method raises OutOfTimeError
    """

    def __init__(
        self,
        loop: Loop,
        V: PolynomialFunction,
        rho: float,
        T: np.ndarray,
        setting: Setting,
        clock: Clock,
    ) -> None:
        self.clock = clock
        self.T = T
        self.setting = setting
        self.V = V
        self.rho = rho
        extents = np.linalg.norm(T, axis=1) * (1.0 + _SLACK)
        named = {
            name: (-extent, extent)
            for name, extent in zip(loop.states, extents.tolist(), strict=True)
        }
        self.statement = RegionStatement.of_terms(loop, V.terms, rho, named)
        self.ball = LoopOnBall(self.statement, T, setting.order)
        self.parts, self.empty = self._split()
        self.V_terms = Terms.of(self.ball.V)
        self._targets: dict[tuple[str, ...], Terms] = {}
        self._decreases: dict[tuple[str, ...], TaylorOnBall] = {}

    def _split(self) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
        """Return the parts on which V' < 0 is to be proved, and the parts to be proved empty."""
        return split(self.ball)

    def target(self, part: Mapping[str, str]) -> Terms:
        """Return a polynomial that is at most -V' / rho on a part of the unit ball."""
        key = tuple(part.values())
        if key not in self._targets:
            lowest = self._decrease_of(part).lowest(self.ball.n, 2 * self.setting.half)
            self._targets[key] = Terms.of(lowest)
        return self._targets[key]

    def _decrease_of(self, part: Mapping[str, str]) -> TaylorOnBall:
        """Return the Taylor polynomial of -V' / rho on a part of the unit ball.

        Raises NoSolutionError if the rates are not enclosed on the ball.
        """
        key = tuple(part.values())
        if key not in self._decreases:
            self._decreases[key] = self.ball.decrease(part)
        return self._decreases[key]

    def remainder_term(self, part: Mapping[str, str]) -> Terms:
        """Return the term c |y|^degree that `target` subtracts instead of higher terms.

        The term bounds the terms of higher degree and the remainder.
        """
        degree = 2 * self.setting.half
        whole = self._decrease_of(part)
        norms = whole.polynomial.norms()
        rest = sum((float(norm) for norm in norms[degree + 1 :]), float(whole.remainder))
        return Terms.of(power_of_length(self.ball.n, degree)).scaled(rest)

    def decrease(
        self, part: Mapping[str, str], share: float, enough: float | None = None
    ) -> dict[str, Any] | None:
        """Return Gram matrices that prove V' < 0 on a part of {V <= share rho}, or None.

        The result is None if no Gram matrices are found.

        share: the level as a share of rho
        enough: margin at which the solver may stop, or None
        """
        low = lowest_degree(part)
        half = self.setting.half
        degrees = Degrees(low, half - self.setting.degree // 2)
        constraints = [
            Constraint(name, polynomial, degrees)
            for name, polynomial in self._level_constraints(share).items()
        ]
        if self.setting.degree > 2:
            constraints.append(_in_ball(self.ball.n, Degrees(low, half - 1)))
        constraints += limits_within(self.ball, part, low, half)
        return _evidence(
            self.target(part), constraints, Degrees(low, half), self.ball.n, self.clock, enough
        )

    def _level_constraints(self, share: float) -> dict[str, Terms]:
        """Return the constraint that defines {V <= share rho}, by name.

        The polynomial is share - V / rho.

        share: the level as a share of rho
        """
        return {LEVEL: ONE.scaled(share) + self.V_terms.scaled(-1.0)}

    @cached_property
    def proofs(self) -> list[tuple[dict[str, str], dict[str, Any]]] | None:
        """Pairs of a part of {V <= rho} and Gram matrices that prove V' < 0 on the part.

        The value is None if no Gram matrices are found for a part.
        """
        found = []
        for part in self.parts:
            evidence = self.decrease(part, 1.0)
            if evidence is None:
                return None
            found.append((part, evidence))
        return found

    def holds(self, share: float) -> bool:
        """Return whether Gram matrices for V' < 0 are found on every part of {V <= share rho}.

        A part that fails is tried first in the next call.
        """
        for index, part in enumerate(self.parts):
            if self.decrease(part, share, _ENOUGH) is None:
                self.parts.insert(0, self.parts.pop(index))
                return False
        return True

    def largest(self, known: float = 0.0) -> float:
        """Return the largest share of rho for which `holds` is true, or 0 if none is found.

        The search is by bisection.

        known: a share for which `holds` is known to be true, or 0
        """
        if self.holds(1.0):
            return 1.0
        if not known and not self.holds(_LEAST):
            return 0.0
        low = known or _LEAST
        high = 1.0
        while high > _NEAR * low:
            middle = float(np.sqrt(low * high))
            if self.holds(middle):
                low = middle
            else:
                high = middle
        return low

    def evidence(self) -> dict[str, Any] | None:
        """Return the witness of {V <= rho}, or None if the proof of a part is not found."""
        if self.proofs is None:
            return None
        parts = [{"inputs": list(part.values()), "evidence": found} for part, found in self.proofs]
        empty = []
        for part in self.empty:
            found = nothing_of(self.ball, part, self.clock)
            if found is None:
                return None
            empty.append({"inputs": list(part.values()), "evidence": found})
        held = _inside(self.V_terms, self.V.degree, self.ball.n, self.clock)
        if held is None:
            return None
        extents = self._extents()
        return {
            "prover": "squares",
            "T": self.T.tolist(),
            "order": self.setting.order,
            "inside": held,
            "parts": parts,
            "empty": empty,
            "extents": extents,
        }

    def _extents(self) -> dict[str, Any]:
        """Return the proofs of the extents of the set, and store the extents in the statement.

        The extents are the lowest and highest deviations at boundary points, slightly enlarged. A
        state without proof keeps the extent of the unit ball. A V of degree 2 needs no proofs.
        """
        if self.V.degree == 2:
            return {}
        points = edge_points(self.V, self.T, self.rho)
        measured = points @ self.T.T
        found = {}
        extents = dict(self.statement.extents)
        for index, name in enumerate(extents):
            ends = (measured[:, index].min(), measured[:, index].max())
            for larger in (1.01, 1.03, 1.1):
                low, high = (float(end) * larger for end in ends)
                pair = self._extent(index, low, high)
                if pair is not None:
                    found[name] = pair
                    extents[name] = (low, high)
                    break
        self.statement = replace(self.statement, extents=extents)
        return found

    def _extent(self, index: int, low: float, high: float) -> dict[str, Any] | None:
        """Return Gram matrices that prove bounds of a state's deviation in the set, or None.

        The result is None if no Gram matrices are found.

        index: index of the state
        low, high: the bounds
        """
        half = self.V.degree // 2
        deviation = Terms.of(self.ball.deviation(index))
        level = ONE + self.V_terms.scaled(-1.0)
        constraints = [
            Constraint(LEVEL, level, Degrees(0, 0)),
            _in_ball(self.ball.n, Degrees(0, half - 1)),
        ]
        pair = {}
        for side, room in (
            (LOWEST, deviation + ONE.scaled(-low)),
            (HIGHEST, ONE.scaled(high) + deviation.scaled(-1.0)),
        ):
            found = _evidence(room, constraints, Degrees(0, half), self.ball.n, self.clock)
            if found is None:
                return None
            pair[side] = found
        return pair


def lowest_degree(part: Mapping[str, str]) -> int:
    """Return the lowest degree of the monomials in the Gram matrices of V' on a part.

    - 1 if every input is free, because V' = 0 at the trim
    - 0 otherwise
    """
    return 1 if all(what == FREE for what in part.values()) else 0


def split(ball: LoopOnBall) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Return the parts that may have points in the unit ball of y, and the parts that have none.

    The parts are distinguished in double precision. In a part of the second list, inputs that need
    no distinction are `ANY`.
    """
    names = list(ball.statement.loop.inputs)
    met: list[dict[str, str]] = []
    empty: list[dict[str, str]] = []

    def descend(done: dict[str, str]) -> None:
        if not _meets(ball, done):
            empty.append(done | {name: ANY for name in names if name not in done})
            return
        if len(done) == len(names):
            met.append(done)
            return
        name = names[len(done)]
        reaches_lowest, reaches_highest = ball.reaches(name)
        descend(done | {name: FREE})
        if reaches_lowest:
            descend(done | {name: LOWEST})
        if reaches_highest:
            descend(done | {name: HIGHEST})

    descend({})
    return met, empty


def limits_within(
    ball: LoopOnBall, part: Mapping[str, str], low: int, half: int
) -> list[Constraint]:
    """Return the constraints that define a part.

    Constraints with too high a degree for a multiplier are omitted.

    low: lowest degree of the multiplier's monomials
    half: half of the highest degree of the product of constraint and multiplier
    """
    constraints = []
    for name, polynomial in limits_of(ball, part).items():
        highest = half - (polynomial.degree + 1) // 2
        if highest >= low:
            degrees = Degrees(low, highest)
            constraints.append(Constraint(name, Terms.of(polynomial), degrees))
    return constraints


def _linear_limits(ball: LoopOnBall, part: Mapping[str, str]) -> dict[str, Polynomial]:
    """Return name -> constraint of a part, for the constraints that are linear in y."""
    limits = limits_of(ball, part)
    return {name: polynomial for name, polynomial in limits.items() if polynomial.degree == 1}


def _meets(ball: LoopOnBall, done: Mapping[str, str]) -> bool:
    """Return whether a point of the unit ball satisfies the linear constraints of a part.

    The shortest y with G y >= h is found by nonnegative least squares (Lawson and Hanson, Solving
    Least Squares Problems, chapter 23).

    done: input -> FREE, LOWEST or HIGHEST, for the inputs that are distinguished
    """
    rows = []
    sides = []
    for polynomial in _linear_limits(ball, done).values():
        _, linear = polynomial.parts
        slopes = np.zeros(ball.n)
        for i in range(ball.n):
            slopes[i] = float(linear.get(key_of([*[0] * i, 1]), 0))
        rows.append(slopes)
        sides.append(-float(polynomial.constant_term))
    if not rows:
        return True
    stacked = np.vstack([np.array(rows).T, np.array(sides)])
    wanted = np.zeros(ball.n + 1)
    wanted[-1] = 1.0
    weights, _ = nnls(stacked, wanted)
    residual = stacked @ weights - wanted
    if np.linalg.norm(residual) < 1e-9:
        return False
    shortest = -residual[:-1] / residual[-1]
    return bool(np.linalg.norm(shortest) < 1.0 + 1e-6)


def nothing_of(ball: LoopOnBall, part: Mapping[str, str], clock: Clock) -> dict[str, Any] | None:
    """Return a proof that the linear constraints of a part exclude the unit ball, or None.

    None does not imply that a point of the ball satisfies the constraints.

    ball: the loop on the unit ball
    part: input -> FREE, LOWEST, HIGHEST or ANY
    """
    number = Degrees(0, 0)
    constraints = [_in_ball(ball.n, number)]
    for name, polynomial in _linear_limits(ball, part).items():
        constraints.append(Constraint(name, Terms.of(polynomial), number))
    return _evidence(ONE.scaled(-1.0), constraints, Degrees(0, 1), ball.n, clock)


def _evidence(
    target: Terms,
    constraints: Sequence[Constraint],
    degrees: Degrees,
    variables: int,
    clock: Clock,
    enough: float | None = None,
) -> dict[str, Any] | None:
    """Return the Gram matrices found by `positive`, or None.

    The result is None if the solver fails or the margin is below `MARGIN`.

    Raises OutOfTimeError at the time limit.
    """
    clock(0.0, 1.0, "a sum of squares")
    found = positive(target, constraints, degrees, variables, enough, clock.left)
    if found is None or found[0] < MARGIN:
        return None
    return found[1]


def _in_ball(variables: int, degrees: Degrees) -> Constraint:
    """Return the constraint 1 - |y|² >= 0."""
    return Constraint(BALL, ONE + _length(variables).scaled(-1.0), degrees)


def _length(variables: int) -> Terms:
    """Return the polynomial |y|²."""
    keys = np.array([2 * BASE**i for i in range(variables)], dtype=np.int64)
    return Terms(keys, np.ones(variables))


def _inside(V: Terms, degree: int, n: int, clock: Clock) -> dict[str, Any] | None:
    """Return Gram matrices that prove {V <= rho} to lie in the open unit ball, or None.

    The result is None if no Gram matrices are found.

    V: V / rho as a polynomial in y
    degree: degree of V
    n: number of states
    """
    target = V + ONE.scaled(-1.0)
    outside = _length(n) + ONE.scaled(-1.0)
    half = degree // 2
    clock(0.0, 1.0, "a ball around the set")
    constraints = [Constraint(OUTSIDE, outside, Degrees(0, half - 1))]
    found = positive(target, constraints, Degrees(0, half), n, seconds=clock.left)
    return None if found is None or found[0] <= 0.0 else found[1]


def holding_ball(
    V: PolynomialFunction, rho: float, T: np.ndarray, clock: Clock
) -> np.ndarray | None:
    """Return T (n, n) of coordinates z = T y in which {V <= rho} lies in the unit ball, or None.

    For V of degree 2, the ball follows from the matrix of V. For a higher degree, the property is
    tested in double precision, and the result is None if the test fails.

    T: coordinates in which boundary points are searched
    """
    if V.degree == 2:
        return ball_of(V.matrix(), rho)
    points = edge_points(V, T, rho)
    if not len(points):
        return None
    P = ellipsoid(points)
    n = len(T)
    for inflation in _INFLATIONS:
        held = T @ np.linalg.inv(np.linalg.cholesky(P)).T * inflation
        level = V.substituted(held).scaled(1.0 / rho)
        if _inside(Terms.packed(level), V.degree, n, clock) is not None:
            return np.asarray(held)
    return None


def proved_level(
    loop: Loop,
    V: PolynomialFunction,
    rho: float,
    setting: Setting,
    T: np.ndarray,
    clock: Clock,
) -> ProvedLevel | None:
    """Return the proof of the largest level of V up to rho that the checker accepts, or None.

    loop: the saturated loop
    V: the polynomial V
    rho: highest level to be tried
    setting: degrees of the proof
    T: coordinates in which the boundary of {V <= rho} is searched
    """
    share = 0.0
    for _ in range(_SMALLER):
        held = holding_ball(V, rho, T, clock)
        if held is None:
            return None
        try:
            known = 1.0 / rho if rho > 1.0 else 0.0  # level 1 is proved in its ball
            share = LevelSearch(loop, V, rho, held, setting, clock).largest(known)
            break
        except NoSolutionError:  # not enclosed on such a large ball
            rho = 1.0 if rho > 1.0 else 0.8 * rho
    for _ in range(6):
        if share == 0.0:
            return None
        last = holding_ball(V, share * rho, T, clock)
        if last is None:
            return None
        tried = LevelSearch(loop, V, share * rho, last, setting, clock)
        proved = accepted(tried)
        if proved is not None:
            return proved
        share *= 0.99
    return None


def accepted(tried: LevelSearch) -> ProvedLevel | None:
    """Return the statement of a search with its witness, or None unless the checker accepts it."""
    evidence = tried.evidence()
    if evidence is None:
        return None
    witness = read_region_witness(Fields("witness", evidence), tried.statement)
    assert isinstance(witness, SquaresWitness)  # evidence of this search
    try:
        parts = check_region(tried.statement, witness)
    except NoSolutionError:
        return None
    return ProvedLevel(tried.statement, evidence, parts)
