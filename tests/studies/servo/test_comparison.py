"""The study of servo controllers: comparison with SimVFA, requirements and stored results."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import model_at
from project import ROOT
from servo_cases import A_Z

import hfa
from hfa import BadInputError, Model
from hfa_design import Actuator, check_margins, design_controller, servo_margins, servo_plant
from hfa_flight import OneMinusCosine, save_controller
from studies.servo.__main__ import main
from studies.servo.comparison import CASES, ServoFlight, designed_servo, fly_case, laws_of, rows_of
from studies.servo.flights import delayed, gust_held, servo_loop, simulated_flight, slowest_delayed
from studies.servo.simvfa import reference_servo, simvfa_design

pytestmark = pytest.mark.slow

FOLDER = ROOT / "studies" / "servo"
FINDINGS = (FOLDER / "findings.md").read_text(encoding="utf-8")


def errors(flight: ServoFlight) -> tuple[float, float]:
    """Return the rms errors of dihedral angle (deg) and vertical acceleration (ft/s²) in a
    flight.
    """
    angle, acceleration = flight.tracked
    return float(np.degrees(angle.rms)), acceleration.rms


def test_a_case_is_simulated_stored_and_resumed(
    tmp_path: Path,
    published_aircraft: Model,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The paper's policy leaves the envelope after the fault of a case, and SimVFA's LQR does not.

    With --resume, a finished case is reused, and a changed result file is replaced. Unknown cases,
    laws and too long durations are refused.
    """

    def run(*words: str, code: int = 0) -> str:
        # The program reads its command line from there.
        monkeypatch.setattr(sys, "argv", ["studies.servo", *words])
        assert main() == code
        return "".join(capsys.readouterr())

    save_controller(
        tmp_path / "own.npz",
        reference_servo(published_aircraft, "simvfa-1", np.radians([10.0, 13.0])),
    )
    words = (
        "fly",
        "order-1-fault",
        "-o",
        str(tmp_path / "out"),
        "--duration",
        "15",
        "--law",
        "paper",
    )
    words = (
        *words,
        "--controller",
        str(tmp_path / "own.npz"),
        "--law",
        str(tmp_path / "own.npz"),
        "--json",
    )
    first = json.loads(run(*words))
    (case,) = first["cases"]
    own, paper = case["flights"]
    assert (own["lost_at"], paper["left"]) == (None, "pitch_rate")
    assert "  ".join(rows_of(case)[1][1:2]) in FINDINGS
    kept = tmp_path / "out" / "order-1-fault.json"
    before = kept.stat().st_mtime_ns
    assert json.loads(run(*words, "--resume")) == first
    assert (kept.stat().st_mtime_ns, (tmp_path / "out" / "order-1-fault.png").is_file()) == (
        before,
        True,
    )
    kept.write_text(kept.read_text("utf-8").replace("pitch_rate", "pitch", 1), encoding="utf-8")
    assert json.loads(run(*words, "--resume"))["cases"][0]["flights"] == case["flights"]
    assert run("fly", "order-3", "-o", "out", code=2).count("\n") == 1
    assert "end after 1051 s" in run("fly", "order-1", "-o", "out", "--duration", "1e5", code=2)
    with pytest.raises(BadInputError, match="order 2 has no law 'simvfa-1'; did you mean simvfa-2"):
        laws_of(2, {}, ("simvfa-1",))


STORED = json.loads((FOLDER / "results" / "comparison.json").read_bytes())["cases"]
#: Table row of every stored flight.
STORED_ROWS = [
    f"| {case['case']} | {' | '.join(row)} |" for case in STORED for row in rows_of(case)
]


def test_the_findings_have_stored_results() -> None:
    """Every case with the published dynamics has a stored result.

    findings.md shows only rows of stored results.
    """
    published = [case["case"] for case in STORED if case["dynamics"] == "published"]
    assert published == list(CASES)
    shown = re.findall(r"^\| order-.*$", FINDINGS, re.M)
    assert set(shown) <= set(STORED_ROWS)
    assert len(shown) >= 15


#: rms errors of the dihedral angle, deg, and of A_z, ft/s², in SimVFA's simulation, from a port of
#: it.
THEIRS = (0.408, 0.101)


def test_a_new_simulation_reproduces_the_stored_result(published_aircraft: Model) -> None:
    """A new simulation reproduces the stored result, and SimVFA's published errors within 1e-3.

    The study flies all laws and cases, each for minutes; this one contains a fault and adaptation.
    """
    case, law = "order-1-fault", "simvfa-1 adaptive"
    (flight,) = fly_case(published_aircraft, CASES[case], {}, only=(law,))
    np.testing.assert_allclose(errors(flight), THEIRS, atol=1e-3)
    ((_, angle, acceleration, _, outcome),) = rows_of({"flights": [flight.to_dict()]})
    assert (flight.law, flight.lost_at, outcome) == (law, None, "held")
    begin = f"| {case} | {law} | {angle} | {acceleration} | "
    assert any(row.startswith(begin) for row in STORED_ROWS)


def test_the_largest_gust_is_the_limit(published_aircraft: Model) -> None:
    """A flight stays within the envelope in the largest gust found, but not in one 1 ft/s
    stronger.
    """
    controller = designed_servo(published_aircraft)
    model = model_at(11.0)
    acting = Actuator(2, 2.0)
    held = gust_held(published_aircraft, model, controller, acting, 150.0, -60.0)
    assert -60.0 < held < -5.0
    for peak, lost in ((held, False), (held - 1.0, True)):
        gust = OneMinusCosine(150.0, peak, model.point.states.speed, 1.0)
        assert (
            simulated_flight(published_aircraft, model, controller, acting, gust=gust).departure
            is not None
        ) == lost


