"""How far from trim a linear policy holds, and what a map of it says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.flight.envelope import Envelope
from controller.flight.trials import Trials
from hfa_model.vectors import LINEAR_STATES, STATE_UNITS, STATES
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, in_degrees, short_number, shown_unit
from trim.point.operating_point import OperatingPoint

MAP_SCHEMA = "hfa.recoverable-map/1"


class Edge(NamedTuple):
    """How far one can go along a ray from trim: what is varied and in which direction, and on which plant.

    held: the largest deviation (ft/s or rad, absolute value) up to which every flight stays in the envelope. state:
    which one leaves it just beyond, and when, s. returned: up to where every flight comes to rest on its target,
    whether or not it left the envelope. reach: the end of the scanned range; a value that equals it met no failure,
    and `state` is then "".
    """

    axis: str
    sign: int
    plant: str
    held: float
    state: str
    time: float
    returned: float
    reach: float


@dataclass(frozen=True, eq=False, repr=False)
class RecoverableMap(Reported):
    """Trials from a grid of initial deviations and of a line of dihedral commands, by both plants.

    speeds: (S,), ft/s; dihedrals: (D,), rad: deviations at the start; nonlinear, linear: trials of all pairs, the
    speed varying fastest. commands: (C,), rad, steps of the dihedral command from trim, with their trials.
    """

    dynamics: str
    point: OperatingPoint
    envelope: Envelope
    speeds: np.ndarray
    dihedrals: np.ndarray
    nonlinear: Trials
    linear: Trials
    commands: np.ndarray
    nonlinear_commands: Trials
    linear_commands: Trials
    edges: tuple[Edge, ...]

    def report(self) -> Report:
        """See `map_report`."""
        return map_report((self,))

    def held(self, plant: str) -> np.ndarray:
        """Which starts stay in the envelope and come back, (D, S); plant: "nonlinear" or "linear"."""
        trials: Trials = getattr(self, plant)
        return self._grid(trials.held & self._returned(trials))

    def returned(self, plant: str) -> np.ndarray:
        """Which starts come back, in or out of the envelope, (D, S)."""
        return self._grid(self._returned(getattr(self, plant)))

    def left(self, plant: str) -> np.ndarray:
        """Index of the state that left first, -1 for none, (D, S)."""
        return self._grid(getattr(self, plant).left)

    def _returned(self, trials: Trials) -> np.ndarray:
        return trials.returned(np.zeros((len(trials.left), len(LINEAR_STATES))))

    def _grid(self, flat: np.ndarray) -> np.ndarray:
        return flat.reshape(len(self.dihedrals), len(self.speeds))


def map_report(maps: tuple[RecoverableMap, ...], law: str = "") -> Report:
    """How far along each axis the policy holds, nonlinear beside linear; maps: about the same dihedral.

    law: whose gain it is.
    """
    dihedral = in_degrees(maps[0].point.states.dihedral)
    limits = [
        (name, shown_unit(unit), maps[0].envelope.limits_text(index))
        for index, (name, unit) in enumerate(zip(STATES, STATE_UNITS, strict=True))
    ]
    return Report(
        title=f"How far u = -K z holds, dihedral {dihedral:g} deg" + (f", law {law}" if law else ""),
        parts=(*map(_edges, maps), (("envelope", Table(("state", "unit", "limits"), limits)))),
        data={
            "schema": MAP_SCHEMA,
            "states": list(STATES),
            "maps": {each.dynamics: _one_map(each) for each in maps},
        },
        records=_records(maps),
    )


def _edges(each: RecoverableMap) -> Part:
    header = ("from trim", "unit", "held", "then leaves", "comes back", "held, linear model", "then leaves")
    counts = ", ".join(
        f"{plant} {int(each.held(plant).sum())} held and {int(each.returned(plant).sum())} came back"
        for plant in ("nonlinear", "linear")
    )
    return (
        f"{each.dynamics} dynamics",
        Table(header, [_edge_row(edge, other) for edge, other in _pairs(each.edges)]),
        f"of {each.speeds.size * each.dihedrals.size} starts: {counts}",
    )


def _records(maps: tuple[RecoverableMap, ...]) -> Table:
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


def _pairs(edges: tuple[Edge, ...]) -> list[tuple[Edge, Edge]]:
    """Each nonlinear edge with the linear one of the same ray."""
    linear = {(edge.axis, edge.sign): edge for edge in edges if edge.plant == "linear"}
    return [(edge, linear[edge.axis, edge.sign]) for edge in edges if edge.plant == "nonlinear"]


def _edge_row(edge: Edge, linear: Edge) -> tuple[str, ...]:
    unit = _unit(edge)
    sign = "+" if edge.sign > 0 else "-"

    def reached(value: float, one: Edge) -> str:
        return f"{sign}{short_number(value, unit)}" + (" (all)" if value == one.reach else "")

    def leaving(one: Edge) -> str:
        return f"{one.state} at {one.time:.3g} s" if one.state else ""

    return (
        edge.axis,
        shown_unit(unit),
        reached(edge.held, edge),
        leaving(edge),
        reached(edge.returned, edge),
        reached(linear.held, linear),
        leaving(linear),
    )


def _unit(edge: Edge) -> str:
    return "ft/s" if edge.axis == "speed" else "rad"


def _one_map(each: RecoverableMap) -> dict[str, Any]:
    data: dict[str, Any] = {
        "operating_point": each.point.to_dict(),
        "envelope": each.envelope.to_dict(),
        "speeds": each.speeds,
        "speed_units": "ft/s",
        "dihedrals": each.dihedrals,
        "commands": each.commands,
        "edges": [{**edge._asdict(), "unit": _unit(edge)} for edge in each.edges],
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
