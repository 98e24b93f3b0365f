"""A flight of a linear plant in discrete time, step by step: x⁺ = (A - B K) x."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.game.discrete_game import DiscreteGame
from controller.game.zero_sum import LARGEST
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result
from hfa_support.reporting.text import Table

#: Rows of the table on a terminal; a file has all.
_ROWS = 11


@dataclass(frozen=True, kw_only=True, eq=False)
class StepFlightData(Result):
    """A flight in steps.

    plant: file of the plant.
    policy: what flew.
    states: names.
    inputs: names.
    x: state before each step and after the last.
    u: input of each step.
    cost: of all steps, discounted.
    spectral_radius: of A - B K.
    decays: whether it is below 1; exit code 0.
    warnings: defaults of the plant that were taken."""

    schema = "hfa.step-flight/1"
    made_by = "hfa fly --model"

    plant: str
    policy: str
    states: Sequence[str]
    inputs: Sequence[str]
    x: Matrix
    u: Matrix
    cost: float
    spectral_radius: float
    decays: bool
    warnings: Sequence[str] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class StepFlight(Reported):
    """What was flown.

    problem: the plant and its cost
    policy: what it is called
    states: (N + 1, n)
    inputs: (N, m)
    costs: (N,), αᵏ (x'Qx + 2x'Nu + u'Ru) of each step
    radius: the spectral radius of A - B K
    """

    problem: DiscreteGame
    policy: str
    states: np.ndarray
    inputs: np.ndarray
    costs: np.ndarray
    radius: float

    def data(self) -> StepFlightData:
        """As data."""
        names = self.problem.step.names
        return StepFlightData(
            plant=names.origin,
            policy=self.policy,
            states=names.states,
            inputs=names.inputs,
            x=self.states,
            u=self.inputs,
            cost=float(self.costs.sum()),
            spectral_radius=self.radius,
            decays=self.radius < 1.0,
        )

    def report(self) -> Report:
        """Whether it decays, its cost, and some steps; files have all."""
        data = self.data()
        count = len(self.inputs)
        verdict = "decays" if data.decays else "does NOT decay"
        rows = []
        for k in range(count + 1):
            u = self.inputs[k] if k < count else np.full(len(data.inputs), np.nan)
            rows.append((k, *self.states[k].tolist(), *u.tolist()))
        shown = np.unique(np.linspace(0, count, _ROWS).round().astype(int))
        texts = [
            (str(k), *("" if np.isnan(value) else f"{value:.5g}" for value in rows[k][1:]))
            for k in shown
        ]
        header = ("step", *data.states, *data.inputs)
        line = f"A - B K has the spectral radius {self.radius:.7g}; cost {data.cost:.7g}"
        return Report(
            f"Flight of {data.plant} in {count} steps, {self.policy}: {verdict}",
            (line, Table(header, texts)),
            data=data.to_dict(),
            records=Table(header, rows),
        )


def fly_steps(
    problem: DiscreteGame, K: np.ndarray, policy: str, start: np.ndarray, count: int
) -> StepFlight:
    """The flight of u = -K x, (m, n), from a state, (n,), of so many steps.

    NoSolutionError where it leaves all bounds on the way.
    """
    step = problem.step
    loop = step.A - step.B @ K
    weights = problem.q_function(np.zeros_like(loop))
    states = [np.asarray(start, dtype=float)]
    for k in range(count):
        states.append(loop @ states[-1])
        if not (np.abs(states[-1]) <= LARGEST**0.5).all():
            raise NoSolutionError(f"the state grows without bound: beyond 1e50 at step {k + 1}")
    before = np.array(states[:-1])
    inputs = -before @ K.T
    together = np.hstack([before, inputs])
    weights = weights[: together.shape[1], : together.shape[1]]
    costs = np.einsum("ki,ij,kj->k", together, weights, together)
    return StepFlight(
        problem,
        policy,
        np.array(states),
        inputs,
        problem.discount ** np.arange(count) * costs,
        float(np.abs(np.linalg.eigvals(loop)).max()),
    )