def test_a_loop_is_unstable_beyond_its_delay_margin(published_aircraft: Model) -> None:
    """The servo loop is stable with 0.98 times its delay margin and unstable with 1.02 times.

    The delay is approximated by Padé's approximant at all inputs.
    """
    controller = designed_servo(published_aircraft)
    plant = servo_plant(
        published_aircraft,
        model_at(11.0),
        controller,
        dict.fromkeys(controller.inputs, Actuator(2)),
    )
    loop = servo_loop(plant, controller)
    margin = servo_margins(loop, controller.inputs, controller.measurements)["all inputs"]
    assert (
        delayed(loop, 0.98 * margin.delay).abscissa
        < 0.0
        < delayed(loop, 1.02 * margin.delay).abscissa
    )


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_delay_and_half_effectiveness_are_in_the_slowest_pole(dynamics: str) -> None:
    """With twice the gain, the loop is stable without delay and unstable with 20 ms.

    With a tenth of the gain, the delay does not matter: the slowest pole is that with half
    effectiveness of the actuators, and half as fast as with full effectiveness.
    """
    aircraft = hfa.aircraft(dynamics)
    controller = designed_servo(aircraft)
    strong, weak = (replace(controller, C=gain * controller.C) for gain in (2.0, 0.1))

    def slowest(servo: Any, effectiveness: float) -> float:
        """Return the largest real part of the poles without delay."""
        found = []
        for acting in (Actuator(order, rate) for order in (1, 2) for rate in (2.0, 10.0)):
            with_share = replace(acting, effectiveness=effectiveness)
            actuators = dict.fromkeys(servo.inputs, with_share)
            plant = servo_plant(aircraft, model_at(11.0, dynamics), servo, actuators)
            found.append(servo_loop(plant, servo).abscissa)
        return max(found)

    assert max(slowest(strong, share) for share in (0.5, 1.0)) < 0.0
    assert slowest_delayed(aircraft, strong, (11.0,)) > 0.0
    half, full = slowest(weak, 0.5), slowest(weak, 1.0)
    assert slowest_delayed(aircraft, weak, (11.0,)) == pytest.approx(half, rel=0.05)
    assert full == pytest.approx(2.0 * half, rel=0.1)


@pytest.mark.parametrize(
    ("dynamics", "places"),
    [
        ("published", [(11, 10.0), (18, 2.0)]),
        pytest.param(
            "newton",
            [(degrees, bandwidth) for degrees in (1, 11, 18) for bandwidth in (2.0, 10.0)],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_designed_servo_has_the_stored_margins(
    dynamics: str, places: list[tuple[int, float]]
) -> None:
    """The designed servo has the stored gain and phase margins.

    places: dihedral angle (deg) and actuator bandwidth (rad/s) of the smallest margins
    """
    aircraft = hfa.aircraft(dynamics)
    stored = json.loads(
        (FOLDER / "results" / f"requirements_{dynamics}.json").read_text(encoding="utf-8")
    )["requirements"]
    reached = {row["what"]: row["reached"] for row in stored}
    controller = designed_servo(aircraft)
    tables = [
        check_margins(aircraft, controller, np.radians([degrees]), (bandwidth,))
        for degrees, bandwidth in places
    ]
    margins = [margin for table in tables for margin in table.single]
    gain = min(margin.gain for margin in margins)
    phase = min(margin.phase for margin in margins)
    assert gain == pytest.approx(reached["gain margin, dB"], rel=1e-6)
    assert phase == pytest.approx(reached["phase margin, deg"], rel=1e-6)
    assert A_Z in tables[0].rows[0].loops


@pytest.mark.parametrize(
    ("dynamics", "degrees", "is_stable"),
    [("published", 5.0, True), ("newton", 15.0, True), ("unsteady", 15.0, False)],
)
def test_unsteady_air_makes_the_servo_loop_unstable(
    dynamics: str, degrees: float, is_stable: bool
) -> None:
    """SimVFA's servo loop is stable with the dynamics `published` and `newton` and actuators of 2
    rad/s, but not `unsteady`.
    """
    servo = design_controller(hfa.aircraft(), simvfa_design("simvfa-1"), np.radians([5.0, 15.0]))
    actuators = dict.fromkeys(servo.inputs, Actuator(1, 2.0))
    plant = servo_plant(hfa.aircraft(dynamics), model_at(degrees, dynamics), servo, actuators)
    assert (servo_loop(plant, servo).abscissa < 0.0) == is_stable


@pytest.mark.parametrize(
    ("bandwidth", "degrees", "damping"), [(10.0, 13.0, 0.37), (2.0, 20.0, 0.334)]
)
def test_the_servo_is_stable_down_to_this_damping(
    published_aircraft: Model, bandwidth: float, degrees: float, damping: float
) -> None:
    """The servo loop becomes unstable if the actuators' damping is below the given value."""
    controller = designed_servo(published_aircraft)
    model = model_at(degrees)

    def abscissa(share: float) -> float:
        acting = dict.fromkeys(controller.inputs, Actuator(2, bandwidth, damping=share * damping))
        plant = servo_plant(published_aircraft, model, controller, acting)
        return servo_loop(plant, controller).abscissa

    assert abscissa(0.99) > 0.0 > abscissa(1.01)
