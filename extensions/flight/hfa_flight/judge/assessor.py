"""Assessment of a deployed policy at several trims: equilibria, sampled loops and flights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.judge.action_effects import action_effects
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.cost_above_optimum import CostAboveOptimum, cost_above_optimum
from hfa_flight.judge.outcomes import Outcomes, Place, ends_from_trim, fly_places, refuse_edges
from hfa_flight.judge.reach import HORIZON, Reach, reach_of, seconds_to_converge
from hfa_flight.judge.resolved_flight import resolved_flight
from hfa_flight.judge.weights import has_weights
from hfa_flight.needs import ALL, SAMPLES
from hfa_flight.plan.initial_box import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium, EquilibriumSearch, whole_turns
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

#: Duration of the flight from the trim that ends at the equilibrium, s.
_TO_REST = 200.0
#: Longest integration step of flights whose step is halved until it is short enough, in time
#: constants of the fastest mode. The error is usually 2e-5 of a deviation.
_LONGEST_CHECKED = 0.5
#: Two equilibria closer than this are equal, in half-widths of the initial-condition box.
_ELSEWHERE = 1e-3


@dataclass(frozen=True, eq=False)
class Assessor:
    """Assessment of a deployment at several trims of one aircraft.

    deployed: the policy on the aircraft.
    points: the trims.
    samples: number of initial conditions at each trim.
    seed: seed of the initial conditions.
    box: linear state -> half-width of the initial-condition box, instead of the usual half-width.
    steady: original trim if the points are on a changed aircraft, otherwise None.
    share: share of the flights that must converge.
    """

    deployed: Deployed
    points: tuple[OperatingPoint, ...]
    samples: int = SAMPLES
    seed: int = 0
    box: Mapping[str, float] = field(default_factory=dict)
    steady: OperatingPoint | None = None
    share: float = ALL

    def flight(self) -> SampledFlight:
        """Return the simulation of sampled flights that begin near the trims."""
        deployment = self.deployed.deployment
        boxes = [self._widths(point) for point in self.points]
        is_checked = self.samples > 0 and self.steady is None
        step = {"longest": _LONGEST_CHECKED} if is_checked else {}
        parts = parts_of_a_sample(self.points, deployment.dt, boxes, **step)
        return SampledFlight(self.deployed, deployment.dt, deployment.delay, parts)

    def places(self, flight: SampledFlight) -> list[Place]:
        """Return each trim with its equilibrium, initial-condition box and modes, in order.

        flight: result of the method `flight`
        """
        searches = [EquilibriumSearch(self.deployed, point, self.steady) for point in self.points]
        equilibria = [search.from_point(search.point.x, search.point.u) for search in searches]
        samples = flight.compiled(len(self.points), _TO_REST + 2 * HORIZON * self.samples)
        states, inputs = ends_from_trim(flight, list(self.points), samples, _TO_REST)
        places = []
        for number, search in enumerate(searches):
            widths = self._widths(search.point)
            equilibrium = equilibria[number]
            turns = search.turns()
            end = states[number]
            if np.isfinite(end).all():
                moved = (end - search.point.x)[search.rows]
                end[search.rows] -= whole_turns(moved, turns)
                elsewhere = search.from_point(end, inputs[number])
                equilibrium = _nearer(equilibrium, elsewhere, end, search, widths)
            places.append(self._place(search, widths, turns, equilibrium))
        return places

    def _place(
        self,
        search: EquilibriumSearch,
        widths: np.ndarray,
        turns: np.ndarray,
        equilibrium: Equilibrium | None,
    ) -> Place:
        """Return the description of one trim for flights: box, equilibrium and modes."""
        point = search.point
        if equilibrium is None:
            return Place(point, widths, turns, None, False, steady=self.steady)
        reach = reach_of(self.deployed, equilibrium, widths)
        chain = self._chain(reach)
        drift = search.drift(equilibrium)
        return Place(
            point,
            widths,
            turns,
            equilibrium,
            stable=chain.radius < 1.0,
            reach=reach,
            seconds=seconds_to_converge(chain.radius, chain.dt),
            drift=drift,
            lag=search.lag(equilibrium, drift),
            steady=self.steady,
        )

    def _widths(self, point: OperatingPoint) -> np.ndarray:
        widths = start_box(self.deployed.model, point)
        for name, width in self.box.items():
            widths[self.deployed.model.linear.index(name)] = width
        return widths

    def _chain(self, reach: Reach) -> Chain:
        """Return the sampled loop with the deployed delay, restricted to the modes within reach."""
        deployment = self.deployed.deployment
        return chain_of(reach.loop, deployment.dt, deployment.delay)

    def assessed(self, progress: Progress | None = None) -> list[AssessedPoint]:
        """Assess the policy at each trim.

        Raises BadInputError for a trim at the limit of a state, for the weight of an output that
        depends on the inputs, or if an observation, the policy or a map is not finite at a trim.
        """
        refuse_edges(self.points)
        self.deployed.refuse_undefined_at(self.points)
        flight = self.flight()
        places = self.places(flight)
        plain: Sequence[Outcomes | None] = [None] * len(places)
        disturbed = plain
        error = None
        if self.samples and self.steady is None:
            flight, error = resolved_flight(flight, places, self.seed)
        if self.samples:
            plain, disturbed = fly_places(flight, places, self.samples, self.seed, progress)
        with ThreadPoolExecutor() as pool:
            late = [*pool.map(self._delays, places)]
        rows = zip(places, late, plain, disturbed, strict=True)
        return [replace(self._point(*row), integration=error) for row in rows]

    def _delays(self, place: Place) -> Delays | None:
        deployment = self.deployed.deployment
        if place.reach is None:
            return None
        return delays(place.reach.loop, deployment.dt, deployment.delay)

    def _point(
        self,
        place: Place,
        loop_delays: Delays | None,
        flown: Outcomes | None,
        pushed: Outcomes | None,
    ) -> AssessedPoint:
        """Return the result at a trim, without comparison of costs and flights in moving air."""
        search = EquilibriumSearch(self.deployed, place.point, self.steady)
        found = AssessedPoint(
            deployed=self.deployed,
            point=place.point,
            place=place,
            slowest=math.nan,
            delays=loop_delays,
            margins=None,
            cost=None,
            flights=flown,
            disturbed=pushed,
            actions=tuple(action_effects(self.deployed, place, search)),
            share=self.share,
        )
        if place.equilibrium is None or place.reach is None:
            return found
        chain = self._chain(place.reach)
        remarks: list[str] = []
        return replace(
            found,
            slowest=chain.slowest,
            margins=_margins(chain, remarks),
            cost=self._cost(place.reach, chain, remarks),
            remarks=tuple(remarks),
        )

    def _cost(self, reach: Reach, chain: Chain, remarks: list[str]) -> CostAboveOptimum | None:
        """Return the cost above the optimum, or None without weights or an optimum."""
        if not has_weights(self.deployed):
            return None
        lost = cost_above_optimum(self.deployed, reach.loop, chain)
        if isinstance(lost, str):
            remarks.append(lost)
            return None
        return lost


def _margins(chain: Chain, remarks: list[str]) -> Margins | None:
    """Return the margins of a stable loop, or None."""
    if chain.radius >= 1.0:
        return None
    try:
        return margins(chain)
    except (NoSolutionError, np.linalg.LinAlgError):
        remarks.append("the margins could not be computed")
        return None


def _nearer(
    equilibrium: Equilibrium | None,
    elsewhere: Equilibrium | None,
    end: np.ndarray,
    search: EquilibriumSearch,
    widths: np.ndarray,
) -> Equilibrium | None:
    """Return the equilibrium to which flights from a trim converge, or None."""
    if elsewhere is None:
        return equilibrium
    if equilibrium is None:
        return elsewhere
    rows = search.rows
    from_end = np.abs(elsewhere.states - end)[rows] / widths
    apart = np.abs(elsewhere.states - equilibrium.states)[rows] / widths
    if from_end.max() < _ELSEWHERE <= apart.max():
        return elsewhere
    return equilibrium
