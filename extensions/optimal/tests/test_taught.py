"""A network that the predictive policy teaches."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hfa
from hfa.main import main

EXAMPLES = Path(__file__).parents[3] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"


@pytest.mark.slow
def test_a_taught_network_flies_almost_as_the_best_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its flight from the taught initial condition costs at most 5 % more than the best, flights
    from there and from nearer to the trim end at the trim and nowhere else, and its gradient at the
    trim is that of the exact gain with held inputs.
    """
    pytest.importorskip("onnx")
    file = tmp_path / "policy.onnx"
    words = ["--aircraft", PENDULUM, "--start", "angle=40", "--law", "taught", "-o", str(file)]
    assert main(["optimize", *words, "--json"]) == 0
    policies = json.loads(capsys.readouterr().out)["policies"]
    assert policies[-1]["over_best"] < 1.05
    model = hfa.load_model(PENDULUM)
    point = hfa.trim(model)
    network = hfa.Deployment.load(file.with_suffix(".toml"))
    for degrees in (40.0, 10.0, -5.0, 1.0):
        start = {"angle": np.radians(degrees)}
        flight = hfa.fly(model, point, network, 12.0, initial=start, predict=False)
        assert np.abs(flight.states[-1]).max() < 1e-4
    flight = hfa.fly(model, point, network, 5.0, initial={"angle": 1e-5}, predict=False)
    exact = hfa.predictive(model, point)
    first = np.array(flight.inputs)[0] - np.array(point.inputs)
    assert first == pytest.approx(-exact.K @ np.array([1e-5, 0.0]), rel=1e-3)


@pytest.mark.parametrize(
    "words",
    [
        ["--law", "taught", "--start", "angle=40"],
        ["--law", "taught", "--starts", "2", "-o", "policy.onnx"],
        ["--start", "angle=40", "-o", "policy.onnx"],
    ],
)
def test_what_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Without an initial condition, a file or the law, one line says so and nothing is written."""
    assert main(["optimize", "--aircraft", PENDULUM, *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "requires -o FILE.onnx and --start NAME=VALUE" in line
    assert not Path("policy.onnx").exists()
