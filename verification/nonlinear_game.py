"""Comparison of a critic with the value of the nonlinear game about the trim, degree by degree."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.expansion.expansion import HIGHEST, LOWEST, Expansion, expand
from controller.expansion.series import homogeneous, name_of
from controller.expansion.taylor import PowerSeries
from controller.riccati.gare import Solution
from hfa_support.cached import cached_property
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.parts import Part
from hfa_support.reporting.results import Result, without_empty
from hfa_support.reporting.text import Table, percent
from trim.linear.linear_model import LinearModel
from verification.box import SHARE, Box, BoxFlights, box_flights, nonlinear_plant

if TYPE_CHECKING:
    from controller.expansion.radius import Radius

#: Grades of a verdict, from the best to the worst.
GRADES = ("exact", "near", "fail")
#: Degree to which a critic is compared that is no polynomial.
ORDER = 4
#: Largest number of scalar operations of a network whose power series is computed.
_MOST_OPERATIONS = 100_000
#: An entry whose largest contribution to V in the set V2 <= 1 is below this fraction of that of its
#: degree is compared with this fraction: it may consist of rounding.
_SMALL = 1e-5


@dataclass(frozen=True, eq=False)
class DegreeError(Result):
    """Error of a critic's terms of one degree, the largest over all coefficients.

    of: "V", or "u" of a policy
    degree: degree of the terms
    error: largest |w - w*| / |w*| of a coefficient, or with a small w* divided by `_SMALL` times
        the largest one
    worst: the monomial of this coefficient, for a policy with the input
    learned: the coefficient w of the critic
    exact: the coefficient w* of the game
    """

    of: str
    degree: int
    error: float
    worst: str
    learned: float
    exact: float


@dataclass(frozen=True, eq=False)
class NonlinearComparison(Result):
    """A critic compared with the nonlinear game: its coefficients, and flights.

    The coefficients are those of V, and of a policy that does not follow from V.

    errors: the errors of each degree
    limit: limit of each error
    expansion: value and policy of the nonlinear game, to the critic's degree
    flown: flights of the critic from a part of the box, or None without flights
    """

    errors: tuple[DegreeError, ...]
    limit: float
    expansion: Expansion
    flown: BoxFlights | None = None

    @property
    def has_right_terms(self) -> bool:
        """True if every coefficient is within the limit."""
        return all(error.error <= self.limit for error in self.errors)

    @property
    def ok(self) -> bool:
        """True if the critic passes in the whole box."""
        return self.grade() == "exact"

    def grade(self, limit_cost: float | None = None) -> str:
        """Return the grade: "exact", "near" if the critic passes in a part of the box alone, or
        "fail".

        Every coefficient must be within the limit, and the flights must cost what those of the
        exact policy do (`BoxFlights.within`).

        limit_cost: limit of the cost of the flights above that of the exact policy, percent, which
            decides in place of the coefficients; or None
        """
        flown = self.flown
        if flown is None:
            return "exact" if self.has_right_terms else "fail"
        share = SHARE if limit_cost is None else limit_cost / 100.0
        if not (flown.within(share) and (self.has_right_terms or limit_cost is not None)):
            return "fail"
        return "exact" if flown.part == 1.0 else "near"

    @cached_property
    def radius(self) -> Radius | None:
        """Set z'Pz <= c in which simulated flights cost what the value of a right critic predicts.

        None if the critic is wrong. The flights are simulated when the property is first used.
        """
        return self.expansion.radii[-1] if self.has_right_terms else None

    @property
    def sentence(self) -> str:
        """The verdict on the coefficients as text: what is right, and what is not."""
        compared = " and ".join(dict.fromkeys(error.of for error in self.errors))  # "V and u"
        last = max(error.degree for error in self.errors)
        wrong = [error for error in self.errors if not error.error <= self.limit]
        if not wrong:
            return f"every coefficient of {compared} to degree {last} within {self.limit:g}"
        largest = max(wrong, key=lambda error: error.error)
        degrees = ", ".join(str(error.degree) for error in wrong if error.of == largest.of)
        off = f"off by {percent(100.0 * largest.error)}"
        if math.isfinite(largest.learned) and largest.exact == 0.0:
            off = f"{largest.learned:.3g} in place of 0"
        elif not math.isfinite(largest.error):
            off = "not finite"
        return f"{largest.of} wrong in degree {degrees} (worst: {largest.worst}, {off})"

    def part(self) -> Part:
        """Return the part of a report: where the value is known, and the error of each degree."""
        radius, about = self.radius, f", to degree {self.errors[-1].degree}"
        if radius is not None:
            where = "is not known by flights"  # c = 0
            if radius.c and math.isinf(radius.c):
                where = "agrees with flights everywhere"
            elif radius.c:
                where = f"agrees with flights where z'Pz <= {radius.c:.3g}"
            share = f"within {100 * radius.share:g} %"
            about = f": its value to degree {radius.degree} {where}, {share}"
        lines = [f"Nonlinear game about the trim{about}"]
        if self.flown is not None and self.flown.flights:
            names, widths = self.expansion.game.names.states, self.flown.half_widths
            box = ", ".join(
                f"{name} {width:.3g}" for name, width in zip(names, widths, strict=True)
            )
            lines += [
                "Flown with the input limits of the aircraft, without disturbance, from "
                f"±({box}): {self.flown.sentence}",
                self.flown.integration,
            ]
        rows = [
            (
                f"{error.of}, {error.degree}",
                f"{error.error:.3g}",
                error.worst,
                f"{error.learned:z.7g}",  # z: 0 in place of -0
                f"{error.exact:z.7g}",
            )
            for error in self.errors
        ]
        return (*lines, Table(("degree", "error", "worst term", "learned", "exact"), rows))

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"errors": self.errors, "limit": self.limit, "ok": self.ok} | without_empty(
            radius=self.radius, flown=self.flown
        )


def compare_with_nonlinear(
    critic: Critic,
    linear: LinearModel,
    solution: Solution,
    limit: float,
    box: Box,
    flights: int,
    progress: Progress | None = None,
) -> NonlinearComparison:
    """Return the errors of a critic's terms against the nonlinear game, and its flights.

    The terms of a polynomial value are compared up to its degree, those of another function up to
    degree `ORDER`. The terms of a policy that does not follow from the value are compared up to the
    degree below.

    linear: linear model of the game at a trim of the aircraft
    limit: limit of the error of each coefficient
    box: box of states, of which a part is flown
    flights: number of flights
    progress: called with (parts done, parts, text), or None

    Raises BadInputError if the aircraft or the critic has no power series at the trim.
    """
    widths = np.sqrt(np.diag(np.linalg.inv(solution.P)))  # of the set V2 <= 1
    show = progress or (lambda *_: None)
    show(0, 3, "power series")
    terms = _terms(critic)
    # A policy of degree d follows from a value of degree d + 1.
    order = max(degree + (of == "u") for of, degrees in terms.items() for degree in degrees)
    expansion = expand(linear, solution, min(max(order, LOWEST), HIGHEST))
    errors = [
        _degree_error(of, degree, learned, expansion, widths)
        for of, degrees in terms.items()
        for degree, learned in sorted(degrees.items())
    ]
    show(1, 3, "flights from the box")
    flown = None
    if flights:
        exact = expansion.policy
        if not _is_policy_given(critic):  # the policy that follows from the exact value
            weights, basis, K, P = expansion.weights, expansion.basis, solution.K, solution.P
            by_value = replace(critic, K=K, P=P, network={}, weights=weights, basis=basis)
            exact = by_value.policy
        plant = nonlinear_plant(linear)
        flown = box_flights(critic.policy, exact, expansion, plant, box, flights)
    show(2, 3, "flights within the radius of the series")
    compared = NonlinearComparison(tuple(errors), limit, expansion, flown)
    _ = compared.radius  # simulates the flights under this progress text; the result is cached
    show(3, 3)
    return compared


def _is_policy_given(critic: Critic) -> bool:
    """Return whether a critic's policy is its own, and does not follow from its value."""
    return critic.value is None or critic.slope_gain is None


