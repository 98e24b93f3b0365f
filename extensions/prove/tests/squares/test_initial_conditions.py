"""Flights from proved sets, among them initial conditions of the tutorial's aircraft."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from pendulum_regions import PENDULUM, VAN_DER_POL, certified, pendulum_loop, proved
from simulated_initial_conditions import count_departures, random_points

from hfa_aircraft.loading import load_model
from hfa_prove.check import check_certificate
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.statements.region import RegionStatement

ROOT = Path(__file__).parents[4]


def stated(path: Path, aircraft: str, *words: str) -> tuple[RegionStatement, dict]:
    """Prove a region with `hfa prove region`, and return the checked statement and the JSON output.

    path: path of the certificate
    aircraft: argument of --aircraft
    words: further arguments
    """
    printed = proved(path, aircraft, "--json", *words)
    statement = check_certificate(path, model=load_model(aircraft)).statement
    return statement, json.loads(printed)


def test_initial_conditions_are_uniform_in_the_set(tmp_path: Path) -> None:
    """Initial conditions are drawn uniformly in the set and on its boundary.

    Every flight from such an initial condition stays in the set and converges. From initial
    conditions four times as far from the trim, more than 20 of 200 flights leave a limit or do not
    converge.
    """
    model = load_model(PENDULUM)
    path = certified(tmp_path / "pendulum.json", pendulum_loop(model), 0.98)
    statement = check_certificate(path, model=model).statement
    V = PolynomialFunction.of_terms(statement.terms).scaled(1.0 / statement.rho)
    starts = random_points(V, statement, 2000, np.random.default_rng(0))
    values = V(starts)
    assert np.all(values <= 1.0)
    assert np.all(values[1000:] > 1.0 - 1e-6)
    # Uniform in an ellipse: V is uniform.
    assert np.quantile(values[:1000], [0.25, 0.5, 0.75]) == pytest.approx(
        [0.25, 0.5, 0.75], abs=0.06
    )
    assert count_departures(statement, 200) == (0, 0)
    # Far outside, the torque cannot lift the pendulum; the simulation detects this.
    left, late = count_departures(statement, 200, farther=4.0)
    assert left + late > 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aircraft", "words"),
    [
        (PENDULUM, ("--degree", "4", "--seconds", "8")),
        (PENDULUM, ("--degree", "2", "--seconds", "6", "--disturbance", "push=0.1")),
        (VAN_DER_POL, ("--degree", "4", "--seconds", "5")),
    ],
)
def test_all_flights_in_a_proved_set_converge(
    aircraft: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    """None of 20,000 flights from each proved set leaves the set or the limits.

    Without a disturbance, all flights converge.
    """
    statement, _ = stated(tmp_path / "proved.json", aircraft, *words)
    assert count_departures(statement, 20_000) == (0, 0)


@pytest.mark.slow
def test_the_region_of_the_tutorials_navion_is_proved(tmp_path: Path) -> None:
    """The region of the tutorial's Navion is proved within its limits, and 1,000 flights from it
    converge.
    """
    page = (ROOT / "docs" / "aircraft.md").read_text()
    (source,) = re.findall(r"```python\n(# navion\.py\n.*?)```", page, re.DOTALL)
    (tmp_path / "navion.py").write_text(source)
    aircraft = f"{tmp_path / 'navion.py'}:NAVION"
    weights = ("--Q", "0.01,10,10,10", "--R", "0.0001,100", "--delta", "20")
    statement, data = stated(
        tmp_path / "region.json", aircraft, *weights, "--degree", "2", "--seconds", "10"
    )
    assert data["states"] == ["speed", "alpha", "pitch", "pitch_rate"]
    assert data["rho"] < data["leaves_limits_at"]["V"]
    assert data["extents"]["speed"] > 1.0
    # The limits of the inputs and of gamma are those of the model.
    assert data["limits"]["thrust"] == [0.0, 1000.0]
    assert data["limits"]["gamma"] == [-0.4, 0.4]
    assert count_departures(statement, 1000) == (0, 0)


@pytest.mark.slow
def test_the_region_of_the_f16_is_proved(tmp_path: Path) -> None:
    """The region of the F-16 with constant derivatives is proved, and 1,000 flights from it
    converge.
    """
    aircraft = f"{ROOT / 'examples' / 'f16_constant.py'}:F16"
    words = ("--delta", "inf", "--degree", "2", "--seconds", "10")
    statement, data = stated(tmp_path / "region.json", aircraft, *words)
    assert data["rho"] < data["leaves_limits_at"]["V"]
    assert data["extents"]["speed"] > 10.0
    assert statement.loop.limits["elevator"] == (-25.0, 25.0)
    assert count_departures(statement, 1000) == (0, 0)
