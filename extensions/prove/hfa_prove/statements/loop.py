"""Closed loop of an aircraft and a policy about a trim, read from a certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import mul
from typing import Any

import casadi as ca
import numpy as np

from hfa_prove.enclosure.program import Program
from hfa_prove.fields import Fields, Stated, Terms, entry, require, rows_of
from hfa_prove.statements.plant import Plant, digest_of
from hfa_support.errors import BadInputError

#: Largest difference of two policies that are called equal, relative to the largest entry.
SAME_GAIN = 1e-9
#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 12


def _read_terms(file: Fields, name: str, known: Any) -> dict[str, Terms]:
    """Return input -> terms of a polynomial in the moving states, in the order of the inputs."""
    rows = file.fields(name)
    n = len(known.model.linear)
    terms = {}
    for each in known.model.inputs:
        if rows.has(each):
            terms[each] = rows.terms(each, n, HIGHEST_POLICY)
    rows.close()
    return terms


def _stored_terms(terms: Mapping[str, Terms]) -> dict[str, Any]:
    return {name: rows_of(rows) for name, rows in terms.items()}


@dataclass(frozen=True, eq=False)
class Gain(Stated):
    """Policy u0 - K z + q(z) before saturation, with z the deviations from the trim.

    K: (m, n), in the order of the inputs and the moving states
    terms: input -> terms of q of degree 2 to `HIGHEST_POLICY`, omitted if q = 0
    """

    K: np.ndarray = entry(
        lambda file, name, known: file.array(
            name, len(known.model.inputs), len(known.model.linear)
        ),
        subject="policy",
    )
    terms: Mapping[str, Terms] = entry(
        _read_terms, store=_stored_terms, subject="policy", default_factory=dict
    )

    def function(self, inputs: Sequence[str]) -> ca.Function:
        """Return the function from state deviations z (n,) to input deviations (m,).

        inputs: names of the inputs, in order
        """
        m, n = self.K.shape
        z = ca.SX.sym("z", n)
        deviations = ca.SX.zeros(m)
        for index, name in enumerate(inputs):
            total = ca.SX(0)
            for j in range(n):
                total -= self.K[index, j] * z[j]
            for coefficient, powers in self.terms.get(name, ()):
                factors = [z[j] for j, power in enumerate(powers) for _ in range(power)]
                total += coefficient * reduce(mul, factors)
            deviations[index] = total
        return ca.Function("gain", [z], [ca.densify(deviations)])


def _read_policy(file: Fields, name: str, known: Any) -> Gain | ca.Function:
    """Return the coefficients of a policy, or the user's policy if its digest is stored."""
    stated = file.value(name, (str, dict))
    if isinstance(stated, dict):
        return Gain.read(Fields(name, stated), known)
    own = known.subject.policy
    if own is None:
        raise BadInputError(
            "the certificate is about a policy in a file; give this file with --weights or --policy"
        )
    if stated != digest_of(own):
        raise BadInputError(
            "the certificate is about another policy; give the file and the options used to "
            "prove the certificate"
        )
    return own


def stored_policy(policy: Gain | ca.Function) -> Any:
    """Return a policy in the form stored in a file: its coefficients, or its digest."""
    return policy.content() if isinstance(policy, Gain) else digest_of(policy)


def _read_disturbances(file: Fields, name: str, known: Any) -> dict[str, float]:
    """Return disturbance -> its largest absolute value, in the order of the model."""
    names = tuple(known.model.disturbances)
    sizes = file.numbers(name, names)
    for each, size in sizes.items():
        require(size > 0.0, f"disturbances: {each}", size)
    return {each: sizes[each] for each in names if each in sizes}


@dataclass(frozen=True, eq=False)
class Loop(Plant):
    """Closed loop x' = f(x, u, w), u = min(max(u0 + policy(x - x0), low), high).

    policy: coefficients of a polynomial, or any function from state deviations (n,) to input
        deviations (m,), with the trim (all states, inputs and parameters) as an optional second
        argument
    disturbances: disturbance w -> bound d > 0 with |w(t)| <= d for any measurable w(t), omitted if
        w = 0
    """

    policy: Gain | ca.Function = entry(_read_policy, store=stored_policy, subject="policy")
    disturbances: Mapping[str, float] = entry(_read_disturbances, default_factory=dict)

    @cached_property
    def function(self) -> ca.Function:
        """The policy as a function."""
        policy = self.policy
        return policy.function(tuple(self.inputs)) if isinstance(policy, Gain) else policy

    def rates(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the rates of the moving states in the loop, and the outputs that have limits.

        x: values of the moving states, (n,)
        """
        return self.rates_at(x, self.commands(x))

    def disturbed_rates(self, x: ca.SX, w: Sequence[Any]) -> tuple[ca.SX, ca.SX]:
        """Return the rates of the moving states in the loop, and the outputs that have limits.

        x: values of the moving states, (n,)
        w: values of `disturbances`; all others are 0
        """
        acting = dict(zip(self.disturbances, w, strict=True))
        every = [acting.get(name, 0.0) for name in self.model.disturbances]
        return self.rates_at(x, self.commands(x), every if acting else None)

    def commands(self, x: ca.SX) -> ca.SX:
        """Return the saturated inputs (m,) at the states x (n,)."""
        u0 = ca.DM(list(self.inputs.values()))
        if not self.inputs:
            return ca.SX(0, 1)
        commands = ca.vertsplit(u0 + self.deviations(x - ca.DM(list(self.trim.values()))))
        saturated = []
        for name, command in zip(self.inputs, commands, strict=True):
            low, high = self.limits.get(name, (-np.inf, np.inf))
            above = ca.fmax(command, low) if np.isfinite(low) else command
            saturated.append(ca.fmin(above, high) if np.isfinite(high) else above)
        return ca.vertcat(*saturated)

    def deviations(self, z: ca.SX) -> ca.SX:
        """Return the input deviations (m,) that the policy commands at state deviations z (n,)."""
        if self.function.n_in() == 1:
            return self.function(z)
        at_trim = {**self.trim, **self.held}
        states = [at_trim[name] for name in self.model.states]
        numbers = [*states, *self.inputs.values(), *self.parameters.values()]
        return self.function(z, ca.DM(numbers))

    @cached_property
    def rate_function(self) -> ca.Function:
        """Function x -> rates of the closed loop."""
        x = ca.SX.sym("x", len(self.states))
        return ca.Function("rates", [x], [self.rates(x)[0]])

    @cached_property
    def program(self) -> Program:
        """Program of `rate_function`."""
        return Program(self.rate_function, self.model.name)
