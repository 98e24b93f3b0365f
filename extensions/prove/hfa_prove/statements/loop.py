"""Loops of statements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_prove.fields import Terms
from hfa_prove.statements.plant import Plant
from verification.enclosure.program import Program


@dataclass(frozen=True, eq=False)
class Loop(Plant):
    """Closed loop x' = f(x, u), u = min(max(u0 + policy(x - x0), low), high).

    policy: state deviations (n,) -> input deviations (m,), with the trim (all states, inputs and
        parameters) as an optional second argument
    """

    policy: ca.Function

    def rates(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the rates of the moving states in the loop, and the outputs that have limits.

        x: values of the moving states, (n,)
        """
        return self.rates_at(x, self.commands(x))

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
        if self.policy.n_in() == 1:
            return self.policy(z)
        at_trim = {**self.trim, **self.held}
        states = [at_trim[name] for name in self.model.states]
        return self.policy(z, ca.DM([*states, *self.inputs.values(), *self.parameters.values()]))

    @cached_property
    def closed(self) -> Program:
        """Program x -> rates of the closed loop."""
        x = ca.SX.sym("x", len(self.states))
        return Program(ca.Function("rates", [x], [self.rates(x)[0]]), self.model.name)


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


#: Entry of an input that is not saturated.
FREE = "free"
#: Entry of an input or a disturbance at its lowest value.
LOWEST = "low"
#: Entry of an input or a disturbance at its highest value.
HIGHEST = "high"
