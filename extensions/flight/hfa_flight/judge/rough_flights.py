"""Flights of a deployed policy from its trim with sensor noise, a gust or turbulence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.policy import policy_about, sampled_scenario
from hfa_flight.policies.filtered_policy import behind_own_filter
from hfa_flight.samples.monte_carlo import MonteCarlo, fly_member, member_row
from hfa_flight.simulate.envelope import Departure, flight_envelope
from hfa_flight.simulate.flight import Flight
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table, beside_unit, short_number
from trim.point.operating_point import OperatingPoint

#: Largest number of flights at a trim.
_MOST_FLIGHTS = 20


@dataclass(frozen=True, eq=False)
class RoughFlights(Result):
    """Flights from one trim with sensor noise or in moving air.

    flights: number of flights.
    inside: number of flights that stay inside the envelope.
    seconds: duration of a flight, s.
    disturbed_by: description of the disturbances.
    rms: linear state or commanded input -> root mean square deviation from the trim, inside the
        envelope.
    calm: `rms` of a flight without noise in still air.
    departure: departure of the flight that leaves the envelope first, or None.
    air: description of the gust or turbulence in one line, or "".
    left_out: components of the moving air that the equations do not support, one sentence each.
    """

    flights: int
    inside: int
    seconds: float
    disturbed_by: str
    rms: dict[str, float]
    calm: dict[str, float]
    departure: Departure | None
    air: str = ""
    left_out: tuple[str, ...] = ()


def rough_scenario(scenario: Scenario, model: Model, samples: int) -> Scenario:
    """Return the scenario of flights with noise or in moving air, completed for a model.

    samples: number of flights

    Raises BadInputError if the scenario does not fit the model or contains no disturbance, or if
    `samples` is below 1.
    """
    if samples < 1:
        raise BadInputError(
            f"samples is {samples}, so there is no flight with noise, gust or turbulence; give at "
            "least 1"
        )
    on_model = scenario.on(model)
    if not _disturbed_by(on_model):
        raise BadInputError(
            "the scenario has no noise, gust or turbulence; add noise, a gust or turbulence"
        )
    return on_model


def rough_flights(
    deployed: Deployed,
    points: Sequence[OperatingPoint],
    scenarios: Sequence[Scenario],
    samples: int,
    seed: int,
    progress: Progress | None,
) -> list[RoughFlights]:
    """Return the results of flights of a deployment from each trim, with noise or in moving air.

    From each trim there are `samples` flights, at most 20, or one if the scenario has no
    uncertainty.

    scenarios: noise, gust and turbulence at each trim, from `rough_scenario`
    seed: seed of noise and turbulence
    """
    found = []
    for number, (point, happens) in enumerate(zip(points, scenarios, strict=True)):
        policy = behind_own_filter(deployed.deployment, point)
        scenario = sampled_scenario(policy_about(deployed, point, ""), happens, point)
        policy, scenario = policy.in_scenario(scenario)
        is_random = scenario.uncertainty != Uncertainty()
        members = min(samples, _MOST_FLIGHTS) if is_random else 1
        envelope = flight_envelope(deployed.model, point)
        plan = MonteCarlo(members, seed, deployed.model, point, policy, scenario, envelope)
        found.append(_simulated(plan, deployed))
        if progress is not None:
            progress(number + 1, len(points))
    return found


def _simulated(plan: MonteCarlo, deployed: Deployed) -> RoughFlights:
    """Return the results of the flights from one trim."""
    flights = [fly_member(plan, member) for member in range(plan.members)]
    rms = _rms(plan, flights)
    about = policy_about(deployed, plan.point, "")
    still = sampled_scenario(about, Scenario(plan.scenario.duration), plan.point)
    calm_plan = replace(plan, members=1, scenario=still)
    calm = _rms(calm_plan, [fly_member(calm_plan, 0)])
    names = (*plan.model.linear, *deployed.commanded)
    gust = plan.member(0).gust
    departures = [flight.departure for flight in flights if flight.departure is not None]
    return RoughFlights(
        flights=len(flights),
        inside=len(flights) - len(departures),
        seconds=plan.scenario.duration,
        disturbed_by=_disturbed_by(plan.scenario)
        + ", behind a Kalman filter" * (deployed.deployment.filter is not None),
        rms={name: rms[name] for name in names},
        calm={name: calm[name] for name in names},
        departure=min(departures, key=lambda left: left.time, default=None),
        air="" if gust is None else gust.text(plan.model),
        left_out=() if gust is None else tuple(gust.left_out(plan.model)),
    )


def _rms(plan: MonteCarlo, flights: Sequence[Flight]) -> dict[str, float]:
    """Return linear state or input -> root mean square deviation from trim inside the envelope."""
    rows = [member_row(plan, flight) for flight in flights]
    seconds = np.array([row["flown"] for row in rows])
    of_each = np.array([np.concatenate([row["rms_error"], row["effort"]]) for row in rows])
    mean = (seconds @ of_each**2) / max(seconds.sum(), plan.scenario.step)
    return dict(zip((*plan.model.linear, *plan.model.inputs), np.sqrt(mean).tolist(), strict=True))


def _disturbed_by(scenario: Scenario) -> str:
    """Return the names of a scenario's disturbances as text, or "" if there are none."""
    uncertain = scenario.uncertainty
    named = {
        "noise": any(uncertain.noise.values()),
        _turbulence_text(uncertain.turbulence): uncertain.turbulence is not None,
        "a gust": scenario.gust is not None,
        "wrong parameters": bool(uncertain.errors or scenario.errors),
        "moving air": bool(scenario.air),
        "actuators": scenario.actuators is not None,
    }
    return " and ".join(name for name, is_there in named.items() if is_there)


def _turbulence_text(turbulence: Turbulence | None) -> str:
    """Return turbulence as text, such as "light turbulence"."""
    if turbulence is None or not isinstance(turbulence.level, str):
        return "turbulence"
    return f"{turbulence.level} turbulence"


def rough_table(found: Sequence[RoughFlights], trims: Sequence[str], units: Sequence[str]) -> Table:
    """Return the table of root mean square deviations, with two rows for each trim.

    The first row contains the values of the flights with noise or in moving air, and the number of
    flights inside the envelope. The second row contains the values of the flight in calm air.

    found: results at each trim
    trims: description of each trim
    units: unit of each entry of `rms`
    """
    names = [beside_unit(name, unit) for name, unit in zip(found[0].rms, units, strict=True)]
    rows = []
    for trim, flown in zip(trims, found, strict=True):
        inside = f"{flown.inside} of {flown.flights}"
        for count, rms in ((inside, flown.rms), ("calm", flown.calm)):
            values = zip(rms.values(), units, strict=True)
            rows.append((trim, count, *(short_number(value, unit) for value, unit in values)))
    return Table(("trim", "inside", *(f"rms {name}" for name in names)), rows)
