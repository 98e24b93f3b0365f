"""`hfa fly` and `hfa export` with `--aircraft FILE.py:NAME`."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from project import ROOT

from hfa_support.rows.store import open_store

NAVION = "navion.py:NAVION"
F16 = "f16.py:F16"
EXAMPLES = ROOT / "examples"


@pytest.fixture(autouse=True)
def _with_example_files(folder: Path) -> None:
    for name in ("navion.py", "f16.py"):
        shutil.copy(EXAMPLES / name, ".")


def test_a_flight_accepts_offsets_actuators_faults_and_delay() -> None:
    """A flight accepts an initial deviation, actuators, a fault and a delay, which sets the tick.

    The fault applies to all surfaces.
    """
    words = (
        "--law",
        "exact",
        "--initial",
        "alpha=2",
        "--actuators",
        "0.1:60",
        "--fault",
        "0.5:5",
        "--delay",
        "0.025",
    )
    data = json.loads(hfa("fly", "--aircraft", NAVION, *words, "--duration", "5", "--json").out)
    scenario = data["scenario"]
    assert (scenario["tick"], scenario["delay"], data["within_limits"]) == (0.005, 0.025, True)
    assert scenario["actuators"]["faults"][0]["inputs"] == ["elevator", "aileron", "rudder"]


FOUR = ("--law", "exact", "--samples", "4", "--duration", "0.2")
MEMBERS = ("fly", "--aircraft", NAVION, *FOUR, "--noise", "alpha=0.1", "-o", "a.zarr")


def test_flights_of_users_aircraft_are_stored() -> None:
    """The flights of a Monte Carlo plan for users' aircraft are stored.

    After a change of the aircraft file, --resume is refused.
    """
    assert hfa(*MEMBERS).code == 0
    assert open_store(Path("a.zarr"))["final"].values.shape == (4, 8)
    source = Path("navion.py").read_text("utf-8")
    Path("navion.py").write_text(source.replace("4.44", "4.45"), "utf-8")
    assert_refused(hfa(*MEMBERS, "--resume"), 2, "another Monte Carlo")


def test_a_gain_scheduled_policy_tracks_a_speed_command() -> None:
    """A gain-scheduled policy tracks a speed command. A command beyond the speeds of the table
    is refused.
    """
    gain = json.loads(hfa("solve", "--aircraft", NAVION, "--json").out)["K"]
    np.savez("gains.npz", speed=np.array([170.0, 200.0]), K=np.array([gain, gain]))
    words = ("fly", "--aircraft", NAVION, "--controller", "gains.npz", "--command", "speed=1:14")
    result = hfa(*words, "--duration", "30", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["final"]["speed"] == pytest.approx(190.0, abs=5.0)
    np.savez("gains.npz", speed=np.array([170.0, 180.0]), K=np.array([gain, gain]))
    assert_refused(hfa(*words), 2, "the gains cover 170 ft/s to 180 ft/s, but 176 ft/s to 190 ft/s")


TANKS = """
import casadi as ca
from hfa import Model, Signal

TABLE = ca.interpolant("drag", "linear", [[0.0, 1.0, 2.0, 3.0]], [0.0, 1.0, 3.0, 6.0])
X, Y = ca.SX.sym("x"), ca.SX.sym("y")
ROOT = ca.rootfinder("inflow", "newton", {"x": X, "p": Y, "g": X + 0.1 * X**3 - Y})


def tank(rate):
    return Model("tank", {"level": Signal("ft", start=0.5)}, {"pump": Signal(start=0.5)},
                 lambda x, u, p, w: ({"level": rate(x.level, u.pump) + 0.1 * w.rain}, {}),
                 disturbances={"rain": Signal("ft/s")}, trim={"level": 0.5}, schedule="level")


