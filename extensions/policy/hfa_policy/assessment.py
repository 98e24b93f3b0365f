"""A policy assessed as it is deployed: at each trim where it rests, whether the sampled loop holds,
with how much delay and margin, at what cost, and what becomes of flights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_policy.cost_lost import CostLost, cost_lost
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.flights import SampledFlight
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.nonlinearity import Nonlinearity, nonlinearity
from hfa_policy.outcomes import HORIZON, Outcome, Place, ends_from_trim, fly_places, start_box
from hfa_policy.rest import Rest, RestSearch
from hfa_policy.sampled_loop import Delays, Margins, chain_of, delays, margins
from hfa_policy.trims import trims_of
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result
from trim.point.operating_point import OperatingPoint

#: Flights at each trim unless asked for.
SAMPLES = 300
#: Part of the starts that must come back where a policy holds.
_MOST_OF_THEM = 0.5
#: Seconds of the flight from the trim that shows where the policy rests.
_TO_REST = 200.0
#: Another point of rest than Newton's from the trim is where the flight ends, in half-widths of the
#: box.
_ELSEWHERE = 1e-3


@dataclass(frozen=True, eq=False)
class AssessedPoint(Result):
    """What a policy does at one trim.

    point: the trim.
    place: its box of starts and its point of rest.
    radius: spectral radius of the sampled loop with the deployed delay; nan without a rest.
    delays: what delays do to it; None without a rest.
    margins: of a stable loop; None else.
    cost: percent lost against the optimum; None where the card has no cost, or has no optimum.
    nonlinearity: how far the command is from its slope at rest over the box of starts; None without
        a rest.
    flights: what becomes of the seeded starts; None where none were asked for.
    disturbed: the same with pushes.
    findings: what to know, a sentence each.
    """

    keys = (
        "holds spectral_radius=radius delay_limit=delays.limit delay_limit_fine=delays.fine "
        "delay_searched=delays.searched radii disk_margin=margins.disk.disk input_margins "
        "rest=rest_states rest_inputs K=rest.K cost_lost=cost nonlinearity flights disturbed "
        "findings"
    )

    point: OperatingPoint
    place: Place
    radius: float
    delays: Delays | None
    margins: Margins | None
    cost: CostLost | None
    nonlinearity: Nonlinearity | None
    flights: Outcome | None
    disturbed: Outcome | None
    findings: tuple[str, ...]

    @property
    def rest(self) -> Rest | None:
        """Where the policy holds the aircraft."""
        return self.place.rest

    @property
    def holds(self) -> bool:
        """Whether the sampled loop is stable at its point of rest with no action or input held by a
        clip there, and at least half of the starts come back."""
        if self.rest is None or self.rest.clips or not self.radius < 1.0:
            return False
        if self.flights is None:
            return True
        return self.flights.returned >= _MOST_OF_THEM * self.flights.starts

    @property
    def buzzes(self) -> bool:
        """Whether every start comes back to a small ball about a point of rest that is unstable
        itself, as in a kink of a network."""
        if self.rest is None or self.flights is None or not self.radius >= 1.0:
            return False
        return self.flights.returned == self.flights.starts

    @property
    def rest_offset(self) -> np.ndarray:
        """How far from the trim it rests, (k,), the linear states."""
        assert self.rest is not None
        model = self.point.model
        rows = [list(model.states).index(name) for name in model.linear]
        return (self.rest.states - np.array(self.point.states))[rows]

    @property
    def radii(self) -> tuple[float, ...]:
        """Spectral radius with 0, 1, 2, ... whole samples of delay."""
        return () if self.delays is None else self.delays.radii

    @property
    def rest_states(self) -> dict[str, float] | None:
        """Where it rests, by state."""
        if self.rest is None:
            return None
        return dict(zip(self.point.model.states, self.rest.states.tolist(), strict=True))

    @property
    def rest_inputs(self) -> dict[str, float] | None:
        """Inputs there."""
        if self.rest is None:
            return None
        return dict(zip(self.point.model.inputs, self.rest.inputs.tolist(), strict=True))

    def as_data(self) -> dict[str, Any]:
        """The value of the scheduling variable by its key, and the entries."""
        return scheduled_value(self.point) | super().as_data()

    @property
    def input_margins(self) -> list[dict[str, float]]:
        """Of each commanded input: gain_low, gain_high, phase_deg, disk."""
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
    """The value of the scheduling variable by its key; nothing where the model has none."""
    model = point.model
    if not model.schedule:
        return {}
    if model.schedule in model.parameters:
        value = model.parameters[model.schedule].start
    else:
        value = float(point.values[model.schedule])
    return {model.schedule_key: math.degrees(value) if model.schedule_unit == "deg" else value}


@dataclass(frozen=True, eq=False)
class Assessor:
    """Assesses a deployment at several trims of one aircraft.

    deployed: the policy on the aircraft.
    points: its trims.
    samples: flights at each; 0 for none.
    seed: that decides their starts.
    box: linear state -> half-width of the box of starts, in place of the usual.
    """

    deployed: Deployed
    points: tuple[OperatingPoint, ...]
    samples: int = SAMPLES
    seed: int = 0
    box: Mapping[str, float] = field(default_factory=dict)

    def flight(self) -> SampledFlight:
        """What the flights have in common."""
        deployment = self.deployed.deployment
        parts = parts_of_a_sample(list(self.points), deployment.dt)
        return SampledFlight(self.deployed, deployment.dt, deployment.delay, parts)

    def places(self, flight: SampledFlight) -> list[Place]:
        """Where the policy rests at each trim, and the box of starts about the trim."""
        searches = [RestSearch(self.deployed, point) for point in self.points]
        rests = [
            search.from_point(np.array(search.point.states), np.array(search.point.inputs))
            for search in searches
        ]
        window = flight.window(len(self.points), _TO_REST + 2 * HORIZON * self.samples)
        states, inputs = ends_from_trim(flight, list(self.points), window, _TO_REST)
        places = []
        for number, search in enumerate(searches):
            widths = self._widths(search.point)
            rest = rests[number]
            if np.isfinite(states[number]).all():
                elsewhere = search.from_point(states[number], inputs[number])
                rest = _nearer(rest, elsewhere, states[number], search, widths)
            stable = rest is not None and self._radius(rest) < 1.0
            places.append(Place(search.point, widths, rest, stable))
        return places

    def _widths(self, point: OperatingPoint) -> np.ndarray:
        widths = start_box(self.deployed.model, point)
        for name, width in self.box.items():
            widths[self.deployed.model.linear.index(name)] = width
        return widths

    def _radius(self, rest: Rest) -> float:
        deployment = self.deployed.deployment
        return chain_of(rest, deployment.dt, deployment.delay).radius

    def assessed(self, progress: Progress | None = None) -> list[AssessedPoint]:
        """What the policy does at each trim."""
        self.deployed.refuse_undefined_at(self.points)
        flight = self.flight()
        places = self.places(flight)
        plain: Sequence[Outcome | None] = [None] * len(places)
        disturbed = plain
        if self.samples:
            plain, disturbed = fly_places(flight, places, self.samples, self.seed, progress)
        with ThreadPoolExecutor() as pool:
            late = [*pool.map(self._delays, places)]
        rows = zip(places, late, plain, disturbed, strict=True)
        return [self._point(*row) for row in rows]

    def _delays(self, place: Place) -> Delays | None:
        deployment = self.deployed.deployment
        if place.rest is None:
            return None
        return delays(place.rest, deployment.dt, deployment.delay)

    def _point(
        self,
        place: Place,
        loop_delays: Delays | None,
        flown: Outcome | None,
        pushed: Outcome | None,
    ) -> AssessedPoint:
        deployment = self.deployed.deployment
        rest = place.rest
        findings: list[str] = []
        radius = math.nan
        loop_margins: Margins | None = None
        cost: CostLost | None = None
        off_slope: Nonlinearity | None = None
        if rest is None:
            findings.append("there is no point of rest near the trim")
        else:
            chain = chain_of(rest, deployment.dt, deployment.delay)
            radius = chain.radius
            findings += rest_findings(rest)
            off_slope = nonlinearity(self.deployed, place.point, rest, place.box)
            if radius < 1.0:
                try:
                    loop_margins = margins(chain)
                except (NoSolutionError, np.linalg.LinAlgError):
                    findings.append("the margins could not be computed")
            if deployment.cost is not None:
                lost = cost_lost(self.deployed, rest, chain)
                cost = None if isinstance(lost, str) else lost
                findings += [lost] if isinstance(lost, str) else []
        findings += flight_findings(radius, flown, pushed)
        return AssessedPoint(
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
        )


def _nearer(
    rest: Rest | None,
    elsewhere: Rest | None,
    end: np.ndarray,
    search: RestSearch,
    widths: np.ndarray,
) -> Rest | None:
    """The point of rest at which the flight from the trim ends, where it ends at one; else that of
    Newton's method from the trim."""
    if elsewhere is None:
        return rest
    if rest is None:
        return elsewhere
    rows = search.rows
    from_end = np.abs(elsewhere.states - end)[rows] / widths
    apart = np.abs(elsewhere.states - rest.states)[rows] / widths
    if from_end.max() < _ELSEWHERE <= apart.max():
        return elsewhere
    return rest


