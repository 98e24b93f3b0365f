"""What recoverable maps say: text for a person, data and tables for files."""

from __future__ import annotations

from typing import Any

from controller.flight.envelope import Envelope
from hfa_model.support.text import Table, columns
from hfa_model.vectors import STATE_UNITS, STATES
from verification.flights.flight_report import envelope_data, limits_text, number_text, unit_text
from verification.flights.recoverable import Edge, RecoverableMap

MAP_SCHEMA = "hfa.recoverable-map/1"


def map_data(maps: tuple[RecoverableMap, ...]) -> dict[str, Any]:
    """Maps by dynamics: grids, outcomes and edges, ready for JSON."""
    return {"schema": MAP_SCHEMA, "states": list(STATES), "maps": {each.dynamics: _one_map(each) for each in maps}}


def map_table(maps: tuple[RecoverableMap, ...]) -> Table:
    """One row a start and plant."""
    rows: list[tuple[Any, ...]] = []
    for each in maps:
        for plant in ("nonlinear", "linear"):
            held, returned, left = each.held(plant), each.returned(plant), each.left(plant)
            for i, dihedral in enumerate(each.dihedrals.tolist()):
                for j, speed in enumerate(each.speeds.tolist()):
                    first = STATES[left[i, j]] if left[i, j] >= 0 else ""
                    rows.append((each.dynamics, plant, speed, dihedral, int(held[i, j]), int(returned[i, j]), first))
    return Table(("dynamics", "plant", "speed [ft/s]", "dihedral [rad]", "held", "returned", "left_first"), rows)


def map_text(maps: tuple[RecoverableMap, ...], title: str) -> str:
    """How far along each axis the policy holds, nonlinear beside linear."""
    parts = [title]
    for each in maps:
        rows = [_edge_row(edge, other) for edge, other in _pairs(each.edges)]
        header = ("from trim", "unit", "held", "then leaves", "comes back", "held, linear model", "then leaves")
        counts = ", ".join(
            f"{plant} {int(each.held(plant).sum())} held and {int(each.returned(plant).sum())} came back"
            for plant in ("nonlinear", "linear")
        )
        grid = f"of {each.speeds.size * each.dihedrals.size} starts: {counts}"
        parts.append(f"{each.dynamics} dynamics\n{columns(header, rows)}\n{grid}")
    parts.append("envelope\n" + columns(("state", "unit", "limits"), _envelope_rows(maps[0].envelope)))
    return "\n\n".join(parts)


def _pairs(edges: tuple[Edge, ...]) -> list[tuple[Edge, Edge]]:
    """Each nonlinear edge with the linear one of the same ray."""
    linear = {(edge.axis, edge.sign): edge for edge in edges if edge.plant == "linear"}
    return [(edge, linear[edge.axis, edge.sign]) for edge in edges if edge.plant == "nonlinear"]


def _edge_row(edge: Edge, linear: Edge) -> tuple[str, ...]:
    unit = "ft/s" if edge.axis == "speed" else "rad"
    sign = "+" if edge.sign > 0 else "-"

    def reached(value: float, one: Edge) -> str:
        return f"{sign}{number_text(value, unit)}" + (" (all)" if value == one.reach else "")

    def leaving(one: Edge) -> str:
        return f"{one.state} at {one.time:.3g} s" if one.state else ""

    return (
        edge.axis,
        unit_text(unit),
        reached(edge.held, edge),
        leaving(edge),
        reached(edge.returned, edge),
        reached(linear.held, linear),
        leaving(linear),
    )


def _one_map(each: RecoverableMap) -> dict[str, Any]:
    data: dict[str, Any] = {
        "operating_point": each.point.to_dict(),
        "envelope": envelope_data(each.envelope),
        "speeds": each.speeds,
        "dihedrals": each.dihedrals,
        "commands": each.commands,
        "edges": [edge._asdict() for edge in each.edges],
    }
    for plant in ("nonlinear", "linear"):
        commands = getattr(each, f"{plant}_commands")
        data[plant] = {
            "held": each.held(plant),
            "returned": each.returned(plant),
            "left_first": each.left(plant),
            "commands_held": commands.held,
            "commands_arrived": commands.arrived(each.commands),
            "commands_left_first": commands.left,
            "commands_reached": commands.final[:, STATES.index("dihedral")],
        }
    return data


def _envelope_rows(envelope: Envelope) -> list[tuple[str, ...]]:
    return [
        (name, unit_text(getattr(STATE_UNITS, name)), limits_text(envelope, index)) for index, name in enumerate(STATES)
    ]
