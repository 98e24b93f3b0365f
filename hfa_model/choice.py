"""Construction of the paper's aircraft as a `Model` with the chosen dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hfa_aircraft.model import Model
from hfa_model.atmosphere import air_at
from hfa_model.declaration import check_in_range, parameters_of, rigid_panels, variant_of
from hfa_model.dynamics import Loads, aircraft_loads
from hfa_model.parameters import INPUTS, STATES, Input, Parameters, State, default_parameters
from hfa_model.variants import DYNAMICS, VARIANTS, Variant
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import without_rounding
from hfa_support.units import si_factor

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def loads(model: Model, x: ArrayLike, u: ArrayLike) -> Loads:
    """Return the forces and moments on the flexible aircraft and on its panels.

    The units are lbf and ft lbf, or N and N m for a model in SI units.

    model: a model for which `is_hfa` is true
    x: (7,), in the order of `STATES`, in the units of the model
    u: (5,), in the order of `INPUTS`, in the units of the model

    Raises BadInputError for another shape, or if the state is out of range (`check_in_range`).
    """
    model.refuse_vectors(x, u)
    native = model.native
    state = State(*model.native_values(STATES, x).tolist())
    control = Input(*model.native_values(INPUTS, u).tolist())
    check_in_range(state)
    density = air_at(state.altitude).density
    in_lbf = aircraft_loads(state, control, density, parameters_of(native), variant_of(native))
    return in_lbf if native is model else _loads_in_si(in_lbf)


def _loads_in_si(loads: Any) -> Any:
    """Return loads of the aircraft, or of a panel, in N and N m."""
    converted = {}
    for name, value in loads._asdict().items():
        if isinstance(value, tuple):
            converted[name] = _loads_in_si(value)
        else:
            converted[name] = value * si_factor("ft lbf" if name.endswith("moment") else "lbf")
    return loads._replace(**converted)


def panel_groups(point: Any) -> list[tuple[str, list[Row], tuple[str, ...]]]:
    """Return the group of a trim's sheet with the loads on the center and on one outer panel.

    point: `OperatingPoint` of a model for which `is_hfa` is true
    """
    aircraft = point.model
    forces = loads(aircraft, point.states, point.inputs)
    names = ("dynamic_pressure", "reference_area", "weight", "hinge_moment_total")
    given = aircraft.outputs_at(point.states, point.inputs, names)
    force, moment = aircraft.unit("lift"), aircraft.unit("hinge_moment")
    # q S of one of the three panels, for its lift coefficient.
    panel_force = given["dynamic_pressure"] * given["reference_area"] / 3
    rows = [Row("weight of a panel", given["weight"] / 3, force)]
    for name, panel in (("center", forces.center), ("outer", forces.outer)):
        rows.append(Row(f"lift {name}", panel.lift, force))
        rows.append(Row(f"drag {name}", panel.drag, force))
        rows.append(Row(f"lift coefficient {name}", panel.lift / panel_force))
    rows.append(Row("hinge moment", forces.hinge_moment, moment))
    nominal = aircraft.outputs["hinge_moment_total"].nominal
    total = without_rounding(given["hinge_moment_total"], nominal)
    rows.append(Row("hinge moment total", total, moment, "with hinge spring"))
    return [("loads on the panels", rows, ())]


#: Parameters that must not be negative. Inertias are not included: a fit to the matrices of one
#: angle leaves one of them undetermined, and it may be negative.
_SIZES = ("panel_mass", "panel_span", "chord")


def aircraft(dynamics: str | Variant = "published", parameters: Parameters | None = None) -> Model:
    """Return the highly flexible aircraft as a `Model`.

    dynamics: "published", "newton", "unsteady", or a `Variant`
    parameters: by default the identified ones

    Raises BadInputError for unknown dynamics, for a parameter that is not finite, and for a
    negative size.

    >>> import hfa
    >>> hfa.aircraft("newton").inputs["throttle"].max
    200.0
    """
    values = default_parameters().values if parameters is None else parameters
    for name in _SIZES:
        if (value := getattr(values, name)) < 0.0:
            raise BadInputError(f"parameter {name} is {value:g}; give a number of at least 0")
    if not isinstance(dynamics, str):
        return rigid_panels(dynamics, values, panel_groups)
    if dynamics == "unsteady":
        from hfa_model.unsteady import UNSTEADY

        return UNSTEADY.with_parameters(**values._asdict())
    refuse_unknown("unknown dynamics", dynamics, DYNAMICS)
    return rigid_panels(VARIANTS[dynamics], values, panel_groups)
