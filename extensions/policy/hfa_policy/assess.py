"""Assess a policy as it is deployed: the function `hfa.assess`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hfa_aircraft.model import Model
from hfa_flight.scenario import Scenario
from hfa_policy.assessment import SAMPLES, Assessor
from hfa_policy.assessment_report import Assessment
from hfa_policy.deployment import Deployment
from hfa_policy.mistakes import mistakes_of
from hfa_policy.rough_flights import rough_flights, rough_scenario
from hfa_policy.trims import trims_of
from hfa_policy.variations import changes_of, variations
from hfa_support.arguments import checks_arguments
from hfa_support.errors import refuse_unless_whole
from hfa_support.progress import Progress


@checks_arguments
def assess(
    model: Model,
    deployment: Deployment,
    points: Sequence[Any] | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    scenario: Scenario | None = None,
) -> Assessment:
    """Assess a policy as it is deployed.

    model: the aircraft
    deployment: observations, actions and timing of the policy
    points: operating points, or values of the scheduling variable in the units of the model; its
        own trim unless given
    samples: flights at each trim, with and without disturbance; 0 for none
    seed: seed of their initial conditions
    progress: called during the flights
    vary: parameter, or input that no action moves -> lowest and highest value; the policy is judged
        on the changed aircraft too, with the trim values of the original
    scenario: sensor noise, gust or turbulence of at most 20 further flights from each trim, as for
        `hfa.fly`

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
    refuse_unless_whole("samples", samples, 0)
    refuse_unless_whole("seed", seed, 0)
    deployed = deployment.on(model)
    changes = changes_of(deployed, vary or {})
    if scenario is not None:
        scenario = rough_scenario(scenario, model, samples)
    assessor = Assessor(deployed, trims_of(model, points), samples, seed)
    assessed = assessor.assessed(progress)
    mistakes = tuple(mistakes_of(assessor, assessed))
    changed = variations(assessor, changes, progress)
    if scenario is not None:
        rough = rough_flights(
            deployed, assessor.points, [scenario] * len(assessed), samples, seed, progress
        )
        assessed = [replace(at, rough=flown) for at, flown in zip(assessed, rough, strict=True)]
    return Assessment(deployed, tuple(assessed), mistakes, variations=tuple(changed))