def rest_findings(rest: Rest) -> list[str]:
    """What a clip holds at rest."""
    findings = []
    if rest.clips:
        what = " and ".join(rest.clips)
        findings.append(f"rests with {what}: its slope is 0 there, it is not judged as stable")
    if rest.clipped_observations:
        names = ", ".join(rest.clipped_observations)
        findings.append(f"the normalizer clips {names} at rest: the policy does not see it there")
    return findings


def flight_findings(radius: float, flown: Outcome | None, pushed: Outcome | None) -> list[str]:
    """What the flights add to the spectral radius."""
    findings: list[str] = []
    if flown is None or pushed is None:
        return findings
    if flown.cycle is not None:
        findings.append(f"limit cycle: {flown.cycle.motion()}")
    elif pushed.cycle is not None:
        findings.append(f"disturbed: limit cycle: {pushed.cycle.motion()}")
    if radius >= 1.0 and flown.returned >= _MOST_OF_THEM * flown.starts:
        findings.append(
            f"unstable at its point of rest (radius {radius:.4g}), yet {flown.returned} of "
            f"{flown.starts} flights stay near it: it buzzes there"
        )
    if flown.elsewhere:
        where = ", ".join(f"{name} {value:.4g}" for name, value in flown.elsewhere_at.items())
        findings.append(f"{flown.elsewhere} of {flown.starts} flights rest elsewhere, at {where}")
    if radius < 1.0 and flown.returned < _MOST_OF_THEM * flown.starts:
        findings.append(
            f"stable at its point of rest, yet only {flown.returned} of {flown.starts} starts "
            "come back to it"
        )
    return findings


