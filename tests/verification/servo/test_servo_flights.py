"""`hfa servo`: the flights of SimVFA come out again, cases are kept and found again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import model_at

from controller import ActuatorFault, CommandSteps, Dryden, OneMinusCosine, flight_envelope, load_design, servo_law
from controller.design.controllers import design_controller
from controller.flight.nonlinear_flight import Tracked, fly_law
from controller.flight.plants import NonlinearPlant
from controller.policy.servo_policy import ServoPolicy
from hfa_model import Aircraft
from hfa_model.provenance import Provenance
from hfa_support import BadInputError, shown_in
from hfa_support.reporting.figure import new_figure
from verification import reference_servo
from verification.servo import cases, servo_flights
from verification.servo.cases import (
    ANGLES,
    CASES,
    REGULATED,
    Start,
    laws_of,
    scenario_of,
    simvfa_commands,
)
from verification.servo.servo_flights import fly_case, run_case
from verification.servo.servo_result import ServoFlight, servo_figure, servo_report

ORIGIN = Provenance("hfa servo")


def errors(flight: ServoFlight) -> tuple[float, float]:
    """Of dihedral, deg, and of vertical acceleration, ft/s²."""
    angle, acceleration = flight.tracked
    return float(np.degrees(angle.rms)), acceleration.rms


@pytest.mark.slow  # shorter flights of the same laws are below
def test_two_steps_with_a_fault(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first 120 s of the case: the adaptive law misses less than the LQR, and the paper's policy is lost."""
    monkeypatch.setattr(cases, "OWN_ANGLES", np.radians([9.0, 13.0]))
    names = ("simvfa-1", "simvfa-1 adaptive", "servo", "paper")
    lqr, adaptive, ours, paper = fly_case(published_aircraft, "order-1-fault", {}, 120.0, only=names)
    assert tuple(each.law for each in (lqr, adaptive, ours, paper)) == names
    assert lqr.lost_at is None
    assert adaptive.lost_at is None
    assert errors(adaptive)[0] < 0.95 * errors(lqr)[0]
    assert ours.lost_at is None
    assert errors(ours)[0] < 0.8 * errors(adaptive)[0]
    assert paper.lost_at is not None
    assert paper.left == "pitch_rate"
    assert paper.times[-1] == pytest.approx(paper.lost_at, abs=0.05)


#: rms error of dihedral, deg, and of A_z, ft/s²: of SimVFA's own simulation, as a port of it states them.
THEIRS = {
    ("order-1", "simvfa-1"): (0.380, 0.065),
    ("order-1", "simvfa-1 adaptive"): (0.379, 0.065),
    ("order-1-fault", "simvfa-1"): (0.685, 0.202),
    ("order-1-fault", "simvfa-1 adaptive"): (0.408, 0.101),
    ("order-2", "simvfa-2"): (0.446, 0.140),
    ("order-2", "simvfa-2 adaptive"): (0.445, 0.140),
    ("order-2-fault", "simvfa-2 adaptive"): (0.498, 0.322),
}


#: What ours stay below, rms of dihedral in deg, in the order of `CASES`; of those from three measurements it was asked.
ASKED = (0.20, 0.25, 0.25, 0.30)
OURS = {"servo": ASKED, "servo-gusts": ASKED, "servo-states": (0.25,) * 4}
OURS |= {f"servo {kind}": ASKED for kind in ("frozen", "learned", "learned frozen")}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_numbers_of_simvfa_come_out_again(published_aircraft: Aircraft, case: str) -> None:
    flights = {flight.law: flight for flight in fly_case(published_aircraft, case, {})}
    for (where, law), theirs in THEIRS.items():
        if where == case:
            assert flights[law].lost_at is None
            np.testing.assert_allclose(errors(flights[law]), theirs, atol=1e-3)
    for law, largest in OURS.items():
        assert flights[law].lost_at is None
        assert errors(flights[law])[0] < largest[list(CASES).index(case)]
        assert np.degrees(flights[law].fastest) < (1.03 if "frozen" in law else 1.0)
    if case == "order-2-fault":
        lost = flights["simvfa-2"].lost_at
        assert lost is not None
        assert 780.0 < lost < 840.0


#: Seed of the steps, effectiveness and bandwidth of the fault -> rms error of dihedral, deg, as docs/servo.md has it.
UNSEEN = {
    (1, 1.0, 2.0): (0.348, 0.348, 0.089, 0.119),
    (1, 0.58, 0.86): (0.411, 0.380, 0.118, 0.073),
    (2, 1.0, 2.0): (0.432, 0.432, 0.104, 0.158),
    (2, 0.26, 1.09): (0.679, 0.510, 0.202, 0.148),
}


