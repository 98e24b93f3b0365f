"""What a search asks of a design: turbulence adds to the cost, a missed constraint by its own size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from servo_cases import A_Z

from controller import Actuator, Design
from controller.design.design_file import read_design
from controller.design.scheduled_controller import ScheduledController
from hfa_model import Aircraft
from trim.linear.linear_model import LinearModel
from verification.synthesis import design_evaluation
from verification.synthesis.design_evaluation import LOST, PENALTY, DesignEvaluation
from verification.synthesis.tuning import Evaluation, InCommands, InGust, InTurbulence, Tuning, Variable


def tuning() -> Tuning:
    angle, sound = math.radians(11.0), Actuator()
    return Tuning(
        name="tune.toml",
        start=read_design("servo"),
        variables=(Variable("effort", ("weights.inputs.aileron_outer",), 0.01, 1e4),),
        cases=(InCommands(angle, sound, 20.0, [[0.02, -1.0], [0.0, 0.0]]),),  # type: ignore[arg-type]
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
    norm = evaluated(published_aircraft, power=6.0).cost
    assert norm == pytest.approx(((100.0 * error) ** 6 + (50.0 * rms) ** 6) ** (1 / 6))
    larger = tuning().gusts[0]._replace(peak=-90.0, dynamics="newton")
    missed = evaluated(
        published_aircraft, margin=2.0 * found.margin, fastest=found.fastest / 3.0, gusts=(*tuning().gusts, larger)
    )
    assert missed.gusts[0] == found.gusts[0] < 0.5
    assert missed.gusts[1] > 1.0
    assert missed.cost == pytest.approx(found.cost + PENALTY * (0.5 + 2.0 + missed.gusts[1] - 1.0))
    weak = Actuator(2, 0.2, 0.3)  # the case itself is not stable
    lost = evaluated(published_aircraft, turbulence=(tuning().turbulence[0]._replace(actuator=weak),))
    assert lost.cost == pytest.approx(LOST * (1.0 + lost.abscissa))
    assert (lost.abscissa > 0.0, lost.errors) == (True, ())


def test_what_is_no_longer_of_interest_is_not_flown(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a limit the evaluation ends above it exactly where the whole one does, and what it leaves out is what takes
    longest."""
    gusts = (InGust(math.radians(11.0), Actuator(), 250.0, 1.0),) * 3
    asked = replace(tuning(), gusts=gusts, margin=10.0, power=3.0)
    flown: list[float] = []
    monkeypatch.setattr(design_evaluation, "gust_share", lambda *_: (flown.append(1.0), 1.0 + len(flown))[1])
    evaluation, values = DesignEvaluation(published_aircraft, asked), asked.first_values()
    whole = evaluation.at(values)
    assert len(flown) == 3
    reached = []
    for below in (0.0, whole.cost % PENALTY / 2.0, 1500.0, 3000.0, 5000.0, whole.cost - 1e-6, whole.cost, math.inf):
        flown.clear()
        found = evaluation.at(values, below)
        assert (found.cost > below) == (whole.cost > below)
        assert found.cost <= whole.cost
        assert found == (whole if below >= whole.cost else found)
        reached.append((bool(found.rms), bool(found.errors), found.margin > 0.0, len(found.gusts)))
        assert len(flown) == len(found.gusts)
        flown.clear()
        farther = evaluation.at(values, found.cost)  # what is not above the limit goes on
        assert farther.cost > found.cost or farther == whole
    assert reached == sorted(reached)
    assert reached[0] == (True, False, False, 0)
    assert len(set(reached)) == 5


def test_the_controller_of_a_place_is_made_once(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    """For flights, corners and gusts alike; another place or other dynamics have their own."""
    made: list[tuple[str, float]] = []
    make = design_evaluation.quick_controller

    def counted(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
        made.append((aircraft.variant.name, round(math.degrees(model.point.states.dihedral))))
        return make(aircraft, model, design)

    monkeypatch.setattr(design_evaluation, "quick_controller", counted)
    monkeypatch.setattr(design_evaluation, "gust_share", lambda *_: 0.5)
    gust = tuning().gusts[0]
    asked = (gust, gust._replace(peak=-1.0), gust._replace(dynamics="newton"), gust._replace(dihedral=0.1))
    assert evaluated(published_aircraft, gusts=asked).gusts == (0.5,) * 4
    assert made == [("published", 11), ("newton", 11), ("published", 6)]


def test_no_more_corners_are_closed_than_until_one_is_unstable(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[float] = []
    corners = design_evaluation.corner_loops
    monkeypatch.setattr(design_evaluation, "corner_loops", lambda *each: (closed.append(1.0), corners(*each))[1])
    start = read_design("simvfa-1") | {"sensors": tuning().start["sensors"]}
    asked = replace(tuning(), start=start, dynamics=("published", "newton"))
    evaluation, values = DesignEvaluation(published_aircraft, asked), asked.first_values()
    found, ended = evaluation.at(values), evaluation.at(values, LOST)
    assert LOST < ended.cost <= found.cost
    assert len(closed) == 3
    fast = DesignEvaluation(published_aircraft, replace(asked, fastest=1e-6))  # missed by more than a lost corner costs
    assert fast.at(values, 10.0 * LOST) == fast.at(values)


def test_the_corners_are_those_of_every_dynamics_named(published_aircraft: Aircraft) -> None:
    """A design that is stable at the corners of `published` only is lost when `newton` is asked for as well."""
    values, found = tuning().first_values(), {}
    for dynamics in ((), ("published",), ("newton",), ("published", "newton")):
        asked = replace(tuning(), angles=(math.radians(20.0),), dynamics=dynamics)
        found[dynamics] = DesignEvaluation(published_aircraft, asked).at(values).abscissa
    assert found[()] == found["published",] != found["newton",]
    assert found["published", "newton"] == max(found["published",], found["newton",])


def test_without_air_there_is_none(published_aircraft: Aircraft) -> None:
    found = evaluated(published_aircraft, turbulence=(), gusts=(), margin=0.0)
    assert (found.rms, found.gusts, found.margin) == ((), (), 0.0)
    assert found.cost == pytest.approx(100.0 * found.errors[0]["dihedral"])


def test_weights_that_no_design_can_have_are_lost(published_aircraft: Aircraft) -> None:
    """A search goes on from there: the limits of its variables are the user's."""
    variable = Variable("effort", ("weights.inputs.aileron_outer",), 1e-320, 1e4)
    evaluation = DesignEvaluation(published_aircraft, replace(tuning(), variables=(variable,)))
    assert evaluation.at(np.array([1e-320])) == Evaluation(2.0 * LOST, math.inf)
