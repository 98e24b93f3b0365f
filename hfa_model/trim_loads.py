"""Loads on the panels of the flexible aircraft (HFA) at a trim, for its report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hfa_aircraft.model import Model
from hfa_model.aerodynamics import Loads, PanelLoads, aircraft_loads
from hfa_model.atmosphere import density
from hfa_model.declaration import check_in_range, parameters_of, variant_of
from hfa_model.vectors import INPUTS, STATES, Input, State
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, four_decimals
from hfa_support.units import si_factor

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def loads(model: Model, x: ArrayLike, u: ArrayLike) -> Loads:
    """Return the forces and moments on the flexible aircraft and on its panels.

    The units are lbf and ft lbf, or N and N m for a model in SI units.

    model: a model for which `is_hfa` is true
    x: (7,), in the order of `STATES`, in the units of the model
    u: (5,), in the order of `INPUTS`, in the units of the model

    Raises BadInputError if the state is out of range (`check_in_range`).
    """
    native = model.native
    state = State(*model.native_values(STATES, x).tolist())
    control = Input(*model.native_values(INPUTS, u).tolist())
    check_in_range(state)
    air = density(state.altitude)
    in_lbf = aircraft_loads(state, control, air, parameters_of(native), variant_of(native))
    return in_lbf if native is model else _loads_in_si(in_lbf)


def _loads_in_si(loads: Any) -> Any:
    """Return the loads in N and N m."""
    converted = {}
    for name, value in loads._asdict().items():
        if isinstance(value, tuple):
            converted[name] = _loads_in_si(value)
        else:
            converted[name] = value * si_factor("ft lbf" if name.endswith("moment") else "lbf")
    return loads._replace(**converted)


def with_loads(point: Any, report: Report) -> Report:
    """Return the report of an operating point with a table of the loads on the panels added.

    The same numbers, and the loads on the aircraft, are added to the data of the report.
    """
    aircraft = point.model
    forces = loads(aircraft, point.states, point.inputs)
    flat = {
        name: getattr(forces, name) for name in Loads._fields if name not in ("center", "outer")
    }
    for panel in ("center", "outer"):
        flat |= {
            f"{panel}_{name}": getattr(getattr(forces, panel), name) for name in PanelLoads._fields
        }
    force = aircraft.unit("lift")
    moment = aircraft.unit("hinge_moment")
    load_units = {name: moment if name.endswith("moment") else force for name in flat}
    parts = (*report.parts, _panels(point, forces, force, moment))
    return replace(report, parts=parts).with_data(loads=flat, load_units=load_units)


def _panels(point: Any, forces: Loads, force: str, moment: str) -> Table:
    """Return a table of the loads on the center panel and on one outer panel.

    force, moment: units
    """
    names = ("dynamic_pressure", "reference_area", "weight", "hinge_moment_total")
    given = point.model.outputs_at(point.states, point.inputs, names)
    # q S of one of the three panels, for its lift coefficient.
    panel_force = given["dynamic_pressure"] * given["reference_area"] / 3
    center, outer = forces.center, forces.outer
    rows = [
        ("weight", *_row((given["weight"] / 3, given["weight"] / 3), force)),
        ("lift", *_row((center.lift, outer.lift), force)),
        ("drag", *_row((center.drag, outer.drag), force)),
        ("lift coefficient", *_row((center.lift / panel_force, outer.lift / panel_force), "1")),
        ("hinge moment", *_row((None, forces.hinge_moment), moment)),
        ("with hinge spring", *_row((None, given["hinge_moment_total"]), moment)),
    ]
    return Table(("load", "center panel", "outer panel", "unit"), rows)


def _row(values: Iterable[float | None], unit: str) -> tuple[str, ...]:
    """Return the cells of a table row: values as text, or "" for None, then the unit."""
    return *("" if value is None else four_decimals(value) for value in values), unit
