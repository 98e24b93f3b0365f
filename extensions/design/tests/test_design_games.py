"""The game of a design in the commands `solve`, `learn`, `verify` and `design`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from known_models import model_at
from project import ROOT
from servo_cases import SIMVFA, simvfa_design
from tolerances import SAME_FORMULA

from hfa import Model, aircraft
from hfa_aircraft import in_si
from hfa_design import design_model
from hfa_flight import load_controller

# Solve.


@pytest.fixture(autouse=True)
def _in_a_folder(folder: Path) -> None:
    """Run each test in a new empty folder."""


AT_11 = ("--dihedral", "11")
PEER = ROOT / "extensions/design/tests/peer_gains.json"


@pytest.mark.parametrize(("name", "size"), [("simvfa-1", 10), ("simvfa-2", 12)])
def test_solve_design_returns_simvfas_gain(name: str, size: int, published_aircraft: Model) -> None:
    """`hfa solve --design` returns the gain of the independent program SimVFA within 2e-5.

    Names and units are those of the design.
    """
    data = answer("solve", "--design", SIMVFA[name], *AT_11)
    theirs = np.array(json.loads(PEER.read_text(encoding="utf-8"))["gains"][name]["11"])
    assert np.linalg.norm(data["K"] - theirs) <= 2e-5 * np.linalg.norm(theirs)
    assert data["certificate"]["ok"] is True
    assert (data["delta"], len(data["states"])) == (None, size)
    built = design_model(published_aircraft, model_at(11.0), simvfa_design(name))
    for key in ("states", "inputs", "state_units", "input_units"):
        assert data[key] == list(getattr(built, key))


# From measured outputs.

SENSORS = """
[sensors]
vertical_acceleration_short_period_integral = 1e-2
dihedral_integral = 1e-4
load_factor = 1e-3
"""


def own(name: str, sensors: str = SENSORS, **changed: str) -> str:
    """Write a changed copy of the design `simvfa-1` to a file, and return the name of the file.

    sensors: text appended to the file
    changed: old text -> new text
    """
    text = Path(SIMVFA["simvfa-1"]).read_text(encoding="utf-8")
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new)
    Path(name).write_text(text + sensors, encoding="utf-8")
    return name


@pytest.mark.slow
def test_sensors_give_an_output_feedback_controller() -> None:
    """A design with sensors gives an output-feedback controller.

    Its delta_min is larger than with state feedback. A delta between the two values is refused.
    """
    file = own("own.toml", **{"delta = inf": "delta = 200.0"})
    data = answer("solve", "--design", file, *AT_11)
    assert (
        data["K"] == answer("solve", "--design", SIMVFA["simvfa-1"], *AT_11, "--delta", "200")["K"]
    )
    measured = answer("design", file, *AT_11)
    assert measured["measurements"] == [
        "load_factor",
        "dihedral",
        "vertical_acceleration_short_period",
    ]
    (angle,) = measured["angles"]
    assert data["delta_min"] < angle["delta_min"] < 200.0
    assert all(check["ok"] for check in angle["checks"])
    assert np.shape(measured["A"]) == (1, 12, 12)
    below = 0.5 * (data["delta_min"] + angle["delta_min"])
    refused = hfa("design", own("own.toml", **{"delta = inf": f"delta = {below}"}), *AT_11)
    assert_refused(
        refused, 1, "at dihedral 11 deg: the coupling condition fails", "is below delta_min = "
    )


@pytest.mark.parametrize(
    ("sensors", "changed", "code", "named"),
    [
        ("[sensors]\nliftt = 1", {}, 2, "unknown sensor 'liftt'; did you mean"),
        (
            "[sensors]\nspeed = 0",
            {},
            2,
            "the noise of sensor speed is 0.0; give a positive number",
        ),
        (
            "[sensors]\nspeed = 'x'",
            {},
            2,
            "sensors.speed is 'x'; give a finite number of at least 0",
        ),
        (
            "[sensors]\npitch_rate = 1",
            {},
            1,
            "the sensors do not observe the mode with eigenvalue 0,",
        ),
        (
            SENSORS,
            {"delta = inf": 'disturbance = "updraft"'},
            2,
            "sensor load_factor depends directly on the updraft",
        ),
        (
            "",
            {"vertical_acceleration_short_period": "pitch_rate"},
            2,
            "output pitch_rate: no input changes the steady-state value",
        ),
    ],
)
def test_an_impossible_design_is_refused(
    sensors: str, changed: dict[str, str], code: int, named: str
) -> None:
    """A design that no controller can satisfy is refused with a one-line message.

    docs/servo.md lists more cases.
    """
    assert_refused(hfa("design", own("own.toml", sensors, **changed), *AT_11), code, named)


@pytest.mark.slow
def test_a_written_design_prints_the_same_report() -> None:
    """`hfa design FILE` prints the report of a file written by `hfa design -o`, with the same
    matrices.
    """
    made = hfa("design", "--design", SIMVFA["simvfa-1"], "--dihedral", "9:11:2", "-o", "servo.npz")
    assert made.code == 0
    again = hfa("design", "servo.npz")
    table = made.out.split("\n\n")[:-1]  # the last paragraph is the provenance
    assert again.out.split("\n\n")[:-1] == table
    said = " ".join(made.out.split())
    assert "simvfa-1.toml: state feedback, 2 states, 2 angles from 9 to 11 deg" in said
    margins = f"Margins of controller {SIMVFA['simvfa-1']}, published dynamics"
    assert f"{margins}: PASS, 3 of 3 loops stable" in said
    controller = load_controller("servo.npz", aircraft())
    assert controller.about["provenance"]["command"].startswith(
        f"hfa design --design {SIMVFA['simvfa-1']}"
    )
    data = answer("design", "servo.npz")
    np.testing.assert_array_equal(data["C"], controller.C)
    assert [row["dihedral"] for row in data["angles"]] == pytest.approx(controller.breakpoints)


def test_controllers_in_si_and_english_units_agree() -> None:
    """A controller designed with --units si equals the converted controller in English units.

    A flight with --units si ends in the converted state.
    """
    words = ("design", SIMVFA["simvfa-1"], "--dihedral", "11", "--bandwidth", "10")
    feet = hfa(*words, "-o", "feet.npz")
    metres = hfa(*words, "--units", "si", "-o", "metres.npz")
    assert (feet.code, metres.code) == (0, 0)
    assert metres.out.split("\n\n")[:-1] == feet.out.split("\n\n")[:-1]
    model = aircraft()
    for shown, factor in ((model, 1.0), (in_si(model), 0.3048)):
        one = load_controller("feet.npz", shown)
        other = load_controller("metres.npz", shown)
        for name in ("A", "B", "C", "D", "W", "trim_states", "trim_inputs"):
            expected = getattr(one, name)
            np.testing.assert_allclose(
                getattr(other, name), expected, rtol=SAME_FORMULA, atol=1e-14
            )
        speed = one.measurements.index("speed")
        in_feet = load_controller("feet.npz", model)
        np.testing.assert_allclose(
            one.D[0][:, speed], in_feet.D[0][:, speed] / factor, rtol=SAME_FORMULA
        )
    flight = ("fly", *AT_11, "--controller", "feet.npz", "--actuators", "0.5:60", "--duration", "1")
    ends = [
        answer(*flight, "--command", "dihedral=0.2:0.5", *units)["final"]
        for units in ((), ("--units", "si"))
    ]
    assert ends[1]["speed"] == pytest.approx(0.3048 * ends[0]["speed"], rel=SAME_FORMULA)
    assert ends[1]["alpha"] == pytest.approx(ends[0]["alpha"], rel=1e-9)
