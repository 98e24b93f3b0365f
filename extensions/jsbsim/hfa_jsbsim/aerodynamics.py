"""Forces and moments of the air: <aerodynamics> (`FGAerodynamics`)."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from hfa_jsbsim.air import Motion
from hfa_jsbsim.airframe import Metrics
from hfa_jsbsim.functions import function_value
from hfa_jsbsim.properties import Properties, Writer
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened

_AXES = ("DRAG", "SIDE", "LIFT", "ROLL", "PITCH", "YAW")


class Aerodynamics:
    """Functions along the axes of wind (DRAG, SIDE, LIFT) and body (ROLL, PITCH, YAW)."""

    def __init__(
        self,
        element: Element | None,
        properties: Properties,
        wings: Metrics,
        motion: Motion,
        body: Any,
    ) -> None:
        """Read the functions, and set the properties that follow from them.

        element: <aerodynamics>; None of an aircraft without it
        properties: of the aircraft
        wings: area, span and chord
        motion: through the air
        body: has `mass` and `reference_point(where)`
        """
        self.element = element
        self._properties = properties
        self._wings = wings
        self._body = body
        self._motion = motion
        self.hysteresis = ""
        self._functions = _functions_along_axes(element)
        self._define_stall()
        where = element.where if element else ""
        computed = {
            "aero/cl-squared": self._lift_squared,
            "forces/load-factor": lambda: self._sum("LIFT") / body.mass.weight,
        }
        for name, compute in computed.items():
            properties.compute(name, Writer(compute, where))

    def _define_stall(self) -> None:
        """Let the limits of alpha, the warning of a stall and the stall set their properties."""
        ends = {"min": 0.0, "max": 0.0}
        limits = self._limits("alphalimits")
        if limits is not None:
            ends = limits
        for name, value in ends.items():
            self._properties.define_initial(f"aero/alpha-{name}-rad", value)
        alpha = self._motion.alpha
        warning: Any = 0.0
        if ends["max"]:
            share = alpha / ends["max"] - 0.85
            warning = ca.if_else(alpha > 0.85 * ends["max"], 10.0 * share, 0.0)
        self._properties.define("systems/stall-warn-norm", warning)
        stall: Any = 0.0
        band = self._limits("hysteresis_limits")
        if band is not None and band["min"] and band["max"]:
            stall = ca.if_else(alpha > band["max"], 1.0, 0.0)
            low, high = (math.degrees(band[name]) for name in ("min", "max"))
            where = self.element.need("hysteresis_limits").where if self.element else ""
            self.hysteresis = (
                f"{where}: no hysteresis of the stall; between alpha {low:g} and {high:g} deg the"
                " flow is attached"
            )
        self._properties.define("aero/stall-hyst-norm", stall)

    def _limits(self, kind: str) -> dict[str, float] | None:
        """min and max of an element, rad; None without it."""
        element = self.element.find(kind) if self.element else None
        if element is None:
            return None
        unit = element.attributes.get("unit", "") or "RAD"
        factor = 1.0 if unit == "RAD" else element.factor(unit, "RAD")
        return {name: element.need(name).number() * factor for name in ("min", "max")}

    def _sum(self, axis: str) -> Any:
        """The sum of the functions along an axis."""
        total = ca.SX(0.0)
        for function in self._functions.get(axis, ()):
            total = total + function_value(function, self._properties)
        return total

    def _lift_squared(self) -> Any:
        """(LIFT / (q S))^2."""
        return (self._sum("LIFT") / (self._motion.pressure_head * self._wings.area)) ** 2

    def loads(self) -> tuple[ca.SX, ca.SX]:
        """Force, lb, and moment about the center of gravity, ft lb, in body axes."""
        drag, side, lift, *moments = (self._sum(axis) for axis in _AXES)
        force = ca.mtimes(self._motion.wind_to_body, ca.vertcat(-drag, side, -lift))
        where = self.element.where if self.element else ""
        arm = self._body.mass.arm(self._body.reference_point(where))
        shift = None if self.element is None else self.element.find("aero_ref_pt_shift_x")
        if shift is not None:
            back = function_value(shift.need("function"), self._properties) * self._wings.chord
            arm = arm - ca.vertcat(back, 0.0, 0.0)
        return force, ca.vertcat(*moments) + ca.cross(arm, force)


def _functions_along_axes(element: Element | None) -> dict[str, list[Element]]:
    """The functions of each <axis>, by its name; a second axis of one name replaces the first,
    which is then left out. BadInputError for an axis or a function that is not read."""
    functions: dict[str, list[Element]] = {}
    if element is None:
        return functions
    axes: dict[str, Element] = {}
    for axis in element.all("axis"):
        name = axis.attributes.get("name", "")
        if name not in _AXES or "frame" in axis.attributes:
            fault = f"the axis {shortened(name)} is not read"
            raise axis.error(f"{fault}; use {', '.join(_AXES)} without a frame")
        functions[name] = list(axis.all("function"))
        for function in functions[name]:
            if function.attributes.get("apply_at_cg") == "true":
                raise function.error("apply_at_cg is not read; leave it out")
        if name in axes:
            axes[name].taken = False
        axes[name] = axis
    return functions
