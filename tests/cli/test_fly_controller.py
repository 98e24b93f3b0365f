"""`hfa fly --controller` and `hfa monte-carlo --controller` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from controllers import integrating_controller

from controller import save_controller
from hfa_model import Aircraft
from studies.servo.simvfa import reference_servo

FLY = ("fly", "--dihedral", "11", "--duration", "5")
FLOWN = (*FLY, "--controller", "servo.npz", "--actuators", "0.5:60", "--command", "dihedral=1:1")


@pytest.fixture(scope="module")
def folder(published_aircraft: Aircraft, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("servo")
    save_controller(made / "slow.npz", integrating_controller(published_aircraft))
    save_controller(
        made / "servo.npz", reference_servo(published_aircraft, "simvfa-1", np.radians(np.arange(9.0, 15.0)))
    )
    return made


@pytest.fixture(autouse=True)
def _there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def test_a_controller_flies_its_commands_and_says_what_it_missed() -> None:
    result = hfa(*FLOWN, "--command", "vertical_acceleration_short_period=1:-1", "--fault", "0.2:0.5:2", "--json")
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert data["policy"]["law"] == "simvfa-1, reference model"
    assert set(data["commanded"]) == {"dihedral", "vertical_acceleration_short_period"}
    assert 0.0 < data["commanded"]["dihedral"]["rms_error"] < 0.01
    fault = data["scenario"]["actuators"]["faults"][0]
    assert (fault["begin"], fault["effectiveness"], fault["bandwidth"]) == (2.0, 0.2, 0.5)
    assert data["scenario"]["reference"]["values"][0][0] == pytest.approx(0.01745, abs=1e-5)
    assert "commanded output" in hfa(*FLOWN).out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--dynamics", "newton"), "designed for published dynamics"),
        (("--fault", "0:0.5"), "effectiveness after a fault is 0"),
        (("--fault", "0.2"), "give EFFECTIVENESS:BANDWIDTH[:BEGIN]"),
        (("--command", "speed=1:1"), "follows no command of 'speed'"),
        (("--command", "vertical_acceleration_short_period=1"), "give NAME=TIME:VALUE"),
        (("--command", "vertical_acceleration_short_period=2:1,1:0"), "the times must increase"),
        (("--law", "exact"), "--law changes nothing beside --controller"),
        (("--command", "dihedral=1"), "give NAME=TIME:VALUE"),
    ],
)
def test_controllers_that_do_not_fit_are_refused(words: tuple[str, ...], named: str) -> None:
    assert_refused(hfa(*FLOWN, *words), 2, named)


def test_members_follow_commands_behind_failing_actuators() -> None:
    words = (
        "monte-carlo",
        "--dihedral",
        "11",
        "--actuators",
        "0.5:60",
        "--duration",
        "2",
        "--samples",
        "3",
    )
    noisy = ("--noise", "dihedral=0.01", "--turbulence", "0.01:1750", "--command", "dihedral=0:1")
    data = [
        json.loads(hfa(*words, *noisy, "--controller", "slow.npz", *more, "--json").out)
        for more in ((), ("--fault", "0.2:0.5"))
    ]
    assert [each["held"] for each in data] == [3, 3]
    assert data[0]["law"] == "small"
    whole, weak = (each["effort"]["aileron_outer"][1] for each in data)
    assert weak < 0.5 * whole
    stiff = json.loads(hfa(*words, *noisy, "--controller", "servo.npz", "--json").out)
    assert (stiff["held"], stiff["law"]) == (3, "simvfa-1, reference model")
