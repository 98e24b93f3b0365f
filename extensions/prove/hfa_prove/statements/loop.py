"""Closed loop of an aircraft and a policy about a trim, read from a certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from hfa_prove.enclosure.program import Program
from hfa_prove.fields import Fields, Stated, entry, require
from hfa_prove.statements.plant import Plant, digest_of
from hfa_support.errors import BadInputError

#: Largest difference of two policies that are called equal, relative to the largest entry.
SAME_GAIN = 1e-9


@dataclass(frozen=True, eq=False)
class Gain(Stated):
    """Policy u0 - K z before saturation, with z the deviations from the trim.

    K: (m, n), in the order of the inputs and the moving states
    """

    K: np.ndarray = entry(
        lambda file, name, known: file.array(
            name, len(known.model.inputs), len(known.model.linear)
        ),
        subject="policy",
    )

    @property
    def function(self) -> ca.Function:
        """Function from state deviations z (n,) to input deviations (m,)."""
        z = ca.SX.sym("z", self.K.shape[1])
        return ca.Function("gain", [z], [ca.densify(-ca.mtimes(ca.DM(self.K), z))])


def _read_policy(file: Fields, name: str, known: Any) -> Gain | ca.Function:
    """Return a gain, or the user's policy if its digest is stored."""
    stated = file.value(name, (str, dict))
    if isinstance(stated, dict):
        return Gain.read(Fields(name, stated), known)
    own = known.subject.policy
    if own is None:
        raise BadInputError(
            "the certificate is about a policy in a file; give this file with --weights"
        )
    if stated != digest_of(own):
        raise BadInputError(
            "the certificate is about another policy; give the file and the options used to "
            "prove the certificate"
        )
    return own


def stored_policy(policy: Gain | ca.Function) -> Any:
    """Return a policy in the form stored in a file: its gain, or its digest."""
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

    policy: gain, or any function from state deviations (n,) to input deviations (m,)
    disturbances: disturbance w -> bound d > 0 with |w(t)| <= d for any measurable w(t), omitted if
        w = 0
    """

    policy: Gain | ca.Function = entry(_read_policy, store=stored_policy, subject="policy")
    disturbances: Mapping[str, float] = entry(_read_disturbances, default_factory=dict)

    @cached_property
    def function(self) -> ca.Function:
        """The policy as a function."""
        return self.policy.function if isinstance(self.policy, Gain) else self.policy

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
        commands = ca.vertsplit(u0 + self.function(x - ca.DM(list(self.trim.values()))))
        saturated = []
        for name, command in zip(self.inputs, commands, strict=True):
            low, high = self.limits.get(name, (-np.inf, np.inf))
            above = ca.fmax(command, low) if np.isfinite(low) else command
            saturated.append(ca.fmin(above, high) if np.isfinite(high) else above)
        return ca.vertcat(*saturated)

    @cached_property
    def rate_function(self) -> ca.Function:
        """Function x -> rates of the closed loop."""
        x = ca.SX.sym("x", len(self.states))
        return ca.Function("rates", [x], [self.rates(x)[0]])

    @cached_property
    def program(self) -> Program:
        """Program of `rate_function`."""
        return Program(self.rate_function, self.model.name)
