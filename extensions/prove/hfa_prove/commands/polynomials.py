"""The polynomial policy of a critic as terms."""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial, prod
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hfa_prove.fields import Terms
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from controller.critic.critic import Critic

#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 5
#: Number of points at which the polynomials are compared with the policy.
_POINTS = 200
#: Largest difference there, over the sum of the sizes of the terms.
_SAME = 1e-9


def policy_terms(critic: Critic, inputs: tuple[str, ...]) -> Mapping[str, Terms]:
    """Return input -> terms of degree 2 and more of a critic's policy.

    Inputs without such terms are omitted.

    inputs: names of the inputs, in the order of the game

    Raises BadInputError unless the policy is a polynomial of degree at most `HIGHEST_POLICY` and 0
    at z = 0.
    """
    if critic.has_linear_policy:
        return {}
    if critic.is_wide or not critic.policy.is_a("SXFunction"):
        raise BadInputError(
            "the policy is a network; give K, P, or the weights W of a polynomial critic"
        )
    z = critic.symbols
    u = critic.policy(z)
    policy = {}
    for index, name in enumerate(inputs):
        terms = _terms(u[index], z)
        _check_same(ca.Function("u", [z], [u[index]]), terms)
        curved = tuple(term for term in terms if sum(term[1]) > 1)
        if curved:
            policy[name] = curved
    return policy


def _terms(u: ca.SX, z: ca.SX) -> Terms:
    """Return the terms ∂^α u / α! z^α of an input u at z = 0, up to the degree `HIGHEST_POLICY`."""
    n = z.numel()
    slopes = {(0,) * n: u}
    found: dict[tuple[int, ...], ca.SX] = {}
    for _ in range(HIGHEST_POLICY + 1):
        found |= slopes
        higher = {}
        for powers, slope in slopes.items():
            first = max((i for i in range(n) if powers[i]), default=0)
            for i in range(first, n):
                next_slope = ca.gradient(slope, z[i])
                if not next_slope.is_zero():
                    higher[(*powers[:i], powers[i] + 1, *powers[i + 1 :])] = next_slope
        slopes = higher
    at_zero = ca.Function("slopes", [z], [ca.densify(ca.vertcat(*found.values()))])
    values = np.array(at_zero(np.zeros(n))).ravel()
    terms = []
    for powers, value in zip(found, values.tolist(), strict=True):
        if value != 0.0:
            terms.append((value / prod(factorial(power) for power in powers), powers))
    return tuple(terms)


def _check_same(u: ca.Function, terms: Terms) -> None:
    """Raise BadInputError unless a policy equals its terms at random points, and is 0 at z = 0."""
    n = u.numel_in(0)
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (_POINTS, n))
    total = np.zeros(_POINTS)
    sizes = np.zeros(_POINTS)
    for coefficient, powers in terms:
        values = coefficient * np.prod(points ** np.array(powers), axis=1)
        total += values
        sizes += np.abs(values)
    wanted = np.array(u(points.T)).ravel()
    if not np.all(np.abs(total - wanted) <= _SAME * sizes):
        raise BadInputError(
            f"the policy is not a polynomial of degree {HIGHEST_POLICY} or less; give K, P, or"
            " the weights W of a polynomial critic"
        )
    if any(not any(powers) for _, powers in terms):
        raise BadInputError("the policy is not 0 at the trim; remove the linear terms of V")
