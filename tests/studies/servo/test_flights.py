"""The table of requirements: the largest gust is where flights begin to end, and a delay is that of the margins."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from known_models import model_at
from project import ROOT
from servo_cases import A_Z

from controller import OneMinusCosine
from controller.design.design import Actuator
from controller.design.servo_loop import loop_margins, servo_loop, servo_plant
from hfa_model import Aircraft
from studies.servo.comparison import designed_servo
from studies.servo.flights import delayed, flown, gust_held, slowest_delayed

RESULTS = ROOT / "studies" / "servo" / "results"


@pytest.mark.slow
def test_the_largest_gust_is_where_flights_begin_to_end(published_aircraft: Aircraft) -> None:
    controller, model, acting = designed_servo(published_aircraft), model_at(11.0), Actuator(2, 2.0)
    held = gust_held(published_aircraft, model, controller, acting, 150.0, -60.0)
    assert -60.0 < held < -5.0
    for peak, lost in ((held, False), (held - 1.0, True)):
        gust = OneMinusCosine(150.0, peak, model.point.states.speed, 1.0)
        assert (flown(published_aircraft, model, controller, acting, gust=gust).departure is not None) == lost


def test_a_loop_ends_at_its_delay_margin(published_aircraft: Aircraft) -> None:
    """Padé's delay in all inputs agrees with the margin from the frequency response; a little more is unstable."""
    controller = designed_servo(published_aircraft)
    plant = servo_plant(published_aircraft, model_at(11.0), controller, dict.fromkeys(controller.inputs, Actuator(2)))
    loop = servo_loop(plant, controller)
    margin = loop_margins(loop, controller.inputs, controller.measurements)["all inputs"]
    assert delayed(loop, 0.98 * margin.delay).abscissa < 0.0 < delayed(loop, 1.02 * margin.delay).abscissa


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_20_ms_are_stood_at_half_the_effectiveness_and_a_planted_gain_is_not(dynamics: str) -> None:
    aircraft = Aircraft(dynamics=dynamics)
    controller = designed_servo(aircraft)
    assert slowest_delayed(aircraft, controller, (0.0, 11.0, 20.0)) < 0.0
    assert slowest_delayed(aircraft, replace(controller, C=20.0 * controller.C), (11.0,)) > 0.0


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_stored_requirements_are_of_the_shipped_design(dynamics: str) -> None:
    """The margins of the stored table, the smallest of which are at these angles, come out again."""
    from controller.design.servo_loop import check_margins

    aircraft = Aircraft(dynamics=dynamics)
    stored = json.loads((RESULTS / f"requirements_{dynamics}.json").read_text(encoding="utf-8"))["requirements"]
    reached = {row["what"]: row["reached"] for row in stored}
    table = check_margins(aircraft, designed_servo(aircraft), np.radians([1, 11, 18]), (2.0, 10.0))
    single = table.single
    assert min(each.gain for each in single) == pytest.approx(reached["gain margin, dB"], rel=1e-6)
    assert min(each.phase for each in single) == pytest.approx(reached["phase margin, deg"], rel=1e-6)
    assert A_Z in table.rows[0].loops
