"""Control system in steady state: output of each component for a constant input (`FGFCS`).

The components are those of <system>, <autopilot> and <flight_control>.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import casadi as ca

from hfa_aircraft.batch_simulation import saturated
from hfa_jsbsim.functions import function_value, table_value
from hfa_jsbsim.properties import (
    LoopError,
    Note,
    Properties,
    Writer,
    is_constant,
    is_zero,
    lower_dashes,
)
from hfa_jsbsim.xml_file import Element, number_of
from hfa_support.errors import shortened


def parameter(element: Element, name: str, properties: Properties, default: float) -> Any:
    """Return the value of a child of an element, given as a number or as the name of a property.

    default: value without such a child
    """
    child = element.find(name)
    return default if child is None else properties.value(child.text, child)


def coefficients(component: Element, properties: Properties, count: int) -> list[Any]:
    """Return the values of <c1>, <c2>, ..., given as numbers or as names of properties.

    count: number of coefficients

    Raises BadInputError if a coefficient is missing.
    """
    children = [component.need(f"c{number}") for number in range(1, count + 1)]
    return [properties.value(child.text, child) for child in children]


def input_of(component: Element, properties: Properties) -> Any:
    """Return the value of a component's first input."""
    return _input(component.need("input"), properties)


def _input(child: Element, properties: Properties) -> Any:
    """Return the value of the property named by an <input>. Raises BadInputError for a number."""
    if number_of(child.text) is not None:
        raise child.error(f"<input> is {shortened(child.text)}; give the name of a property")
    return properties.value(child.text, child)


def min_and_max(element: Element) -> tuple[float, float]:
    """Return the numbers in <min> and <max> of an element."""
    return element.need("min").number(), element.need("max").number()


def after_deadband(value: Any, width: Any) -> Any:
    """Return a value after a deadband centered at 0: the part of the value outside the deadband.

    width: width of the deadband
    """
    half = 0.5 * width
    value = ca.SX(value)
    above = ca.if_else(value > half, value - half, 0.0)
    return ca.if_else(value < -half, value + half, above)


def filter_rate(component: Element, properties: Properties) -> Any:
    """Return <c1> of a filter, 1/s. Raises BadInputError for a constant that is not positive."""
    rate = parameter(component, "c1", properties, 0.0)
    if is_constant(rate) and float(rate) <= 0.0:
        raise component.error(
            f"<c1> is {float(rate):g}, so the filter is not stable; give a positive value"
        )
    return rate


def detents(component: Element) -> tuple[float, float]:
    """Return the first and the last position of a <kinematic>.

    Raises BadInputError for fewer than two positions, or positions that decrease.
    """
    settings = list(component.need("traverse").all("setting"))
    if len(settings) < 2:
        raise component.error(
            "<traverse> of <kinematic> contains fewer than two <setting> "
            "elements; give at least two"
        )
    positions = [setting.need("position").number() for setting in settings]
    if any(later < earlier for earlier, later in pairwise(positions)):
        raise component.error(
            "a <position> of <kinematic> is less than the position before; give "
            "positions in ascending order"
        )
    return positions[0], positions[-1]


#: Surfaces whose position JSBSim stores in rad, in deg and as a magnitude. One value determines the
#: others.
SURFACES = ("elevator", "left-aileron", "right-aileron", "rudder", "flap", "speedbrake", "spoiler")


def add_control_systems(sections: Iterable[Element], properties: Properties) -> None:
    """Define the properties of all components in the sections of the control system.

    sections: <system>, <autopilot> and <flight_control> elements
    """
    order = 0
    for section in sections:
        for channel in section.all("channel"):
            execute = channel.attributes.get("execute", "")
            for component in channel.children:
                if component.name in KINDS:
                    order += 2  # the other units of a surface are set directly after it
                    _add_component(component, properties, order, execute)
    _join_units(properties)


