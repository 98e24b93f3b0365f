"""`hfa fly --draws N`: flights and linear loops of aircraft drawn from a covariance of parameters."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa.main import main

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
    words = ["fly", "--aircraft", written(), "--policy", "none", "--draws", "150"]
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
        assert main([*words, "--policy", weights]) == 1
        assert json.loads(capsys.readouterr().out)["draws"]["stable"] == 0
    assert main([*words, "--policy", "K.npz", "--delay", "0.02"]) == 0
    assert "draws" not in json.loads(capsys.readouterr().out)
