"""Mass, inertias and sizes of an aircraft, and warnings that they raise about a trim."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from typing import Any, NamedTuple

from hfa_aircraft.control_systems import LINEAR
from hfa_aircraft.model import Model
from hfa_aircraft.readers.derivatives.published import unusual
from hfa_aircraft.recognition import altitudes
from hfa_aircraft.rigid.aircraft import inertia_warning
from hfa_aircraft.rigid.atmosphere import GAS_CONSTANT, HEAT_RATIO, air_at
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import ROUNDING
from hfa_support.reporting.rows import Lacking, Row
from hfa_support.reporting.text import digits, is_zero, shown_value
from hfa_support.units import STANDARD_GRAVITY, conversion_factor, si_factor, si_unit
from trim.point.condition import release
from trim.point.solve import trim
from trim.reports.trimmed import Trimmed, named_value_text, value_text

#: Name of an entry -> name on the sheet. Models name signals or `About.configuration` so.
_ENTRIES = {
    "mass": "mass",
    "center_of_gravity": "c.g.",
    "center_of_gravity_x": "c.g. x",
    "center_of_gravity_y": "c.g. y",
    "center_of_gravity_z": "c.g. z",
    "Ixx": "Ixx",
    "Iyy": "Iyy",
    "Izz": "Izz",
    "Ixz": "Ixz",
    "reference_area": "S",
    "reference_span": "b",
    "reference_chord": "c",
    "flap": "flap",
    "gear": "gear",
}
#: Parameter of a table -> its entry, where that has another name.
_ENTRY_OF_PARAMETER = {"cg": "center_of_gravity"}
PARAMETER_OF_ENTRY = {entry: name for name, entry in _ENTRY_OF_PARAMETER.items()}
#: Entries that are optional, because 0 or unimportant where they are missing.
_OPTIONAL = ("center_of_gravity_y", "Ixz")


class Quantity(NamedTuple):
    """Number with its unit, or a word, such as that on a gear, with the unit "".

    value: a number, or a word
    unit: unit of the number
    """

    value: Any
    unit: str


def configuration_of(trimmed: Trimmed) -> dict[str, Quantity]:
    """Return mass, center of gravity, inertias and sizes at a trim as far as known, by name, in the
    units of the condition.

    The values are those of `About.configuration`, or of parameters, outputs and inputs with these
    names. Without a mass, it is the weight divided by the gravity.
    """
    point = trimmed.point
    model = point.model
    native = model.native
    configuration: dict[str, Quantity] = {}
    in_si = native is not model
    if native.about.configuration is not None:
        vectors = ((model.states, point.x), (model.inputs, point.u), (model.parameters, model.p))
        native_vectors = [model.native_values(tuple(names), vector) for names, vector in vectors]
        for name, (value, unit) in native.about.configuration(*native_vectors).items():
            factor = si_factor(unit) if in_si else 1.0
            number = value if isinstance(value, str) else float(value) * factor
            configuration[name] = Quantity(number, si_unit(unit) if in_si else unit)
    parameters = dict(zip(model.parameters, model.p.tolist(), strict=True))
    for name in _ENTRIES:
        if name not in configuration and name in (*parameters, *model.outputs, *model.inputs):
            value = parameters[name] if name in parameters else point[name]
            configuration[name] = Quantity(value, model.unit(name))
    if "mass" not in configuration and "weight" in model.outputs and parameters.get("gravity"):
        unit = {"lbf": "slug", "N": "kg"}.get(model.unit("weight"), "")
        if unit:
            configuration["mass"] = Quantity(point["weight"] / parameters["gravity"], unit)
    return configuration


def configuration_rows(trimmed: Trimmed) -> list[Row | Lacking]:
    """Return the rows of the configuration at a trim, with what is unknown of an aircraft.

    Parameters that are not as the model was loaded follow.
    """
    model = trimmed.point.model
    entries = configuration_of(trimmed)
    labels = {name: label for name, label in _ENTRIES.items() if name in entries}
    notes = {name: _lever_angle(model, name, entry.value) for name, entry in entries.items()}
    for parameter, loaded in model.changed.items():
        name = _ENTRY_OF_PARAMETER.get(parameter, parameter)
        value, unit = model.parameters[parameter].start, model.unit(parameter)
        texts = (_lever_angle(model, parameter, value), f"as loaded: {shown_value(loaded, unit)}")
        notes[name] = ", ".join(filter(None, texts))
        if name not in entries:
            entries[name] = Quantity(value, unit)
            labels[name] = parameter
    rows: list[Row | Lacking] = [
        Row(label, *entries[name], notes.get(name, ""), digits=6) for name, label in labels.items()
    ]
    for name, label in labels.items():
        full = model.signals[name].full if name in model.signals else 0.0
        if full:  # the angle of a lever, whose value is a share
            rows.append(
                Row(f"{label} angle", entries[name].value * math.radians(full), "rad", rare=True)
            )
    if entries.keys() & _ENTRIES.keys() or "alpha" in trimmed.roles:
        rows += [Lacking(label, "") for label in _missing_labels(entries)]
    return rows


def _missing_labels(entries: Collection[str]) -> list[str]:
    """Return the labels of the entries that are unknown; "c.g." if its position is."""
    missing = [label for name, label in _ENTRIES.items() if name not in (*entries, *_OPTIONAL)]
    labels = [label for label in missing if not label.startswith("c.g.")]
    has_center = any(name.startswith("center_of_gravity") for name in entries)
    return labels if has_center else ["c.g.", *labels]


def configuration_lines(trimmed: Trimmed) -> list[str]:
    """Return a sentence on inertias that no rigid body has, unless the first lines contain it."""
    warning = inertias_warning(trimmed)
    is_in_first_lines = warning in trimmed.model.warnings or holds_inertias(trimmed)
    return [warning] if warning and not is_in_first_lines else []


def _lever_angle(model: Model, name: str, value: Any) -> str:
    """Return the angle of what a lever moves as text: "15 of 40 deg", or "" if the signal is none.

    value: share of the travel of the lever
    """
    signal = model.signals.get(name)
    if signal is None or not signal.full:
        return ""
    return f"{digits(value * signal.full)} of {digits(signal.full)} deg"


def holds_inertias(trimmed: Trimmed) -> bool:
    """Return whether the inertias are parameters, which `--hold` sets."""
    return {"Ixx", "Iyy", "Izz"} <= {*trimmed.model.parameters}


def inertias_warning(trimmed: Trimmed) -> str:
    """Return a sentence if no rigid body has the inertias, or ""."""
    configuration = configuration_of(trimmed)
    if not {"Ixx", "Iyy", "Izz"} <= {*configuration}:
        return ""
    xx, yy, zz = (configuration[name].value for name in ("Ixx", "Iyy", "Izz"))
    xz = configuration["Ixz"].value if "Ixz" in configuration else 0.0
    return inertia_warning([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])


#: Lift coefficients at which wings begin to stall are larger.
_STALLING = 0.7
#: Largest usual angle of attack, deg.
_STEEPEST = 60.0
#: Outputs that are 0 without air.
_OF_AIR = ("density", "dynamic_pressure", "keas", "kcas")
#: Smaller speeds, per nominal speed, are none of a flight.
_STANDING = 1e-2
#: Largest change of the speed, as a share, over which derivatives with respect to it are believed.
_NEAR_SPEED = 0.1


class _Identity(NamedTuple):
    """Comparison of two ways to compute a figure of a trim, with the range in which they agree.

    compared: a ratio or another number without a size, or a temperature; nan if a figure is unknown
    least, most: the range
    says: sentence on a number outside
    """

    compared: Callable[[Trimmed], float]
    least: float
    most: float
    says: str


def warnings_of(trimmed: Trimmed) -> list[str]:
    """Return sentences on data and on values of the trim that are probably wrong."""
    warnings = [*trimmed.point.model.warnings, *warnings_at(trimmed)]
    if holds_inertias(trimmed) and (warning := inertias_warning(trimmed)):
        warnings.append(warning)
    return [*dict.fromkeys(warnings)]


def warnings_at(trimmed: Trimmed) -> Iterator[str]:
    """Yield sentences on values that data in wrong units or with wrong signs cause: alpha, drag,
    directional stability, figures that contradict each other.
    """
    model, roles = trimmed.point.model, trimmed.roles
    if "alpha" in roles and abs(math.degrees(trimmed[roles["alpha"]])) > _STEEPEST:
        yield _steep(trimmed)
    speed = roles.get("speed", "")
    is_aircraft = ("alpha" in roles or "lift" in model.outputs) and LINEAR not in model.about.notes
    is_still = speed and abs(trimmed.point[speed]) < _STANDING * model.states[speed].nominal
    if is_aircraft and is_still:
        here = value_text(model, speed, trimmed.point[speed])
        yield f"the speed is {here}, no flight; hold a speed"
    if {"drag", "lift"} <= {*model.outputs}:
        drag, lift = trimmed["drag"], trimmed["lift"]
        if drag < -ROUNDING * abs(lift):  # the drag is a component of the force that has the lift
            yield f"the drag is {value_text(model, 'drag', drag)}, below 0; check signs and units"
    yield from _warning_of_speed(trimmed)
    for identity in _IDENTITIES if trimmed.point.ok else ():
        number = identity.compared(trimmed)
        if number < identity.least or number > identity.most:
            yield identity.says.format(number)
    is_known = trimmed.point.ok and not trimmed.fault
    if is_known and (warning := _unusual_slope(trimmed)):
        yield warning
    if is_known and {"beta", "r", "speed"} <= {*roles} and _is_unstable_in_yaw(trimmed):
        yield "sideslip turns the nose out of the wind (body-axis Cn_beta below 0); check it"


def _steep(trimmed: Trimmed) -> str:
    """Return a sentence on an alpha at which nothing flies: what is 0 without air, the cause in a
    table, and the options of a flight.
    """
    point, model = trimmed.point, trimmed.point.model
    without_air = [
        name
        for name in _OF_AIR
        if name in model.outputs and is_zero(point[name], model.outputs[name].nominal)
    ]
    words = [named_value_text(point, trimmed.roles["alpha"])]
    words += [f"{name} {value_text(model, name, 0.0)}" for name in without_air]
    warning = f"{', '.join(words)}: {'no' if without_air else 'hardly a'} flight"
    if model.about.equations == "derivatives":
        return f"{warning}; the data may have degrees without a unit"
    options = _flight_options(trimmed) if point.ok else ""
    return f"{warning}; a flight: {options}" if options else warning


def _flight_options(trimmed: Trimmed) -> str:
    """Return the options that hold speed and altitude at the start values of the model and free its
    inputs, or "" if they lead to no trim, or to one that is as steep.
    """
    model, condition = trimmed.point.model, trimmed.point.trim_problem.condition
    alpha, speed = trimmed.roles["alpha"], trimmed.roles.get("speed", "")
    imposed = {*condition.imposed}
    if not imposed.isdisjoint(model.airspeeds):
        imposed.add(speed)
    motion = [name for name in (speed, "altitude") if name in model.states and name not in imposed]
    hold = {name: model.states[name].start for name in motion}
    defaults = {name for name, value in model.trim.items() if condition.imposed.get(name) == value}
    free = [name for name in model.inputs if name in defaults]
    try:
        flown = trim(model, release(condition, hold=hold, free=free))
    except (BadInputError, NoSolutionError):
        return ""
    if not hold or abs(math.degrees(flown.in_coherent_units[alpha])) > _STEEPEST:
        return ""
    held = [f"--hold {name}={shown_value(hold[name], model.unit(name))}" for name in hold]
    return " ".join([*held, *(f"--free {name}" for name in free)])


def _is_unstable_in_yaw(trimmed: Trimmed) -> bool:
    """Return whether ∂N/∂β, the yawing moment about the body's z-axis by sideslip, is below 0.

    Without angular rates, N = Izz dr/dt - Ixz dp/dt. An unknown Ixz is 0.
    """
    roles, states = trimmed.roles, trimmed.slopes.states
    by_sideslip = trimmed.slopes.A[:, states.index(roles["beta"])]
    yawing = float(by_sideslip[states.index(roles["r"])])
    rolling = 0.0  # Ixz / Izz times ∂(dp/dt)/∂β
    configuration = configuration_of(trimmed)
    if "p" in roles and {"Izz", "Ixz"} <= {*configuration}:
        coupling = configuration["Ixz"].value / configuration["Izz"].value
        rolling = coupling * float(by_sideslip[states.index(roles["p"])])
    return yawing - rolling < -ROUNDING * (abs(yawing) + abs(rolling))


def _warning_of_speed(trimmed: Trimmed) -> Iterator[str]:
    """Yield a sentence if the speed is far from that of derivatives with respect to the speed."""
    domain, speed = trimmed.point.model.domain, trimmed.roles.get("speed", "")
    if not domain.by_speed or speed not in domain.reference:
        return
    stated, here = domain.reference[speed], trimmed.point[speed]
    if abs(here - stated) > _NEAR_SPEED * stated:
        percent = 100.0 * abs(here / stated - 1.0)
        yield (
            f"{', '.join(domain.by_speed)} are for "
            f"{value_text(trimmed.point.model, speed, stated)}, {percent:.0f} % off: forces and "
            "thrust are uncertain here"
        )


def _value_in(trimmed: Trimmed, name: str, unit: str) -> float:
    """Return a value of the trim in a unit; nan if it is unknown or has another quantity."""
    if name not in trimmed.values:
        return math.nan
    return trimmed[name] * (conversion_factor(trimmed.unit(name), unit) or math.nan)


def _configured_in(trimmed: Trimmed, name: str, unit: str) -> float:
    """Return an entry of the configuration in a unit, or nan."""
    entry = configuration_of(trimmed).get(name)
    if entry is None or isinstance(entry.value, str):
        return math.nan
    return float(entry.value) * (conversion_factor(entry.unit, unit) or math.nan)


def _speed(trimmed: Trimmed) -> float:
    """Return the true airspeed, m/s, or nan."""
    return _value_in(trimmed, trimmed.roles.get("speed", ""), "m/s") or math.nan


def _lift_beyond_thrust(trimmed: Trimmed) -> float:
    """Return 1 plus the part of lift minus load factor times weight that no thrust explains, per
    weight. An unknown thrust may be as large as the weight.
    """
    lift, weight = _value_in(trimmed, "lift", "N"), _value_in(trimmed, "weight", "N")
    excess = lift - _value_in(trimmed, "load_factor", "1") * weight
    thrust = _value_in(trimmed, trimmed.thrust_name, "N")
    if math.isnan(thrust):
        thrust = weight
    beyond_thrust = math.copysign(max(0.0, abs(excess) - abs(thrust)), excess)
    return 1.0 + beyond_thrust / weight


def _weight_by_mass(trimmed: Trimmed) -> float:
    """Return the weight relative to mass times gravity, of the model if it has one."""
    model = trimmed.point.model
    gravity = STANDARD_GRAVITY
    if "gravity" in model.parameters:
        factor = conversion_factor(model.unit("gravity"), "m/s^2") or math.nan
        gravity = model.parameters["gravity"].start * factor
    return _value_in(trimmed, "weight", "N") / (_configured_in(trimmed, "mass", "kg") * gravity)


def _density_ratio(trimmed: Trimmed) -> float:
    """Return the density of dynamic pressure and speed, relative to standard air there. A model
    without an altitude flies at sea level or above.
    """
    names = altitudes(trimmed.model)
    altitude = _value_in(trimmed, names[0], "m") if names else 0.0
    density = 2.0 * _value_in(trimmed, "dynamic_pressure", "N/m^2") / _speed(trimmed) ** 2
    ratio = density / float(air_at(altitude, "si").density)
    return ratio if names else max(1.0, ratio)


def _temperature(trimmed: Trimmed) -> float:
    """Return the temperature of speed and Mach number, K."""
    mach = _value_in(trimmed, "mach", "1") or math.nan
    return (_speed(trimmed) / mach) ** 2 / (HEAT_RATIO * GAS_CONSTANT)


def _slope_in(trimmed: Trimmed, row: str, column: str, unit: str) -> float:
    """Return the derivative of a rate per second, or of an output, over a state, in a unit.

    row: role of a state, an altitude, or an output
    column: role of a state
    """
    name, by = trimmed.roles.get(row, row), trimmed.roles.get(column, "")
    if trimmed.fault or not by or name not in trimmed.values:
        return math.nan
    slopes = trimmed.slopes
    factor = conversion_factor(trimmed.unit(name), unit) or math.nan
    place = slopes.states.index(by)
    if name in slopes.states:
        return float(slopes.A[slopes.states.index(name), place]) * factor * trimmed.per_second
    if name not in slopes.outputs:
        return math.nan
    return float(slopes.outputs[name].by_states[place]) * factor


def _turning(row: str) -> Callable[[Trimmed], float]:
    """Return the function of a trim to the derivative of an angle's rate over the pitch rate."""
    # In a coherent model the rate has the unit of the angle over time.
    return lambda trimmed: _slope_in(trimmed, row, "q", "rad") / trimmed.per_second


