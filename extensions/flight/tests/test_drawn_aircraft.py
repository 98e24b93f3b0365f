"""`hfa fly --draws N`: flights and linear loops of aircraft drawn from a covariance of parameters."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa.main import main
from hfa_aircraft.uncertain import ParameterSpread, spread_of_file
from hfa_flight import GainPolicy, MonteCarlo, Scenario, flight_envelope
from hfa_flight.samples.drawn_aircraft import drawn_figure
from hfa_flight.samples.monte_carlo import fly_member

UAV = str(ROOT / "examples" / "uav.toml")
NAMES = ("CL_alpha", "Cm_alpha", "Cm_q")
CORRELATION = 0.5 * np.eye(3) + 0.5


def written(deviation: float = 0.02) -> str:
    """Write an aircraft with uncertain parameters: relative standard deviations, correlated by .5."""
    model = hfa.load_model(UAV)
    values = np.array([model.parameters[each].start for each in NAMES])
    covariance = np.outer(values, values) * deviation**2 * CORRELATION
    rows = [f"aircraft = '{UAV}'", "[covariance]", f"names = {list(NAMES)}"]
    Path("found.toml").write_text("\n".join([*rows, f"rows = {covariance.tolist()}"]))
    return "found.toml"


@pytest.mark.usefixtures("folder")
def test_the_band_of_a_trim_agrees_with_a_linear_prediction(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """95 % of the elevators at the aircraft's own trims, within 15 % of covariance times slopes."""
    words = ["fly", "--aircraft", written(), "--law", "none", "--draws", "150"]
    assert main([*words, "--duration", "0.01", "--json"]) == 0
    draws = json.loads(capsys.readouterr().out)["draws"]
    model = hfa.load_model("found.toml")
    slopes = []
    for name in NAMES:
        value = model.parameters[name].start
        above, below = (
            hfa.trim(model.with_parameters(**{name: factor * value}))["elevator"]
            for factor in (1.001, 0.999)
        )
        slopes.append((above - below) / 0.002)
    deviation = 0.02 * np.sqrt(np.array(slopes) @ CORRELATION @ slopes)
    band = draws["bands"]["elevator"]
    assert band["high"] - band["low"] == pytest.approx(2 * 1.96 * deviation, rel=0.15)
    assert draws["trimmed"] == 150


@pytest.mark.usefixtures("folder")
def test_drawn_aircraft_fly_from_the_trim_of_the_given_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The largest pitch errors are those of `hfa.fly`; with very wide bands the exit code is 1."""
    words = ["fly", "--law", "none", "--draws", "3", "--json", "--aircraft"]
    assert main([*words, written(), "--duration", "2"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["within_limits"], found["drawn"]) == (3, list(NAMES))
    model = hfa.load_model("found.toml")
    point = hfa.trim(model)
    errors = []
    for drawn in spread_of_file("found.toml", model).aircraft(model, 3, seed=0):
        flight = hfa.fly(drawn, point, None, seconds=2)
        errors.append(np.abs(flight["pitch"][:-1] - point.states.pitch).max())
    assert found["peak_error"]["pitch"][-1] == pytest.approx(max(errors), rel=1e-6)
    assert main([*words, written(5.0), "--duration", "8"]) == 1


@pytest.mark.usefixtures("folder")
def test_unstable_linear_loops_fail_although_flights_stay(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of a gain and of a network of the same slope; with a delay there is no linear loop."""
    model = hfa.load_model(written())
    linear = hfa.linearize(model, hfa.trim(model))
    K = -hfa.solve(hfa.game(linear, np.ones(8), np.ones(4))).K
    np.savez("K.npz", K=K)
    np.savez("net.npz", **{"0.weight": -K})
    words = ["fly", "--aircraft", "found.toml", "--draws", "2", "--duration", "0.1", "--json"]
    for weights in ("K.npz", "net.npz"):
        assert main([*words, "--weights", weights]) == 1
        assert json.loads(capsys.readouterr().out)["draws"]["stable"] == 0
    assert main([*words, "--weights", "K.npz", "--delay", "0.02"]) == 0
    assert "draws" not in json.loads(capsys.readouterr().out)


def test_the_figure_shows_differences_of_random_flights() -> None:
    """Each line is the difference of a random aircraft's flight from the nominal aircraft's flight.

    The line ends where the flight leaves the envelope. States that do not move have no panel.
    """
    model = hfa.load_model(str(ROOT / "examples" / "uav.toml"))
    point = hfa.trim(model)
    names = ("CL_alpha", "Cm_alpha")
    values = {name: model.parameters[name].start for name in names}
    spread = ParameterSpread(values, np.diag([0.3 * value for value in values.values()]) ** 2)
    start = np.zeros(len(model.states))
    start[list(model.states).index("alpha")] = 0.05
    scenario = Scenario(duration=1.0, initial=start)
    gain = GainPolicy("none", np.zeros((len(model.inputs), len(model.linear))))
    limits = flight_envelope(
        model, point, {"alpha": (point["alpha"] - 0.02, point["alpha"] + 0.06)}
    )
    plan = MonteCarlo(5, 0, model, point, gain, scenario, limits, spread)
    itself = hfa.fly(model, point, None, 1.0, initial=start, envelope=limits)
    axes = drawn_figure(plan).axes
    labels = [each.get_ylabel() for each in axes]
    assert "beta, deg" not in labels
    lines = axes[labels.index("Δ alpha, deg")].get_lines()
    assert len(lines) == 5
    ends = []
    for member, line in enumerate(lines):
        flown = fly_member(plan, member)
        end = min(len(flown.time), len(itself.time)) - 1
        difference = np.degrees(flown["alpha"][end] - itself["alpha"][end])
        drawn = line.get_ydata()
        assert drawn[end] == pytest.approx(difference, abs=1e-9)
        assert np.isnan(drawn[end + 1 :]).all()
        ends.append(end)
    assert len(set(ends)) > 1
    differences = [line.get_ydata()[5] for line in lines]
    (band,) = axes[labels.index("Δ alpha, deg")].collections
    edges = band.get_paths()[0].vertices
    at = edges[np.isclose(edges[:, 0], itself.time[5]), 1]
    expected = np.percentile(differences, [2.5, 97.5])
    np.testing.assert_allclose([at.min(), at.max()], expected)
