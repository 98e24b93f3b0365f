"""Option `--draws N`: results for aircraft drawn from the covariance of identified parameters."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from controller.riccati.cost import cost_above_optimum
from controller.riccati.smallest_delta import minimum_delta
from hfa.main import main
from hfa_aircraft.uncertain import ParameterSpread, spread_of_file
from trim.point.condition import usual_condition
from verification.drawn import DrawnAircraft, band_of

UAV = str(ROOT / "examples" / "uav.toml")
NAMES = ("CL_alpha", "Cm_alpha", "Cm_q")


def written(deviation=0.02, name="found.toml"):
    """Write an aircraft file with uncertain parameters and return its name.

    The parameters have correlation coefficients of 0.5.

    deviation: relative standard deviation of each parameter
    """
    model = hfa.load_model(UAV)
    values = np.array([model.parameters[each].start for each in NAMES])
    correlation = 0.5 * np.eye(3) + 0.5
    covariance = np.outer(values, values) * deviation**2 * correlation
    rows = [f"aircraft = '{UAV}'", "[covariance]", f"names = {list(NAMES)}"]
    rows.append(f"rows = {covariance.tolist()}")
    Path(name).write_text("\n".join(rows))
    return name


def answer(capsys, *words):
    """Return the exit code of a command with --json, and the entry `draws` of the output."""
    code = main([*words, "--json"])
    data = json.loads(capsys.readouterr().out)
    return code, data["draws"]


def test_sampled_values_have_the_specified_covariance():
    """Samples of the parameters have the specified mean and covariance."""
    covariance = np.array([[4.0, 1.0], [1.0, 1.0]])
    spread = ParameterSpread({"CL_alpha": 3.0, "Cm_q": 0.0}, covariance)
    drawn = spread.draws(20_000, seed=1)
    np.testing.assert_allclose(drawn.mean(axis=0), [3.0, 0.0], atol=0.06)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=0.15)


def test_unstable_random_aircraft_are_counted():
    """If one of three random aircraft is unstable, two are reported as stable."""
    model = hfa.load_model(UAV)
    point = hfa.trim(model)
    unstable = model.with_parameters(Cm_alpha=0.3)
    drawn = DrawnAircraft([model, model, unstable], ("Cm_alpha",), 0, usual_condition(model), point)
    assert drawn.trims().stable_alone == 2
    band = band_of(7.0, list(range(1001)), "1/s")
    assert (band.value, band.low, band.high) == (7.0, 25.0, 975.0)
    assert np.isnan([band_of(7.0, [], "1/s").low, band_of(7.0, [], "1/s").high]).all()
    loops = drawn.loops(np.zeros((4, 8)))
    assert (loops.stable, loops.trimmed, loops.ok) == (2, 3, False)


def test_costs_of_a_gain_on_drawn_aircraft_agree(folder, capsys):
    """`hfa solve` and `hfa verify` report the same worst cost of a gain on drawn aircraft.

    With wider bands the worst cost is more than ten times as large. The second line of the report
    contains the number of stable loops.
    """
    narrow, wide = written(), written(0.2, "wide.toml")
    code, draws = answer(capsys, "solve", "--aircraft", narrow, "--draws", "10", "-o", "K.npz")
    assert code == 0
    assert draws["stable"] == 10
    assert 0.0 < draws["cost_lost_worst_percent"] < 1.0
    main(["solve", "--aircraft", narrow, "--draws", "2"])
    second = capsys.readouterr().out.splitlines()[1]
    assert second.startswith("linear loop stable for 2 of 2 drawn aircraft")
    assert len(second) <= 100
    code, again = answer(
        capsys, "verify", "--aircraft", narrow, "--weights", "K.npz", "--draws", "10"
    )
    assert code == 0
    assert again["cost_lost_worst_percent"] == pytest.approx(draws["cost_lost_worst_percent"])
    _, wider = answer(capsys, "verify", "--aircraft", wide, "--weights", "K.npz", "--draws", "10")
    assert wider["cost_lost_worst_percent"] > 10.0 * draws["cost_lost_worst_percent"]


def test_an_aircraft_that_is_not_stabilized_is_counted(folder, capsys):
    """For a gain of the wrong sign, the exit code is 1 and no random aircraft is reported as
    stable.
    """
    model = hfa.load_model(written())
    linear = hfa.linearize(model, hfa.trim(model))
    game = hfa.game(linear, np.ones(8), np.ones(4), delta=np.inf)
    np.savez("K.npz", K=-hfa.solve(game).K)
    words = ["verify", "--aircraft", "found.toml", "--weights", "K.npz", "--draws", "10"]
    assert main(words) == 1
    printed = capsys.readouterr()
    assert "stable for 0 of 10 drawn aircraft" in printed.out
    assert "stable for 0 of 10 drawn aircraft" in printed.err


def test_aircraft_without_a_trim_are_counted():
    """A drawn aircraft without lift is not counted as trimmed, and the result is not ok."""
    model = hfa.load_model(UAV)
    point = hfa.trim(model)
    dead = model.with_parameters(CL_alpha=0.0, CL_0=0.0)
    drawn = DrawnAircraft([model, dead], ("CL_alpha",), 0, usual_condition(model), point)
    draws = drawn.trims()
    assert (draws.trimmed, draws.ok) == (1, False)


@pytest.mark.slow
def test_a_deployed_policy_is_assessed_on_drawn_aircraft(folder, capsys):
    """`hfa assess` reports the band of the sampled loop's spectral radius over the drawn aircraft."""
    model = hfa.load_model(written())
    linear = hfa.linearize(model, hfa.trim(model))
    weak = hfa.game(linear, np.ones(8), 1e2 * np.ones(4), delta=np.inf)
    np.savez("K.npz", K=hfa.solve(weak).K)
    words = ("assess", "K.npz", "--sample-time", "0.02", "--aircraft", "found.toml")
    _, draws = answer(capsys, *words, "--samples", "0", "--best", "0", "--draws", "4")
    assert draws["stable"] == draws["trimmed"] == 4
    band = draws["bands"]["spectral radius"]
    assert band["low"] <= band["value"] <= band["high"] < 1.0