def _add_component(component: Element, properties: Properties, order: int, execute: str) -> None:
    """Define the properties that a component sets, which its name and its outputs name.

    execute: property of the channel, which is executed while it is not 0, or ""
    """
    name = component.attributes.get("name", "")
    names = [name if "/" in name else f"fcs/{lower_dashes(name)}"]
    outputs = list(component.all("output"))
    for output in outputs:
        if output.text.startswith("-"):
            raise output.error(
                f"<output> {shortened(output.text)} begins with a sign, which is not supported; "
                "remove the sign"
            )
    names += [output.text for output in outputs]
    if component.name == "distributor":
        names += [child.text for case in component.children for child in case.all("property")]
    compute = partial(_output, component, properties)
    writer = Writer(compute, component.where, order, component, is_of_file=True)
    for output_name in dict.fromkeys(names):
        if properties.is_read_only(output_name):
            continue
        own = _if_executed(writer, output_name, execute, properties) if execute else writer
        properties.add_writer(output_name, own)


def _if_executed(writer: Writer, name: str, execute: str, properties: Properties) -> Writer:
    """Return the writer of a component of a channel that is executed while a property is not 0.

    execute: name of this property
    """
    before = properties.writer(name)

    def is_on() -> ca.SX:
        """Return whether the channel is executed."""
        return ca.SX(properties.read(execute, writer.where)) != 0.0

    def compute() -> Any:
        """Return the output, or without execution the value before."""
        kept = properties.initial(name)
        if before is not None:
            kept = properties.value_of(before, name, writer.where)
        return ca.if_else(is_on(), properties.value_of(writer, name, writer.where), kept)

    return replace(writer, compute=compute, is_on=is_on)


def _join_units(properties: Properties) -> None:
    """Define surface positions in radians from degrees or vice versa, and their magnitude."""
    # If components set both units, the later one in the order of evaluation is used.
    for surface in SURFACES:
        in_rad = f"fcs/{surface}-pos-rad"
        in_deg = f"fcs/{surface}-pos-deg"
        writers = [properties.writer(in_rad), properties.writer(in_deg)]
        orders = [writer.order if writer else -1 for writer in writers]
        if max(orders) < 0:
            continue
        is_rad_later = orders[0] >= orders[1]
        source, target = (in_rad, in_deg) if is_rad_later else (in_deg, in_rad)
        join_surface(properties, surface, source, target, max(orders) + 1)


def join_surface(
    properties: Properties, surface: str, source: str, target: str, order: int
) -> None:
    """Define a surface position in a second unit, and its magnitude in radians.

    source, target: names of the existing and of the new property
    order: position in the order of evaluation
    """
    factor = math.pi / 180.0 if source.endswith("deg") else 180.0 / math.pi
    in_rad = source if source.endswith("rad") else target

    def other_unit() -> Any:
        return properties.read(source, "") * factor

    def magnitude() -> Any:
        return ca.fabs(ca.SX(properties.read(in_rad, "")))

    properties.add_writer(target, Writer(other_unit, "", order))
    properties.add_writer(f"fcs/mag-{surface}-pos-rad", Writer(magnitude, "", order))


def _output(component: Element, properties: Properties) -> Any:
    """Return the output of a component, within its limits."""
    # The output is the steady-state output, or an expression of filter states.
    if component.name in ("pid", "integrator"):
        value = _controller(component, properties)
    elif component.name in _COMPONENTS:
        value = _COMPONENTS[component.name](component, properties)
    else:
        fault = f"<{shortened(component.name)}> has no steady-state output"
        return properties.unknown(component.error(f"{fault}; remove this dependence"))
    return _clipped(component, properties, value)


def _clipped(component: Element, properties: Properties, value: Any) -> Any:
    """Return a value within the limits of <clipto>."""
    # As in JSBSim, the limits are ignored if one is missing or if they are exchanged.
    limits = component.find("clipto")
    if limits is None or None in (limits.find("min"), limits.find("max")):
        return value
    if limits.attributes.get("type") == "cyclic":
        fault = "a cyclic <clipto> has no steady-state value; remove this <clipto>"
        return properties.unknown(limits.error(fault))
    low, high = (parameter(limits, name, properties, 0.0) for name in ("min", "max"))
    # JSBSim does not clip if the limits are exchanged.
    return ca.if_else(low <= high, saturated(ca.SX(value), low, high), value)


def _summer(component: Element, properties: Properties) -> Any:
    """Return the output of a <summer>: the sum of its inputs and its bias."""
    inputs = [_input(child, properties) for child in component.all("input")]
    return sum(inputs, start=component.value_of("bias", 0.0))


