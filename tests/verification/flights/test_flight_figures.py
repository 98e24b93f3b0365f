"""Pictures of flights: limits are said and drawn where the flight came near, transients enlarged, nothing covered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flight_cases import case_at, flown

from controller import Scenario
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_model import INPUTS, Parameters
from verification.flights.flight_figures import flight_figure


@pytest.fixture(scope="module")
def flight(parameters: Parameters) -> NonlinearFlight:
    return flown(case_at(parameters, "published", 15.0), Scenario(duration=8.0))


def with_inputs(flight: NonlinearFlight, name: str, added: np.ndarray) -> NonlinearFlight:
    """The same flight with something added to an input."""
    inputs = flight.flight.inputs.copy()
    inputs[:, INPUTS.index(name)] += added
    return replace(flight, flight=replace(flight.flight, inputs=inputs))


def drawn(flight: NonlinearFlight) -> dict[str, object]:
    return {axes.get_ylabel(): axes for axes in flight_figure(flight, "a flight").axes}


def levels(axes: object) -> list[float]:
    """Heights of the horizontal lines: limits have two points."""
    return [float(line.get_ydata()[0]) for line in axes.lines if len(line.get_xdata()) == 2]  # type: ignore[attr-defined]


def test_limits_are_said_and_drawn_where_the_flight_came_near(flight: NonlinearFlight) -> None:
    panels = drawn(flight)
    assert panels["alpha, deg"].get_title(loc="right") == "envelope: -20 to 20"  # type: ignore[attr-defined]
    labels = [text.get_text() for text in panels["deflections, deg"].get_legend().get_texts()]  # type: ignore[attr-defined]
    assert labels == [f"{name}: {'-20 to 20' if 'aileron' in name else '-30 to 30'}" for name in INPUTS[1:]]
    assert levels(panels["alpha, deg"]) == []
    steep = flight.envelope.lowest._replace(alpha=float(flight.states[:, 1].min()) - 1e-6)
    near = with_inputs(flight, "aileron_outer", np.full(len(flight.flight.times), np.radians(15.0)))
    panels = drawn(replace(near, envelope=replace(near.envelope, lowest=steep)))
    assert levels(panels["deflections, deg"]) == [pytest.approx(20.0)]
    assert levels(panels["alpha, deg"]) == [pytest.approx(np.degrees(steep.alpha))]
