"""Comparison of a critic with the value of the nonlinear game about the trim, degree by degree."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.expansion.expansion import HIGHEST, LOWEST, Expansion, expand
from controller.expansion.monomials import homogeneous, name_of
from controller.expansion.series import directions, least_squares
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Part
from hfa_support.reporting.results import Result, given
from hfa_support.reporting.text import Table
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.expansion.radius import Radius

#: Degree to which a critic is compared that is no polynomial.
ORDER = 4
#: An entry whose largest contribution to V in the set V2 <= 1 is below this fraction of that of its
#: degree is compared with this fraction: it may consist of rounding.
_SMALL = 1e-5
#: Rays for each coefficient of a critic that is a function, and their seed.
_RAYS = 1.5
_SEED = 7


@dataclass(frozen=True, eq=False)
class DegreeError(Result):
    """Error of a critic's terms of one degree, the largest over all coefficients.

    degree: degree of the terms
    error: largest |w - w*| / |w*| of a coefficient
    worst: the monomial of this coefficient, for a policy with the input
    learned: the coefficient w of the critic
    exact: the coefficient w* of the game
    """

    degree: int
    error: float
    worst: str
    learned: float
    exact: float


@dataclass(frozen=True, eq=False)
class NonlinearComparison(Result):
    """A critic compared with the nonlinear game, coefficient by coefficient.

    of: "V", or "u" of a critic without a value
    errors: the errors of each degree
    limit: limit of each error
    expansion: value and policy of the nonlinear game, to the critic's degree
    """

    of: str
    errors: tuple[DegreeError, ...]
    limit: float
    expansion: Expansion

    @property
    def ok(self) -> bool:
        """True if every coefficient is within the limit."""
        return all(each.error <= self.limit for each in self.errors)

    @cached_property
    def radius(self) -> Radius | None:
        """Set z'Pz <= c in which simulated flights cost what the value of a right critic predicts.

        None if the critic is wrong. The flights are simulated when the property is first used.
        """
        return self.expansion.radii[-1] if self.ok else None

    @property
    def sentence(self) -> str:
        """The verdict as text, without the grade: what is right, and what is not."""
        last = self.errors[-1].degree
        wrong = [each for each in self.errors if not each.error <= self.limit]
        if not wrong:
            return f"every coefficient of {self.of} to degree {last} within {self.limit:g}"
        worst = max(wrong, key=lambda each: each.error)
        degrees = ", ".join(str(each.degree) for each in wrong)
        return f"{self.of} wrong in degree {degrees} (worst: {worst.worst}, {_share(worst)})"

    def part(self) -> Part:
        """Return the part of a report: where the value is known, and the error of each degree."""
        radius = self.radius
        if radius is None:
            return (
                f"Nonlinear game about the trim, to degree {self.errors[-1].degree}",
                self._table(),
            )
        where = "is not known by flights"
        if radius.c and math.isinf(radius.c):
            where = "agrees with flights everywhere"
        elif radius.c:
            where = f"agrees with flights where z'Pz <= {radius.c:.3g}"
        share = f"within {100 * radius.share:g} %"
        return (
            f"Nonlinear game about the trim: its value to degree {radius.degree} {where}, {share}",
            self._table(),
        )

    def _table(self) -> Table:
        rows = [
            (
                each.degree,
                f"{each.error:.3g}",
                each.worst,
                f"{each.learned:.7g}",
                f"{each.exact:.7g}",
            )
            for each in self.errors
        ]
        return Table((f"degree of {self.of}", "error", "worst term", "learned", "exact"), rows)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"of": self.of, "errors": self.errors, "limit": self.limit, "ok": self.ok} | given(
            radius=self.radius
        )


def _share(error: DegreeError) -> str:
    if not math.isfinite(error.error):
        return "not finite"
    return f"off by {100.0 * error.error:.2g} %"


def compare_with_nonlinear(
    critic: Critic, linear: LinearModel, solution: Solution, limit: float
) -> NonlinearComparison:
    """Return the errors of a critic's terms against the value of the nonlinear game.

    The terms of a polynomial are compared up to its degree, those of another function up to degree
    `ORDER`. A critic without a value is compared by the terms of its policy.

    linear: linear model of the game at a trim of the aircraft
    limit: limit of the error of each coefficient

    Raises BadInputError if the aircraft or the critic has no power series at the trim.
    """
    widths = np.sqrt(np.diag(np.linalg.inv(solution.P)))
    of, terms = _terms(critic, widths)
    expansion = expand(linear, solution, min(max(max(terms) + (of == "u"), LOWEST), HIGHEST))
    names = solution.game.names
    n = len(names.states)
    exact = _exact_terms(expansion, of)
    errors = []
    for degree, learned in sorted(terms.items()):
        wanted = exact.get(degree, np.zeros_like(learned))
        exponents = homogeneous(n, degree).exponents
        reach = np.prod(widths**exponents, axis=1)
        floor = _SMALL * float(np.max(np.abs(wanted) * reach)) / reach
        difference = np.abs(learned - wanted)
        scale = np.maximum(np.abs(wanted), floor)
        relative = np.where(difference > 0.0, difference / np.where(scale > 0.0, scale, 1.0), 0.0)
        relative[(scale == 0.0) & (difference > 0.0)] = np.inf
        relative[~np.isfinite(learned)] = np.inf
        row, column = np.unravel_index(np.argmax(relative), relative.shape)
        monomial = name_of(exponents[column].tolist(), names.states)
        worst = monomial if of == "V" else f"{names.inputs[row]}: {monomial}"
        errors.append(
            DegreeError(
                degree,
                float(relative[row, column]),
                worst,
                float(learned[row, column]),
                float(wanted[row, column]),
            )
        )
    return NonlinearComparison(of, tuple(errors), limit, expansion)


def _exact_terms(expansion: Expansion, of: str) -> dict[int, np.ndarray]:
    """Return the exact weights of all monomials of each degree, degree -> (k, M)."""
    weights = expansion.weights[None] if of == "V" else expansion.policy_weights
    degree = LOWEST if of == "V" else 1
    terms = {}
    begin = 0
    while begin < weights.shape[1]:
        size = homogeneous(expansion.states, degree).size
        terms[degree] = weights[:, begin : begin + size]
        begin += size
        degree += 1
    return terms


def _terms(critic: Critic, widths: np.ndarray) -> tuple[str, dict[int, np.ndarray]]:
    """Return "V" or "u", and the critic's weights of all monomials, degree -> (k, M).

    widths: typical deviations, (n,)
    """
    if critic.weights is not None and critic.basis is not None:
        return "V", _terms_of_weights(critic)
    if critic.value is not None:
        return "V", _terms_of_function(critic.value, range(LOWEST, ORDER + 1), widths)
    return "u", _terms_of_function(critic.policy, range(1, ORDER), widths)


def _terms_of_weights(critic: Critic) -> dict[int, np.ndarray]:
    """Return the weights of a polynomial, degree -> (1, M) of all monomials of the degree."""
    assert critic.weights is not None  # the caller found them
    assert critic.basis is not None  # as above
    n = critic.basis.states
    exponents = [tuple(row) for row in critic.basis.exponents.tolist()]
    given = dict(zip(exponents, critic.weights.tolist(), strict=True))
    degrees = [sum(row) for row in exponents]
    terms = {}
    for degree in range(min(degrees), max(degrees) + 1):
        monomials = homogeneous(n, degree).exponents.tolist()
        terms[degree] = np.array([[given.get(tuple(row), 0.0) for row in monomials]])
    return terms


def _terms_of_function(
    function: ca.Function, degrees: range, widths: np.ndarray
) -> dict[int, np.ndarray]:
    """Return the Taylor coefficients of a function at 0, degree -> (k, M) of all monomials.

    widths: scales of the states, in which the coefficients are found, (n,)

    Raises BadInputError for a function that is too wide for symbols.
    """
    if not function.is_a("SXFunction"):
        raise BadInputError("the network is too wide for its power series")
    n = function.numel_in(0)
    t = ca.SX.sym("t")
    z = ca.SX.sym("z", n)
    derivative = function(t * ca.DM(widths) * z)
    terms = {}
    for degree in range(1, degrees[-1] + 1):
        derivative = ca.jacobian(derivative, t)
        if degree not in degrees:
            continue
        along = ca.substitute(derivative, t, 0) / math.factorial(degree)
        basis = homogeneous(n, degree)
        rays = directions(n, math.ceil(_RAYS * basis.size) + n, _SEED)
        values = np.array(ca.Function("along", [z], [ca.densify(along)])(rays.T)).T
        scaled = least_squares(basis.psi(rays), values).T
        terms[degree] = scaled / np.prod(widths**basis.exponents, axis=1)
    return terms