def _gain(component: Element, properties: Properties) -> Any:
    """Return the output of a <pure_gain>: its gain times its input."""
    return parameter(component, "gain", properties, 1.0) * input_of(component, properties)


def _scheduled_gain(component: Element, properties: Properties) -> Any:
    """Return the output of a <scheduled_gain>: its table times its gain times its input."""
    table = table_value(component.need("table"), properties)
    return table * _gain(component, properties)


def _aerosurface_scale(component: Element, properties: Properties) -> Any:
    """Return the output of an <aerosurface_scale>: its input scaled from <domain> to <range>."""
    # Positive and negative inputs have separate slopes about 0 unless <zero_centered> is 0 or
    # false.
    domain = component.find("domain")
    lowest, highest = (-1.0, 1.0) if domain is None else min_and_max(domain)
    out_lowest, out_highest = min_and_max(component.need("range"))
    value = ca.SX(input_of(component, properties))
    centered = component.find("zero_centered")
    if centered is not None and centered.text in ("0", "false"):
        scaled = out_lowest + (value - lowest) / (highest - lowest) * (out_highest - out_lowest)
    else:  # slopes for positive and negative inputs
        up = out_highest / highest if highest else 0.0
        down = out_lowest / lowest if lowest else 0.0
        scaled = value * up if up == down else value * ca.if_else(value > 0.0, up, down)
    return scaled * parameter(component, "gain", properties, 1.0)


def _kinematic(component: Element, properties: Properties) -> Any:
    """Return the steady-state output of a <kinematic>, and list one that takes time to move."""
    # The output is the input times the last detent, clipped to the first and the last detent. With
    # <noscale> the input is not multiplied.
    lowest, highest = detents(component)
    value = input_of(component, properties)
    if component.find("noscale") is None:
        value = value * highest
    target = saturated(ca.SX(value), lowest, highest)
    settings = component.need("traverse").all("setting")
    if any(setting.need("time").number() > 0.0 for setting in settings):
        properties.travels.append((component, target))
    return target


def _deadband(component: Element, properties: Properties) -> Any:
    """Return the output of a <deadband>: its gain times the part of its input outside the band."""
    width = parameter(component, "width", properties, 0.0)
    return after_deadband(input_of(component, properties), width) * component.value_of("gain", 1.0)


def _actuator(component: Element, properties: Properties) -> Any:
    """Return the output of an <actuator>: its input after lag, deadband and bias."""
    # Rate limits and hysteresis are omitted with a note.
    value = _lagged(component, "lag", input_of(component, properties), properties)
    if component.find("rate_limit") is not None:
        properties.leave_out(component, "its rate limit", is_always=True)
    width = component.value_of("deadband_width", 0.0)
    if width:
        value = after_deadband(value, width)
    play = component.value_of("hysteresis_width", 0.0)
    if play:
        name = shortened(component.attributes.get("name", ""))
        statement = (
            "hysteresis is omitted; in JSBSim these actuators may stop this far from their command"
        )
        properties.notes.append(Note(statement, f"{name} by {0.5 * play:g}", component.where))
    return value + component.value_of("bias", 0.0)


def _lagged(component: Element, name: str, value: Any, properties: Properties) -> Any:
    """Return a value after the first-order lag that a child of a component specifies."""
    # - The component has no such child: the value.
    # - Filters have no states: the value, with a note that the lag is omitted.
    # - Otherwise: a new state y with y' = rate (value - y).
    child = component.find(name)
    if child is None:
        return value
    if not properties.has_filter_states:
        properties.leave_out(component, "its lag is omitted")
        return value
    rate = properties.value(child.text, child)
    state = properties.add_state(component, value)
    properties.set_rate(state, lambda: rate * (value - state))
    return state


def _function(component: Element, properties: Properties) -> Any:
    """Return the output of an <fcs_function>: its function, times its input if it has one."""
    value = function_value(component.need("function"), properties)
    if component.find("input") is not None:
        value = value * input_of(component, properties)
    return value


