"""Statement of a certificate about a region of attraction or an invariant set, and its witnesses.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from hfa_prove.fields import Fields, Statement, Terms, Witness, entry, part, require
from hfa_prove.statements.evidence import Evidence
from hfa_prove.statements.loop import FREE, HIGHEST, LOWEST, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import check_limits_of_model

#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 100_000_000
#: Highest order of the Taylor polynomials.
_HIGHEST_ORDER = 12
#: Entry of an input that may be free or at a limit.
ANY = "any"
#: Constraint V <= rho.
LEVEL = "level"
#: Constraint V >= rho.
EDGE = "edge"
#: Constraint |y| <= 1.
BALL = "ball"
#: Constraint |y| >= 1.
OUTSIDE = "outside"


def _read_extents(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    """Return state -> lowest and highest deviation.

    Raises Malformed unless every lowest deviation is negative and every highest deviation positive.
    """
    listed = file.fields(name)
    extents = {state: listed.pair(state) for state in known.loop.states}
    listed.close()
    require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
    return extents


@dataclass(frozen=True, eq=False)
class RegionStatement(Statement):
    """Claim that the trajectories from a set converge to the equilibrium of a closed loop.

    Every trajectory of the loop that begins in the set exists for all time, stays in the set and
    within all limits, and converges to the equilibrium. With disturbances, convergence is not
    claimed. z are the deviations from the equilibrium.

    loop: the model with its policy and saturated inputs
    equilibrium: moving state -> value, within `SAME_TRIM` nominal values of the proved equilibrium
    piece: the set {V <= rho}
    extents: moving state -> lower and upper bound of the deviation in the set
    """

    loop: Loop = part(Loop)
    equilibrium: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, known.loop.states)
    )
    piece: Piece = entry(
        lambda file, name, known: Piece.read(file.fields(name), len(known.loop.states)),
        store=Piece.content,
    )
    # Proved; the extents in a report of sums of squares are computed by the checker.
    extents: Mapping[str, tuple[float, float]] = entry(_read_extents, shown=False)

    def check_consistent(self) -> None:
        """Raise Malformed unless the limits are admissible for the model."""
        check_limits_of_model(self.loop)

    @classmethod
    def of_terms(
        cls, loop: Loop, terms: Terms, rho: float, extents: Mapping[str, tuple[float, float]]
    ) -> RegionStatement:
        """Return the claim about the whole set {V(z) <= rho} around the trim of a loop.

        terms: terms of V = Σ coefficient z^exponents
        """
        n = len(loop.states)
        piece = Piece(np.eye(n), Polynomial(n, terms), rho, whole=True)
        return cls(loop, loop.trim, piece, extents)

    @property
    def terms(self) -> Terms:
        """Terms of V in the coordinates y = M z."""
        return self.piece.W.terms

    @property
    def rho(self) -> float:
        """Level of V that defines the set."""
        return self.piece.c

    @property
    def degree(self) -> int:
        """Degree of V."""
        return max(sum(powers) for _, powers in self.terms)


@dataclass(frozen=True, eq=False)
class BoxWitness(Witness):
    """Data for the proof of a region on boxes.

    The bounds of the deviations z are proved with multiples of rho - V.

    multipliers: (n, 2), nonnegative factors of rho - V for the lower and upper bound of each z_i
    boxes: number of boxes after which the checker stops
    """

    multipliers: np.ndarray
    boxes: int

    @classmethod
    def read(cls, entries: Fields, statement: RegionStatement) -> BoxWitness:
        """Return the witness of a certificate.

        Raises Malformed for the first wrong entry.
        """
        multipliers = entries.array("multipliers", len(statement.loop.states), 2)
        require(bool(np.all(multipliers >= 0.0)), "witness: multipliers")
        boxes = entries.count("boxes", _MOST_BOXES)
        entries.close()
        return cls(multipliers, boxes)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `witness`."""
        return {
            "prover": "boxes",
            "multipliers": self.multipliers.tolist(),
            "boxes": self.boxes,
        }


