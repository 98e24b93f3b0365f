"""`hfa solve`, `hfa learn`, `hfa verify`, with plants of the user's own and with designs; `hfa
design`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from game_files import AT_15, HISTORY, LABELS, QUICK, small
from known_models import game_at, model_at
from project import ROOT
from scipy.io import loadmat
from servo_cases import SIMVFA, simvfa_design

import hfa_model
from controller import design_model, load_controller
from hfa.main import DONE, FAILED
from hfa_aircraft.model import Model
from hfa_model import INPUTS, LINEAR_STATES
from hfa_model.vectors import INPUT_UNITS, STATE_UNITS
from verification import solve_game

# Solve.


@pytest.mark.parametrize(("degrees", "dynamics"), [("5", "published"), ("15", "newton")])
def test_solve_gives_the_certified_solution(degrees: str, dynamics: str) -> None:
    data = answer("solve", "--dihedral", degrees, "--dynamics", dynamics)
    assert (
        set(data)
        >= {"schema", "P", "K", "delta", "delta_min", "certificate", "meaning", "disk_margin"}
        | LABELS
    )
    exact = solve_game(game_at(float(degrees), dynamics))
    np.testing.assert_array_equal(data["P"], exact.P)
    np.testing.assert_array_equal(data["K"], exact.K)
    assert data["delta"] == 200.0
    assert 100.0 < data["delta_min"] < 120.0
    assert data["delta_margin"] == 200.0 / data["delta_min"]
    assert data["certificate"]["ok"] is True
    assert all(check["ok"] for check in (*data["certificate"]["checks"], *data["meaning"]))
    assert (data["states"], data["inputs"]) == (list(LINEAR_STATES), list(INPUTS))
    assert data["state_units"] == [getattr(STATE_UNITS, name) for name in LINEAR_STATES]
    assert data["input_units"] == list(INPUT_UNITS)
    assert list(data["loop_margins"]) == list(INPUTS)


@pytest.mark.parametrize(
    ("delta", "failed"),
    [
        ("100", "against every input the disturbance gains at least 113.304, at 0 rad/s"),
        ("113.5", "P is indefinite"),
    ],
)
def test_solve_below_the_smallest_delta_gives_no_P_and_says_what_would_do(
    delta: str, failed: str
) -> None:
    result = hfa("solve", *AT_15, "--delta", delta, "--json", "-o", "solution.json")
    assert (result.code, result.out) == (FAILED, "")
    assert result.err.count("\n") == 1
    assert failed in result.err
    assert f"delta = {delta} is below delta_min = 113.5486; ask for a larger delta" in result.err
    assert list(Path().iterdir()) == []


# Plants of the user's own.


@pytest.mark.parametrize(
    "changes",
    [
        {"E": None},
        {"E": [[0.0], [0.0]]},
        {"E": [[], []]},
        {"delta": math.inf},
        {"Q": [[0.0, 0.0], [0.0, 1.0]]},
        {"A": [[-1.0]], "B": [[1.0]], "Q": [[1.0]], "R": [[1.0]], "E": None},
        {
            "A": [[-1.0, 0.0, 0.0], [0.2, -2.0, 0.0], [0.0, 0.3, -4.0]],
            "B": [[1.0], [0.5], [0.2]],
            "E": None,
        }
        | {"Q": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
    ],
    ids=[
        "E not given",
        "E zero",
        "E empty",
        "delta inf",
        "one free state",
        "one state",
        "two free states",
    ],
)
def test_every_command_takes_plants_at_the_edge(changes: dict[str, Any]) -> None:
    plant = small("plant.json", **changes)
    assert answer("solve", "--model", plant)["certificate"]["ok"] is True
    assert answer("learn", "--model", plant, *QUICK, "-o", "learned.json")["converged"] is True
    assert answer("verify", "--model", plant, "--weights", "learned.json")["P_rel_error"] <= 1e-12


# Learn.


def test_learn_prints_the_outcome_and_keeps_the_history_for_files() -> None:
    printed = answer("learn", *AT_15, *QUICK, "-o", "run.json")
    assert (
        set(printed)
        >= {"schema", "law", "P", "K", "W", "converged", "certificates", "settling_time"} | LABELS
    )
    assert HISTORY.isdisjoint(printed)
    assert printed["converged"] is True
    assert all(row["ok"] for row in printed["certificates"])
    assert printed["settling_time"] <= printed["settings"]["predefined_time"] == 10.0
    filed = json.loads(Path("run.json").read_text(encoding="utf-8"))
    assert {key: value for key, value in filed.items() if key not in HISTORY} == printed
    assert set(filed) - set(printed) == HISTORY
    assert np.shape(filed["weights"]) == (101, 21)
    assert filed["weights"][0] == pytest.approx([100.0] * 21, rel=1e-14)
    assert filed["weights"][-1] == printed["W"]


@pytest.mark.parametrize(("command", "suffix"), [("learn", "npz"), ("solve", "mat")])
def test_verify_reads_what_learn_and_solve_write(command: str, suffix: str) -> None:
    plant = small("plant.json")
    assert hfa(command, "--model", plant, "-o", f"critic.{suffix}").code == DONE
    data = answer("verify", "--model", plant, "--weights", f"critic.{suffix}")
    assert data["ok"] is True
    assert data["P_rel_error"] <= 1e-13
    assert (data["plant"], data["delta"]) == ("plant.json", 3.0)
    assert (data["states"], data["inputs"], data["state_units"]) == (["x1", "x2"], ["u1"], ["", ""])
    assert (data["provenance"]["model"], data["provenance"]["parameters"]) == (plant, "")


def test_a_linear_model_keeps_its_names() -> None:
    assert hfa("linearize", "--dihedral", "12", "-o", "plant.json").code == 0
    found = answer("solve", "--model", "plant.json")
    assert (tuple(found["states"]), tuple(found["inputs"])) == (LINEAR_STATES, INPUTS)
    assert found["state_units"][:2] == ["ft/s", "rad"]
    assert found["plant_provenance"]["parameters"] == "identified"
    assert found["plant_provenance"]["command"].startswith("hfa linearize --dihedral 12 -o ")


# The game of a design.

AT_11 = ("--dihedral", "11")
PEER = ROOT / "extensions/servo/tests/peer_gains.json"


@pytest.mark.parametrize(("name", "size"), [("simvfa-1", 10), ("simvfa-2", 12)])
def test_the_exact_gain_of_a_design_with_names_and_units(
    name: str, size: int, published_aircraft: Model
) -> None:
    data = answer("solve", "--design", SIMVFA[name], *AT_11)
    theirs = np.array(json.loads(PEER.read_text(encoding="utf-8"))["gains"][name]["11"])
    assert np.linalg.norm(data["K"] - theirs) <= 2e-5 * np.linalg.norm(theirs)
    assert data["certificate"]["ok"] is True
    assert (data["delta"], len(data["states"])) == (None, size)
    built = design_model(published_aircraft, model_at(11.0), simvfa_design(name))
    for key in ("states", "inputs", "state_units", "input_units"):
        assert data[key] == list(getattr(built, key))
    assert (
        data["plant"]
        == f"design {SIMVFA[name]} of the aircraft at dihedral 11 deg, published dynamics"
    )


def test_the_paper_s_design_is_the_default_game() -> None:
    one = answer("solve", "--design", "paper", *AT_15)
    other = answer("solve", *AT_15)
    assert {key for key in one if one[key] != other.get(key)} - {"provenance"} == {"plant"}


def test_a_critic_of_a_servo_is_learned_and_certified() -> None:
    learned = answer("learn", "--design", SIMVFA["simvfa-1"], *AT_11, *QUICK, "-o", "servo.npz")
    assert (learned["converged"], len(learned["W"]), len(learned["states"])) == (True, 55, 10)
    checked = answer("verify", "--design", SIMVFA["simvfa-1"], *AT_11, "--weights", "servo.npz")
    assert checked["ok"] is True
    assert max(checked["P_rel_error"], checked["K_rel_error"]) <= 1e-8
    run = answer("verify", "--design", SIMVFA["simvfa-1"], *AT_11, *QUICK)
    assert run["P_rel_error"] == checked["P_rel_error"]


# From measured outputs.

SENSORS = """
[sensors]
vertical_acceleration_short_period_integral = 1e-2
dihedral_integral = 1e-4
load_factor = 1e-3
"""


def own(name: str, sensors: str = SENSORS, **changed: str) -> str:
    """A file with the settings of `simvfa-1`, some words changed, and sensors."""
    text = Path(SIMVFA["simvfa-1"]).read_text(encoding="utf-8")
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new)
    Path(name).write_text(text + sensors, encoding="utf-8")
    return name


def test_a_design_with_sensors_is_designed_from_its_measurements() -> None:
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
        ("[sensors]\nlift = 1", {}, 2, "unknown sensor 'lift'; choose from speed"),
        (
            "[sensors]\nspeed = 0",
            {},
            2,
            "the noise of sensor speed is 0.0; it must be a positive number",
        ),
        ("[sensors]\nspeed = 'x'", {}, 2, "sensors.speed is 'x'; give a finite number from 0 on"),
        ("[sensors]\npitch_rate = 1", {}, 1, "the sensors do not see the mode with eigenvalue 0,"),
        (
            SENSORS,
            {"delta = inf": 'disturbance = "updraft"'},
            2,
            "sensor load_factor sees the updraft itself",
        ),
        (
            "",
            {"vertical_acceleration_short_period": "pitch_rate"},
            2,
            "output pitch_rate: no input moves it at rest",
        ),
    ],
)
def test_what_no_controller_can_do_is_one_line(
    sensors: str, changed: dict[str, str], code: int, named: str
) -> None:
    """More of them are in docs/servo.md."""
    assert_refused(hfa("design", own("own.toml", sensors, **changed), *AT_11), code, named)


def test_a_design_becomes_a_file_that_prints_the_same_table() -> None:
    made = hfa("design", "--design", SIMVFA["simvfa-1"], "--dihedral", "9:11:2", "-o", "servo.npz")
    assert made.code == 0
    again = hfa("design", "servo.npz")
    table = made.out.split("\n\n")[:-1]  # the last paragraph is the provenance
    assert again.out.split("\n\n")[:-1] == table
    assert "simvfa-1.toml: state feedback, 2 states, 2 angles from 9 to 11 deg" in table[0]
    assert (
        f"Margins of controller {SIMVFA['simvfa-1']}, published dynamics: PASS, 12 of 12 loops"
        " stable" in made.out
    )
    controller = load_controller("servo.npz", hfa_model.aircraft())
    assert controller.about["provenance"]["command"].startswith(
        f"hfa design --design {SIMVFA['simvfa-1']}"
    )
    data = answer("design", "servo.npz")
    np.testing.assert_array_equal(data["C"], controller.C)
    assert [row["dihedral"] for row in data["angles"]] == pytest.approx(controller.breakpoints)


def test_matrices_go_to_other_tools() -> None:
    assert (
        hfa("design", "--design", SIMVFA["simvfa-1"], "--dihedral", "11", "-o", "servo.mat").code
        == 0
    )
    assert loadmat("servo.mat")["D"].shape == (2, 11, 1) or loadmat("servo.mat")["D"].shape == (
        2,
        11,
    )