def test_parameters_of_the_hfa_are_sampled(capsys):
    """`hfa solve --draws` solves the game of each sampled HFA and lists the parameters."""
    code, draws = answer(capsys, "solve", "--dihedral", "15", "--draws", "5")
    assert code == 0
    assert draws["stable"] == 5
    assert "hinge_stiffness" in draws["parameters"]


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ("", "has no [covariance], which --draws requires"),
        (
            "[covariance]\nnames = ['CL_alpha']\nrows = [[1.0, 2.0]]",
            "does not consist of names of parameters and one row",
        ),
        (
            "[covariance]\nnames = ['Cl']\nrows = [[1.0]]",
            "does not consist of names of parameters and one row",
        ),
        ("[covariance]\nnames = ['CL_alpha']\nrows = [[-1.0]]", "is not a covariance"),
    ],
)
def test_a_wrong_covariance_is_refused(covariance, message, folder, capsys):
    """A file without a covariance, or with one of wrong names or values, is refused."""
    Path("found.toml").write_text(f"aircraft = '{UAV}'\n{covariance}")
    assert main(["fly", "--law", "none", "--aircraft", "found.toml", "--draws", "3"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (
            "[bands]\nCm_q = [-30.0, -40.0]",
            "band of Cm_q is [-30.0, -40.0]; give the lower limit first",
        ),
        ("[bands]\nCm_q = [-2.0, -1.0]", "outside the band [-2.0, -1.0]; correct the value or the"),
        ("[bands]\nCm_p = [-2.0, -1.0]", "unknown parameter 'Cm_p'; did you mean"),
        ("[bands]\nCm_q = [nan, 1.0]", "band of Cm_q is [nan, 1.0]"),
        ("[bands]\nCm_q = 3.0", "band of Cm_q is 3.0; give [low, high]"),
        ("bands = 3.0", "bands is 3.0; give a table [bands]"),
        ("[sensors]\nbias_alpha = 2.0\n[bands]\nbias_alpha = [0.0, 1.0]", "bias_alpha is 2.0, out"),
    ],
)
def test_a_wrong_band_is_refused(entries, message, folder, capsys):
    """Bands with reversed limits, unknown names or wrong values are refused in one line."""
    Path("found.toml").write_text(f"aircraft = '{UAV}'\n{entries}")
    assert main(["trim", "--aircraft", "found.toml"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_aircraft_without_a_game_solution_are_counted():
    """A drawn aircraft whose game has no solution with the given delta is counted as unsolved."""
    model = hfa.load_model(UAV)
    point = hfa.trim(model)
    game = hfa.game(hfa.linearize(model, point), np.ones(8), np.ones(4), delta=np.inf)
    least = minimum_delta(game).value
    tight = game.with_delta(1.001 * least)
    slow = model.with_parameters(Cm_elevator=0.8 * model.parameters["Cm_elevator"].start)
    drawn = DrawnAircraft([model, slow], ("Cm_elevator",), 0, usual_condition(model), point)
    K = hfa.solve(tight).K
    draws = drawn.gain(tight, K)
    assert draws.unsolved == 1
    band = draws.bands["abscissa of the loop"]
    assert band.value == pytest.approx(np.linalg.eigvals(tight.A - tight.B @ K).real.max())
    loose = tight.with_delta(np.inf)
    better = replace(drawn, models=[model, slow]).gain(loose, 0.9 * K)
    plants = [hfa.linearize(each, hfa.trim(each)) for each in (model, slow)]
    games = [replace(loose, A=plant.A, B=plant.B) for plant in plants]
    worst = [cost_above_optimum(each, hfa.solve(each), 0.9 * K)[0] for each in games]
    assert better.cost_lost_worst_percent == pytest.approx(100.0 * max(worst), rel=1e-6)
    assert "the game has no solution on 1; cost at most" in draws.first_line


def test_several_critics_with_draws_are_refused(folder, capsys):
    """`hfa verify --draws` refuses several critics before it prints a result."""
    for name in ("one.npz", "two.npz"):
        np.savez(name, K=np.zeros((4, 8)))
    words = ["verify", "--aircraft", written(), "--weights", "one.npz", "two.npz", "--draws", "2"]
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "--draws requires a single critic" in printed.err


def test_drawn_aircraft_are_simulated_from_the_nominal_trim(folder, capsys):
    """`hfa fly --draws` simulates drawn aircraft from the trim of the aircraft in the file.

    The largest pitch error agrees with flights of `hfa.fly`. With very wide bands the exit code is
    1.
    """
    pytest.importorskip("hfa_flight")
    words = ("fly", "--law", "none", "--draws", "3", "--json", "--duration")
    assert main([*words, "2", "--aircraft", written()]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["within_limits"], found["drawn"]) == (3, list(NAMES))
    model = hfa.load_model("found.toml")
    spread = spread_of_file("found.toml", model)
    point = hfa.trim(model)
    errors = []
    for drawn in spread.aircraft(model, 3, seed=0):
        flight = hfa.fly(drawn, point, None, seconds=2)
        pitch = flight.states[:-1, list(model.states).index("pitch")] - point.states.pitch
        errors.append(np.abs(pitch).max())
    assert found["peak_error"]["pitch"][-1] == pytest.approx(max(errors), rel=1e-6)
    assert main([*words, "8", "--aircraft", written(5.0, "wide.toml")]) == 1
    capsys.readouterr()
    main(["fly", "--aircraft", "found.toml", "--draws", "2", "--duration", "1"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "PASS: 2 of 2 members stayed within limits",
        "linear loop stable for 2 of 2 drawn aircraft",
    ]
    assert "members are aircraft with drawn parameters" in " ".join(lines)
    main(["fly", "--law", "none", "--aircraft", "found.toml", "--draws", "2", "--duration", "1"])
    assert capsys.readouterr().out.splitlines()[1].startswith("trimmed: 2 of 2 drawn aircraft; ")


def test_unstable_loops_of_random_aircraft_fail(folder, capsys):
    """Unstable linear loops of random aircraft fail although their flights stay within limits.

    A gain and a network with the same slope are tested. With a delay, the linear loop is not
    reported.
    """
    pytest.importorskip("hfa_flight")
    model = hfa.load_model(written())
    linear = hfa.linearize(model, hfa.trim(model))
    K = -hfa.solve(hfa.game(linear, np.ones(8), np.ones(4))).K
    np.savez("K.npz", K=K)
    np.savez("net.npz", **{"0.weight": -K})
    words = ["fly", "--aircraft", "found.toml", "--draws", "2", "--duration", "0.1", "--weights"]
    for weights in ("K.npz", "net.npz"):
        assert main([*words, weights]) == 1
        printed = capsys.readouterr()
        first, second = printed.out.splitlines()[:2]
        assert first.startswith("FAIL: linear loop stable for 0 of 2 drawn aircraft")
        assert second.startswith("PASS")
        assert "linear loop stable for 0 of 2 drawn aircraft" in printed.err
    assert main([*words, "K.npz", "--delay", "0.02"]) == 0
    assert "linear loop" not in capsys.readouterr().out