PLAIN = tank(lambda level, pump: pump - level)
WITH_TABLE = tank(lambda level, pump: pump - TABLE(level))
IMPLICIT = tank(lambda level, pump: ROOT(1.0, pump) - level)
"""


def test_exports_contain_the_models_disturbances() -> None:
    """Exports contain the disturbances of the model.

    A function that C cannot express is refused by name.
    """
    Path("tanks.py").write_text(TANKS, "utf-8")
    for place in ("c", "a.fmu"):
        assert hfa("export", "--aircraft", "tanks.py:PLAIN", "-o", place).code == 0
        for name, function in (("WITH_TABLE", "drag"), ("IMPLICIT", "inflow")):
            refused = hfa("export", "--aircraft", f"tanks.py:{name}", "-o", f"refused_{place}")
            assert_refused(
                refused,
                2,
                f"the function {function}",
                "cannot be written as C",
            )
    texts = [path.read_text("utf-8") for path in Path("c").iterdir()]
    assert any("HFA_WIND_RAIN, /* ft/s */" in text for text in texts)
    assert not any("updraft" in text or "dihedral" in text for text in texts)
    with zipfile.ZipFile("a.fmu") as archive:
        description = archive.read("modelDescription.xml").decode()
    assert 'name="rain"' in description
    assert "updraft" not in description


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("fly --initial paper", "'paper' is not NAME=VALUE"),
        ("fly --initial speed=1,alpa=2", "alpa is unknown; did you mean alpha?"),
        ("fly --command flap=1:1", "a gain cannot follow a command of 'flap'"),
        ("fly --law none --command flap=1:1", "unknown input 'flap'"),
        ("fly --law none --command speed=1", "give NAME=TIME:VALUE"),
        ("fly --law none --delta 100", "applies only to a law"),
        ("fly --disturbance rain=1", "rain is unknown; choose from"),
        ("fly --error mass=1.1", "unknown parameter 'mass'"),
        ("fly --envelope speed=200:300", "speed is 176 ft/s at trim, outside the envelope, "),
        ("fly --delay 0.0105", "give a multiple of the tick"),
    ],
)
def test_options_for_another_aircraft_are_refused(words: str, named: str) -> None:
    """Options with names, units or values that do not fit the Navion are refused in one line."""
    command, *more = words.split()
    assert_refused(hfa(command, "--aircraft", NAVION, *more), 2, named)


@pytest.mark.slow
def test_a_controller_is_scheduled_over_the_users_speed() -> None:
    """A controller scheduled over the speed of a user's model is designed, simulated and exported.

    A speed outside the schedule and another aircraft are refused.
    """
    for name in ("gtm.py", "gtm.toml"):
        shutil.copy(EXAMPLES / name, ".")
    gtm = ("--aircraft", "gtm.py:GTM")
    at = ("--hold", "speed=45")
    made = json.loads(
        hfa("design", "gtm.toml", *gtm, "--at", "40,45,50", "-o", "gtm.npz", "--json").out
    )
    assert (made["schedule"], made["places"], made["commands"]) == (
        "speed",
        [40.0, 45.0, 50.0],
        ["gamma_command", "speed_command"],
    )
    assert made["signal_units"][:5] == ["m/s", "rad", "rad/s", "rad", "rad"]
    assert made["signal_units"][5:] == ["%", "rad", "rad", "m/s"]
    assert [row["speed"] for row in made["margins"]["rows"][::4]] == [40.0, 42.5, 45.0, 47.5, 50.0]
    exact = np.array(json.loads(hfa("solve", "--design", "gtm.toml", *gtm, *at, "--json").out)["K"])
    np.testing.assert_allclose(made["C"][1], -exact[:, 6:], rtol=1e-9)
    np.testing.assert_allclose(np.array(made["D"])[1, :, :6], -exact[:, :6], rtol=1e-9)
    flight = ("--controller", "gtm.npz", "--actuators", "0.05:60", "--duration", "10")
    flown = json.loads(hfa("fly", *gtm, *at, *flight, "--command", "speed=1:2", "--json").out)
    assert (flown["within_limits"], flown["commanded"]["speed"]["unit"]) == (True, "m/s")
    assert flown["commanded"]["speed"]["rms_error"] < 1.0
    assert hfa("export", *gtm, *at, "--controller", "gtm.npz", "-o", "c").code == 0
    header = Path("c/hfa_controller.h").read_text("utf-8")
    assert "in the measured\n   speed between" in header
    assert "40 to 50 m/s" in header
    of_gtm = ("--controller", "gtm.npz", "--actuators", "0.05:60")
    assert_refused(
        hfa("fly", *gtm, "--hold", "speed=60", *of_gtm),
        2,
        "covers speed 40 to 50 m/s, but 60 to 60 m/s is",
    )
    assert_refused(
        hfa("fly", "--dihedral", "5", *of_gtm), 2, "made for GTM, not for published dynamics"
    )
    assert_refused(
        hfa("fly", "--aircraft", F16, *of_gtm), 2, "the controller was made for GTM, not for F-16"
    )
    prove = (
        "prove",
        "schedule",
        *gtm,
        "--at",
        "40:45",
        "--design",
        "gtm.toml",
        "--weights",
        "gtm.npz",
    )
    assert_refused(hfa(*prove), 2, "a proof does not support the measurement elevator_position")
    assert_refused(
        hfa("design", "gtm.toml", *gtm), 2, "values of speed are missing; give --at RANGE"
    )
    assert_refused(hfa("design", "gtm.toml"), 2, "unknown input 'elevator'")
