"""Stored certificates with one wrong entry are refused when they are read, before any proof."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import pytest
from stored_certificates import STORED, read, stored

from hfa_prove.certificate import read_statement
from hfa_prove.fields import Malformed
from hfa_support.errors import BadInputError


def places(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield path and value of every entry, of long lists those of the first and the last entry."""
    yield path, value
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from places(entry, (*path, key))
    if isinstance(value, list) and value:
        for index in {0, len(value) - 1}:
            yield from places(value[index], (*path, index))


def with_entry(content: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return content with another value at a path; unchanged parts are shared."""
    if not path:
        return value
    first, *rest = path
    made = copy.copy(content)
    made[first] = with_entry(content[first], tuple(rest), value)
    return made


def of_another_type(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [None, [], value | {"note": 1.0}]
    if isinstance(value, bool):
        return [0]
    return {int: ["x"], float: ["x", None], str: [None], list: [{}]}[type(value)]


@pytest.mark.parametrize("name", STORED)
def test_entries_of_another_type_and_unknown_entries_are_refused(name: str) -> None:
    """Every entry is refused if it has another type, and every object with an unknown entry."""
    content = stored(name)
    read(content)
    for part in ("kind", "statement", "witness"):
        for path, value in places(content[part], (part,)):
            for wrong in of_another_type(value):
                with pytest.raises((Malformed, BadInputError)):
                    read(with_entry(content, path, wrong))


FLIGHT = ("statement", "flight")
HALF = [[15.0, 15.125, 0, 0]]
STATES = ["speed", "alpha", "pitch", "pitch_rate", "dihedral"]
#: Certificate and path -> values that are refused, None for a missing entry.
DOMAINS: dict[tuple[Any, ...], list[Any]] = {
    ("schedule", *FLIGHT, "spread"): [{"chord": 0.0}, {"chord": -1.0}, {"dihedral": 0.1}],
    ("schedule", *FLIGHT, "limits", "throttle"): [[-1.0, 200.0], [0.0, 201.0], None],
    ("schedule", *FLIGHT, "limits", "speed"): [[70.0, 80.0], [1.0, 60.0]],
    ("schedule", *FLIGHT, "limits", "dihedral"): [[0.262, 1.0], [0.0, 0.266]],
    ("schedule", *FLIGHT, "trims", 0, "breakpoint"): [14.9, 15.3],
    ("schedule", *FLIGHT, "imposed"): [{"dihedral": 0.26}, {}],
    ("schedule", "statement", "controller", "breakpoints"): [[15.0], [15.25, 15.0], [15.0, 15.0]],
    ("schedule", "statement", "controller", "inputs"): [["throttle"] * 5, ["throttle"]],
    ("schedule", "statement", "controller", "measurements"): [[*STATES, "wind"], STATES],
    ("schedule", "statement", "controller", "A"): [[[[1.0]]], [[[1.0, 2.0]]] * 2],
    ("schedule", "statement", "loop"): [
        *([], [[15.0, 15.2, 0, 0]], [[15.1, 15.25, 0, 0]], [[15.0, 15.25, 0, 7]], HALF),
        *([[15.0, 15.25, 1, 0]], [[15.0, 15.25, -1, 0]], [[15.0, 15.25, 0, 0.5]]),
        *([*HALF, [15.2, 15.25, 0, 0]], [[15.0, 15.25, 0, 0], [15.25, 15.25, 0, 0]]),
        [[15.0, 15.25, 0, 1]],  # a decay rate is claimed, but no stable range
    ],
    ("schedule", "statement", "modes"): [[], [[15.0, 15.25, 0, 7]]],
    ("schedule", "statement", "decay_rate"): [-1.0],
    ("schedule", "statement", "scheduled_rate"): [0.0, -1.0, 1.0],
    ("schedule", "witness", "loop", 0, "range"): [[14.9, 15.25], [15.0, 15.3], [15.1, 15.1]],
    ("schedule", "witness", "loop", 0, "trim", "throttle"): [[0.0, 1, 1, 1], [-1, 1, 1, 1]],
    ("solution", "statement", "plant", "spread"): [{"chord": 0.1}],
    ("solution", "statement", "plant", "range"): [[14.9, 15.0], [15.0, 15.1]],
    ("solution", "statement", "weights", "delta"): [0.0, -1.0],
    ("solution", "statement", "delta_min"): [[-1.0, 1.0], [0.0, 1.0], [2.0, 1.0], [1.0, 1.0], None],
    ("solution", "statement", "modes"): [[-1, 0], [0, 7], [2, 1], [0.5, 1], [0, 0.5], None],
    ("solution", "statement", "loop"): [[-1, 0], [0, 7], [1, 0], [0.5, 1], None],
    ("solution", "statement", "distances", "P"): [[-1.0, 1.0], [1.0, 0.5]],
    ("solution", "witness", "solution", "reach"): [0.0, -1.0],
    ("solution", "witness", "solution", "units", 0): [0.0, -1.0],
    ("solution", "witness", "solution", "P", 0, 1, 0): ["9.0"],
    ("solution", "witness", "trim", "throttle"): [["40", 0, 1], ["40", -1, 1], ["40", 2, 1]],
    ("critic", "statement", "critic", "W"): [[[1.0]] * 20],
    ("region", "statement", "piece", "c"): [0.0, -1.0],
    ("region", "statement", "piece", "W"): [[[1.0, [13, 0]]], [[1.0, [1, 0]]], [[1.0, [9, 0]]]],
    ("region", "statement", "extents", "angle"): [[0.0, 1.0], [-1.0, 0.0], [0.1, 1.0]],
    ("region", "statement", "loop", "limits"): [
        *({}, {"torque": [-0.6, 0.7]}, {"torque": [-0.7, 0.6]}, {"torque": [None, 0.7]}),
        *({"torque": [0.7, -0.7]}, {"torque": [-0.7, 0.7, 1.0]}, {"wind": [-0.7, 0.7]}),
        {"torque": [-0.7, 0.7], "angle": [1.0, 1.0]},
    ],
    ("region", "witness", "order"): [13, 1, -1],
    ("region", "witness", "prover"): ["magic"],
    ("region", "witness", "inside", "degrees"): [[0, 13], [0.5, 1], [0, 1.5], [-1, 1], [1, 0]],
    ("region", "witness", "parts", 0, "inputs"): [[], ["free", "free"], ["any"], ["FREE"]],
    ("region_disturbed", "witness", "parts", 0, "inputs"): [["low", "free"], ["free"]],
    ("region_disturbed", "statement", "loop", "disturbances"): [{"push": 0.0}, {"push": -0.1}],
    ("region_boxes", "statement", "piece", "W"): [[[0.1, [3, 0]], [1.0, [2, 0]]]],
    ("region_boxes", "witness", "multipliers", 0, 0): [-1e-9],
    ("region_boxes", "witness", "boxes"): [-1, 100_000_001],
    ("cost", "statement", "pieces"): [[]],
    ("cost", "statement", "pieces", 0, "whole"): [True],
    ("cost", "statement", "Q"): [[[1.0, 1.5], [1.5, 1.0]], [[1.0, 0.1], [0.0, 1.0]]],
    ("cost", "statement", "R"): [[[-1e-300]]],
    ("cost", "statement", "plant", "limits"): [
        *({}, {"torque": [-0.6, 0.7]}, {"torque": [-0.7, 0.6]}, {"torque": [None, None]}),
        {"torque": [-0.7, 0.7], "wind": [0.0, 1.0]},
    ],
    ("value", "statement", "order"): [0, 1, 2, 4, 6],
    ("value", "statement", "residual"): [-1e-20, 1.01e-9],
    ("value", "statement", "plant", "limits"): [{"torque": [-0.7, 0.7]}],
    ("value", "statement", "weights", "Q"): [[[1.0, 1.5], [1.5, 1.0]]],
    ("value", "statement", "weights", "R"): [[[0.0]], [[-1.0]]],
    ("value", "statement", "V"): [[1.0] * 6, [1.0] * 8],
    ("value", "statement", "u"): [[[1.0] * 4], [[1.0] * 5] * 2],
    ("cost", "witness", "solved"): [["angle", "angle"], ["wind"]],
    ("cost", "witness", "boxes", 0): [1_000_000_001],
}


@pytest.mark.parametrize("place", DOMAINS, ids=lambda place: " ".join(map(str, place)))
def test_values_outside_their_domain_are_refused(place: tuple[Any, ...]) -> None:
    """An entry outside its domain, or that contradicts another entry, is refused."""
    name, *path = place
    for wrong in DOMAINS[place]:
        made = copy.deepcopy(stored(name))
        holder = made
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = wrong
        if wrong is None:
            del holder[path[-1]]
        with pytest.raises((Malformed, BadInputError)):
            read(made)


FIXED = {"order": [2] * 5, "damping": [0.7] * 5, "bandwidth": [9.0] * 5, "effectiveness": [1.0] * 5}
UNCERTAIN = FIXED | {"bandwidth": [1.0, 9.0], "effectiveness": [0.5, 1.0], "delay": 0.1}


@pytest.mark.parametrize(
    ("actuators", "wrong"),
    [
        (FIXED, {"order": [3, 2, 2, 2, 2]}),
        (FIXED, {"order": [0.5] * 5}),
        (FIXED, {"damping": [0.7, 0.7, 0.7, 0.7, 0.0]}),
        (FIXED, {"bandwidth": [-1.0, 9.0, 9.0, 9.0, 9.0]}),
        (FIXED, {"effectiveness": [1.0] * 4}),
        (UNCERTAIN, {"bandwidth": [0.0, 9.0]}),
        (UNCERTAIN, {"bandwidth": [9.0, 1.0]}),
        (UNCERTAIN, {"effectiveness": [-0.1, 1.0]}),
        (UNCERTAIN, {"delay": -0.1}),
    ],
)
def test_actuators_outside_their_domain_are_refused(
    actuators: dict[str, Any], wrong: dict[str, Any]
) -> None:
    """Fixed and uncertain actuators are read, and refused with one entry outside its domain.

    No decay rate or rate of the scheduling variable is claimed with uncertain actuators.
    """
    content = stored("schedule")["statement"] | {"decay_rate": 0.0}
    made = read_statement("schedule", content | {"actuators": actuators})
    assert made.actuators.content() == actuators
    with pytest.raises(Malformed):
        read_statement("schedule", content | {"actuators": actuators | wrong})
    if actuators is UNCERTAIN:
        for claim in ({"decay_rate": 0.1}, {"scheduled_rate": 0.1}):
            with pytest.raises(Malformed):
                read_statement("schedule", content | {"actuators": actuators} | claim)