def _lag(component: Element, properties: Properties) -> Any:
    """Return the output of the filter c1 / (s + c1), its input unless filters are states."""
    rate = filter_rate(component, properties)
    if not properties.has_filter_states:
        properties.leave_out(component, "its lag is omitted")
        return input_of(component, properties)
    state = properties.add_state(component)
    properties.set_rate(state, lambda: rate * (input_of(component, properties) - state))
    return state


def _washout(component: Element, properties: Properties) -> Any:
    """Return the output of the filter s / (s + c1), 0 unless filters are states."""
    rate = filter_rate(component, properties)
    if not properties.has_filter_states:
        properties.leave_out(component, "its output is 0, as for a constant input")
        return 0.0
    value = input_of(component, properties)
    state = properties.add_state(component, value)
    properties.set_rate(state, lambda: rate * (value - state))
    return value - state


#: What a filter is whose denominator is 0 at s = 0.
_NO_STEADY_STATE = "has no steady-state value; give a value other than 0"


def _refuse_zero(component: Element, name: str, coefficient: Any, consequence: str) -> None:
    """Raise BadInputError if a coefficient of a filter is 0, with the consequence of 0."""
    if is_zero(coefficient):
        raise component.error(f"<{name}> is 0, so the filter {consequence}")


def _lead_lag(component: Element, properties: Properties) -> Any:
    """Return the output of the filter (c1 s + c2) / (c3 s + c4)."""
    # It is c2 / c4 times the input unless filters are states.
    value = input_of(component, properties)
    c1, c2, c3, c4 = coefficients(component, properties, 4)
    _refuse_zero(component, "c4", c4, _NO_STEADY_STATE)
    if not properties.has_filter_states:
        properties.leave_out(component, "its dynamics are omitted")
        return value * c2 / c4
    differentiates = "differentiates the input, which is not supported; give a value other than 0"
    _refuse_zero(component, "c3", c3, differentiates)
    state = properties.add_state(component, value)
    # (c1 s + c2) / (c3 s + c4) = c1 / c3 + (c2 - c1 c4 / c3) / (c3 s + c4); a state for the latter
    properties.set_rate(state, lambda: (c2 / c3 - c1 * c4 / c3**2) * value - c4 / c3 * state)
    return c1 / c3 * value + state


def _switch(component: Element, properties: Properties) -> Any:
    """Return the output of a <switch>: the value of the first <test> that is true."""
    # If no <test> is true, it is the value of <default>, or 0 without <default>.
    default = component.find("default")
    value: Any = 0.0
    if default is not None:
        if not default.attributes.get("value"):
            raise default.error(
                "<default> has no value, so JSBSim ignores this <default>; add the attribute value"
            )
        value = properties.value(default.attributes["value"], default)
    for test in reversed(list(component.all("test"))):
        if not test.attributes.get("value"):
            raise test.error(
                "<test> has no value, so JSBSim ignores this <test>; add the "
                "attribute value, or remove the <test>"
            )
        holds = _holds(test, properties)
        if is_zero(holds):
            continue
        value = ca.if_else(holds, properties.value(test.attributes["value"], test), value)
    return value


_COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_WORDS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_WORDS |= {word.upper(): sign for word, sign in _WORDS.items()}


def _holds(test: Element, properties: Properties) -> ca.SX:
    """Return whether all conditions of a <test> are true, or with logic="OR" at least one."""
    conditions = []
    for line, text in test.lines:
        words = text.split()
        sign = _WORDS.get(words[1], words[1]) if len(words) == 3 else ""
        # JSBSim ignores a condition with a tab, which is therefore refused.
        if "\t" in text or sign not in _COMPARISONS or number_of(words[0]) is not None:
            fault = f"{shortened(text)!r} is not a condition; write PROPERTY lt NUMBER, with spaces"
            raise test.error_at(line, fault)
        one, other = (properties.value(word, test) for word in (words[0], words[2]))
        conditions.append(_COMPARISONS[sign](ca.SX(one), ca.SX(other)))
    conditions += [_holds(nested, properties) for nested in test.all("test")]
    if not conditions:
        raise test.error("<test> has no condition; give a condition, such as PROPERTY lt NUMBER")
    logic = test.attributes.get("logic", "") or "AND"
    if logic not in ("AND", "OR"):
        raise test.error(f"the attribute logic of <test> is {shortened(logic)!r}; write AND or OR")
    either = logic == "OR"
    result = conditions[0]
    for condition in conditions[1:]:
        result = ca.logic_or(result, condition) if either else ca.logic_and(result, condition)
    return result


