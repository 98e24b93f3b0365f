"""Assessment of a deployed policy at several trims: equilibria, sampled loops and flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from hfa_aircraft.batch_simulation import Figures, IntegrationError, ReportedFigure, resolved
from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.air.sensors import Sensor
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.outcomes import (
    BALL,
    ExactFlights,
    TrimCase,
    exact_flights,
    fly_cases,
    refuse_edges,
    seeded_starts,
)
from hfa_flight.needs import ALL, SAMPLES, SHARE
from hfa_flight.plan.problem import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import MOST_SAMPLES
from hfa_flight.policies.deployment.sampled_loop import (
    EquilibriumSearch,
    chain_margins,
    chain_of_loop,
)
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.sampled_flights import SampledFlight
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from trim.linear.delays import Delays, searched_delays
from trim.point.operating_point import OperatingPoint

#: Largest duration (s) and number of samples of a flight.
_LONGEST_FLIGHT = 10.0
_MOST_SAMPLES = 1000
#: Number of flights from each trim whose integration error is computed.
_CHECKED_FLIGHTS = 2
#: Nominal values of the states to which changes of smaller deviations are relative.
_SMALL_DEVIATION = 1e-3


def resolved_flight(
    flight: SampledFlight, cases: Sequence[TrimCase], seed: int
) -> tuple[SampledFlight, IntegrationError]:
    """Return the aircraft with so many integration steps in a sample that flights are resolved.

    `_CHECKED_FLIGHTS` flights from each trim are compared with the same flights with half the step.

    seed: seed of the initial conditions
    """
    model = flight.deployed.model

    def flown(refinement: int) -> tuple[SampledFlight, np.ndarray]:
        """Return the flights with so many times the integration steps, and largest deviations."""
        finer = replace(flight, steps_per_sample=refinement * flight.steps_per_sample)
        return finer, _largest_deviations(finer, cases, seed)

    def figures(flown: tuple[SampledFlight, np.ndarray]) -> Figures:
        """Return the figures that must hardly change: the largest deviations of linear states."""
        largest = dict(zip(model.states, flown[1].tolist(), strict=True))
        return {
            f"the largest deviation of {name}": ReportedFigure(
                largest[name], least=_SMALL_DEVIATION * model.states[name].nominal
            )
            for name in model.linear
        }

    # Refined until the figures hardly change.
    (checked, _), error = resolved(flown, figures, flight.dt / flight.steps_per_sample)
    return checked, error


def _largest_deviations(flight: SampledFlight, cases: Sequence[TrimCase], seed: int) -> np.ndarray:
    """Return the largest deviation of each state from the trim, within the envelope, (n,)."""
    deployed = flight.deployed
    owners = np.repeat(np.arange(len(cases)), _CHECKED_FLIGHTS)
    starts = np.vstack(
        [seeded_starts(case, _CHECKED_FLIGHTS, seed, with_pulse=False)[0] for case in cases]
    )
    trims = np.array([deployed.trim_vector(case.point) for case in cases])[owners]
    seconds = min(_LONGEST_FLIGHT, _MOST_SAMPLES * flight.dt)
    ticks = flight.samples_in_window * flight.windows(seconds)
    loop = flight.compiled(len(owners), seconds)
    flown, _ = loop.fly(flight.start(starts, trims), trims, ticks)
    lowest, highest = flight.extremes(flown.states)
    envelopes = [flight_envelope(deployed.model, case.point) for case in cases]
    least = np.array([envelope.least for envelope in envelopes])[owners, None]
    most = np.array([envelope.most for envelope in envelopes])[owners, None]
    # Samples of a flight from the first one outside the envelope on do not count. The initial
    # condition always counts.
    inside = np.logical_and.accumulate(flight.stays(flown.states, least, most), axis=1)
    inside[:, 0] = True
    trim = trims[:, None, : lowest.shape[2]]  # the states, before inputs and parameters
    farthest = np.maximum(highest - trim, trim - lowest)
    deviations: np.ndarray = np.where(inside[:, :, None], farthest, 0.0).max(axis=(0, 1))
    return deviations


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
    needs: requirement -> required value, as in `assess`; with that of "delay", flights are
        simulated, too.
    sensors: what is measured -> `Sensor`. Flights, but those of the exact gain, have their errors.
    """

    deployed: Deployed
    points: tuple[OperatingPoint, ...]
    samples: int = SAMPLES
    seed: int = 0
    box: Mapping[str, float] = field(default_factory=dict)
    needs: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)

    def assessed(self, progress: Progress | None = None) -> list[AssessedPoint]:
        """Assess the policy at each trim.

        Raises BadInputError for a trim at the limit of a state, for the weight of an output that
        depends on the inputs, or if an observation, the policy or a map is not finite at a trim.
        """
        refuse_edges(self.points)
        self.deployed.refuse_undefined_at(self.points)
        self.deployed.sensing(self.sensors)  # refuses what the policy cannot see
        cases = [self._case(point) for point in self.points]
        with ThreadPoolExecutor() as pool:  # a loop that tolerates all delays takes seconds
            delays = pool.map(self._delays, cases)
        points = [*map(self._linear_point, cases, delays)]
        if not self.samples:
            return points
        flight, error = resolved_flight(self._flight(cases), cases, self.seed)
        exact = [ExactFlights()] * len(cases)
        for number, case in enumerate(cases):
            try:
                shrinks = not self.box
                exact[number] = exact_flights(flight, case, self.samples, self.seed, shrinks)
            except NoSolutionError as failure:
                remark = f"no costs are compared: {failure}"
                points[number] = replace(points[number], remarks=(*points[number].remarks, remark))
        flight = replace(flight, sensors=self.sensors)
        flown = fly_cases(flight, cases, exact, self.samples, self.seed, progress)
        points = [
            replace(
                point,
                flights=of.plain,
                disturbed=of.disturbed,
                box=of.box,
                costs=of.costs,
                integration=error,
            )
            for point, of in zip(points, flown, strict=True)
        ]
        if "delay" in self.needs:
            delayed = replace(flight, delay=max(self.needs["delay"], flight.delay))
            same_boxes = [ExactFlights(box=of.box) for of in exact]
            late = fly_cases(delayed, cases, same_boxes, self.samples, self.seed, None)
            points = [replace(at, late=of.plain) for at, of in zip(points, late, strict=True)]
        return points

    def _case(self, point: OperatingPoint) -> TrimCase:
        """Return one trim with its box, equilibrium and sampled loop."""
        widths = start_box(self.deployed.model, point)
        for name, width in self.box.items():
            widths[self.deployed.model.linear.index(name)] = width
        equilibrium = EquilibriumSearch(self.deployed, point).equilibrium()
        if equilibrium is None:
            return TrimCase(point, widths)
        timing = self.deployed.deployment
        loop = chain_of_loop(equilibrium.nominal, timing.dt, timing.delay)
        return TrimCase(point, widths, equilibrium, loop)

    def _flight(self, cases: Sequence[TrimCase]) -> SampledFlight:
        """Return the simulation of sampled flights that begin near the trims."""
        deployment = self.deployed.deployment
        boxes = [case.box for case in cases]
        parts = parts_of_a_sample(self.points, deployment.dt, boxes, longest=_LONGEST_CHECKED)
        return SampledFlight(self.deployed, deployment.dt, deployment.delay, parts)

    def _delays(self, case: TrimCase) -> Delays | None:
        """Return the effect of delays on the sampled loop, or None without an equilibrium."""
        if case.equilibrium is None:
            return None
        timing, nominal = self.deployed.deployment, case.equilibrium.nominal
        loop = partial(chain_of_loop, nominal, timing.dt)
        return searched_delays(loop, timing.dt, timing.delay, MOST_SAMPLES)

    def _linear_point(self, case: TrimCase, delays: Delays | None) -> AssessedPoint:
        """Return the result of the linear loop at a trim, without flights."""
        point = AssessedPoint(self.deployed, case, share=self.needs.get(SHARE, ALL))
        at_kink = case.equilibrium is not None and case.equilibrium.is_nonsmooth
        if at_kink or not _has_slope(self.deployed, case):
            steps = (
                "no linear figures: the slope of the policy at the trim is not that over its "
                "kinks, steps or noise; the flights decide"
            )
            return replace(point, case=replace(case, loop=None), remarks=(steps,))
        if case.loop is None:
            return point
        try:
            margins = None if case.radius >= 1.0 else chain_margins(case.loop)
        except (NoSolutionError, np.linalg.LinAlgError):
            return replace(point, delays=delays, remarks=("the margins could not be computed",))
        return replace(point, delays=delays, margins=margins)


