"""Assessment of a deployed policy at several trims: equilibria, sampled loops and flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.judge.action_effects import action_effects
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.cost_above_optimum import CostAboveOptimum, cost_above_optimum
from hfa_flight.judge.outcomes import Outcomes, TrimCase, fly_cases, refuse_edges
from hfa_flight.judge.resolved_flight import resolved_flight
from hfa_flight.judge.weights import has_weights
from hfa_flight.needs import ALL, SAMPLES
from hfa_flight.plan.initial_box import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium, EquilibriumSearch
from hfa_flight.policies.deployment.sampled_loop import (
    Chain,
    Delays,
    Margins,
    chain_of,
    delays,
    margins,
)
from hfa_flight.simulate.sampled_flights import SampledFlight
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from trim.point.operating_point import OperatingPoint

#: Longest integration step of flights whose step is halved until it is short enough, in time
#: constants of the fastest mode. The error is usually 2e-5 of a deviation.
_LONGEST_CHECKED = 0.5


@dataclass(frozen=True, eq=False)
class Assessor:
    """Assessment of a deployment at several trims of one aircraft.

    deployed: the policy on the aircraft.
    points: the trims.
    samples: number of initial conditions at each trim.
    seed: seed of the initial conditions.
    box: linear state -> half-width of the initial-condition box, instead of the usual half-width.
    share: share of the flights that must converge.
    """

    deployed: Deployed
    points: tuple[OperatingPoint, ...]
    samples: int = SAMPLES
    seed: int = 0
    box: Mapping[str, float] = field(default_factory=dict)
    share: float = ALL

    def assessed(self, progress: Progress | None = None) -> list[AssessedPoint]:
        """Assess the policy at each trim.

        Raises BadInputError for a trim at the limit of a state, for the weight of an output that
        depends on the inputs, or if an observation, the policy or a map is not finite at a trim.
        """
        refuse_edges(self.points)
        self.deployed.refuse_undefined_at(self.points)
        cases = [self._case(point) for point in self.points]
        plain: Sequence[Outcomes | None] = [None] * len(cases)
        disturbed = plain
        error = None
        if self.samples:
            flight, error = resolved_flight(self._flight(cases), cases, self.seed)
            plain, disturbed = fly_cases(flight, cases, self.samples, self.seed, progress)
        with ThreadPoolExecutor() as pool:
            late = [*pool.map(self._delays, cases)]
        rows = zip(cases, late, plain, disturbed, strict=True)
        return [replace(self._point(*row), integration=error) for row in rows]

    def _case(self, point: OperatingPoint) -> TrimCase:
        """Return one trim with its box, equilibrium and sampled loop."""
        widths = start_box(self.deployed.model, point)
        for name, width in self.box.items():
            widths[self.deployed.model.linear.index(name)] = width
        timing = self.deployed.deployment
        equilibrium = EquilibriumSearch(self.deployed, point).equilibrium()
        if equilibrium is None:
            return TrimCase(point, widths)
        return TrimCase(point, widths, equilibrium, chain_of(equilibrium, timing.dt, timing.delay))

    def _flight(self, cases: Sequence[TrimCase]) -> SampledFlight:
        """Return the simulation of sampled flights that begin near the trims."""
        deployment = self.deployed.deployment
        boxes = [case.box for case in cases]
        parts = parts_of_a_sample(self.points, deployment.dt, boxes, longest=_LONGEST_CHECKED)
        return SampledFlight(self.deployed, deployment.dt, deployment.delay, parts)

    def _delays(self, case: TrimCase) -> Delays | None:
        deployment = self.deployed.deployment
        if case.equilibrium is None:
            return None
        return delays(case.equilibrium, deployment.dt, deployment.delay)

    def _point(
        self,
        case: TrimCase,
        loop_delays: Delays | None,
        flown: Outcomes | None,
        disturbed: Outcomes | None,
    ) -> AssessedPoint:
        """Return the result at a trim, without the comparison of costs."""
        linearized = case.equilibrium
        if linearized is None or linearized.clips:
            linearized = EquilibriumSearch(self.deployed, case.point).at_trim()
        found = AssessedPoint(
            deployed=self.deployed,
            case=case,
            delays=loop_delays,
            margins=None,
            cost=None,
            flights=flown,
            disturbed=disturbed,
            actions=tuple(action_effects(self.deployed, linearized)),
            share=self.share,
        )
        if case.equilibrium is None or case.loop is None:
            return found
        remarks: list[str] = []
        return replace(
            found,
            margins=_margins(case.loop, remarks),
            cost=self._cost(case.equilibrium, remarks),
            remarks=tuple(remarks),
        )

    def _cost(self, equilibrium: Equilibrium, remarks: list[str]) -> CostAboveOptimum | None:
        """Return the cost above the optimum, or None without weights or an optimum."""
        if not has_weights(self.deployed):
            return None
        lost = cost_above_optimum(self.deployed, equilibrium)
        if isinstance(lost, str):
            remarks.append(lost)
            return None
        return lost


def _margins(loop: Chain, remarks: list[str]) -> Margins | None:
    """Return the margins of a stable loop, or None."""
    if loop.radius >= 1.0:
        return None
    try:
        return margins(loop)
    except (NoSolutionError, np.linalg.LinAlgError):
        remarks.append("the margins could not be computed")
        return None
