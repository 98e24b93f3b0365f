"""Loads, performance, static stability and validity at a trim, from outputs with known names."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import recognized
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.results import Result
from hfa_support.units import conversion

if TYPE_CHECKING:
    from trim.point.condition import TrimCondition
    from trim.point.operating_point import OperatingPoint

#: Names of the output or input with the thrust; the first that a model declares is used.
_THRUST = ("thrust_force", "thrust")
#: Product of units -> usual unit.
_USUAL = {"lbf ft/s": "ft lbf/s", "N m/s": "W"}
#: Number of angles of attack at which the largest lift is searched.
_ANGLES = 200
#: Change of the speed between a trim and its neighbors, kt.
_KNOTS = 0.5
#: Condition number above which alpha and pitch rate have no steady state.
_SINGULAR = 1e12


@dataclass(frozen=True)
class Quantity(Result):
    """Load, measure of performance or handling quality, such as the short-period damping.

    name: name of the measure
    value: number in `unit`
    unit: unit of the value
    """

    name: str
    value: float
    unit: str

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"value": self.value, "unit": self.unit}


@dataclass(frozen=True, eq=False)
class Figures:
    """Loads, performance and static stability of an aircraft at a trim.

    performance: name -> load or measure of performance, and outputs of the model
    stability: name -> static margin, neutral point and control gradients
    not_in_model: name of a figure -> what the model lacks for it
    """

    performance: dict[str, Quantity] = field(default_factory=dict)
    stability: dict[str, Quantity] = field(default_factory=dict)
    not_in_model: dict[str, str] = field(default_factory=dict)


def figures_of(point: OperatingPoint, condition: TrimCondition) -> Figures:
    """Return the loads, the performance and the static stability at a trim.

    A model states its forces by outputs with these names: lift and drag (aerodynamic, normal to and
    along the flight path), thrust, weight, pitching_moment (aerodynamic, about the center of
    gravity), dynamic_pressure, reference_area, reference_chord, largest_lift_coefficient.

    - power required: D V
    - thrust available: thrust with the inputs that change it at their highest values, unless the
      thrust follows an engine state
    - stall: largest lift coefficient, declared or a maximum of the lift over alpha
    - static margin: -(∂M/∂α) / (c ∂L/∂α), with all other states and the inputs fixed
    - neutral point: distance behind the center of gravity, margin times chord
    - pull-up: change of an input per load factor in a steady pull-up of the linear model at
      constant speed
    - speed: change of an input per knot between trims 0.5 kt slower and faster
    """
    figures = Figures()
    model = point.model
    outputs = model.outputs_at(point.states, point.inputs)
    for name, value in outputs.items():
        _add(figures.performance, name, value, model.unit(name))
    if not {"speed", "alpha"} <= {*recognized(model.states)}:
        return figures
    _add_performance(point, figures)
    _add_static_margin(point, figures)
    _add_gradients(point, condition, figures)
    return figures


def _add(figures: dict[str, Quantity], name: str, value: float, unit: str) -> None:
    figures[name] = Quantity(name, float(value), unit)


def _lacking(point: OperatingPoint, *names: str) -> str:
    """Return the outputs that a model does not declare as text, or ""."""
    missing = [name for name in names if name not in point.model.outputs]
    return f"no output {', '.join(missing)}" if missing else ""


def _add_performance(point: OperatingPoint, figures: Figures) -> None:
    """Add L/D, power, thrust, coefficients and stall margin to the figures."""
    model = point.model
    found = figures.performance
    lacking = figures.not_in_model
    if reason := _lacking(point, "lift", "drag"):
        lacking["L/D"] = lacking["power required"] = reason
    else:
        _add(found, "lift_over_drag", point["lift"] / point["drag"], "1")
        speed = recognized(model.states)["speed"]
        unit = f"{model.unit('drag')} {model.unit(speed)}"
        _add(found, "power_required", point["drag"] * point[speed], _USUAL.get(unit, unit))
    available = thrust_available(point)
    if isinstance(available, str):
        lacking["thrust available"] = available
    else:
        found["thrust_available"] = available
    if reason := _lacking(point, "lift", "dynamic_pressure", "reference_area"):
        lacking["stall margin"] = reason
        return
    force = point["dynamic_pressure"] * point["reference_area"]
    coefficient = point["lift"] / force
    _add(found, "lift_coefficient", coefficient, "1")
    if "drag" in model.outputs:
        _add(found, "drag_coefficient", point["drag"] / force, "1")
    largest = largest_lift(point)
    if largest is None:
        lacking["stall margin"] = "no CL_max, and lift without a maximum"
    elif coefficient > 0.0:
        _add(found, "largest_lift_coefficient", largest / force, "1")
        _add(found, "speed_over_stall_speed", math.sqrt(largest / point["lift"]), "1")


def thrust_available(point: OperatingPoint) -> Quantity | str:
    """Return the thrust at the highest values of its inputs, or why it is unknown."""
    model = point.model
    known = (*model.inputs, *model.outputs, *model.states)
    name = next((name for name in _THRUST if name in known), "")
    if not name:
        return "no output thrust"
    if name in model.inputs:
        highest = model.inputs[name].max
        return (
            Quantity("thrust_available", highest, model.unit(name))
            if math.isfinite(highest)
            else "no upper limit of the thrust"
        )
    if name in model.states:
        return f"the thrust follows the state {name}"
    of_states, of_inputs = point.slopes_of(name)
    motion = {*recognized(model.states).values(), "altitude"}
    engine = [state for state, slope in zip(model.states, of_states, strict=True) if slope]
    if engine := [state for state in engine if state not in motion]:
        return f"the thrust follows the state {engine[0]}"
    moving = [control for control, slope in zip(model.inputs, of_inputs, strict=True) if slope]
    inputs = point.inputs._replace(**{control: model.inputs[control].max for control in moving})
    value = math.inf
    if moving and np.isfinite(inputs).all():
        value = model.outputs_at(point.states, inputs, (name,))[name]
    if not math.isfinite(value):
        return "no upper limit of the inputs that change the thrust"
    return Quantity("thrust_available", value, model.unit(name))


def largest_lift(point: OperatingPoint) -> float | None:
    """Return the largest lift at the speed and the inputs of a trim, or None if it is unknown.

    The lift is q S CL_max with a declared CL_max. Otherwise it is the first maximum of the output
    `lift` over alpha, between the trim and the upper limit of alpha.
    """
    model = point.model
    if "largest_lift_coefficient" in model.outputs:
        declared = point["largest_lift_coefficient"]
        return point["dynamic_pressure"] * point["reference_area"] * declared
    alpha = recognized(model.states)["alpha"]
    highest = model.states[alpha].max
    if "alpha" in model.domain.range:
        highest = min(highest, model.domain.range["alpha"][1])
    if not math.isfinite(highest):
        return None
    lifts = _lifts(point, alpha, np.linspace(point[alpha], highest, _ANGLES))
    peak = int(np.argmax(lifts))
    falls = len(lifts) > 1 and lifts[-1] < lifts[peak] * (1.0 - 1e-9)
    # A table that is constant beyond its last breakpoint has no maximum of the lift.
    return lifts[peak] if falls and 0 < peak < len(lifts) - 1 else None


def _lifts(point: OperatingPoint, alpha: str, angles: np.ndarray) -> list[float]:
    """Return the output `lift` at other angles of attack and otherwise the values of a point."""
    model = point.model
    angle = ca.SX.sym(alpha)
    state = point.states._replace(**{alpha: angle})
    _, lift = model.layout.expressions((state, point.inputs, model.p), ("lift",))
    lifts: list[float] = ca.Function("lift", [angle], [lift])(angles[None]).full()[0].tolist()
    return lifts


def _add_static_margin(point: OperatingPoint, figures: Figures) -> None:
    """Add the static margin, the neutral point and the slopes of lift and pitching moment."""
    names = ("lift", "pitching_moment", "dynamic_pressure", "reference_area", "reference_chord")
    reason = _lacking(point, *names)
    if not reason and not point["reference_chord"]:
        reason = "the reference chord is 0"
    if reason:
        figures.not_in_model["static margin"] = figures.not_in_model["neutral point"] = reason
        return
    found = figures.stability
    chord = point["reference_chord"]
    (alpha,) = point.model.state_places([recognized(point.model.states)["alpha"]])
    lift, moment = (float(point.slopes_of(name)[0][alpha]) for name in ("lift", "pitching_moment"))
    force = point["dynamic_pressure"] * point["reference_area"]
    _add(found, "CL_alpha", lift / force, "1/rad")
    _add(found, "Cm_alpha", moment / (force * chord), "1/rad")
    if lift:
        margin = -moment / (lift * chord)
        _add(found, "static_margin", margin, "chord")
        unit = point.model.unit("reference_chord")
        _add(found, "neutral_point_behind_center_of_gravity", margin * chord, unit)


def _add_gradients(point: OperatingPoint, condition: TrimCondition, figures: Figures) -> None:
    """Add the changes of the pitching input per load factor and per knot."""
    model = point.model
    lacking = figures.not_in_model
    pulled = pull_up(point)
    if pulled is None:
        reason = "no input pitches the aircraft without delay"
        lacking["control per g"] = lacking["control per knot"] = reason
        return
    unit = model.unit(pulled.name)
    if "load_factor" not in model.outputs:
        lacking["control per g"] = "no output load_factor"
    elif pulled.load_factor:
        _add(figures.stability, f"{pulled.name}_per_g", 1.0 / pulled.load_factor, f"{unit}/g")
    change = change_per_knot(point, condition, pulled.name)
    if change is None:
        lacking["control per knot"] = "no trims 0.5 kt slower and faster that free the control"
    else:
        _add(figures.stability, f"{pulled.name}_per_knot", change, f"{unit}/kt")


class PullUp(NamedTuple):
    """Steady pull-up or push-over at constant speed, per unit of one input.

    name: input that pitches the aircraft most
    alpha: change of alpha, rad per unit of the input
    load_factor: change of the load factor per unit of the input; nan without this output
    """

    name: str
    alpha: float
    load_factor: float


def pull_up(point: OperatingPoint) -> PullUp | None:
    """Return the steady changes of alpha and load factor after a step of the input that pitches the
    aircraft most. All states except alpha and pitch rate are held.

    The result is None if the short period does not consist of alpha and one other state, or if no
    input changes the rate of that state.
    """
    model = point.model
    declared = model.modes.get("short period", ())
    others = [name for name in declared if name in model.linear and name != "alpha"]
    if (
        "alpha" not in declared
        or "alpha" not in model.linear
        or len(others) != 1
        or not model.inputs
    ):
        return None
    places = model.state_places(["alpha", *others])
    A = point.slopes.A[np.ix_(places, places)]
    B = point.slopes.B[places]
    nominal = np.array([signal.nominal for signal in model.inputs.values()])
    _, pitching = np.abs(B) * nominal
    strongest = int(np.argmax(pitching))
    if not pitching[strongest] or np.linalg.cond(A) > _SINGULAR:
        return None
    at_rest = -np.linalg.solve(A, B[:, strongest])
    load = math.nan
    if "load_factor" in model.outputs:
        of_states, of_inputs = point.slopes_of("load_factor")
        load = float(of_states[places] @ at_rest + of_inputs[strongest])
    return PullUp(tuple(model.inputs)[strongest], float(at_rest[0]), load)


def change_per_knot(point: OperatingPoint, condition: TrimCondition, name: str) -> float | None:
    """Return the change of an input per knot between trims 0.5 kt slower and faster.

    The result is None if the speed is free or the input is held, or if a trim does not exist.
    """
    from trim.point.solve import trim

    model = point.model
    speed = recognized(model.states)["speed"]
    knot = conversion("kt", model.unit(speed))
    held = point.problem_of(condition).condition
    if knot is None or speed not in held.imposed or name in held.imposed:
        return None
    values = []
    for change in (-_KNOTS, _KNOTS):
        imposed = {**held.imposed, speed: point[speed] + change * knot}
        try:
            values.append(trim(model, replace(held, imposed=imposed), point)[name])
        except (BadInputError, NoSolutionError):  # beyond the limits
            return None
    return (values[1] - values[0]) / (2.0 * _KNOTS)
