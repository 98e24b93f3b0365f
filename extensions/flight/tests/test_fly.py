"""`hfa fly`: reports, files, exit codes and refused options."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from c_files import called, compiled, needs_gcc
from cli import answer, assert_refused, hfa
from controllers import integrating_controller
from game_files import stored
from known_models import model_at
from network_files import torch_file
from scipy.integrate import simpson

from hfa import Game, solve
from hfa_aircraft.model import Model
from hfa_flight import save_controller
from hfa_flight.envelope import control_limits
from hfa_model import LINEAR_STATES
from hfa_support.rows.store import open_store
from studies.servo.simvfa import reference_servo


@pytest.fixture(autouse=True)
def _in_a_folder(folder: Path) -> None:
    """Run each test in a new empty folder."""


FLY = ("fly", "--dihedral", "15", "--law", "exact")


def test_a_flight_is_reported_and_written() -> None:
    """A flight inside the envelope gives PASS. Its JSON file contains the scenario and the history."""
    words = (
        *FLY,
        "--duration",
        "1",
        "--initial",
        "speed=0.1",
        "--gust",
        "50:2",
        "--error",
        "lift_slope=0.99",
    )
    result = hfa(*words, "-o", "flight.json")
    assert (result.code, result.err) == (0, "wrote flight.json\n")
    assert "PASS: 1 s inside the envelope and the control limits" in result.out
    data = json.loads(Path("flight.json").read_text(encoding="utf-8"))
    assert data["schema"] == "hfa.flight/1"
    assert data["held"] is True
    assert data["departure"] is None
    assert data["scenario"]["errors"] == {"lift_slope": 0.99}
    assert data["scenario"]["gust"]["length"] == 50.0
    history = data["history"]
    assert (len(history["times"]), len(history["states"][0]), len(history["inputs"][0])) == (
        101,
        7,
        5,
    )
    assert history["states"][0][0] == pytest.approx(68.1)
    assert len(history["angles_of_attack"]) == 101
    assert data["final"]["angle_of_attack"] == history["angles_of_attack"][-1]
    assert max(history["updrafts"]) == pytest.approx(2.0, abs=0.01)
    assert hfa(*words, "-o", "flight.csv").code == 0
    lines = Path("flight.csv").read_text(encoding="utf-8").splitlines()
    assert "hfa.flight/1" in lines[1]
    assert lines[0].startswith("time [s],speed [ft/s],alpha [rad]")
    assert len(lines) == 102


def test_a_flight_without_a_policy_reports_a_cost() -> None:
    """With --Q and --R, a flight without a policy reports a cost within 0.1 % of Simpson's rule.

    Without --Q and --R, no cost is reported.
    """
    words = (
        "fly",
        "--dihedral",
        "15",
        "--law",
        "none",
        "--initial",
        "speed=0.1",
        "--duration",
        "1",
    )
    weights = ("--Q", "1,2,3,4,5,6", "--R", "1,1,1,1,1", "--json", "-o", "flight.npz")
    data = answer(*words, *weights)
    with np.load("flight.npz", allow_pickle=True) as file:
        z, times = file["history.errors"], file["history.times"]
    rate = z**2 @ np.arange(1.0, 7.0)
    assert data["cost"] == pytest.approx(simpson(rate, times), rel=1e-3)
    assert "cost" not in answer(*words, "--json")


def test_gains_and_critics_in_files_equal_law_exact(game: Game) -> None:
    """An exact K or P in a file gives the same flight as --law exact.

    Another R changes the policy that follows from P. Wrong files and options are refused.
    """
    exact = solve(game)
    stored("K.json", K=exact.K)
    stored("P.npz", P=exact.P)
    flight = ("fly", "--dihedral", "15", "--duration", "0.5", "--initial", "speed=0.1", "--json")
    expected = json.loads(hfa(*flight, "--law", "exact").out)
    for kind, file in (("gain", "K.json"), ("weights", "P.npz")):
        data = json.loads(hfa(*flight, "--weights", file).out)
        assert data["policy"]["law"] == f"{kind} of {file}"
        np.testing.assert_allclose(data["policy"]["K"], expected["policy"]["K"], rtol=1e-9)
        assert data["final"]["alpha"] == pytest.approx(expected["final"]["alpha"], rel=1e-6)
    costlier = json.loads(hfa(*flight, "--weights", "P.npz", "--R", "200,800,800,800,100").out)
    np.testing.assert_allclose(costlier["policy"]["K"], exact.K / 2, rtol=1e-9)
    stored("V.npz", W=np.ones(25))
    stored("small.npz", K=np.eye(2))
    for words, named in (
        ("--weights K.json --law exact", "--law has no effect with --weights; remove this option"),
        ("--weights P.npz --delta 300", "--delta has no effect with --weights"),
        ("--weights K.json --seed 3", "--seed applies only to --turbulence"),
        (
            "--weights small.npz",
            "small.npz: K is 2 x 2; give 5 x 6, inputs x states",
        ),
        (
            "--weights V.npz",
            "V.npz: W has 25 weights, but basis 'quadratic' of 6 states has 21",
        ),
        ("--weights none.npz", "no such file"),
    ):
        assert_refused(hfa("fly", "--dihedral", "15", *words.split()), 2, named)


# Scheduled controllers.

BEHIND = ("--dihedral", "11", "--actuators", "0.5:60")
FLOWN = (
    "fly",
    *BEHIND,
    "--duration",
    "3",
    "--controller",
    "servo.npz",
    "--command",
    "dihedral=1:1",
)


@pytest.fixture(scope="module")
def controllers(published_aircraft: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("servo")
    save_controller(made / "slow.npz", integrating_controller(published_aircraft))
    save_controller(
        made / "servo.npz",
        reference_servo(published_aircraft, "simvfa-1", np.radians([10.0, 13.0])),
    )
    return made


@pytest.fixture
def _in_folder_of_controllers(controllers: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(controllers)


@pytest.mark.usefixtures("_in_folder_of_controllers")
def test_a_controller_follows_commands_during_a_fault() -> None:
    """A controller follows commands during an actuator fault.

    The errors and the fault are in the JSON.
    """
    result = hfa(
        *FLOWN,
        "--command",
        "vertical_acceleration_short_period=2:-1",
        "--fault",
        "0.2:0.5:2",
        "-o",
        "flight.json",
    )
    assert (result.code, result.err) == (0, "wrote flight.json\n")
    assert "commanded output" in result.out
    data = json.loads(Path("flight.json").read_text("utf-8"))
    assert data["policy"]["law"] == "simvfa-1, reference model"
    assert set(data["commanded"]) == {"dihedral", "vertical_acceleration_short_period"}
    assert 0.0 < data["commanded"]["dihedral"]["rms_error"] < 0.01
    fault = data["scenario"]["actuators"]["faults"][0]
    assert (fault["begin"], fault["effectiveness"], fault["bandwidth"]) == (2.0, 0.2, 0.5)
    by_time = [row[0] for row in data["scenario"]["reference"]["values"]]
    assert by_time == pytest.approx([np.radians(1.0)] * 2)  # also when the other command begins


@pytest.mark.usefixtures("_in_folder_of_controllers")
def test_unsuitable_controllers_faults_and_commands_are_refused() -> None:
    """Controllers of other dynamics, wrong faults and wrong commands are refused."""
    for words, named in (
        ("--dynamics newton", "designed for published dynamics"),
        ("--fault 0:0.5", "effectiveness after a fault is 0"),
        ("--fault 0.2", "give EFFECTIVENESS:BANDWIDTH[:BEGIN]"),
        ("--command speed=1:1", "cannot follow a command of 'speed'"),
        ("--command dihedral=1", "give NAME=TIME:VALUE"),
        ("--command dihedral=2:1,1:0", "give increasing times"),
        ("--law exact", "--law has no effect with --controller"),
    ):
        assert_refused(hfa(*FLOWN[:-2], *words.split()), 2, named)


@pytest.mark.usefixtures("_in_folder_of_controllers")
def test_members_follow_commands_during_a_fault() -> None:
    """All members of a Monte Carlo simulation that follow commands stay inside the envelope.

    With a fault of effectiveness 0.2, the effort of the outer ailerons falls by more than half.
    """
    words = ("fly", *BEHIND, "--duration", "2", "--samples", "3")
    noisy = (
        "--noise",
        "dihedral=0.01",
        "--turbulence",
        "own:0.01:1750",
        "--command",
        "dihedral=0:1",
    )
    data = [
        json.loads(hfa(*words, *noisy, "--controller", "slow.npz", *more, "--json").out)
        for more in ((), ("--fault", "0.2:0.5"))
    ]
    assert [each["held"] for each in data] == [3, 3]
    assert data[0]["law"] == "small"
    whole, weak = (each["effort"]["aileron_outer"][1] for each in data)
    assert weak < 0.5 * whole


# Networks.


def network_of(K: np.ndarray) -> str:
    """Write a file with a network that computes u = -K z, and return its path.

    The network uses relu(z) - relu(-z) = z.
    """
    twice = np.vstack([np.eye(6), -np.eye(6)])
    layers = {
        "0.weight": twice,
        "0.bias": np.zeros(12),
        "2.weight": -K @ twice.T,
        "2.bias": np.zeros(5),
    }
    return torch_file("net.pt", layers)


def test_a_linear_network_flies_as_its_gain(game: Game) -> None:
    """A network that computes -K z gives the same flight as the gain K.

    From a larger initial deviation, only the inputs of the network are saturated at the control
    limits.
    """
    path = network_of(solve(game).K)
    network = ("--weights", path, "--set", "activation=relu")
    words = ("fly", "--dihedral", "15", "--duration", "0.5", "-o", "a.json")
    flown = {}
    for name, policy in (("gain", ("--law", "exact")), ("network", network)):
        assert hfa(*words, *policy, "--initial", "speed=0.1").code == 0
        flown[name] = json.loads(Path("a.json").read_text("utf-8"))
    assert flown["network"]["policy"] == {"law": "critic of net.pt"}
    states = {name: np.array(data["history"]["states"]) for name, data in flown.items()}
    np.testing.assert_allclose(states["network"], states["gain"], rtol=1e-9, atol=1e-12)
    largest = flown["network"]["largest_difference_from_linear"]
    assert largest == pytest.approx(flown["gain"]["largest_difference_from_linear"], rel=1e-6)
    far = ("--initial", "speed=0.5", "--json")
    gain = json.loads(hfa(*words[:-2], "--law", "exact", *far).out)
    assert gain["exceeded"][0]["input"] == "elevator_outer"
    limited = json.loads(hfa(*words[:-2], *network, *far).out)
    assert limited["exceeded"] == []


@needs_gcc
def test_a_network_is_exported_as_c(game: Game) -> None:
    """The exported C code of a network computes inputs that are saturated at the control limits."""
    K = solve(game).K
    network = ("--weights", network_of(K), "--set", "activation=relu", "--dihedral", "15")
    assert hfa("export", "-o", "c", *network).code == 0
    folder = Path("c").resolve()
    compiled(folder, "-shared", "-fPIC", "hfa_aircraft.c", "-o", "library.so")
    point = model_at(15.0).point
    x = np.array(point.states) + np.array([0.01, 1e-3, 0.0, 1e-3, 1e-3, 1e-3, 1e-3])
    u = np.empty(5)
    called(folder, "hfa_policy", x, u)
    z = np.delete(x - np.array(point.states), 2)
    np.testing.assert_allclose(u, np.array(point.inputs) - K @ z, rtol=1e-12)
    called(folder, "hfa_policy", x + np.array([5.0, 0, 0, 0, 0, 0, 0]), u)
    limits = control_limits(point.model)
    assert limits.within(u).all()
    assert np.isclose(u, limits.highest).any()


# Monte Carlo.


def test_a_monte_carlo_command_stores_and_summarizes(tmp_path: Path) -> None:
    """`hfa fly --samples` stores each member, and the quantiles in its summary are those of the
    store.
    """
    store = str(tmp_path / "a.zarr")
    uncertain = ("--error", "panel_mass=0.05", "--noise", "alpha=0.1", "--turbulence", "own:3:1750")
    words = (
        "fly",
        "--dihedral",
        "15",
        "--law",
        "exact",
        "--duration",
        "0.1",
        "--samples",
        "8",
        *uncertain,
    )
    result = hfa(*words, "--json", "-o", store)
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert (data["schema"], data["members"], data["held"]) == ("hfa.monte-carlo-summary/1", 8, 8)
    kept = open_store(Path(store))
    peaks = kept["peak_error"].values[:, LINEAR_STATES.index("alpha")]
    assert data["peak_error"]["alpha"] == pytest.approx(
        np.quantile(peaks, data["quantiles"]).tolist()
    )
    angles = kept["peak_angle_of_attack"].values
    assert data["peak_deviation"]["angle_of_attack"] == pytest.approx(
        np.quantile(angles, data["quantiles"]).tolist()
    )
    ends = np.quantile(kept["final"].values, data["quantiles"], axis=0)
    assert np.transpose(list(data["final"].values())) == pytest.approx(ends)
    assert "angle_of_attack" in data["left"]
    again = hfa(*words, "--resume", "-o", store)
    assert "8 of 8 members stayed within limits" in again.out
    assert f"{np.degrees(data['peak_error']['alpha'][3]):.4g}" in again.out
    assert "members not kept" in " ".join(hfa(*words).out.split())


# Gains over the dihedral.

SCHEDULE = ("fly", "--dihedral", "5", "--command", "dihedral=1:6", "--duration", "3")


@pytest.mark.slow
def test_scheduled_gains_of_three_formats_fly_equally() -> None:
    """Gains from `hfa design`, a JSON table and a MATLAB stack give the same flight.

    A single gain for all angles gives another flight. A command beyond the table is refused.
    """
    made = hfa("design", "--design", "paper", "--dihedral", "5,10,15", "-o", "paper.npz", "--json")
    assert made.code == 0, made.err
    K = -np.array(json.loads(made.out)["D"])
    stored("gains.json", K=K, dihedral_deg=np.array([5.0, 10.0, 15.0]))
    stored("stacked.mat", K=np.moveaxis(K, 0, -1), dihedral_deg=np.array([5.0, 10.0, 15.0]))
    stored("one.json", K=K[0])
    finals = {}
    for name in ("paper.npz", "gains.json", "stacked.mat", "one.json"):
        result = hfa(*SCHEDULE, "--controller", name, "-o", "flown.json")
        assert (result.code, result.err) == (0, "wrote flown.json\n")
        assert result.out.startswith("PASS: 3 s")
        assert f"law gains of {name}\n" in result.out
        data = json.loads(Path("flown.json").read_text("utf-8"))
        finals[name] = np.array(data["history"]["states"][-1])
    np.testing.assert_allclose(data["policy"]["K"], K[:1])
    np.testing.assert_allclose(finals["gains.json"], finals["paper.npz"], rtol=1e-9)
    np.testing.assert_allclose(finals["stacked.mat"], finals["paper.npz"], rtol=1e-9)
    assert np.abs(finals["one.json"] - finals["paper.npz"]).max() > 1e-6
    beyond = hfa(*SCHEDULE[:3], "--command", "dihedral=1:11", "--controller", "paper.npz")
    assert_refused(beyond, 2, "the gains cover 5 deg to 15 deg, but 5 deg to 16 deg")


def test_flights_in_si_and_english_units_agree() -> None:
    """A flight with --units si and converted options ends in the converted state."""
    foot = 0.3048
    words = (*FLY, "--duration", "0.5", "--gust")
    feet = answer(*words, "200:5")["final"]
    metres = answer(*words, f"{200 * foot!r}:{5 * foot!r}", "--units", "si")["final"]
    assert metres["speed"] == pytest.approx(feet["speed"] * foot, rel=1e-9)
    assert metres["alpha"] == pytest.approx(feet["alpha"], rel=1e-7, abs=1e-12)