def _degree_error(
    of: str, degree: int, learned: np.ndarray, expansion: Expansion, widths: np.ndarray
) -> DegreeError:
    """Return the largest relative error of a critic's weights of one degree.

    of: "V", or "u" of a policy
    learned: weights of all M monomials of the degree, (1, M) of V, (m, M) of u
    widths: half-widths of the set V2 <= 1, (n,), with the quadratic part V2 of the exact V
    """
    names = expansion.game.names
    exponents = homogeneous(expansion.states, degree).exponents
    # Exact weights of all monomials from the lowest degree on, degree by degree.
    weights = expansion.weights[None] if of == "V" else expansion.policy_weights
    lowest = LOWEST if of == "V" else 1
    begin = sum(homogeneous(expansion.states, each).size for each in range(lowest, degree))
    exact = weights[:, begin : begin + len(exponents)]
    if degree < lowest or not exact.size:  # the expansion has no terms of this degree
        exact = np.zeros_like(learned)
    monomials = np.prod(widths**exponents, axis=1)  # at typical deviations
    input_weights = np.sqrt(np.diag(expansion.game.R))
    # Sizes of the terms with the weight 1, which make inputs comparable.
    terms = monomials if of == "V" else np.outer(input_weights, monomials)
    least = _SMALL * float(np.max(np.abs(exact) * terms)) / terms
    scale = np.maximum(np.abs(exact), least)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.abs(learned - exact) / scale
    relative[learned == exact] = 0.0  # also where the scale is 0
    relative[~np.isfinite(learned)] = np.inf
    row, column = np.unravel_index(np.argmax(relative), relative.shape)
    monomial = name_of(exponents[column].tolist(), names.states)
    return DegreeError(
        of=of,
        degree=degree,
        error=float(relative[row, column]),
        worst=monomial if of == "V" else f"{names.inputs[row]}: {monomial}",
        learned=float(learned[row, column]),
        exact=float(exact[row, column]),
    )


