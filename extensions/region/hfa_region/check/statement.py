"""Statement of a certificate about a region, proved by sums of squares.

The checker interprets or refuses every field. The digest covers all fields. Reports show them; the
shown extents are those computed by the checker.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.plant import (
    Plant,
    check_limits_of_model,
    facts,
    read_extents,
    read_plant,
    terms_by_input,
)
from hfa_proof.checker.reading import Fields, Terms, require, rows_of

#: Highest degree of V.
HIGHEST_DEGREE = 6
#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 5


@dataclass(frozen=True, eq=False)
class SaturatedLoop(Plant):
    """Closed loop of a model and a polynomial policy about a trim.

        x' = f(x, u, w),  u = sat(u0 - K (x - x0) + q(x - x0))

    Inputs are saturated at the model's limits. The limits of states and outputs are the model's
    limits or narrower. The rates are affine in the disturbances.

    K: (m, n), in the order of the inputs and the moving states
    policy: input -> terms of q of degree 2 to `HIGHEST_POLICY`, omitted if q = 0
    disturbances: disturbance w -> bound d > 0 with |w(t)| <= d for any measurable w(t), omitted if
        w = 0
    """

    K: np.ndarray
    policy: Mapping[str, Terms] = field(default_factory=dict)
    disturbances: Mapping[str, float] = field(default_factory=dict)

    @property
    def acting(self) -> tuple[str, ...]:
        """Names of the inputs and disturbances, in the order used in a certificate.

        A part of the set is defined by one condition for each input (free, at its lowest or at its
        highest value) and one extreme value for each disturbance.
        """
        return (*self.inputs, *self.disturbances)


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
    def read(cls, content: Any, own: Model | None) -> RegionStatement:
        """Return the statement of a certificate.

        content: the certificate's entry `statement`
        own: the user's model, if the statement concerns one

        Raises Malformed for the first wrong entry, and BadInputError if the statement concerns
        another model.
        """
        entries = Fields("statement", content)
        plant = read_plant(entries, content, own)
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
