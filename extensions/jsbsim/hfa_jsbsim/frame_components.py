"""Dynamic components of the control system, computed once per frame as in JSBSim.

Sources: JSBSim's `FGFilter`, `FGActuator`, `FGSensor`, `FGKinemat` and `FGPID`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from hfa_aircraft.march.march import saturated
from hfa_jsbsim.component_parts import beyond, coefficients, detents, input_of, parameter
from hfa_jsbsim.properties import Properties
from hfa_jsbsim.xml_file import Element


class _Past:
    """Values that a component of the control system stores from one frame to the next."""

    def __init__(self, component: Element, properties: Properties) -> None:
        self._key = f"{component.where} {component.attributes.get('name', '')}"
        self._properties = properties

    def of(self, name: str, compute: Callable[[], Any]) -> ca.SX:
        """Return the symbol of a stored value, as it was at the end of the previous frame."""
        return self._properties.remember(f"{self._key} {name}", compute)

    def unless_first(self, value: Any, begin: Any) -> ca.SX:
        """Return an expression that equals `begin` in the first frame, and `value` afterwards."""
        has_begun = self.of("begun", lambda: ca.SX(1.0))
        return ca.if_else(has_begun > 0.0, value, begin)

    def input_of_filter(self, component: Element) -> ca.SX:
        """Return the input of a filter, or 0 in the first frame, as in JSBSim."""
        return self.unless_first(input_of(component, self._properties), 0.0)


def _tustin(rate: Any, step: float) -> tuple[Any, Any]:
    """Return Tustin's factors (c, d) of a first-order lag, y = c (u + u_last) + d y_last."""
    return step * rate / (2.0 + step * rate), (2.0 - step * rate) / (2.0 + step * rate)


def _lagged(value: Any, rate: Any, past: _Past, step: float, begin: Any = 0.0) -> Any:
    """Return a value after a first-order lag."""
    of_inputs, of_output = _tustin(rate, step)
    last_input = past.unless_first(past.of("lag input", lambda: value), begin)
    last_output = past.unless_first(past.of("lag output", lambda: output), begin)
    output = of_inputs * (value + last_input) + of_output * last_output
    return output


def _lag(component: Element, properties: Properties) -> Any:
    """Return the output of the filter c1 / (s + c1)."""
    rate = parameter(component, "c1", properties, 0.0)
    past = _Past(component, properties)
    return _lagged(past.input_of_filter(component), rate, past, properties.step)


def _washout(component: Element, properties: Properties) -> Any:
    """Return the output of the filter s / (s + c1)."""
    rate = parameter(component, "c1", properties, 0.0)
    past = _Past(component, properties)
    value = past.input_of_filter(component)
    _, of_output = _tustin(rate, properties.step)
    of_inputs = 2.0 / (2.0 + properties.step * rate)
    last_input = past.of("input", lambda: value)
    last_output = past.of("output", lambda: output)
    output = of_inputs * (value - last_input) + of_output * last_output
    return output


def _lead_lag(component: Element, properties: Properties) -> Any:
    """Return the output of the filter (c1 s + c2) / (c3 s + c4)."""
    c1, c2, c3, c4 = coefficients(component, properties, 4)
    step = properties.step
    below = 2.0 * c3 + step * c4
    past = _Past(component, properties)
    value = past.input_of_filter(component)
    last_input = past.of("input", lambda: value)
    last_output = past.of("output", lambda: output)
    output = (
        value * (2.0 * c1 + step * c2) / below
        + last_input * (step * c2 - 2.0 * c1) / below
        + last_output * (2.0 * c3 - step * c4) / below
    )
    return output


