"""Step to a better V: with the multipliers of the level fixed, V of smallest mean over the ball.

V and multipliers are optimized alternately (Jarvis-Wloszek, Lyapunov based analysis and controller
synthesis for polynomial systems using sum-of-squares optimization, 2003). Each step nearly contains
the last set and extends it where V' < 0 permits.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from hfa_prove.enclosure.polynomial import exponents_of, monomials, power_of_length
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.level import MARGIN, LevelSearch, limits_within, lowest_degree
from hfa_prove.search.squares import BASE, Identity, Squares, Terms, packed_monomials
from hfa_prove.statements.region import LEVEL

#: Least ratio of V to |y|².
_LEAST = 1e-3
#: Longest processor time of a step, s.
_SECONDS = 120.0


def better(
    search: LevelSearch, rows: np.ndarray, room: np.ndarray, reach: float
) -> PolynomialFunction | None:
    """Return the V of the next step, scaled to level 1, or None if the problem is not solved.

    The step minimizes the mean of V over the ball. The set usually becomes larger.

    search: search with the present V, whose level is proved in double precision
    rows: gradients of the signals with limits, (k, n)
    room: lowest and highest permitted deviation of each of these signals, (k, 2)
    reach: largest radius of the next set, relative to the ball, above 1
    """
    return _Step(search, reach).solved(rows, room)


class _Step:
    """Semidefinite problem for the coefficients θ of the next V = Σ θ_α y^α.

    search: search with the present V
    reach: largest radius of the next set, relative to the ball
    """

    def __init__(self, search: LevelSearch, reach: float) -> None:
        self.search = search
        self.reach = reach
        n = search.ball.n
        self.n = n
        self.problem = Squares(n)
        keys = monomials(n, 2, search.setting.degree)
        self.exponents = np.zeros((len(keys), n), dtype=int)
        for row, key in zip(self.exponents, keys, strict=True):
            powers = exponents_of(key)
            row[: len(powers)] = powers
        self.keys = packed_monomials(n, 2, search.setting.degree)
        self.theta = self.problem.free(len(keys))

    def solved(self, rows: np.ndarray, room: np.ndarray) -> PolynomialFunction | None:
        """Return the next V in z, scaled to level 1, or None if the problem is not solved.

        rows: gradients of the signals with limits, (k, n)
        room: lowest and highest permitted deviation of each of these signals, (k, 2)
        """
        proofs = self.search.proofs
        if proofs is None:
            return None
        for part, evidence in proofs:
            self._decrease(part, evidence)
        self._positive()
        self._bounded(Terms.packed(_ball(self.n, self.reach)), 1)
        for row, (low, high) in zip(rows, room.tolist(), strict=True):
            self._bounded(self._beyond(row, low, high), 1)
        self.problem.cost(self.theta, _means(self.exponents))
        solution = self.problem.solve(margin=MARGIN, seconds=min(_SECONDS, self.search.clock.left))
        if solution is None:
            return None
        coefficients = solution.x[self.theta]
        in_y = PolynomialFunction(coefficients, self.exponents)
        return in_y.substituted(np.linalg.inv(self.search.T))

    def _decrease(self, part: Mapping[str, str], evidence: Mapping[str, Any]) -> None:
        """Require, by a sum of squares, that the next V decreases on a part of the set.

        -V' - σ (1 - V) minus products with further multipliers must be a sum of squares. σ is the
        multiplier of the level in the proof for the present V.

        part: input -> `FREE`, `LOWEST` or `HIGHEST`
        evidence: Gram matrices of the proof for the present V
        """
        search = self.search
        half = search.setting.half
        problem = self.problem
        scale = 1.0 / search.target(part).size
        identity = problem.identity(Terms(np.zeros(0, dtype=np.int64), np.zeros(0)))
        keys, rates = self._rates(part, 2 * half)
        for i in range(self.n):
            kept = self.exponents[:, i] > 0
            lowered = self.keys[kept] - BASE**i
            slopes = -self.exponents[kept, i] * scale
            for key, rate in zip(keys.tolist(), rates[i].tolist(), strict=True):
                within = _degrees(lowered + key) <= 2 * half
                columns = self.theta[kept][within]
                problem.add(identity, lowered[within] + key, columns, slopes[within] * rate)
        low = lowest_degree(part)
        multiplier = evidence["multipliers"][LEVEL]
        sigma = _square(self.n, low, multiplier["degrees"][1], np.array(multiplier["gram"]))
        sigma = sigma.scaled(scale)
        identity.constants += [sigma.scaled(-1.0), search.remainder_term(part).scaled(-scale)]
        for key, value in zip(sigma.keys.tolist(), sigma.values.tolist(), strict=True):
            problem.add(identity, self.keys + key, self.theta, np.full(len(self.keys), value))
        problem.subtract(identity, low, half)
        if search.setting.degree > 2:
            in_ball = Terms.packed(_ball(self.n, self.reach)).scaled(-1.0)
            problem.subtract(identity, low, half - 1, in_ball)
        for _, limit, degrees in limits_within(search.ball, part, low, half):
            problem.subtract(identity, *degrees, limit)

    def _rates(self, part: Mapping[str, str], highest: int) -> tuple[np.ndarray, np.ndarray]:
        """Return packed keys (k,) and coefficients (n, k) of the polynomials y' = T⁻¹ z' on a part.

        highest: degree below which terms are included
        """
        polynomials = [Terms.of(rate.polynomial) for rate in self.search.ball.rates(part)]
        keys = np.unique(np.concatenate([terms.keys for terms in polynomials]))
        keys = keys[_degrees(keys) < highest]
        values = np.zeros((self.n, len(keys)))
        for row, terms in zip(values, polynomials, strict=True):
            kept = np.isin(terms.keys, keys)
            np.add.at(row, np.searchsorted(keys, terms.keys[kept]), terms.values[kept])
        return keys, np.linalg.solve(self.search.T, values)

    def _positive(self) -> None:
        """Require that V - `_LEAST` |y|² is a sum of squares."""
        problem = self.problem
        length = Terms.of(power_of_length(self.n, 2))
        identity = problem.identity(length.scaled(-_LEAST))
        problem.add(identity, self.keys, self.theta, np.ones(len(self.keys)))
        problem.subtract(identity, 1, self.search.setting.degree // 2)

    def _bounded(self, beyond: Terms, degree: int) -> None:
        """Require V > 1 wherever a polynomial is >= 0.

        beyond: the polynomial, negative at y = 0
        degree: half of the polynomial's degree
        """
        problem = self.problem
        half = self.search.setting.degree // 2
        identity: Identity = problem.identity(Terms(np.zeros(1, dtype=np.int64), -np.ones(1)))
        problem.add(identity, self.keys, self.theta, np.ones(len(self.keys)))
        problem.subtract(identity, 0, half)
        problem.subtract(identity, 0, half - degree, beyond)

    def _beyond(self, row: np.ndarray, low: float, high: float) -> Terms:
        """Return (s - low) (s - high) / |low high| as a polynomial in y, with s = row z.

        The polynomial is >= 0 where the signal s is at or beyond a limit. If only one limit is
        finite, its negative is used as the other limit.
        """
        low = -high if not np.isfinite(low) else low
        high = -low if not np.isfinite(high) else high
        slopes = row @ self.search.T
        squared = PolynomialFunction.quadratic(np.outer(slopes, slopes))
        linear = PolynomialFunction(-(low + high) * slopes, np.eye(self.n, dtype=int))
        constant = Terms(np.zeros(1, dtype=np.int64), np.array([low * high]))
        total = Terms.packed(squared) + Terms.packed(linear) + constant
        return total.scaled(1.0 / abs(low * high))


def _ball(n: int, radius: float) -> PolynomialFunction:
    """Return the polynomial |y|² / radius² - 1."""
    exponents = np.concatenate([2 * np.eye(n, dtype=int), np.zeros((1, n), dtype=int)])
    return PolynomialFunction(np.array([radius**-2.0] * n + [-1.0]), exponents)


def _means(exponents: np.ndarray) -> np.ndarray:
    """Return the mean of each monomial over the unit ball of y, (k,).

    For even exponents α of sum k the mean is n / (n + k) times the mean over the unit sphere,
    Π (α_i - 1)!! / (n (n + 2) .. (n + k - 2)). For other exponents the mean is 0.

    exponents: exponents of the monomials, (k, n)
    """
    n = exponents.shape[1]
    means = []
    for powers in exponents.tolist():
        degree = sum(powers)
        if any(power % 2 for power in powers):
            means.append(0.0)
            continue
        top = prod(prod(range(1, power, 2)) for power in powers)
        bottom = prod(range(n, n + degree, 2))
        means.append(top / bottom * n / (n + degree))
    return np.array(means)


def _square(n: int, low: int, high: int, Q: np.ndarray) -> Terms:
    """Return the polynomial m'Q m, with m the monomials of the degrees low to high.

    n: number of variables
    """
    keys = packed_monomials(n, low, high)
    sums = (keys[:, None] + keys[None, :]).ravel()
    known, place = np.unique(sums, return_inverse=True)
    values = np.zeros(len(known))
    np.add.at(values, place, Q.ravel())
    return Terms(known, values)


def _degrees(keys: np.ndarray) -> np.ndarray:
    """Return the degree of each monomial from its packed key."""
    total = np.zeros_like(keys)
    rest = keys.copy()
    while np.any(rest):
        total += rest % BASE
        rest //= BASE
    return total
