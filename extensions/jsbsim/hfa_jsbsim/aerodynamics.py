"""Forces and moments of the air: <aerodynamics> (`FGAerodynamics`)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from hfa_jsbsim.air import Motion
from hfa_jsbsim.airframe import Mass, Metrics
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
        mass: Mass,
        motion: Motion,
    ) -> None:
        self.element = element
        self._properties = properties
        self._wings = wings
        self._mass = mass
        self._motion = motion
        self._functions: dict[str, list[Element]] = {name: [] for name in _AXES}
        for axis in element.all("axis") if element is not None else ():
            name = axis.attributes.get("name", "")
            if name not in _AXES or "frame" in axis.attributes:
                fault = f"the axis {shortened(name)} is not read"
                raise axis.error(f"{fault}; use {', '.join(_AXES)} without a frame")
            functions = list(axis.all("function"))
            for function in functions:
                if function.attributes.get("apply_at_cg") == "true":
                    raise function.error("apply_at_cg is not read; leave it out")
            self._functions[name] = functions  # a second axis of one name replaces the first
        where = element.where if element else ""
        computed = {
            "aero/cl-squared": self._lift_squared,
            "forces/fwx-aero-lbs": lambda: self._sum("DRAG"),
            "forces/fwy-aero-lbs": lambda: self._sum("SIDE"),
            "forces/fwz-aero-lbs": lambda: self._sum("LIFT"),
            "forces/load-factor": lambda: self._sum("LIFT") / mass.weight,
        }
        for name, compute in computed.items():
            properties.compute(name, Writer(compute, where))

    def _sum(self, axis: str) -> Any:
        """The sum of the functions along an axis."""
        values = (function_value(function, self._properties) for function in self._functions[axis])
        return sum(values, start=ca.SX(0.0))

    def _lift_squared(self) -> Any:
        """(LIFT / (q S))^2."""
        return (self._sum("LIFT") / (self._motion.pressure_head * self._wings.area)) ** 2

    def loads(self) -> tuple[ca.SX, ca.SX]:
        """Force, lb, and moment about the center of gravity, ft lb, in body axes."""
        drag, side, lift, *moments = (self._sum(axis) for axis in _AXES)
        force = ca.mtimes(self._motion.wind_to_body, ca.vertcat(-drag, side, -lift))
        arm = ca.SX(ca.DM(self._mass.arm(self._wings.reference_point)))
        shift = None if self.element is None else self.element.find("aero_ref_pt_shift_x")
        if shift is not None:
            back = function_value(shift.need("function"), self._properties) * self._wings.chord
            arm = arm - ca.vertcat(back, 0.0, 0.0)
        return force, ca.vertcat(*moments) + ca.cross(arm, force)
