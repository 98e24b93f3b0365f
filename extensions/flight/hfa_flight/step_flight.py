"""Simulation of a discrete-time linear plant with a gain, x⁺ = (A - B K) x."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.discrete_game import DiscreteGame
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import LARGEST, quadratic_forms, spectral_radius
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result
from hfa_support.reporting.text import Table

#: Rows of the printed table. A file contains all rows.
_ROWS = 11


@dataclass(frozen=True, eq=False, repr=False)
class StepFlight(Result, Reported):
    """Simulation of a discrete-time plant.

    problem: the plant and its cost
    policy: name of the policy
    states: (N + 1, n), before each step and after the last
    inputs: (N, m), at each step
    costs: (N,), αᵏ (x'Qx + 2x'Nu + u'Ru) of each step
    radius: spectral radius of A - B K
    warnings: notes on defaults of the plant that were used
    """

    schema = "hfa.step-flight/1"

    problem: DiscreteGame
    policy: str
    states: Matrix
    inputs: Matrix
    costs: np.ndarray
    radius: float
    warnings: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """Discounted cost of all steps."""
        return float(self.costs.sum())

    @property
    def decays(self) -> bool:
        """True if the spectral radius is below 1."""
        return self.radius < 1.0

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "plant": self.problem.step.names.origin,
            "states": self.problem.step.names.states,
            "inputs": self.problem.step.names.inputs,
            "policy": self.policy,
            "x": self.states,
            "u": self.inputs,
            "spectral_radius": self.radius,
            "warnings": self.warnings,
            "cost": self.cost,
            "decays": self.decays,
        }

    def report(self) -> Report:
        """Return the report: verdict, spectral radius, cost and a selection of steps.

        The records of the report contain all steps.
        """
        names = self.problem.step.names
        count = len(self.inputs)
        decay = "decays" if self.decays else "does not decay"
        outcome = f"{verdict_text(self.decays)}: the state {decay}, cost {self.cost:.7g}"
        rows = []
        for k in range(count + 1):
            u = self.inputs[k] if k < count else np.full(len(names.inputs), np.nan)
            rows.append((k, *self.states[k].tolist(), *u.tolist()))
        shown = np.unique(np.linspace(0, count, _ROWS).round().astype(int))
        texts = [
            (str(k), *("" if np.isnan(value) else f"{value:.5g}" for value in rows[k][1:]))
            for k in shown
        ]
        header = ("step", *names.states, *names.inputs)
        flight = f"Flight of {names.origin}, {count} steps, {self.policy}"
        radius = f"spectral radius of A - B K: {self.radius:.7g}"
        return Report(
            f"{outcome}\n{flight}",
            (radius, Table(header, texts)),
            data=self.as_data(),
            records=Table(header, rows),
        )


def fly_steps(
    problem: DiscreteGame, K: np.ndarray, policy: str, start: np.ndarray, count: int
) -> StepFlight:
    """Simulate u = -K x on a discrete-time plant and return the states, inputs and costs.

    problem: x⁺ = A x + B u, with cost and discount
    K: (m, n)
    policy: name of the policy
    start: initial state, (n,)
    count: number of steps

    Raises NoSolutionError if the state exceeds 1e50.
    """
    step = problem.step
    loop = step.A - step.B @ K
    states = [np.asarray(start, dtype=float)]
    for k in range(count):
        states.append(loop @ states[-1])
        if not (np.abs(states[-1]) <= LARGEST**0.5).all():
            raise NoSolutionError(
                f"the state exceeds 1e50 at step {k + 1}; check that the policy stabilizes the "
                "plant"
            )
    before = np.array(states[:-1])
    inputs = -before @ K.T
    xu = np.hstack([before, inputs])
    size = xu.shape[1]
    weights = problem.q_function(np.zeros_like(loop))[:size, :size]
    costs = quadratic_forms(xu, weights)
    return StepFlight(
        problem,
        policy,
        np.array(states),
        inputs,
        problem.discount ** np.arange(count) * costs,
        spectral_radius(loop),
    )