def _terms(critic: Critic) -> dict[str, dict[int, np.ndarray]]:
    """Return "V" or "u" -> degree -> the critic's weights of all M monomials, (1, M) or (m, M)."""
    terms = {}
    degree_of_value = ORDER
    if critic.weights is not None and critic.basis is not None:
        terms["V"] = _terms_of_weights(critic)
        degree_of_value = max(terms["V"])
    elif critic.value is not None:
        terms["V"] = _terms_of_function(critic.value, range(LOWEST, ORDER + 1))
    if _is_policy_given(critic):
        # A policy follows from the slopes of V, so that its degree is one below that of V.
        terms["u"] = _terms_of_function(critic.policy, range(1, degree_of_value))
    return terms


def _terms_of_weights(critic: Critic) -> dict[int, np.ndarray]:
    """Return the weights of a polynomial, degree -> (1, M) of all monomials of the degree."""
    assert critic.weights is not None  # checked by the caller, as is the basis
    assert critic.basis is not None
    n = critic.basis.states
    exponents = [tuple(row) for row in critic.basis.exponents.tolist()]
    given = dict(zip(exponents, critic.weights.tolist(), strict=True))
    degrees = [sum(row) for row in exponents]
    terms = {}
    for degree in range(min(degrees), max(degrees) + 1):
        monomials = homogeneous(n, degree).exponents.tolist()
        terms[degree] = np.array([[given.get(tuple(row), 0.0) for row in monomials]])
    return terms


def _terms_of_function(function: ca.Function, degrees: range) -> dict[int, np.ndarray]:
    """Return the Taylor coefficients of a function at 0: degree -> those of M monomials, (k, M)."""
    function = function.expand()
    if function.n_instructions() > _MOST_OPERATIONS:
        raise BadInputError("the network is too wide for its power series")
    ring = PowerSeries(function.numel_in(0), degrees[-1])
    results = ring.values(function, ring.variables())
    return {d: results[:, ring.of[d]].astype(float) for d in degrees}