@dataclass(frozen=True, eq=False)
class Part:
    """Part of the set with its proof.

    In a part, each input is free or at a limit, and each disturbance is at an end of its range.

    inputs: input -> `FREE`, `LOWEST` or `HIGHEST`, and disturbance -> `LOWEST` or `HIGHEST`. In an
        empty part also `ANY`.
    evidence: proof that V' < 0 on the part, or that the part is empty
    """

    inputs: Mapping[str, str]
    evidence: Evidence


@dataclass(frozen=True, eq=False)
class SquaresWitness(Witness):
    """Sums of squares that prove a region, in coordinates y, z = T y.

    T: (n, n)
    order: highest degree of the Taylor polynomials
    inside: proof that {V <= rho} lies in the open unit ball of y
    parts: proofs that V' < 0 on each part of the set, with disturbances only where V = rho
    empty: proofs that the set has no point in the other parts
    extents: state -> proofs of its lowest and highest deviation, omitted if the stated deviations
        contain the unit ball
    """

    T: np.ndarray
    order: int
    inside: Evidence
    parts: tuple[Part, ...]
    empty: tuple[Part, ...]
    extents: Mapping[str, tuple[Evidence, Evidence]]

    @classmethod
    def read(cls, entries: Fields, statement: RegionStatement) -> SquaresWitness:
        """Return the witness of a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        loop = statement.loop
        n = len(loop.states)
        T = entries.array("T", n, n)
        order = entries.count("order", _HIGHEST_ORDER)
        polynomials = [*statement.terms, *chain.from_iterable(loop.gain.terms.values())]
        degree = max(sum(exponents) for _, exponents in polynomials)
        require(order >= degree, "order", order)
        inside = Evidence.read(entries.fields("inside"), n, (OUTSIDE,))
        parts = _read_parts(entries, "parts", statement, (FREE, LOWEST, HIGHEST))
        empty = _read_parts(entries, "empty", statement, (FREE, LOWEST, HIGHEST, ANY))
        stated = entries.fields("extents")
        extents = {}
        for name in loop.states:
            if stated.has(name):
                pair = stated.fields(name)
                low, high = (
                    Evidence.read(pair.fields(side), n, (LEVEL, BALL)) for side in (LOWEST, HIGHEST)
                )
                pair.close()
                extents[name] = (low, high)
        stated.close()
        entries.close()
        return cls(T, order, inside, parts, empty, extents)


def limit_names(inputs: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the constraints for the lowest and highest values of inputs."""
    return tuple(f"{name} {side}" for name in inputs for side in (LOWEST, HIGHEST))


def _read_parts(
    entries: Fields, name: str, statement: RegionStatement, allowed: tuple[str, ...]
) -> tuple[Part, ...]:
    """Return the parts of the set in an entry of the witness, with their proofs.

    entries: reader of the witness
    name: entry with the parts
    statement: the statement, which determines the sizes of the matrices
    allowed: permitted descriptions of an input or a disturbance, such as `FREE`

    Raises Malformed for the first wrong entry.
    """
    loop = statement.loop
    names = (LEVEL, BALL, *limit_names(loop.inputs))
    if loop.disturbances:
        names = (EDGE, *names)
    parts = []
    for each in entries.items(name):
        done = each.texts("inputs", allowed)
        require(len(done) == len(loop.acting), f"{each.where}: inputs", list(done))
        require(FREE not in done[len(loop.inputs) :], f"{each.where}: inputs", list(done))
        evidence = Evidence.read(each.fields("evidence"), len(loop.states), names)
        each.close()
        parts.append(Part(dict(zip(loop.acting, done, strict=True)), evidence))
    return tuple(parts)


def read_region_witness(entries: Fields, statement: RegionStatement) -> BoxWitness | SquaresWitness:
    """Return the witness of a certificate about a region.

    Raises Malformed for the first wrong entry.
    """
    prover = entries.value("prover", str)
    require(prover in ("boxes", "squares"), "prover", prover)
    if prover == "boxes":
        return BoxWitness.read(entries, statement)
    return SquaresWitness.read(entries, statement)