#: Deviations, in half-widths of the box, over which a slope is compared with the derivative, and
#: larger ones, over which a policy may saturate but not act more than its derivative says.
_NEAR = (1e-3, 1e-2, BALL)
_FAR = (0.2, 1.0)
#: Factor between slope and derivative above which a policy has another slope.
_OTHER_SLOPE = 2.0


def _has_slope(deployed: Deployed, case: TrimCase) -> bool:
    """Return whether the derivative of a policy at a trim is its slope over small deviations."""
    point, trim = case.point, deployed.trim_vector(case.point)
    model = point.model
    columns = model.input_places(deployed.commanded)
    units = model.nominal(deployed.commanded)[:, None]
    rows = model.state_places(model.linear)
    derivative = EquilibriumSearch(deployed, point).at_trim().K * case.box / units

    def command(x: np.ndarray) -> np.ndarray:
        return np.array(deployed.command(x, point.u, trim)).ravel()[columns]

    size = np.linalg.norm(derivative)
    for share in (*_NEAR, *_FAR):
        slopes = np.empty_like(derivative)
        for number, (row, width) in enumerate(zip(rows, case.box.tolist(), strict=True)):
            step = np.zeros(len(model.states))
            step[row] = share * width
            both = command(point.x + step) - command(point.x - step)
            slopes[:, number] = both / (2.0 * share)
        slope = np.linalg.norm(slopes / units)
        if slope > _OTHER_SLOPE * size or (share in _NEAR and size > _OTHER_SLOPE * slope):
            return False
    return True