def _controller(component: Element, properties: Properties) -> Any:
    """Return the output of a <pid> or an <integrator> with the input u, before limits (`FGPID`)."""
    # - <pid>: kp u + ki ∫ u dt + kd u'
    # - <pid> of type "standard": kp (u + ki ∫ u dt + kd u')
    # - <integrator>: the formula of a <pid> with ki = c1
    # u' is <pvdot>, or 0 without it.
    value = ca.SX(input_of(component, properties))
    integral = component.find("ki") if component.name == "pid" else component.need("c1")
    gain = 0.0 if integral is None else properties.value(integral.text, integral)
    integrated: Any = 0.0
    if not is_zero(gain):
        integrated = _integral(component, properties, value, gain)
    proportional = parameter(component, "kp", properties, 0.0)
    damping = parameter(component, "kd", properties, 0.0)
    slope: Any = 0.0
    if component.find("pvdot") is not None:
        slope = parameter(component, "pvdot", properties, 0.0)
    elif not is_zero(damping):
        properties.leave_out(component, "the derivative of its input", is_always=True)
    if component.attributes.get("type") == "standard":
        return proportional * (value + integrated + damping * slope)
    return proportional * value + integrated + damping * slope


def _integral(component: Element, properties: Properties, value: Any, gain: Any) -> Any:
    """Return the integral of gain times value, a state, which is omitted if it moves no force and
    filters are not states.

    The integral is unknown if a pilot's command would move it without end.
    """
    # As in JSBSim, <trigger> stops the integral unless it is 0, and a negative one sets it to 0.
    trigger = ca.SX(parameter(component, "trigger", properties, 0.0))
    if properties.loop_in(trigger):  # one that depends on the output itself acts at its limit
        trigger = ca.SX(0.0)
    if is_constant(trigger) and float(trigger) < 0.0:
        return 0.0
    if not properties.has_filter_states:
        # A command that the pilot holds moves the integral without end, unless controls are
        # centered.
        if ca.depends_on(properties.at_start(value), properties.commands):
            error = LoopError(component.where, "the integrator has no steady-state value")
            return properties.unknown(error)
        properties.leave_out(component, "its integral is 0")
    state = properties.add_state(component, value)
    rate = ca.if_else(ca.fabs(trigger) < 1e-6, gain * value, 0.0)
    properties.set_rate(state, lambda: rate)
    return state


_COMPONENTS: dict[str, Callable[[Element, Properties], Any]] = {
    "summer": _summer,
    "pure_gain": _gain,
    "scheduled_gain": _scheduled_gain,
    "aerosurface_scale": _aerosurface_scale,
    "kinematic": _kinematic,
    "deadband": _deadband,
    "actuator": _actuator,
    "fcs_function": _function,
    "switch": _switch,
    "lag_filter": _lag,
    "lead_lag_filter": _lead_lag,
    "washout_filter": _washout,
}
#: Elements that JSBSim regards as components of a channel. It ignores others.
KINDS = (
    *(*_COMPONENTS, "pid", "integrator", "distributor", "linear_actuator", "second_order_filter"),
    *("sensor", "accelerometer", "magnetometer", "gyro", "angle"),
    *("waypoint_heading", "waypoint_distance"),
)


def output_limits(component: Element) -> tuple[float, float]:
    """Return the lowest and highest output of a component that sets a surface.

    The limits are given by <clipto>, <range> or detents. Limits that are unknown or not constant
    are infinite.
    """
    clip = component.find("clipto")
    try:
        if clip is not None:
            low, high = min_and_max(clip)
            return (low, high) if low <= high else (-math.inf, math.inf)
        if component.name == "aerosurface_scale":
            return min_and_max(component.need("range"))
    except ValueError:  # limits that are properties
        return -math.inf, math.inf
    return detents(component) if component.name == "kinematic" else (-math.inf, math.inf)
