"""The recoverable set: what single flights say, edge by edge."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import FlownCase, flown, signal

from controller import Scenario
from controller.flight.closed_loop import NonlinearPlant
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_model import STATES
from hfa_model.aircraft import HFA
from hfa_support import BadInputError
from verification import recoverable_map
from verification.flights.recoverable_map import ManyFlights, RecoverableMap, on_target


@pytest.fixture(scope="module")
def recoverable(newton: FlownCase) -> RecoverableMap:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("verification.flights.recoverable_map._SCAN", 8)
        patch.setattr("verification.flights.recoverable_map._HALVINGS", 8)
        return recoverable_map(
            newton.aircraft,
            newton.point,
            newton.law.gains[0],
            newton.envelope,
            starts={"speed": np.array([-2.0, 0.3, 2.0]), "dihedral": np.radians([-10.0, 10.0])},
            commands={"dihedral": np.radians([-30.0, 5.0])},
        )


def alone(newton: FlownCase, seconds: float, **start: float) -> NonlinearFlight:
    """One flight by `fly`."""
    initial = np.array([start.get(name, 0.0) for name in STATES])
    return flown(newton, Scenario(duration=seconds, initial=initial))


def test_the_map_is_what_single_flights_say(newton: FlownCase, recoverable: RecoverableMap) -> None:
    """The compiled flights, at their longer step, against `fly`: who leaves, what leaves, and when."""
    found = recoverable.starts["nonlinear"]
    left, held = found["left_first"], found["held"]
    for i, dihedral in enumerate(recoverable.axes["dihedral"]):
        for j, speed in enumerate(recoverable.axes["speed"]):
            departure = alone(newton, 3.0, speed=speed, dihedral=dihedral).departure
            assert held[i, j] == (departure is None) == (left[i, j] == -1)
            assert departure is None or STATES[left[i, j]] == departure.state
    assert held.any()
    assert not held.all()
    assert np.all(found["within_limits"] <= (found["exceeded"] == -1))


def test_the_edges_are_where_flights_begin_to_leave_or_to_exceed(
    newton: FlownCase, recoverable: RecoverableMap
) -> None:
    """Where an edge says that a state leaves or an input exceeds its limit, `fly` says the same, and names the same."""
    edges = {(edge.plant, edge.axis, edge.sign): edge for edge in recoverable.edges}
    for sign in (-1, 1):
        edge = edges["nonlinear", "speed", sign]
        assert 0.0 < edge.within_limits < edge.inside < edge.returned
        for part in (0.97, 1.03):
            departure = alone(newton, 2.0, speed=sign * part * edge.inside).departure
            assert (None if departure is None else departure.state) == (None if part < 1.0 else edge.state)
            near = alone(newton, 2.0, speed=sign * part * edge.within_limits)
            assert near.within_limits == (part < 1.0)
            assert [each.input for each in near.exceeded] == [edge.control] * (part > 1.0)
        command = edges["nonlinear", "dihedral command", sign]
        scenario = Scenario(duration=2.0, reference=signal(dihedral=0.97 * sign * command.inside))
        assert flown(newton, scenario).departure is None


def test_commands_arrive_or_not(newton: FlownCase) -> None:
    plant = NonlinearPlant(newton.aircraft, newton.point)
    flights = ManyFlights(plant, newton.envelope, newton.law.gains[0], 24.0)
    for degrees, arrives in ((-30.0, False), (-5.0, True), (0.0, True), (5.0, True)):
        outcome = flights.fly({}, {"dihedral": float(np.radians(degrees))})
        assert (outcome.returned, outcome.left < 0) == (arrives, arrives)
    # At rest elsewhere is not arrived: a planted end on the other side of trim.
    for end, arrived in ((-0.1, True), (0.1, False)):
        x = end * np.eye(len(STATES))[STATES.index("dihedral")]
        assert on_target(HFA, x, {"dihedral": -0.1}) == arrived


def test_a_gain_that_does_not_stabilize_is_refused(newton: FlownCase) -> None:
    starts, commands = {"speed": np.zeros(1), "dihedral": np.zeros(1)}, {"dihedral": np.zeros(1)}
    with pytest.raises(BadInputError, match="abscissa"):
        recoverable_map(
            newton.aircraft, newton.point, -newton.law.gains[0], newton.envelope, starts=starts, commands=commands
        )