@pytest.mark.slow
@pytest.mark.parametrize("given", UNSEEN)
def test_steps_and_faults_that_no_one_has_tuned_on(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch, given: tuple[int, float, float]
) -> None:
    seed, effectiveness, bandwidth = given
    rng = np.random.default_rng(seed)
    times = 1.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(50.0, 90.0, 15))])[:15]
    ends = np.column_stack([np.radians(rng.uniform(-2.0, 2.0, 15)), rng.uniform(-2.0, 2.0, 15)])
    ends[-1] = 0.0
    fault = ActuatorFault(0.0, effectiveness, bandwidth)
    monkeypatch.setattr(servo_flights, "simvfa_commands", lambda: CommandSteps(REGULATED, times, ends, 0.5, 2.0))
    monkeypatch.setitem(CASES, "order-1", CASES["order-1"]._replace(faults=(fault,)))
    laws = ("simvfa-1", "simvfa-1 adaptive", "servo", "servo-gusts")
    flights = fly_case(published_aircraft, "order-1", {}, 1000.0, only=laws)
    assert all(flight.lost_at is None for flight in flights)
    np.testing.assert_allclose([errors(flight)[0] for flight in flights], UNSEEN[given], atol=2e-3)


def test_a_finished_case_is_kept_and_known_again(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[str, int, int]] = []
    own = {"ours": reference_servo(published_aircraft, "simvfa-2", ANGLES[10:14])}
    settings: dict[str, Any] = {"duration": 4.0, "only": ("simvfa-2", "ours", "paper")}
    first = run_case(
        published_aircraft,
        "order-2",
        own,
        tmp_path / "out",
        ORIGIN,
        progress=lambda *done: told.append(done),
        **settings,
    )
    assert told[-1] == ("order-2", 3, 3)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["order-2.json", "order-2.png"]
    assert tuple(flight["law"] for flight in first["flights"]) == settings["only"]
    flown = []
    monkeypatch.setattr(servo_flights, "fly_case", lambda *given: flown.append(given) or ())
    monkeypatch.setattr("verification.servo.servo_flights.servo_figure", lambda *_: pytest.fail("drawn again"))
    assert run_case(published_aircraft, "order-2", own, tmp_path / "out", ORIGIN, resume=True, **settings) == first
    others = (
        ({"ours": reference_servo(published_aircraft, "simvfa-2", ANGLES[9:14])}, settings),
        (own, {"duration": 4.0}),
    )
    for controllers, changed in others:
        with pytest.raises(pytest.fail.Exception):
            run_case(published_aircraft, "order-2", controllers, tmp_path / "out", ORIGIN, resume=True, **changed)
    assert len(flown) == 2
    text = servo_report([first]).text()
    assert "case order-2, published dynamics, 4 s" in text
    assert "simvfa-2" in text


