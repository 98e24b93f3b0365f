"""`hfa fly --draws N`: flights of aircraft drawn from a covariance of parameters."""

from pathlib import Path

import numpy as np
import pytest
from cli import answer
from project import ROOT

import hfa

UAV = str(ROOT / "examples" / "uav.toml")
NAMES = ("CL_alpha", "Cm_alpha", "Cm_q")
CORRELATION = 0.5 * np.eye(3) + 0.5
#: Relative standard deviation of each of these parameters.
DEVIATION = 0.02


def uncertain_uav_file():
    """Write an aircraft file with uncertain parameters, correlated by .5, and return its name."""
    model = hfa.load_model(UAV)
    values = np.array([model.parameters[name].start for name in NAMES])
    covariance = np.outer(values, values) * DEVIATION**2 * CORRELATION
    rows = [f"aircraft = '{UAV}'", "[covariance]", f"names = {list(NAMES)}"]
    Path("found.toml").write_text("\n".join([*rows, f"rows = {covariance.tolist()}"]))
    return "found.toml"


@pytest.mark.usefixtures("folder")
def test_flights_of_drawn_aircraft_have_the_spread_of_their_parameters():
    """150 aircraft, whose parameters are drawn from a covariance, fly for .01 s from alpha + 1 deg. The
    range of their pitch rates from the 5 % to the 95 % quantile is, within 15 %, that of the
    covariance, propagated linearly by the sensitivities of the pitch acceleration.
    """
    words = ["fly", "--aircraft", uncertain_uav_file(), "--policy", "none", "--draws", "150"]
    data = answer(*words, "--duration", "0.01", "--initial", "alpha=1")
    assert data["drawn"] == list(NAMES)
    model = hfa.load_model("found.toml")
    point = hfa.trim(model)
    start = np.array(point.states) + np.radians(1.0) * (np.array([*model.states]) == "alpha")
    slopes = []
    for name in NAMES:
        value = model.parameters[name].start
        above, below = (
            model.with_parameters(**{name: factor * value}).rates_at(start, point.inputs)
            for factor in (1.001, 0.999)
        )
        by_factor = (above["pitch_rate"] - below["pitch_rate"]) / (1.001 - 0.999)
        slopes.append(0.01 * by_factor)  # of the pitch rate after .01 s
    deviation = DEVIATION * np.sqrt(np.array(slopes) @ CORRELATION @ slopes)
    low, _, high, _ = data["final"]["pitch_rate"]  # 5 and 95 %
    assert high - low == pytest.approx(2 * 1.645 * deviation, rel=0.15)
