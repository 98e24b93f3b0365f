"""`hfa.assess`: assessment of a policy as it is deployed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hfa.options.command import ProgressLine
from hfa_aircraft.model import Model
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessment import NEEDS, Assessment
from hfa_flight.judge.assessor import Assessor
from hfa_flight.judge.flight_costs import flight_costs
from hfa_flight.judge.trims import trims_of
from hfa_flight.judge.weights import has_weights
from hfa_flight.needs import ALL, SAMPLES, SHARE, refuse_share
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    refuse_unknown,
    refuse_unless_positive,
    refuse_unless_whole,
)
from hfa_support.progress import Progress

#: Largest number of flights at each trim whose costs are compared.
COMPARED = 5


def assess(
    model: Model,
    deployment: Deployment | str | Path,
    points: Sequence[Any] | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    box: Mapping[str, float] | None = None,
    needs: Mapping[str, float] | None = None,
) -> Assessment:
    """Assess a policy as it is deployed: its sampled loop, flights, and cost.

    Flights in noise and moving air are those of `hfa.fly` with `samples`.

    model: the aircraft
    deployment: observations, actions and timing of the policy, or the path of a deployment file
    points: operating points, or values of the scheduling variable in the units of the model.
        Default: the model's default trim
    samples: number of initial conditions at each trim. Each is flown with and without the
        disturbance pulse, and the costs of five of them are compared with those of the exact gain
    seed: seed of the initial conditions
    progress: callback for the progress of the flights, by default a line on a terminal
    box: linear state -> half-width of the initial-condition box in the unit of the model, in place
        of the usual half-width
    needs: requirement of `hfa assess --need`, such as "delay" (s) or "cost" (%) -> required value

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
    refuse_unless_whole("samples", samples, 0)
    refuse_unless_whole("seed", seed, 0)
    deployed = Deployed(Deployment.of(deployment), model)
    for name, width in (box or {}).items():
        refuse_unknown("box names an unknown state", name, model.linear)
        refuse_unless_positive(f"box of {name}", width)
    trims = trims_of(model, points)
    return assessment_of(
        Assessor(deployed, trims, samples, seed, box or {}, share),
        needs=needs or {},
        progress_of=ProgressLine if progress is None else lambda _: progress,
    )


def assessment_of(
    assessor: Assessor,
    *,
    needs: Mapping[str, float],
    progress_of: Callable[[str], Progress | None],
) -> Assessment:
    """Return the assessment of a policy at the trims of an assessor.

    needs: requirement -> required value
    progress_of: function from the name of a step to the callback for its progress, or None
    """
    deployed = assessor.deployed
    if "cost" in needs and not has_weights(deployed):
        raise BadInputError(
            f"a required cost: {deployed.deployment.origin} has no table [cost]; give a deployment "
            "file with Q and R in [cost], or Q and R in the plant file"
        )
    points = assessor.assessed(progress_of("fly"))
    progress = progress_of("compare costs")
    return Assessment(
        deployed, tuple(_with_costs(assessor, point, progress) for point in points), needs
    )


def _with_costs(
    assessor: Assessor, assessed: AssessedPoint, progress: Progress | None
) -> AssessedPoint:
    """Return the result at a trim with the costs of some flights, or a remark why none exist."""
    count = min(COMPARED, assessor.samples)
    if count == 0:
        return assessed
    try:
        costs = flight_costs(assessor.deployed, assessed.case, count, assessor.seed, progress)
    except (BadInputError, NoSolutionError) as error:
        return replace(assessed, remarks=(*assessed.remarks, f"no costs are compared: {error}"))
    return replace(assessed, costs=costs)
