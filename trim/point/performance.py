"""Loads, performance, static stability and validity at a trim, from outputs with known names."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import recognized
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.results import Result
from hfa_support.units import conversion, radian_factor

if TYPE_CHECKING:
    from trim.point.condition import TrimCondition
    from trim.point.operating_point import OperatingPoint

#: Names of the output or input with the thrust; the first that a model declares is used.
_THRUST = ("thrust_force", "thrust")
#: Unit of a power in a model -> unit on the sheet, and factor.
_POWERS = {"lbf ft/s": ("hp", 1.0 / 550.0), "N m/s": ("kW", 1e-3)}
#: Unit of a speed in a model -> unit of a rate of climb on the sheet.
_CLIMBS = {"ft/s": ("ft/min", 60.0), "m/s": ("m/s", 1.0)}
#: Number of angles of attack at which the largest lift is searched, and its accuracy, rad.
_ANGLES = 200
_ACCURACY = 1e-7
#: Change of the speed between a trim and its neighbors, kt.
_KNOTS = 0.5
#: Condition number above which alpha and pitch rate have no steady state.
_SINGULAR = 1e12
#: Rounding of a derivative of 1 in converted units.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Quantity(Result):
    """Load, measure of performance or handling quality, such as the short-period damping.

    name: name of the measure
    value: number in `unit`, or a word on the configuration
    unit: unit of the value
    """

    name: str
    value: Any
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
    stalled: sentences on a trim beyond the largest lift
    """

    performance: dict[str, Quantity] = field(default_factory=dict)
    stability: dict[str, Quantity] = field(default_factory=dict)
    not_in_model: dict[str, str] = field(default_factory=dict)
    stalled: list[str] = field(default_factory=list)


def figures_of(point: OperatingPoint, condition: TrimCondition) -> Figures:
    """Return the loads, the performance and the static stability at a trim.

    A model states its forces by outputs with these names: lift and drag (aerodynamic, normal to and
    along the flight path), thrust, weight, pitching_moment (aerodynamic, about the center of
    gravity), dynamic_pressure, mach, reference_area, reference_chord, largest_lift_coefficient.

    - equivalent and calibrated airspeed: of the dynamic pressure and the Mach number
    - power required: D V
    - thrust available: thrust with the inputs that change it at their highest values, unless the
      thrust follows an engine state
    - excess thrust: thrust available - thrust; rate of climb left: excess thrust V cos α / weight,
      at constant speed
    - stall: largest lift coefficient, declared or the first maximum of the lift over alpha
    - static margin: -(∂M/∂α) / (c ∂L/∂α), with the other rigid-body states and the inputs fixed;
      lags follow (`_QuasiSteady`)
    - neutral point: distance behind the center of gravity, margin times chord
    - pull-up: change of an input per load factor in a steady pull-up of the linear model at
      constant speed
    - speed: change of an input per knot between trims 0.5 kt slower and faster
    """
    figures = Figures()
    given, point = point, point.in_radians
    model = point.model
    outputs = given.model.outputs_at(given.states, given.inputs)
    for name, value in outputs.items():
        _add(figures.performance, name, value, given.model.unit(name))
    if not {"speed", "alpha"} <= {*recognized(model.states)}:
        return figures
    _add_airspeeds(point, figures)
    _add_performance(point, figures)
    _add_stall(point, figures)
    if point.fault:
        lacking = ("static margin", "neutral point", "control per g", "control per knot")
        figures.not_in_model.update(dict.fromkeys(lacking, "a derivative is not a number"))
        return figures
    _add_static_margin(point, figures)
    _add_gradients(point, given, condition, figures)
    return figures


def _add(figures: dict[str, Quantity], name: str, value: float, unit: str) -> None:
    figures[name] = Quantity(name, float(value), unit)


def _lacking(point: OperatingPoint, *names: str) -> str:
    """Return why outputs are not in the model or cannot divide, or ""."""
    missing = [name for name in names if name not in point.model.outputs]
    return f"no output {', '.join(missing)}" if missing else ""


def _zero(point: OperatingPoint, *names: str) -> str:
    """Return a text on the first of some outputs that is 0 or not a number, or ""."""
    for name in names:
        if not point[name] or not math.isfinite(point[name]):
            return f"the {name.replace('_', ' ')} is {point[name]:g}"
    return ""


