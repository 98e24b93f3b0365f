"""The recoverable set: what single flights say, edge by edge."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flight_cases import FlownCase, flown, signal

from controller import Scenario
from hfa_model import LINEAR_STATES, STATES
from hfa_support import BadInputError
from verification import recoverable_map
from verification.flights.recoverable import _edge
from verification.flights.recoverable_map import RecoverableMap

N = len(LINEAR_STATES)


@pytest.fixture(scope="module")
def recoverable(newton: FlownCase) -> RecoverableMap:
    return recoverable_map(
        newton.aircraft,
        newton.point,
        newton.law.gains[0],
        newton.envelope,
        speeds=np.array([-2.0, 0.3, 2.0]),
        dihedrals=np.radians([-10.0, 10.0]),
        commands=np.radians([-30.0, -5.0, 0.0, 5.0]),
    )


def test_the_map_is_what_single_flights_say(newton: FlownCase, recoverable: RecoverableMap) -> None:
    """The compiled trials, at their longer step, against `fly`: who leaves, what leaves, and when."""
    left, held = recoverable.left("nonlinear"), recoverable.held("nonlinear")
    for i, dihedral in enumerate(recoverable.dihedrals):
        for j, speed in enumerate(recoverable.speeds):
            start = np.zeros(len(STATES))
            start[STATES.index("speed")], start[STATES.index("dihedral")] = speed, dihedral
            departure = flown(newton, Scenario(duration=3.0, initial=start)).departure
            assert (departure is None) == (left[i, j] == -1)
            assert held[i, j] == (departure is None)
            if departure is not None:
                assert STATES[left[i, j]] == departure.state
    assert held.any()
    assert not held.all()


def test_the_edges_are_where_flights_begin_to_leave(newton: FlownCase, recoverable: RecoverableMap) -> None:
    edges = {(edge.plant, edge.axis, edge.sign): edge for edge in recoverable.edges}
    for sign in (-1, 1):
        edge = edges["nonlinear", "speed", sign]
        for part, stays in ((0.97, True), (1.03, False)):
            start = np.zeros(len(STATES))
            start[0] = sign * part * edge.held
            departure = flown(newton, Scenario(duration=2.0, initial=start)).departure
            assert (departure is None) == stays
            assert stays or (departure is not None and departure.state == edge.state)
        assert edge.returned > edge.held
        command = edges["nonlinear", "dihedral command", sign]
        scenario = Scenario(duration=2.0, reference=signal(dihedral=0.97 * sign * command.held))
        assert flown(newton, scenario).departure is None


def test_the_linear_model_recovers_from_everywhere_and_alike_on_both_sides(recoverable: RecoverableMap) -> None:
    assert recoverable.returned("linear").all()
    assert not recoverable.returned("nonlinear").all()
    linear = {(edge.axis, edge.sign): edge.held for edge in recoverable.edges if edge.plant == "linear"}
    nonlinear = {(edge.axis, edge.sign): edge.held for edge in recoverable.edges if edge.plant == "nonlinear"}
    for axis in ("speed", "dihedral", "dihedral command"):
        assert linear[axis, 1] == pytest.approx(linear[axis, -1], rel=1e-6)
    assert nonlinear["speed", 1] > 1.5 * nonlinear["speed", -1]


def test_a_map_shows_its_report_at_the_prompt(recoverable: RecoverableMap) -> None:
    assert repr(recoverable).startswith("How far u = -K z holds, dihedral 15 deg\n\nnewton dynamics\nfrom trim")
    assert "<table>" in recoverable._repr_html_()
    ours = [edge for edge in recoverable.edges if edge.plant == "nonlinear"]
    linear = {(edge.axis, edge.sign): edge for edge in recoverable.edges if edge.plant == "linear"}
    lines = [line for line in recoverable.report().text().splitlines() if line.startswith(("speed", "dihedral"))]
    whole = [(edge.held, edge.returned, linear[edge.axis, edge.sign].held).count(edge.reach) for edge in ours]
    assert [line.count("(all)") for line in lines[: len(ours)]] == whole
    assert 0 < sum(whole) < 3 * len(whole)


def test_commands_arrive_or_not(recoverable: RecoverableMap) -> None:
    trials = recoverable.nonlinear_commands
    assert trials.arrived(recoverable.commands).tolist() == [False, True, True, True]
    assert trials.held.tolist() == [False, True, True, True]
    # At rest elsewhere is not arrived: a planted end on the other side of trim.
    final = trials.final.copy()
    final[1, STATES.index("dihedral")] *= -1
    assert replace(trials, final=final).arrived(recoverable.commands).tolist() == [False, False, True, True]


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_edge_is_between_the_last_good_and_the_first_bad_start(sign: int) -> None:
    def fly(values: np.ndarray) -> Any:
        assert np.all(np.sign(values) == sign)
        return SimpleNamespace(held=np.abs(values) < 3.7, left=np.full(len(values), 2), when=np.full(len(values), 1.5))

    found = _edge("speed", sign, "linear", fly, lambda _, values: np.abs(values) < 2.2, 10.0)
    assert (found.held, found.returned) == pytest.approx((3.7, 2.2), rel=0.02)
    assert (found.state, found.time, found.reach) == (STATES[2], 1.5, 10.0)


def test_maps_without_points_and_gains_that_do_not_stabilize_are_refused(newton: FlownCase) -> None:
    ranges = {"speeds": np.zeros(1), "dihedrals": np.zeros(1), "commands": np.zeros(1)}

    def build(gain: np.ndarray, **changes: np.ndarray) -> RecoverableMap:
        given: dict[str, Any] = ranges | changes
        return recoverable_map(newton.aircraft, newton.point, gain, newton.envelope, **given)

    with pytest.raises(BadInputError, match="speeds are empty"):
        build(newton.law.gains[0], speeds=np.zeros(0))
    with pytest.raises(BadInputError, match="at most 50000"):
        build(newton.law.gains[0], speeds=np.zeros(1000), dihedrals=np.zeros(1000))
    with pytest.raises(BadInputError, match="abscissa"):
        build(-newton.law.gains[0])
