"""Data for the proof of a region, which are not part of the claim."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, Terms, require, rows_of
from hfa_prove.statements.evidence import Evidence
from hfa_prove.statements.loop import FREE, HIGHEST, LOWEST, SaturatedLoop
from hfa_prove.statements.plant import (
    Subject,
    check_limits_of_model,
    facts,
    read_extents,
    read_plant,
    terms_by_input,
)

#: Highest degree of V.
HIGHEST_DEGREE = 6
#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 5


@dataclass(frozen=True, eq=False)
class RegionStatement:
    """Claim that the trajectories from {V(z) <= rho} converge to the equilibrium of a closed loop.

    Every trajectory of the loop that begins in the set exists for all time, stays in the set and
    within all limits, and converges to the equilibrium. With disturbances, convergence is not
    claimed. z are deviations from the equilibrium, which differs from the trim x0 by at most
    `SAME_TRIM` nominal values.

    loop: the model with its policy and saturated inputs
    terms: terms of V = Σ coefficient z^exponents, of degrees 2 to `HIGHEST_DEGREE`
    rho: level of V
    extents: moving state -> lower and upper bound of the deviation in the set
    """

    loop: SaturatedLoop
    terms: Terms
    rho: float
    extents: Mapping[str, tuple[float, float]]

    @classmethod
    def read(cls, content: Any, subject: Subject) -> RegionStatement:
        """Return the statement of a certificate.

        content: the certificate's entry `statement`
        subject: the user's aircraft

        Raises Malformed for the first wrong entry, and BadInputError if the statement concerns
        another model.
        """
        entries = Fields("statement", content)
        plant = read_plant(entries, content, subject)
        entries.same("disturbance_units", _disturbance_units(plant.model))
        loop = SaturatedLoop(
            **vars(plant),
            K=entries.array("K", len(plant.inputs), len(plant.states)),
            policy=terms_by_input(entries, "policy", plant, HIGHEST_POLICY),
            disturbances=_read_disturbances(entries, plant.model),
        )
        terms = entries.terms("terms", len(loop.states), HIGHEST_DEGREE)
        rho = entries.number("rho", above=0.0)
        extents = read_extents(entries, loop.states)
        entries.close()
        check_limits_of_model(loop)
        return cls(loop, terms, rho, extents)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `statement`, in the form that `read` accepts."""
        loop = self.loop
        return {
            **loop.content(),
            "disturbance_units": _disturbance_units(loop.model),
            "K": loop.K.tolist(),
            "policy": {name: rows_of(terms) for name, terms in loop.policy.items()},
            "disturbances": dict(loop.disturbances),
            "terms": rows_of(self.terms),
            "rho": self.rho,
            "extents": {name: list(pair) for name, pair in self.extents.items()},
        }


def _disturbance_units(model: Model) -> list[str]:
    return list(model.units(tuple(model.disturbances)))


def facts_of(model: Model) -> dict[str, Any]:
    """Return entries that identify a model: those of `facts`, and the units of the disturbances."""
    return facts(model) | {"disturbance_units": _disturbance_units(model)}


def _read_disturbances(entries: Fields, model: Model) -> dict[str, float]:
    """Return disturbance -> its largest absolute value in a certificate, in the order of the model.

    Raises Malformed unless each value is positive.
    """
    sizes = entries.numbers("disturbances", tuple(model.disturbances))
    for name, size in sizes.items():
        require(size > 0.0, f"disturbances: {name}", size)
    return {name: sizes[name] for name in model.disturbances if name in sizes}


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