def _add_airspeeds(point: OperatingPoint, figures: Figures) -> None:
    """Add the equivalent and the calibrated airspeed, kt.

    The static pressure is p = 2 q / (1.4 M²). The calibrated airspeed is that at which the impact
    pressure at sea level is the same.
    """
    names = ("dynamic_pressure", "mach")
    reason = _lacking(point, *names) or _zero(point, *names)
    pressure_unit = "" if reason else point.model.unit("dynamic_pressure")
    to_pascal = None if reason else conversion(pressure_unit, "N/m^2")
    if reason or to_pascal is None:
        reason = reason or f"no unit of pressure in {pressure_unit}"
        figures.not_in_model["equivalent and calibrated airspeed"] = reason
        return
    from hfa_aircraft.rigid.atmosphere import calibrated_airspeed, equivalent_airspeed

    pressure = point["dynamic_pressure"] * to_pascal
    equivalent = equivalent_airspeed(pressure)
    _add(figures.performance, "equivalent_airspeed", equivalent, "kt")
    calibrated = calibrated_airspeed(pressure, point["mach"])
    _add(figures.performance, "calibrated_airspeed", calibrated, "kt")


def _add_performance(point: OperatingPoint, figures: Figures) -> None:
    """Add L/D, power, thrust and coefficients to the figures."""
    model = point.model
    found = figures.performance
    lacking = figures.not_in_model
    speed = recognized(model.states)["speed"]
    if reason := _lacking(point, "lift", "drag"):
        lacking["L/D"] = lacking["power required"] = reason
    else:
        if reason := _zero(point, "drag"):
            lacking["L/D"] = reason
        else:
            _add(found, "lift_over_drag", point["lift"] / point["drag"], "1")
        unit = f"{model.unit('drag')} {model.unit(speed)}"
        shown, factor = _POWERS.get(unit, (unit, 1.0))
        _add(found, "power_required", point["drag"] * point[speed] * factor, shown)
    available = thrust_available(point)
    if isinstance(available, str):
        for name in ("thrust available", "excess thrust", "rate of climb left"):
            lacking[name] = available
    else:
        found["thrust_available"] = available
        _add_excess(point, figures, available)
    forces = ("lift", "dynamic_pressure", "reference_area")
    if not _lacking(point, *forces) and not _zero(point, *forces[1:]):
        force = point["dynamic_pressure"] * point["reference_area"]
        _add(found, "lift_coefficient", point["lift"] / force, "1")
        if "drag" in model.outputs:
            _add(found, "drag_coefficient", point["drag"] / force, "1")


def _add_excess(point: OperatingPoint, figures: Figures, available: Quantity) -> None:
    """Add the excess thrust, and the rate of climb that it allows at constant speed."""
    model = point.model
    name = next(each for each in _THRUST if each in (*model.inputs, *model.outputs))
    excess = available.value - point[name]
    _add(figures.performance, "excess_thrust", excess, available.unit)
    reason = _lacking(point, "weight") or _zero(point, "weight")
    roles = recognized(model.states)
    if reason:
        figures.not_in_model["rate of climb left"] = reason
        return
    unit = model.unit(roles["speed"])
    shown, factor = _CLIMBS.get(unit, (unit, 1.0))
    climb = excess * math.cos(point[roles["alpha"]]) * point[roles["speed"]] / point["weight"]
    _add(figures.performance, "rate_of_climb_left", climb * factor, shown)


def _add_stall(point: OperatingPoint, figures: Figures) -> None:
    """Add the largest lift coefficient, and the speed over the stall speed, or that the aircraft is
    stalled.
    """
    names = ("lift", "dynamic_pressure", "reference_area")
    if reason := _lacking(point, *names) or _zero(point, *names):
        figures.not_in_model["stall margin"] = reason
        return
    force = point["dynamic_pressure"] * point["reference_area"]
    largest = largest_lift(point)
    if largest is None:
        figures.not_in_model["stall margin"] = "no CL_max, and lift without a maximum"
        return
    coefficient, largest_coefficient = point["lift"] / force, largest.lift / force
    _add(figures.performance, "largest_lift_coefficient", largest_coefficient, "1")
    if largest.passed:
        where = f"CL {largest_coefficient:.4g} at alpha {math.degrees(largest.alpha):.4g} deg"
        figures.stalled.append(f"STALLED: beyond the largest lift, {where}")
        figures.not_in_model["stall margin"] = "beyond the largest lift"
        return
    if point["lift"] > 0.0:
        ratio = math.sqrt(largest.lift / point["lift"])
        _add(figures.performance, "speed_over_stall_speed", ratio, "1")
    if coefficient > largest_coefficient:
        limit = f"CL_max {largest_coefficient:.4g} of the table"
        figures.stalled.append(f"STALLED: CL {coefficient:.4g} is above {limit}")


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
    of_states, of_inputs = point._slopes_of(name)
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