def _climbing(trimmed: Trimmed) -> float:
    """Return the change of the rate of altitude with the pitch angle, per speed."""
    names = altitudes(trimmed.model)
    return _slope_in(trimmed, names[0], "theta", "m") / _speed(trimmed) if names else math.nan


def _unusual_slope(trimmed: Trimmed) -> str:
    """Return a sentence if CL_alpha is none of an aircraft, or "". Near a stall, any is less."""
    area = _value_in(trimmed, "reference_area", "m^2") * _value_in(
        trimmed, "dynamic_pressure", "N/m^2"
    )
    slope = _slope_in(trimmed, "lift", "alpha", "N") / (area or math.nan)
    is_stalling = _value_in(trimmed, "lift", "N") / (area or math.nan) > _STALLING
    if (is_stalling and slope < 1.0) or LINEAR in trimmed.point.model.about.notes:
        return ""
    return unusual("CL_alpha", slope)


def _difference_of_static_margins(trimmed: Trimmed) -> float:
    """Return the difference of the static margin of the rates and that of the outputs, chords.

    Without Iyy, only their signs are compared: Iyy is then that of margins of equal size.
    """
    alpha, q = (trimmed.roles.get(role, "") for role in ("alpha", "q"))
    if trimmed.fault or not alpha or not q:
        return math.nan
    slopes = trimmed.slopes
    if not {"pitching_moment", "lift"} <= {*slopes.outputs}:
        return math.nan
    place = slopes.states.index(alpha)

    def by_alpha(name: str, unit: str) -> float:
        """Return the slope of an output over alpha, in a unit per radian, or nan."""
        factor = conversion_factor(trimmed.unit(name), unit) or math.nan
        return float(slopes.outputs[name].by_states[place]) * factor

    moment = by_alpha("pitching_moment", "N m")
    inertia = _configured_in(trimmed, "Iyy", "kg m^2")
    rate = float(slopes.A[slopes.states.index(q), place])
    moment_of_rate = math.copysign(moment, rate) if math.isnan(inertia) else inertia * rate
    lift_times_chord = by_alpha("lift", "N") * _value_in(trimmed, "reference_chord", "m")
    return (moment - moment_of_rate) / lift_times_chord if lift_times_chord else math.nan


