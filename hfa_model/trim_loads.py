"""Loads and performance of a trim of the flexible aircraft (HFA), for its report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hfa_aircraft.model import Model
from hfa_aircraft.units import in_units_of, native_of, native_values, unit_of
from hfa_model.aerodynamics import Loads, PanelLoads, aircraft_loads
from hfa_model.atmosphere import density, speed_of_sound
from hfa_model.declaration import check_in_range, parameters_of, variant_of
from hfa_model.vectors import INPUTS, STATES, Input, State
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table, four_decimals, short_number, shown_unit
from hfa_support.units import si_factor

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: Name -> unit, and name in the table ("" if not printed). The coefficients are C_L = L / (q S) and
#: C_D = D / (q S) of the entire aircraft, including tails, with q = ρ V² / 2 and the wing area S =
#: 3 s c without tails. hinge_moment_total is the moment of loads, weight, spring and damper about a
#: hinge, which is zero in balance.
PERFORMANCE: dict[str, tuple[str, str]] = {
    "dynamic_pressure": ("lbf/ft^2", "dynamic pressure q"),
    "density": ("slug/ft^3", "air density"),
    "speed_of_sound": ("ft/s", "speed of sound"),
    "mach": ("1", "Mach number"),
    "wing_area": ("ft^2", "wing area S, without tails"),
    "drag_coefficient": ("1", "drag coefficient D/(q S)"),
    "load_factor": ("1", "load factor"),
    "gamma": ("rad", "flight-path angle"),
    "climb_rate": ("ft/s", "climb rate"),
    "weight": ("lbf", ""),
    "lift_coefficient": ("1", ""),
    "lift_over_drag": ("1", ""),
    "hinge_moment_total": ("ft lbf", ""),
}
_WATCHED = ("dynamic_pressure", "load_factor", "gamma", "climb_rate", "hinge_moment_total")


@dataclass(frozen=True)
class TrimLoads(Result):
    """Loads and performance of the flexible aircraft at a trim.

    loads: name -> force or moment on the aircraft or one of its panels
    load_units: name -> unit of the load
    performance: name -> value: weight, lift coefficient, load factor and others; for other
        aircraft, their outputs
    performance_units: name -> unit of the value in `performance`
    """

    loads: Mapping[str, float]
    load_units: Mapping[str, str]
    performance: Mapping[str, float]
    performance_units: Mapping[str, str]


def loads(model: Model, x: ArrayLike, u: ArrayLike) -> Loads:
    """Return the forces and moments on the flexible aircraft and on its panels.

    The units are lbf and ft lbf, or N and N m for a model in SI units.

    model: a model for which `is_hfa` is true
    x: (7,), in the order of `STATES`, in the units of the model
    u: (5,), in the order of `INPUTS`, in the units of the model

    Raises BadInputError if the state is out of range (`check_in_range`).
    """
    native = native_of(model)
    state = State(*native_values(model, STATES, x).tolist())
    control = Input(*native_values(model, INPUTS, u).tolist())
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
    """Return the report of an operating point with two tables added: loads and performance.

    The same numbers are added to the data of the report.
    """
    aircraft = point.model
    forces = loads(aircraft, point.states, point.inputs)
    numbers = performance(point)
    flat = {
        name: getattr(forces, name) for name in Loads._fields if name not in ("center", "outer")
    }
    for panel in ("center", "outer"):
        flat |= {
            f"{panel}_{name}": getattr(getattr(forces, panel), name) for name in PanelLoads._fields
        }
    force = unit_of(aircraft, "lbf")
    moment = unit_of(aircraft, "ft lbf")
    load_units = {name: moment if name.endswith("moment") else force for name in flat}
    units = {name: unit_of(aircraft, unit) for name, (unit, _) in PERFORMANCE.items()}
    rows = [
        (called, short_number(numbers[name], units[name]), shown_unit(units[name]))
        for name, (_, called) in PERFORMANCE.items()
        if called
    ]
    parts = (
        *report.parts,
        _loads(forces, numbers, force, moment),
        Table(("performance", "value", "unit"), rows),
    )
    found = TrimLoads(flat, load_units, numbers, units)
    return replace(report, parts=parts).with_data(**found.as_data())


def performance(point: Any) -> dict[str, float]:
    """Return the quantities in `PERFORMANCE` at an operating point, name -> value.

    The operating point need not be a trim. The values are in the units of the point's model.
    """
    aircraft = point.model
    parameters = parameters_of(aircraft)
    watched = aircraft.outputs_at(point.states, point.inputs, _WATCHED)
    forces = loads(aircraft, point.states, point.inputs)
    wing_area = 3 * parameters.panel_span * parameters.chord
    force = watched["dynamic_pressure"] * wing_area
    altitude_ft = float(native_values(aircraft, ("altitude",), [point.states.altitude])[0])
    sound = in_units_of(aircraft, float(speed_of_sound(altitude_ft)), "ft/s")
    found = watched | {
        "weight": 3 * parameters.panel_mass * parameters.gravity,
        "wing_area": wing_area,
        "density": in_units_of(aircraft, float(density(altitude_ft)), "slug/ft^3"),
        "speed_of_sound": sound,
        "mach": point.states.speed / sound,
        "lift_coefficient": forces.lift / force,
        "drag_coefficient": forces.drag / force,
        "lift_over_drag": forces.lift / forces.drag,
    }
    return {name: found[name] for name in PERFORMANCE}


def _loads(loads: Loads, numbers: dict[str, float], unit: str, moment: str) -> Table:
    """Return a table of the loads on the aircraft, on its center panel and on one outer panel."""
    center = loads.center
    outer = loads.outer
    weight = numbers["weight"]
    # q S of one of the three panels, for its lift coefficient.
    panel_force = numbers["dynamic_pressure"] * numbers["wing_area"] / 3
    coefficients = (
        numbers["lift_coefficient"],
        center.lift / panel_force,
        outer.lift / panel_force,
    )
    rows = [
        ("weight", *_row((weight, weight / 3, weight / 3), unit)),
        ("lift", *_row((loads.lift, center.lift, outer.lift), unit)),
        ("drag", *_row((loads.drag, center.drag, outer.drag), unit)),
        ("thrust", *_row((loads.thrust, None, None), unit)),
        ("lift/drag", f"{numbers['lift_over_drag']:.3f}", "", "", "1"),
        ("lift coefficient", *_row(coefficients, "1")),
        ("pitching moment", *_row((loads.pitching_moment, None, None), moment)),
        ("hinge moment", *_row((None, None, loads.hinge_moment), moment)),
        ("with hinge spring", *_row((None, None, numbers["hinge_moment_total"]), moment)),
    ]
    return Table(("load", "aircraft", "center panel", "outer panel", "unit"), rows)


def _row(values: Iterable[float | None], unit: str) -> tuple[str, ...]:
    """Return the cells of a table row: values as text, or "" for None, then the unit."""
    return *("" if value is None else four_decimals(value) for value in values), unit