def _second_order(component: Element, properties: Properties) -> Any:
    """Return the output of the filter (c1 s² + c2 s + c3) / (c4 s² + c5 s + c6)."""
    c1, c2, c3, c4, c5, c6 = coefficients(component, properties, 6)
    step = properties.step
    below = 4.0 * c4 + 2.0 * c5 * step + c6 * step**2
    past = _Past(component, properties)
    value = past.input_of_filter(component)
    last_input = past.of("input", lambda: value)
    older_input = past.of("older input", lambda: last_input)
    last_output = past.of("output", lambda: output)
    older_output = past.of("older output", lambda: last_output)
    output = (
        value * (4.0 * c1 + 2.0 * c2 * step + c3 * step**2) / below
        + last_input * (2.0 * c3 * step**2 - 8.0 * c1) / below
        + older_input * (4.0 * c1 - 2.0 * c2 * step + c3 * step**2) / below
        - last_output * (2.0 * c6 * step**2 - 8.0 * c4) / below
        - older_output * (4.0 * c4 - 2.0 * c5 * step + c6 * step**2) / below
    )
    return output


def _actuator(component: Element, properties: Properties) -> Any:
    """Return the output of an <actuator>."""
    # It is the input after lag, rate limits, deadband, hysteresis and bias, in this order.
    _refuse_delay(component)
    value = ca.SX(input_of(component, properties))
    past = _Past(component, properties)
    lag = component.find("lag")
    if lag is not None:
        rate = properties.value(lag.text, lag)
        value = _lagged(value, rate, past, properties.step, value)
    value = _slowed(component, value, past, properties)
    width = component.value_of("deadband_width", 0.0)
    if width:
        value = beyond(value, width)
    play = component.value_of("hysteresis_width", 0.0)
    if play:
        wanted = value
        last = past.unless_first(past.of("hysteresis", lambda: moved), wanted)
        down = ca.fmin(last, wanted + 0.5 * play)
        up = ca.fmax(last, wanted - 0.5 * play)
        moved = ca.if_else(wanted > last, up, ca.if_else(wanted < last, down, wanted))
        value = moved
    return value + component.value_of("bias", 0.0)


def _slowed(component: Element, value: ca.SX, past: _Past, properties: Properties) -> ca.SX:
    """Return the input of an actuator within its rate limits."""
    limits: dict[str, Any] = {}
    for child in component.all("rate_limit"):
        limit = properties.value(child.text, child)
        sense = child.attributes.get("sense", "")[:4]
        for direction in [sense] if sense else ["incr", "decr"]:
            limits[direction] = limit
    if not limits:
        return value
    last = past.unless_first(past.of("rate", lambda: moved), value)
    moved = value
    if "incr" in limits:
        most = limits["incr"] * properties.step
        moved = ca.if_else(value - last > most, last + most, moved)
    if "decr" in limits:
        most = limits["decr"] * properties.step
        moved = ca.if_else(value - last < -most, last - most, moved)
    return moved


def _sensor(component: Element, properties: Properties) -> Any:
    """Return the output of a <sensor>: its input after lag, gain and bias."""
    _refuse_delay(component)
    for name in ("quantization", "drift_rate", "noise"):
        child = component.find(name)
        if child is not None:
            raise child.error(f"<{name}> of a sensor is not supported; remove this element")
    value = input_of(component, properties)
    lag = component.value_of("lag", 0.0)
    if lag:
        value = _lagged(value, lag, _Past(component, properties), properties.step)
    return value * (component.value_of("gain", 0.0) or 1.0) + component.value_of("bias", 0.0)


def _refuse_delay(component: Element) -> None:
    """Raise BadInputError for a component with a delay."""
    delay = component.find("delay")
    if delay is not None:
        raise delay.error(
            f"the <delay> of a <{component.name}> is not supported; remove the <delay>"
        )


def _kinematic(component: Element, properties: Properties) -> Any:
    """Return the position of a <kinematic>, which moves between detents in given travel times."""
    detents(component)
    settings = list(component.need("traverse").all("setting"))
    positions = [setting.need("position").number() for setting in settings]
    times = [setting.need("time").number() for setting in settings]
    wanted = ca.SX(input_of(component, properties))
    if component.find("noscale") is None:
        wanted = wanted * positions[-1]
    wanted = saturated(wanted, positions[0], positions[-1])
    last = _Past(component, properties).of("position", lambda: position)
    intervals = [
        (low, high, time)
        for low, high, time in zip(positions, positions[1:], times[1:], strict=False)
    ]
    up = _moved(last, wanted, intervals, properties.step, 1.0)
    down = _moved(last, wanted, intervals[::-1], properties.step, -1.0)
    position = ca.if_else(wanted > last, up, ca.if_else(wanted < last, down, last))
    return position