#: A thrust carries a part of the weight. Gravity changes by 1 % with latitude and height. Hot and
#: cold air differ from the standard by less than a factor 1.3, feet and meters by more. Air has 185
#: to 330 K. Thrust and the lag of the downwash are in the rates alone.
_IDENTITIES = (
    _Identity(
        _lift_beyond_thrust, 0.8, 1.2,
        "lift and thrust do not carry the weight at this load factor (a ratio of {:.3g}); check "
        "the outputs lift, weight and load_factor",
    ),
    _Identity(
        _weight_by_mass, 0.97, 1.03,
        "the weight is {:.3g} times mass and gravity; check them and their units",
    ),
    _Identity(
        _density_ratio, 0.7, 1.4,
        "dynamic pressure and speed are those of {:.3g} times the standard density; check them and "
        "their units",
    ),
    _Identity(
        _turning("theta"), 0.0, 2.0,
        "the rate of the pitch angle is {:.3g} times the pitch rate; check their units and signs",
    ),
    _Identity(
        _turning("alpha"), 0.0, 2.0,
        "the rate of alpha changes by {:.3g} times the pitch rate; check their units and signs",
    ),
    _Identity(
        _climbing, 0.2, 2.0,
        "the rate of altitude changes with the pitch angle by {:.3g} times the speed; check their "
        "signs and units",
    ),
    _Identity(
        lambda trimmed: _slope_in(trimmed, "gamma", "theta", "rad"), 0.2, 3.0,
        "gamma changes by {:.3g} times the pitch angle; check its sign and unit",
    ),
    _Identity(
        _temperature, 150.0, 350.0,
        "Mach number and speed are those of air of {:.3g} K; check them and their units",
    ),
    _Identity(
        _difference_of_static_margins, -0.2, 0.2,
        "the static margins of the rate of the pitch rate and of the output pitching_moment are "
        "{:.3g} chords apart; check the output's sign and unit, and Iyy",
    ),
)  # fmt: skip
