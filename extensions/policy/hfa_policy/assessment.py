"""Assessment of a deployed policy at each trim."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_flight.held_step import parts_of_a_sample
from hfa_flight.initial_box import start_box
from hfa_flight.limit_cycle import LimitCycle
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium, EquilibriumSearch, whole_turns
from hfa_flight.policies.deployment.sampled_loop import (
    Chain,
    Delays,
    Margins,
    chain_of,
    delays,
    margins,
    slowest_swing,
)
from hfa_optimal.bracket import BestCosts
from hfa_policy.cost_above_optimum import CostAboveOptimum, cost_above_optimum
from hfa_policy.evidence import (
    ActionEffect,
    ObservationRange,
    action_effects,
    observation_ranges,
)
from hfa_policy.flights import SampledFlight
from hfa_policy.nonlinearity import Nonlinearity, nonlinearity
from hfa_policy.outcomes import (
    Outcomes,
    Place,
    departure_text,
    ends_from_trim,
    fly_places,
    refuse_edges,
)
from hfa_policy.reach import (
    HORIZON,
    OwnMode,
    Reach,
    left_alone,
    reach_of,
    seconds_to_converge,
)
from hfa_policy.rough_flights import RoughFlights
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.results import UNSTORED, Result, stored, stored_as, stored_parts
from hfa_support.reporting.text import short_number, shown_unit
from trim.point.operating_point import OperatingPoint

#: Default number of flights at each trim.
SAMPLES = 300
#: Fraction of the flights that must converge for a policy to hold.
_MOST_OF_THEM = 0.5
#: Duration of the flight from the trim that ends at the equilibrium, s.
_TO_REST = 200.0
#: Two equilibria closer than this are equal, in half-widths of the initial-condition box.
_ELSEWHERE = 1e-3


@dataclass(frozen=True, eq=False)
class AssessedPoint(Result):
    """Assessment of a policy at one trim.

    deployed: the policy on its aircraft.
    point: the trim.
    place: initial-condition box and equilibrium.
    radius: spectral radius of the sampled loop with the deployed delay, or nan without an
        equilibrium.
    delays: spectral radii with other delays, or None without an equilibrium.
    margins: margins of the loop, or None without an equilibrium, if the loop is unstable, or if the
        computation fails.
    cost: cost above the optimum, or None without an equilibrium, weights or an optimum.
    nonlinearity: largest deviation of the command from its linearization over the initial-condition
        box, or None without an equilibrium.
    flights: outcomes from seeded initial conditions, or None without flights.
    disturbed: outcomes from the same initial conditions with a disturbance pulse, or None without
        flights.
    findings: findings at this trim, one sentence each.
    actions: effect of each action beside the exact gain's, or () if there is no exact gain.
    observations: range of each observation in flight beside the training's, or () without flights.
    best: comparison with the best flights found, or None if it was not requested.
    rough: flights with sensor noise or in moving air, or None if they were not requested.
    slowest: eigenvalue of the sampled loop with the largest absolute value, or nan without an
        equilibrium.
    """

    deployed: Deployed = field(metadata=UNSTORED)
    point: OperatingPoint = field(metadata=UNSTORED)
    place: Place = field(metadata=stored_parts(K="equilibrium.K"))
    radius: float = field(metadata=stored_as("spectral_radius"))
    delays: Delays | None = field(
        metadata=stored_parts(
            delay_limit="limit", delay_limit_fine="fine", delay_searched="searched"
        )
    )
    margins: Margins | None = field(metadata=stored_parts(disk_margin="disk.disk"))
    cost: CostAboveOptimum | None = field(metadata=stored_as("cost_lost"))
    nonlinearity: Nonlinearity | None
    flights: Outcomes | None
    disturbed: Outcomes | None
    findings: tuple[str, ...]
    actions: tuple[ActionEffect, ...] = ()
    observations: tuple[ObservationRange, ...] = ()
    best: BestCosts | None = None
    rough: RoughFlights | None = None
    slowest: complex = field(default=math.nan, metadata=UNSTORED)

    @property
    def own_mode(self) -> OwnMode | None:
        """Slow mode of the aircraft that the policy does not control, or None.

        - The policy cannot move or observe some slow modes: the fastest-growing of these modes.
        - Otherwise, if the policy fails without saturation: the slowest mode of the loop if the
          policy hardly changes it.
        - Otherwise, or without an equilibrium: None.

        The policy fails if it does not hold, or if a flight does not converge.
        """
        reach = self.place.reach
        if reach is None:
            return None
        if reach.own:
            return max(reach.own, key=lambda mode: mode.growth)
        converges = self.flights is None or self.flights.returned == self.flights.starts
        is_saturated = bool(reach.loop.clips)
        if is_saturated or (self.holds and converges):
            return None
        return left_alone(self.deployed, reach.loop, self.slowest, self.deployed.deployment.dt)

    @property
    def equilibrium(self) -> Equilibrium | None:
        """Equilibrium of the sampled loop, or None if it does not exist."""
        return self.place.equilibrium

    @property
    @stored()
    def holds(self) -> bool:
        """True if the policy stabilizes the aircraft.

        The sampled loop must be stable at its equilibrium, with no action or input saturated there.
        If flights were simulated, at least half must converge.
        """
        if self.equilibrium is None or self.equilibrium.clips or not self.radius < 1.0:
            return False
        if self.flights is None:
            return True
        return self.flights.returned >= _MOST_OF_THEM * self.flights.starts

    @property
    def chatters(self) -> bool:
        """True if the loop is unstable at its equilibrium, but every flight stays near it.

        The flights stay in a small ball about the equilibrium. An example is a loop at a kink of a
        network.
        """
        if self.equilibrium is None or self.flights is None or not self.radius >= 1.0:
            return False
        return self.flights.returned == self.flights.starts

    @property
    def offset(self) -> np.ndarray:
        """Equilibrium minus trim in the linear states, (k,), defined only with an equilibrium."""
        assert self.equilibrium is not None
        model = self.point.model
        rows = [list(model.states).index(name) for name in model.linear]
        return (self.equilibrium.states - np.array(self.point.states))[rows]

    @property
    @stored()
    def radii(self) -> tuple[float, ...]:
        """Spectral radii of the sampled loop with delays of 0, 1, 2, ... samples.

        The result is () without an equilibrium.
        """
        return () if self.delays is None else self.delays.radii

    @property
    @stored("equilibrium")
    def equilibrium_states(self) -> dict[str, float] | None:
        """State -> value at the equilibrium, or None without an equilibrium."""
        if self.equilibrium is None:
            return None
        return dict(zip(self.point.model.states, self.equilibrium.states.tolist(), strict=True))

    @property
    @stored()
    def equilibrium_inputs(self) -> dict[str, float] | None:
        """Input -> value at the equilibrium, or None without an equilibrium."""
        if self.equilibrium is None:
            return None
        return dict(zip(self.point.model.inputs, self.equilibrium.inputs.tolist(), strict=True))

    def as_data(self) -> dict[str, Any]:
        """Return the entries of the JSON output, including the value of the scheduling variable."""
        return scheduled_value(self.point) | super().as_data()

    @property
    @stored()
    def input_margins(self) -> list[dict[str, float]]:
        """Return gain_low, gain_high, phase_deg and disk of each commanded input.

        The result is [] without margins.
        """
        if self.margins is None:
            return []
        return [
            {
                "gain_low": loop.gain_low,
                "gain_high": loop.gain_high,
                "phase_deg": loop.phase,
                "disk": loop.disk,
            }
            for loop in self.margins.inputs
        ]


def scheduled_value(point: OperatingPoint) -> dict[str, float]:
    """Return {key: value} of the scheduling variable at a trim, or {} if the model has none.

    Angles are in degrees.
    """
    model = point.model
    if not model.schedule:
        return {}
    if model.schedule in model.parameters:
        value = model.parameters[model.schedule].start
    else:
        value = float(point.values[model.schedule])
    return {model.schedule_key: math.degrees(value) if model.schedule_unit == "deg" else value}


class SampledLoop(NamedTuple):
    """Sampled loop about one equilibrium.

    radius: spectral radius, or nan without an equilibrium.
    cost: cost above the optimum, or None without an equilibrium, weights or an optimum.
    """

    radius: float
    cost: CostAboveOptimum | None


@dataclass(frozen=True, eq=False)
class Assessor:
    """Assessment of a deployment at several trims of one aircraft.

    deployed: the policy on the aircraft.
    points: the trims.
    samples: number of initial conditions at each trim.
    seed: seed of the initial conditions.
    box: linear state -> half-width of the initial-condition box, instead of the usual half-width.
    steady: original trim if the points are on a changed aircraft, otherwise None.
    """

    deployed: Deployed
    points: tuple[OperatingPoint, ...]
    samples: int = SAMPLES
    seed: int = 0
    box: Mapping[str, float] = field(default_factory=dict)
    steady: OperatingPoint | None = None

    def flight(self) -> SampledFlight:
        """Return the simulation of sampled flights that begin near the trims."""
        deployment = self.deployed.deployment
        parts = parts_of_a_sample(list(self.points), deployment.dt)
        return SampledFlight(self.deployed, deployment.dt, deployment.delay, parts)

    def places(self, flight: SampledFlight) -> list[Place]:
        """Return each trim with its equilibrium, initial-condition box and modes, in order.

        flight: result of the method `flight`
        """
        searches = [EquilibriumSearch(self.deployed, point, self.steady) for point in self.points]
        equilibria = [
            search.from_point(np.array(search.point.states), np.array(search.point.inputs))
            for search in searches
        ]
        samples = flight.compiled(len(self.points), _TO_REST + 2 * HORIZON * self.samples)
        states, inputs = ends_from_trim(flight, list(self.points), samples, _TO_REST)
        places = []
        for number, search in enumerate(searches):
            widths = self._widths(search.point)
            equilibrium = equilibria[number]
            turns = search.turns()
            end = states[number]
            if np.isfinite(end).all():
                moved = (end - np.array(search.point.states))[search.rows]
                end[search.rows] -= whole_turns(moved, turns)
                elsewhere = search.from_point(end, inputs[number])
                equilibrium = _nearer(equilibrium, elsewhere, end, search, widths)
            places.append(replace(self._place(search, widths, equilibrium), turns=turns))
        return places

    def _place(
        self, search: EquilibriumSearch, widths: np.ndarray, equilibrium: Equilibrium | None
    ) -> Place:
        """Return the description of one trim for flights: box, equilibrium and modes.

        search: search for the equilibrium at this trim
        widths: half-widths of the initial-condition box, (k,)
        equilibrium: the equilibrium, or None if it does not exist
        """
        point = search.point
        if equilibrium is None:
            return Place(point, widths, None, False, steady=self.steady)
        reach = reach_of(self.deployed, equilibrium, widths)
        chain = self._chain(reach)
        drift = search.drift(equilibrium)
        return Place(
            point,
            widths,
            equilibrium,
            stable=chain.radius < 1.0,
            reach=reach,
            seconds=seconds_to_converge(chain.radius, chain.dt),
            # A mode that is not assessed may later move the other modes away from the equilibrium.
            swing=slowest_swing(chain) if reach.decisive.all() else 0.0,
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
        if self.samples:
            plain, disturbed = fly_places(flight, places, self.samples, self.seed, progress)
        with ThreadPoolExecutor() as pool:
            late = [*pool.map(self._delays, places)]
        seen: Sequence[Sequence[ObservationRange]] = [()] * len(places)
        if self.samples:
            seen = observation_ranges(flight, places, self.seed)
        rows = zip(places, late, plain, disturbed, strict=True)
        assessed = [self._point(*row) for row in rows]
        return [
            replace(each, observations=tuple(ranges))
            for each, ranges in zip(assessed, seen, strict=True)
        ]

    def sampled_loops(self) -> list[SampledLoop]:
        """Return the spectral radius and the cost of the sampled loop at each trim.

        No flights are simulated. Raises BadInputError as `assessed` does.
        """
        refuse_edges(self.points)
        self.deployed.refuse_undefined_at(self.points)
        return [self._sampled_loop(place) for place in self.places(self.flight())]

    def _sampled_loop(self, place: Place) -> SampledLoop:
        if place.reach is None:
            return SampledLoop(math.nan, None)
        chain = self._chain(place.reach)
        if self.deployed.deployment.cost is None:
            return SampledLoop(chain.radius, None)
        lost = cost_above_optimum(self.deployed, place.reach.loop, chain)
        return SampledLoop(chain.radius, None if isinstance(lost, str) else lost)

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
        deployment = self.deployed.deployment
        equilibrium = place.equilibrium
        findings: list[str] = []
        radius = math.nan
        slowest: complex = math.nan
        loop_margins: Margins | None = None
        cost: CostAboveOptimum | None = None
        off_slope: Nonlinearity | None = None
        if equilibrium is None or place.reach is None:
            findings.append("no equilibrium exists near the trim")
        else:
            chain = self._chain(place.reach)
            slowest = chain.slowest
            radius = abs(slowest)
            findings += equilibrium_findings(equilibrium, place.reach)
            off_slope = nonlinearity(self.deployed, place.point, equilibrium, place.box)
            if radius < 1.0:
                try:
                    loop_margins = margins(chain)
                except (NoSolutionError, np.linalg.LinAlgError):
                    findings.append("the margins could not be computed")
            if deployment.cost is not None:
                lost = cost_above_optimum(self.deployed, place.reach.loop, chain)
                cost = None if isinstance(lost, str) else lost
                findings += [lost] if isinstance(lost, str) else []
        findings += flight_findings(radius, flown, pushed)
        return AssessedPoint(
            deployed=self.deployed,
            slowest=slowest,
            point=place.point,
            place=place,
            radius=radius,
            delays=loop_delays,
            margins=loop_margins,
            cost=cost,
            nonlinearity=off_slope,
            flights=flown,
            disturbed=pushed,
            findings=tuple(findings),
            actions=tuple(self._actions(place)),
        )

    def _actions(self, place: Place) -> list[ActionEffect]:
        search = EquilibriumSearch(self.deployed, place.point, self.steady)
        return action_effects(self.deployed, place, search)


def _nearer(
    equilibrium: Equilibrium | None,
    elsewhere: Equilibrium | None,
    end: np.ndarray,
    search: EquilibriumSearch,
    widths: np.ndarray,
) -> Equilibrium | None:
    """Return the equilibrium to which flights from a trim converge, or None.

    Two candidates are given, each of which may be None. The result is `elsewhere` if `equilibrium`
    is None, or if the flight from the trim ends at `elsewhere` and `equilibrium` is a different
    point. Otherwise it is `equilibrium`.

    equilibrium: found by Newton's method from the trim
    elsewhere: found by Newton's method from the end of the flight
    end: final states of the flight, (n,)
    widths: half-widths of the initial-condition box, (k,)
    """
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


def equilibrium_findings(equilibrium: Equilibrium, reach: Reach) -> list[str]:
    """Return the findings at an equilibrium, one sentence each.

    The findings concern saturation, clipped observations, modes out of reach and kinks.
    """
    findings = []
    if equilibrium.clips:
        what = " and ".join(equilibrium.clips)
        findings.append(f"saturated at the equilibrium: {what}; not judged as stable")
    if equilibrium.clipped_observations:
        names = ", ".join(equilibrium.clipped_observations)
        findings.append(f"the normalizer clips {names} at the equilibrium")
    findings += [f"{mode.why} the aircraft's own mode {mode.name}" for mode in reach.own]
    if not reach.decisive.all():
        findings.append(f"convergence is judged by the states within reach: {reach.states}")
    if equilibrium.kinks:
        more = len(equilibrium.kinks) - 1
        findings.append(equilibrium.kinks[0] + (f" (and {more} more)" if more else ""))
    return findings


def flight_findings(radius: float, flown: Outcomes | None, pushed: Outcomes | None) -> list[str]:
    """Return the findings of the flights, worst first, or [] without flights.

    radius: spectral radius of the sampled loop
    flown, pushed: outcomes without and with a disturbance pulse
    """
    findings: list[str] = []
    if flown is None or pushed is None:
        return findings
    for outcome, when in ((flown, ""), (pushed, "with a disturbance pulse: ")):
        if outcome.lost:
            text = f"{outcome.lost} of {outcome.starts} flights leave the envelope"
            if outcome.departure is not None:
                text += f", the first: {departure_text(outcome.departure)}"
            findings.append(when + text)
    if flown.cycle is not None:
        findings.append(f"limit cycle: {cycle_text(flown.cycle)}")
    elif pushed.cycle is not None:
        findings.append(f"with a disturbance pulse: limit cycle: {cycle_text(pushed.cycle)}")
    if radius >= 1.0 and flown.returned >= _MOST_OF_THEM * flown.starts:
        findings.append(
            f"unstable at its equilibrium (radius {radius:.4g}), yet {flown.returned} of "
            f"{flown.starts} flights stay near it: it chatters there"
        )
    if flown.elsewhere:
        where = ", ".join(f"{name} {value:.4g}" for name, value in flown.elsewhere_at.items())
        findings.append(
            f"{flown.elsewhere} of {flown.starts} flights converge to another equilibrium: {where}"
        )
    if flown.moving:
        findings.append(
            f"{flown.moving} of {flown.starts} flights have not converged within "
            f"{flown.seconds:.3g} s"
        )
    return findings


def cycle_text(cycle: LimitCycle) -> str:
    """Return signal, amplitude and frequency of a limit cycle as text, with angles in degrees."""
    unit = "" if cycle.unit == "1" else f" {shown_unit(cycle.unit)}"
    size = short_number(cycle.amplitude, cycle.unit)
    return f"{cycle.name} ±{size}{unit} at {cycle.frequency:.3g} rad/s"
