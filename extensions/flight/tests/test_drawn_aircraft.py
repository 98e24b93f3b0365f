"""The figure that shows flights of aircraft with random parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa_aircraft.uncertain import ParameterSpread
from hfa_flight import GainPolicy, MonteCarlo, Scenario, flight_envelope
from hfa_flight.samples.drawn_aircraft import drawn_figure
from hfa_flight.samples.monte_carlo import fly_member


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


def test_every_drawn_aircraft_must_stay_within_its_limits() -> None:
    """Of drawn aircraft each must pass; one flight of a known aircraft is enough."""
    model = hfa.load_model(str(ROOT / "examples" / "uav.toml"))
    point = hfa.trim(model)
    drawn = ParameterSpread({"CL_alpha": model.parameters["CL_alpha"].start}, np.eye(1))
    gain = GainPolicy("none", np.zeros((len(model.inputs), len(model.linear))))
    limits = flight_envelope(model, point, {})
    plan = MonteCarlo(5, 0, model, point, gain, Scenario(duration=1.0), limits, drawn)
    assert plan.least_within == 5
    assert replace(plan, spread=None).least_within == 1