def test_a_case_is_flown_again_unless_its_numbers_and_its_picture_are_there_and_it_is_resumed(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[str] = []
    monkeypatch.setattr(servo_flights, "fly_case", lambda aircraft, name, *rest: flown.append(name) or ())
    monkeypatch.setattr(servo_flights, "servo_figure", lambda *_: new_figure(1.0, 1.0))

    def times_flown(resume: bool) -> int:
        run_case(published_aircraft, "order-1", {}, tmp_path, ORIGIN, resume=resume)
        return len(flown)

    assert [times_flown(resume) for resume in (True, True, False)] == [1, 1, 2]
    (tmp_path / "order-1.png").unlink()
    assert times_flown(resume=True) == 3


def test_a_case_is_kept_in_the_units_asked_for_and_read_back(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = np.linspace(0.0, 1.0, 5)
    missed = tuple(Tracked(name, times, times + 0.5) for name in REGULATED)
    flown = ServoFlight("one", times, missed, 0.1, None, None, dict.fromkeys(("surface", "state"), times))
    monkeypatch.setattr(servo_flights, "fly_case", lambda *_: (flown,))
    monkeypatch.setattr(servo_flights, "servo_figure", lambda *_: new_figure(1.0, 1.0))
    words = (published_aircraft, "order-1", {}, tmp_path, ORIGIN)
    english = run_case(*words)
    for _ in range(2):  # in other units it is flown again, and then kept
        with shown_in("si"):
            assert run_case(*words, resume=True)["flights"] == english["flights"]
        kept = json.loads((tmp_path / "order-1.json").read_text("utf-8"))
        assert kept["units"] == "si"
        assert kept["provenance"]["command"] == "hfa servo"
        errors = kept["flights"][0]["rms_error"]
        assert errors["dihedral"] == pytest.approx(0.5)
        assert errors["vertical_acceleration_short_period"] == pytest.approx(0.5 * 0.3048)
        assert kept["flights"][0]["rms_error_units"]["vertical_acceleration_short_period"] == "m/s^2"
        monkeypatch.setattr(servo_flights, "fly_case", lambda *_: pytest.fail("flown again"))


def test_a_picture_shows_limits_and_names_laws_that_are_alike_together(published_aircraft: Aircraft) -> None:
    laws = ("simvfa-1", "simvfa-1 adaptive", "paper")
    flights = fly_case(published_aircraft, "order-1", {}, 12.0, only=laws)
    *held, lost = flights
    for flight in held:
        assert all(0.0 < flight.used[name].max() < 0.5 for name in ("surface", "state"))
    assert lost.used["state"][-1] >= 1.0 > lost.used["state"][-2]
    figure = servo_figure("order-1", flights)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "command",
        "simvfa-1 = simvfa-1 adaptive",
        "paper",
        "limit",
    ]
    for axes, used in zip(figure.axes[4:], ("surface", "state"), strict=True):
        alike, lost_line, _cross, limit = axes.lines
        np.testing.assert_array_equal(alike.get_ydata(), 100.0 * held[0].used[used])
        assert lost_line.get_ydata()[-1] == 100.0 * lost.used[used][-1]
        assert set(limit.get_ydata()) == {100.0}


@pytest.mark.parametrize("design", ["servo-states", pytest.param("servo", marks=pytest.mark.slow)])
def test_every_variant_of_ours_flies(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch, design: str
) -> None:
    """Learned gains fly as the exact ones do; frozen ones are those of the trim."""
    monkeypatch.setattr(cases, "OWN_ANGLES", np.radians([10.0, 13.0]))
    variants = ("", " frozen", " learned", " learned frozen")
    names = tuple(f"{design}{variant}" for variant in variants)
    flights = {each.law: each for each in fly_case(published_aircraft, "order-2-fault", {}, 8.0, only=names)}
    assert tuple(flights) == names
    exact, frozen, *learned = (flights[name].tracked[0].output for name in names)
    apart = float(np.abs(exact - frozen).max())
    assert 1e-8 < apart < 1e-3
    np.testing.assert_allclose(learned, [exact, frozen], atol=1e-3 * apart)
    with pytest.raises(BadInputError, match="order 2 has no law 'simvfa-1'; choose from simvfa-2, simvfa"):
        laws_of(2, {}, ("simvfa-1",))


@pytest.mark.slow
@pytest.mark.parametrize(("intensity", "feels_the_air", "held"), [(6.0, True, True), (6.0, False, False)])
def test_our_servo_stands_turbulence_because_its_accelerometer_feels_the_air(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch, intensity: float, feels_the_air: bool, held: bool
) -> None:
    """With A_z made of alpha over ground its integral fights the air that rises, and the aircraft is lost."""
    commands, point = simvfa_commands(), model_at(11.0).point
    law = laws_of(1, {})["servo"](Start(published_aircraft, point, commands))
    assert isinstance(law.policy, ServoPolicy)
    if not feels_the_air:
        monkeypatch.setattr(law.policy.outputs, "F", 0.0 * law.policy.outputs.F)
    air = Dryden(intensity, 1750.0, point.states.speed, 0.05, 2000, 0, 20.0)
    scenario = replace(scenario_of(CASES["order-1"], commands, 100.0), step=0.001, tick=0.05, gust=air)
    envelope = flight_envelope(published_aircraft.parameters, point)
    result = fly_law(NonlinearPlant(published_aircraft, point), law, scenario, envelope)
    assert (result.departure is None) == held


#: ft/s, of 400 ft, within what docs/servo.md has: held at 5 and 15 deg.
STOOD = {
    ("servo", "published", 1.0): 28.5,
    ("servo", "published", -1.0): 29.5,
    ("servo", "newton", 1.0): 21.0,
    ("servo", "newton", -1.0): 45.0,
    ("servo-gusts", "published", 1.0): 60.0,
    ("servo-gusts", "published", -1.0): 60.0,
    ("servo-gusts", "newton", 1.0): 60.0,
    ("servo-gusts", "newton", -1.0): 60.0,
    ("servo-states", "published", 1.0): 45.0,
    ("servo-states", "published", -1.0): 17.0,
    ("servo-states", "newton", 1.0): 45.0,
    ("servo-states", "newton", -1.0): 25.0,
}
#: Of these a gust of 1.5 times the size ends at 5 deg.
ENDED = [(*each, 1.0) for each in (("servo", "published"), ("servo", "newton"), ("servo-gusts", "newton"))]


@pytest.mark.slow
@pytest.mark.parametrize("given", STOOD)
def test_gusts_that_our_servos_stand_and_one_that_they_do_not(given: tuple[str, str, float]) -> None:
    design, dynamics, sign = given
    aircraft = Aircraft(dynamics=dynamics)
    controller = design_controller(aircraft, load_design(design), np.radians(np.arange(21.0)))

    def held(degrees: float, peak: float) -> bool:
        point = model_at(degrees, dynamics).point
        still = CommandSteps(REGULATED, np.zeros(0), np.zeros((0, 2)), 0.5, 2.0)
        law, envelope = servo_law(controller, still, aircraft, point), flight_envelope(aircraft.parameters, point)
        gust = OneMinusCosine(400.0, sign * peak, point.states.speed, 1.0)
        scenario = replace(scenario_of(CASES["order-1"], still, 30.0), step=0.01, tick=0.05, gust=gust)
        return fly_law(NonlinearPlant(aircraft, point), law, scenario, envelope).departure is None

    assert all(held(degrees, STOOD[given]) for degrees in (5.0, 15.0))
    if given in ENDED:
        assert not held(5.0, 1.5 * STOOD[given])