def _moved(
    last: ca.SX,
    wanted: ca.SX,
    intervals: list[tuple[float, float, float]],
    step: float,
    sign: float,
) -> ca.SX:
    """Return the position after a step toward `wanted`, upward (sign 1) or downward (sign -1)."""
    # intervals (low, high, travel time)
    position = last
    left = ca.SX(step)
    for low, high, time in intervals:
        near, far = (low, high) if sign > 0.0 else (high, low)
        inside = ca.logic_and(sign * (position - near) >= 0.0, sign * (far - position) > 0.0)
        goal = ca.fmin(wanted, far) if sign > 0.0 else ca.fmax(wanted, far)
        if time <= 0.0 or high == low:
            position = ca.if_else(inside, wanted, position)
            continue
        rate = (high - low) / time
        needed = sign * (goal - position) / rate
        moves = ca.logic_and(inside, needed > 0.0)
        reached = ca.if_else(left < needed, position + sign * left * rate, goal)
        left = ca.if_else(moves, ca.fmax(left - needed, 0.0), left)
        position = ca.if_else(moves, reached, position)
    return position


#: Integration method -> weights of the present input, the previous one, and the one before.
_WEIGHTS = {
    "rect": (1.0, 0.0, 0.0),
    "trap": (0.5, 0.5, 0.0),
    "ab2": (1.5, -0.5, 0.0),
    "ab3": (23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0),
}


def _pid(component: Element, properties: Properties) -> Any:
    """Return the output of a <pid> or an <integrator> with the input u."""
    # - <pid>: kp u + ki ∫ u dt + kd u'
    # - <pid> of type "standard": kp (u + ki ∫ u dt + kd u')
    # - <integrator>: the formula of a <pid> with ki = c1
    # u' is <pvdot>, or without it the difference from the previous frame divided by the frame's
    # duration. The integral follows JSBSim's integration rules. It is constant while <trigger> is
    # positive, and is set to 0 by a negative <trigger>.
    value = ca.SX(input_of(component, properties))
    past = _Past(component, properties)
    trigger = ca.SX(parameter(component, "trigger", properties, 0.0))
    reset = trigger < 0.0
    last_input = past.of("input", lambda: value)
    older_input = past.of("older input", lambda: ca.if_else(reset, 0.0, last_input))
    integral: Any = 0.0
    is_pid = component.name == "pid"
    child = component.find("ki") if is_pid else component.need("c1")
    if child is not None:
        default = _WEIGHTS["ab2" if is_pid else "trap"]
        weights = _WEIGHTS.get(child.attributes.get("type", ""), default)
        inputs = (value, last_input, older_input)
        mean = sum(weight * each for weight, each in zip(weights, inputs, strict=True))
        last_integral = past.of("integral", lambda: integral)
        gain = properties.value(child.text, child)
        added = ca.if_else(ca.fabs(trigger) < 1e-6, gain * properties.step * mean, 0.0)
        integral = ca.if_else(reset, 0.0, last_integral) + added
    slope = (value - last_input) / properties.step
    if component.find("pvdot") is not None:
        slope = parameter(component, "pvdot", properties, 0.0)
    proportional = parameter(component, "kp", properties, 0.0)
    damping = parameter(component, "kd", properties, 0.0)
    if component.attributes.get("type") == "standard":
        return proportional * (value + integral + damping * slope)
    return proportional * value + integral + damping * slope


WITH_MEMORY: dict[str, Callable[[Element, Properties], Any]] = {
    "lag_filter": _lag,
    "washout_filter": _washout,
    "lead_lag_filter": _lead_lag,
    "second_order_filter": _second_order,
    "actuator": _actuator,
    "sensor": _sensor,
    "kinematic": _kinematic,
    "pid": _pid,
    "integrator": _pid,
}