def assess(
    model: Model,
    deployment: Deployment,
    points: Sequence[Any] | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
) -> Any:
    """Assess a policy as it is deployed.

    model: the aircraft
    deployment: what the policy observes, what its actions move, and when
    points: operating points, or values of the scheduling variable in the units of the model; its
        own trim unless given
    samples: flights at each trim, with and without disturbance; 0 for none
    seed: that decides their starts
    progress: called during the flights

    BadInputError where the deployment is not of this aircraft, TrimError where there is no trim.

    >>> import casadi as ca
    >>> import hfa
    >>> o = ca.SX.sym("o", 2)
    >>> card = hfa.Deployment(
    ...     policy={"file": ca.Function("policy", [o], [0.1 * o[1]])},
    ...     observation={"speed": {"scale": 10.0}, "pitch": {}},
    ...     action={"elevator_center": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    ...     timing={"dt": 0.02},
    ... )
    >>> hfa.assess(hfa.aircraft(), card, [0.1], samples=0).points[0].holds
    True
    """
    from hfa_policy.assessment_report import Assessment
    from hfa_policy.mistakes import mistakes_of

    deployed = deployment.on(model)
    assessor = Assessor(deployed, trims_of(model, points), samples, seed)
    assessed = assessor.assessed(progress)
    return Assessment(deployed, tuple(assessed), tuple(mistakes_of(assessor, assessed)))
