"""What a search asks of a design: turbulence adds to the cost, a missed constraint by its own size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from servo_cases import A_Z

from controller import Actuator
from controller.design.design_file import read_design
from hfa_model import Aircraft
from verification.synthesis.design_evaluation import LOST, PENALTY, DesignEvaluation
from verification.synthesis.tuning import Case, Evaluation, InGust, InTurbulence, Tuning, Variable


def tuning() -> Tuning:
    angle, sound = math.radians(11.0), Actuator()
    return Tuning(
        name="tune.toml",
        start=read_design("servo"),
        variables=(Variable("effort", ("weights.inputs.aileron_outer",), 0.01, 1e4),),
        cases=(Case(angle, sound, 20.0, [[0.02, -1.0], [0.0, 0.0]]),),  # type: ignore[arg-type]
        objective={"dihedral": 100.0},
        angles=(angle,),
        abscissa=-1e-6,
        rate=1.0,
        evaluations=1,
        seed=0,
        turbulence=(InTurbulence(angle, sound, 3.0, 1750.0, {"dihedral": 50.0}),),
        gusts=(InGust(angle, sound, 250.0, 1.0),),
        margin=0.01,
        fastest=1e5,
    )


def evaluated(aircraft: Aircraft, **changed: object) -> Evaluation:
    asked = replace(tuning(), **changed)  # type: ignore[arg-type]
    return DesignEvaluation(aircraft, asked).at(asked.first_values())


def test_the_cost_is_what_it_says(published_aircraft: Aircraft) -> None:
    found = evaluated(published_aircraft)
    rms, error = found.rms[0]["dihedral"], found.errors[0]["dihedral"]
    assert set(found.errors[0]) == {"dihedral", A_Z}
    assert found.cost == pytest.approx(100.0 * error + 50.0 * rms)
    larger = tuning().gusts[0]._replace(peak=-90.0, dynamics="newton")
    missed = evaluated(
        published_aircraft, margin=2.0 * found.margin, fastest=found.fastest / 3.0, gusts=(*tuning().gusts, larger)
    )
    assert missed.gusts[0] == found.gusts[0] < 0.5
    assert missed.gusts[1] > 1.0
    assert missed.cost == pytest.approx(found.cost + PENALTY * (0.5 + 2.0 + missed.gusts[1] - 1.0))
    weak = Actuator(2, 0.2, 0.3)  # the case itself is not stable
    lost = evaluated(published_aircraft, turbulence=(tuning().turbulence[0]._replace(actuator=weak),))
    assert lost.cost > LOST
    assert lost.errors == ()


def test_without_air_there_is_none(published_aircraft: Aircraft) -> None:
    found = evaluated(published_aircraft, turbulence=(), gusts=(), margin=0.0)
    assert (found.rms, found.gusts, found.margin) == ((), (), 0.0)
    assert found.cost == pytest.approx(100.0 * found.errors[0]["dihedral"])


def test_weights_that_no_design_can_have_are_lost(published_aircraft: Aircraft) -> None:
    """A search goes on from there: the limits of its variables are the user's."""
    variable = Variable("effort", ("weights.inputs.aileron_outer",), 1e-320, 1e4)
    evaluation = DesignEvaluation(published_aircraft, replace(tuning(), variables=(variable,)))
    assert evaluation.at(np.array([1e-320])) == Evaluation(2.0 * LOST, math.inf)