class LargestLift(NamedTuple):
    """Largest lift at the speed and the inputs of a trim.

    lift: the lift, in the unit of the model
    alpha: angle of attack at which the lift is largest, rad; nan for a declared CL_max
    passed: whether the trim is beyond this angle, where the lift falls with alpha
    """

    lift: float
    alpha: float = math.nan
    passed: bool = False


def largest_lift(point: OperatingPoint) -> LargestLift | None:
    """Return the largest lift at the speed and the inputs of a trim, or None if it is unknown.

    The lift is q S CL_max with a declared CL_max. Otherwise it is the first maximum of the output
    `lift` over alpha, above the trim, or the last one below a trim at which the lift falls.
    """
    model = point.model
    if "largest_lift_coefficient" in model.outputs:
        declared = point["largest_lift_coefficient"]
        return LargestLift(point["dynamic_pressure"] * point["reference_area"] * declared)
    alpha = recognized(model.states)["alpha"]
    lowest, highest = model.states[alpha].min, model.states[alpha].max
    if alpha in model.domain.range:
        valid_from, valid_to, _ = model.domain.range[alpha]
        lowest, highest = max(lowest, valid_from), min(highest, valid_to)
    if not np.isfinite([lowest, highest]).all():
        return None
    lift = _lift_over(point, alpha)
    trimmed = point[alpha]
    angles = np.linspace(trimmed, max(highest, trimmed), _ANGLES)
    slopes = np.diff(lift(angles))
    is_stalled = bool(slopes.size and slopes[0] < 0.0)
    if is_stalled:
        angles = np.linspace(trimmed, min(lowest, trimmed), _ANGLES)
    peak = _first_peak(lift, angles)
    if peak is None:
        return None
    (largest,) = lift(np.array([peak]))
    return LargestLift(float(largest), peak, is_stalled)


def _first_peak(lift: Callable[[np.ndarray], np.ndarray], angles: np.ndarray) -> float | None:
    """Return the angle of the first maximum of the lift along some angles, or None."""
    # A table that is constant beyond its last breakpoint has no maximum of the lift.
    lifts = lift(angles)
    small = 1e-9 * np.abs(lifts).max()
    falls = np.flatnonzero(np.diff(lifts) < -small)
    if not falls.size or falls[0] == 0:
        return None
    from scipy.optimize import minimize_scalar

    ends = sorted((angles[falls[0] - 1], angles[falls[0] + 1]))
    found = minimize_scalar(
        lambda angle: -float(lift(np.array([angle]))[0]),
        bounds=ends,
        method="bounded",
        options={"xatol": _ACCURACY},
    )
    return float(found.x)


