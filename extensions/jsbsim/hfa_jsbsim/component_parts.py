"""Inputs, parameters and limits that components of the control system have in common."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from hfa_jsbsim.properties import Properties, is_constant
from hfa_jsbsim.xml_file import Element, number_of
from hfa_support.errors import shortened


def parameter(element: Element, name: str, properties: Properties, default: float) -> Any:
    """Return the value of a child of a component, given as a number or as the name of a property.

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


def inputs_of(component: Element, properties: Properties) -> list[Any]:
    """Return the values of all inputs of a component."""
    return [_input(child, properties) for child in component.all("input")]


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


def travels(component: Element) -> bool:
    """Return whether at least one <setting> of a <kinematic> has a travel time greater than 0."""
    settings = component.need("traverse").all("setting")
    return any(setting.need("time").number() > 0.0 for setting in settings)


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
