"""Data for the proof of a region, which are not part of the claim."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from hfa_proof.checker.reading import Fields, require
from hfa_region.check.loop import FREE, HIGHEST, LOWEST
from hfa_region.check.positivity import Evidence
from hfa_region.check.statement import RegionStatement

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
#: Highest order of the Taylor polynomials.
_HIGHEST_ORDER = 12


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
class RegionWitness:
    """Proofs of a region, in coordinates y, z = T y.

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
    def read(cls, entries: Fields, statement: RegionStatement) -> RegionWitness:
        """Return the witness of a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        loop = statement.loop
        n = len(loop.states)
        T = entries.array("T", n, n)
        order = entries.count("order", _HIGHEST_ORDER)
        polynomials = [*statement.terms, *chain.from_iterable(loop.policy.values())]
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
    for part in entries.items(name):
        done = part.texts("inputs", allowed)
        require(len(done) == len(loop.acting), f"{part.where}: inputs", list(done))
        require(FREE not in done[len(loop.inputs) :], f"{part.where}: inputs", list(done))
        evidence = Evidence.read(part.fields("evidence"), len(loop.states), names)
        part.close()
        parts.append(Part(dict(zip(loop.acting, done, strict=True)), evidence))
    return tuple(parts)
