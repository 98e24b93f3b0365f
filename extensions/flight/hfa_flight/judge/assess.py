"""`hfa.assess`: assessment of a policy as it is deployed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

from hfa.options.output import ProgressLine
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessment import NEEDS, Assessment
from hfa_flight.judge.assessor import Assessor
from hfa_flight.judge.flight_costs import flight_costs
from hfa_flight.judge.trims import trims_of
from hfa_flight.judge.variations import changes_of, variations
from hfa_flight.judge.weights import has_weights
from hfa_flight.needs import ALL, OF_POLICY, SAMPLES, SHARE, refuse_share
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.samples.flights_in_air import FlightsInAir, flights_in_air, flown_report
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.simulate.envelope import flight_envelope
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    refuse_unknown,
    refuse_unless_positive,
    refuse_unless_whole,
)
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report
from trim.point.operating_point import OperatingPoint

#: Default number of flights at each trim whose costs are compared.
COMPARED = 5
#: Largest number of flights in noise or moving air from each trim.
_MOST_IN_AIR = 20


@overload
def assess(
    model: Model, deployment: Deployment | str | Path, *args: Any, **options: Any
) -> Assessment: ...


@overload
def assess(model: Model, deployment: Any, *args: Any, **options: Any) -> FlightsInAir: ...


def assess(
    model: Model,
    deployment: Any,
    points: Sequence[Any] | None = None,
    samples: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    scenario: Scenario | None = None,
    *,
    box: Mapping[str, float] | None = None,
    needs: Mapping[str, float] | None = None,
    best: int | None = None,
) -> Assessment | FlightsInAir:
    """Assess a policy as it is deployed, or fly another policy many times in noise or moving air.

    model: the aircraft
    deployment: observations, actions and timing of the policy, or the path of a deployment file.
        Any other policy that `hfa.fly` accepts is flown in the noise and turbulence of `scenario`,
        as `hfa fly --samples` does; the result is then `hfa.FlightsInAir`
    points: operating points, or values of the scheduling variable in the units of the model.
        Default: the model's default trim
    samples: number of initial conditions at each trim, by default 300. Each is flown with and
        without the disturbance pulse. Of another policy, number of flights, by default 20
    seed: seed of the initial conditions, noise and turbulence
    progress: callback for the progress of the flights, by default a line on a terminal
    vary: parameter, or input that no action moves -> lowest and highest value. The policy is also
        assessed on the changed aircraft, with the trim values of the original
    scenario: sensor noise, gust or turbulence for at most 20 further flights from each trim, as in
        `hfa.fly`
    box: linear state -> half-width of the initial-condition box in the unit of the model, in place
        of the usual half-width
    needs: requirement of `hfa assess --need`, such as "delay" (s) or "cost" (%) -> required value
    best: number of flights at each trim whose costs are compared with the best flights found and
        with the exact gain's. 0 compares five with the exact gain's alone. Default: 5 if the
        deployment or the plant file has Q and R, else 0; no flight is compared if `samples` is 0

    Raises BadInputError for a wrong argument or a deployment that does not fit the aircraft, and
    TrimError if there is no trim.

    >>> import casadi as ca
    >>> import hfa
    >>> o = ca.SX.sym("o", 2)
    >>> deployment = hfa.Deployment(
    ...     policy={"file": ca.Function("policy", [o], [0.1 * o[1]])},
    ...     observation={"speed": {"scale": 10.0}, "pitch": {}},
    ...     action={"elevator_center": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    ...     timing={"dt": 0.02},
    ... )
    >>> hfa.assess(hfa.aircraft(), deployment, [0.1], samples=0).points[0].holds
    True
    """
    for name in needs or {}:
        refuse_unknown("unknown requirement", name, NEEDS)
    share = (needs or {}).get(SHARE, ALL)
    refuse_share(share)
    if not isinstance(deployment, (Deployment, str, Path)):
        of_deployments = {"vary": vary, "box": box, "best": best}
        of_deployments |= dict.fromkeys(set(needs or {}) - {SHARE}, True)
        for name, value in of_deployments.items():
            if value is not None:
                raise BadInputError(f"{name} applies only to a deployment; remove {name}")
        count = OF_POLICY if samples is None else samples
        if scenario is None or scenario.uncertainty == Uncertainty():
            raise BadInputError(
                "the flights of the policy are all the same; give scenario=Scenario(uncertainty="
                "Uncertainty(noise={...}, turbulence=...))"
            )
        trims = trims_of(model, points)
        plans = [plan_of(deployment, trim, scenario, count, seed, share) for trim in trims]
        return flights_in_air(plans, progress)
    samples = SAMPLES if samples is None else samples
    refuse_unless_whole("samples", samples, 0)
    refuse_unless_whole("seed", seed, 0)
    if best is not None:
        refuse_unless_whole("best", best, 0)
    deployed = Deployed(Deployment.of(deployment), model)
    changes = changes_of(deployed, vary or {})
    for name, width in (box or {}).items():
        refuse_unknown("box names an unknown state", name, model.linear)
        refuse_unless_positive(f"box of {name}", width)
    trims = trims_of(model, points)
    assessor = Assessor(deployed, trims, samples, seed, box or {}, share=share)
    return assessment_of(
        assessor,
        needs=needs or {},
        changes=changes,
        scenarios=[] if scenario is None else [scenario] * len(assessor.points),
        best=best,
        progress_of=ProgressLine if progress is None else lambda _: progress,
    )


def plan_of(
    policy: Any, point: OperatingPoint, scenario: Scenario, samples: int, seed: int, share: float
) -> MonteCarlo:
    """Return the plan of the flights of a policy from a trim, in noise or moving air."""
    if samples < 1:
        raise BadInputError(
            f"samples is {samples}, so there is no flight with noise, gust or turbulence; give at "
            "least 1"
        )
    flown, happens = policy_and_scenario(policy, point, scenario)
    envelope = flight_envelope(point.model, point)
    return MonteCarlo(samples, seed, point.model, point, flown, happens, envelope, share=share)


def _in_air(
    assessor: Assessor, point: OperatingPoint, scenario: Scenario, progress: Progress | None
) -> Report:
    """Return the report of the flights of a deployment from a trim, in noise or moving air.

    There are as many flights as initial conditions, at most `_MOST_IN_AIR`, or one if nothing is
    random.
    """
    is_random = scenario.uncertainty != Uncertainty()
    disturbed_by = scenario.gust, scenario.air, scenario.errors, scenario.actuators
    if not is_random and not any(disturbed_by):
        raise BadInputError(
            "the scenario has no noise, gust or turbulence; add noise, a gust or turbulence"
        )
    samples = min(assessor.samples, _MOST_IN_AIR if is_random else 1)
    policy = assessor.deployed.deployment
    plan = plan_of(policy, point, scenario, samples, assessor.seed, assessor.share)
    return flown_report(plan, 1, progress)


def assessment_of(
    assessor: Assessor,
    *,
    needs: Mapping[str, float],
    changes: Sequence[tuple[str, float]],
    scenarios: Sequence[Scenario],
    best: int | None,
    progress_of: Callable[[str], Progress | None],
) -> Assessment:
    """Return the assessment of a policy at the trims of an assessor, with all requested parts.

    needs: requirement -> required value
    changes: (parameter or input, value) of each changed aircraft
    scenarios: noise, gust and turbulence at each trim, or empty for no such flights
    best: number of flights that are compared with the best flights, as in `assess`
    progress_of: function from the name of a step to the callback for its progress, or None
    """
    deployed = assessor.deployed
    if ("cost" in needs or best) and not has_weights(deployed):
        asked = "best" if best else "a required cost"
        raise BadInputError(
            f"{asked}: {deployed.deployment.origin} has no table [cost]; give a deployment file "
            "with Q and R in [cost], or Q and R in the plant file"
        )
    in_air = []
    if scenarios:  # first, because they refuse a scenario that does not suit the aircraft
        progress = progress_of("fly in noise and moving air")
        in_air = [
            _in_air(assessor, point, happens, progress)
            for point, happens in zip(assessor.points, scenarios, strict=True)
        ]
    points = assessor.assessed(progress_of("fly"))
    progress = progress_of("optimize")
    points = [_with_costs(assessor, point, best, progress) for point in points]
    if scenarios:
        points = [replace(at, in_air=flown) for at, flown in zip(points, in_air, strict=True)]
    changed = variations(assessor, changes, progress_of("fly changed aircraft"))
    return Assessment(deployed, tuple(points), needs, tuple(changed))


def _with_costs(
    assessor: Assessor,
    assessed: AssessedPoint,
    best: int | None,
    progress: Progress | None,
) -> AssessedPoint:
    """Return the result at a trim with the costs of some flights, or a remark why none exist."""
    deployed = assessor.deployed
    count = min(COMPARED, assessor.samples)
    searched = has_weights(deployed) and count > 0
    if best is not None:
        count, searched = best or count, best > 0
    if count == 0:
        return assessed
    place, seed = assessed.place, assessor.seed
    try:
        costs = flight_costs(deployed, place, count, seed, progress, searched=searched)
    except (BadInputError, NoSolutionError) as error:
        if best:
            raise
        return replace(assessed, remarks=(*assessed.remarks, f"no costs are compared: {error}"))
    return replace(assessed, best=costs)