def _lift_over(point: OperatingPoint, alpha: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function: angles of attack (N,) -> output `lift` (N,), otherwise at the point."""
    model = point.model
    angle = ca.SX.sym(alpha)
    state = point.states._replace(**{alpha: angle})
    _, lift = model.layout.expressions((state, point.inputs, model.p), ("lift",))
    function = ca.Function("lift", [angle], [lift])
    return lambda angles: np.asarray(function(angles[None]).full()[0])


def _add_static_margin(point: OperatingPoint, figures: Figures) -> None:
    """Add the static margin, the neutral point and the slopes of lift and pitching moment."""
    names = ("lift", "pitching_moment", "dynamic_pressure", "reference_area", "reference_chord")
    if reason := _lacking(point, *names) or _zero(point, *names[2:]):
        figures.not_in_model["static margin"] = figures.not_in_model["neutral point"] = reason
        return
    found = figures.stability
    chord = point["reference_chord"]
    alpha = recognized(point.model.states)["alpha"]
    steady = quasi_steady(point)
    place = steady.states.index(alpha)
    lift, moment = (float(steady.outputs[name][0][place]) for name in ("lift", "pitching_moment"))
    force = point["dynamic_pressure"] * point["reference_area"]
    _add(found, "CL_alpha", lift / force, "1/rad")
    _add(found, "Cm_alpha", moment / (force * chord), "1/rad")
    if lift:
        margin = -moment / (lift * chord)
        _add(found, "static_margin", margin, "chord")
        unit = point.model.unit("reference_chord")
        _add(found, "neutral_point_behind_center_of_gravity", margin * chord, unit)


class QuasiSteady(NamedTuple):
    """Slopes of a trim in which lags follow the other states without delay.

    states: names of the other states
    A, B: derivatives of their rates, (n, n) and (n, m)
    outputs: name -> derivatives (n,) by these states and (m,) by the inputs
    """

    states: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    outputs: dict[str, tuple[np.ndarray, np.ndarray]]


def quasi_steady(point: OperatingPoint) -> QuasiSteady:
    """Return the slopes at a trim with its lags residualized, x2 = -A22⁻¹ (A21 x1 + B2 u).

    Lags are linear states without a meaning in the motion of a body: they are no state that
    `recognized` names, no position whose rate is a state, and no rate of a position. They are kept
    if they have no stable steady state.
    """
    model = point.model
    slopes = point.slopes
    names = model.state_names
    of_motion = {*recognized(model.states).values(), "altitude"}
    for position, row in enumerate(slopes.A):
        is_rate_of_position = np.count_nonzero(row) == 1 and abs(row.sum() - 1.0) <= _ROUNDING
        if is_rate_of_position and not slopes.B[position].any():
            of_motion |= {names[position], names[int(np.argmax(row))]}
    lags = [i for i, name in enumerate(names) if name in model.linear and name not in of_motion]
    if lags and np.linalg.eigvals(slopes.A[np.ix_(lags, lags)]).real.max() >= 0.0:
        lags = []
    kept = [i for i in range(len(names)) if i not in lags]
    A22 = slopes.A[np.ix_(lags, lags)]
    lags_by_states = -np.linalg.solve(A22, slopes.A[np.ix_(lags, kept)])
    lags_by_inputs = -np.linalg.solve(A22, slopes.B[lags])

    def with_lags(of_states: np.ndarray, of_inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the slopes by the kept states and by the inputs while the lags follow."""
        of_lags = of_states[..., lags]
        return of_states[..., kept] + of_lags @ lags_by_states, of_inputs + of_lags @ lags_by_inputs

    A, B = with_lags(slopes.A[kept], slopes.B[kept])
    outputs = {name: with_lags(*point._slopes_of(name)) for name in point.sloped}
    return QuasiSteady(tuple(names[i] for i in kept), A, B, outputs)


#: Figures that require the load factor.
_BY_LOAD_FACTOR = ("control per g", "short period CAP")


def _add_gradients(
    point: OperatingPoint, given: OperatingPoint, condition: TrimCondition, figures: Figures
) -> None:
    """Add the changes of the pitching input per load factor and per knot.

    point: the trim, with angles in radians
    given: the trim in the units of the condition
    """
    model = point.model
    lacking = figures.not_in_model
    pulled = pull_up(point)
    if pulled is None:
        reason = "no input pitches the aircraft without delay"
        lacking.update(dict.fromkeys((*_BY_LOAD_FACTOR, "control per knot"), reason))
        return
    unit = model.unit(pulled.name)
    if "load_factor" not in model.outputs:
        lacking.update(dict.fromkeys(_BY_LOAD_FACTOR, "no output load_factor"))
    elif pulled.load_factor:
        _add(figures.stability, f"{pulled.name}_per_g", 1.0 / pulled.load_factor, f"{unit}/g")
    change = change_per_knot(given, condition, pulled.name)
    if change is None:
        lacking["control per knot"] = "no trims 0.5 kt slower and faster that free the control"
    else:
        change *= radian_factor(given.model.unit(pulled.name))
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
    aircraft most. Lags follow, and all other states except alpha and pitch rate are held.

    The result is None if the short period does not consist of alpha and one other state, or if no
    input changes the rate of that state.
    """
    model = point.model
    declared = [name for name in model.modes.get("short period", ()) if name in model.linear]
    alpha = recognized(model.states).get("alpha", "")
    others = [name for name in declared if name != alpha]
    if alpha not in declared or len(others) != 1 or not model.inputs:
        return None
    steady = quasi_steady(point)
    if not {alpha, *others} <= {*steady.states}:
        return None
    places = [steady.states.index(name) for name in (alpha, *others)]
    A = steady.A[np.ix_(places, places)]
    B = steady.B[places]
    nominal = np.array([signal.nominal for signal in model.inputs.values()])
    _, pitching = np.abs(B) * nominal
    strongest = int(np.argmax(pitching))
    if not pitching[strongest] or np.linalg.cond(A) > _SINGULAR:
        return None
    at_rest = -np.linalg.solve(A, B[:, strongest])
    load = math.nan
    if "load_factor" in model.outputs:
        of_states, of_inputs = steady.outputs["load_factor"]
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
    held = point._problem_of(condition).condition
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
