"""Aerodynamic forces and moments from <aerodynamics> (`FGAerodynamics`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.aircraft import wind_axes
from hfa_jsbsim.air import Motion
from hfa_jsbsim.airframe import Loads, Metrics
from hfa_jsbsim.functions import function_value
from hfa_jsbsim.properties import Note, Properties, Writer, is_zero
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened

#: Axis -> component of force (0 to 2) or moment (3 to 5).
_COMPONENTS = {
    **{"DRAG": 0, "AXIAL": 0, "X": 0, "SIDE": 1, "Y": 1, "LIFT": 2, "NORMAL": 2, "Z": 2},
    **{"ROLL": 3, "PITCH": 4, "YAW": 5},
}
#: Force axes whose name determines the frame.
_FRAMES = {"DRAG": "WIND", "LIFT": "WIND", "AXIAL": "AXIAL", "NORMAL": "AXIAL"}


class Aerodynamics:
    """Aerodynamic forces and moments, as sums of the functions in each <axis>.

    Force axes are DRAG, SIDE, LIFT, or AXIAL, SIDE, NORMAL, or X, Y, Z. Moment axes are ROLL, PITCH
    and YAW. `_frames` determines the frames.
    """

    def __init__(
        self,
        element: Element | None,
        properties: Properties,
        wings: Metrics,
        motion: Motion,
        body: Any,
    ) -> None:
        """Read the functions, and define the properties of lift, load factor and stall.

        element: <aerodynamics>, or None if the aircraft has none
        properties: properties of the aircraft
        wings: area, span and chord
        motion: motion relative to the air
        body: object with `mass` and `reference_point(where)`
        """
        self.element = element
        self._properties = properties
        self._wings = wings
        self._body = body
        self._motion = motion
        self.hysteresis: Note | None = None
        self._functions = _functions_along_axes(element)
        self._force_frame, self._moment_frame = _frames(element)
        self._define_stall()
        where = element.where if element else ""
        computed = {  # when they are first read
            "aero/cl-squared": lambda: (self._lift() / (motion.pressure_head * wings.area)) ** 2,
            "forces/load-factor": lambda: self._lift() / body.mass.weight,
        }
        for name, compute in computed.items():
            properties.add_writer(name, Writer(compute, where))

    def _define_stall(self) -> None:
        """Define the properties of the limits of alpha, of the stall warning and of the stall."""
        ends = {"min": 0.0, "max": 0.0}
        limits = self._limits("alphalimits")
        if limits is not None:
            ends = limits
        for name, value in ends.items():
            self._properties.define_initial(f"aero/alpha-{name}-rad", value)
        alpha = self._motion.alpha
        warning: Any = 0.0
        if ends["max"]:  # JSBSim warns from 85 % of the largest alpha on
            level = 10.0 * (alpha / ends["max"] - 0.85)
            warning = ca.if_else(alpha > 0.85 * ends["max"], level, 0.0)
        self._properties.define("systems/stall-warn-norm", warning)
        stall: Any = 0.0
        # The flow separates above the highest alpha of the band, and attaches below the lowest.
        band = self._limits("hysteresis_limits")
        if band is not None and band["min"] and band["max"]:
            stall = ca.if_else(alpha > band["max"], 1.0, 0.0)
            low, high = (math.degrees(band[name]) for name in ("min", "max"))
            where = self.element.need("hysteresis_limits").where if self.element else ""
            span = f"between alpha {low:g} and {high:g} deg the flow is attached"
            self.hysteresis = Note("the hysteresis of the stall is omitted", span, where)
        self._properties.define("aero/stall-hyst-norm", stall)

    def _limits(self, kind: str) -> dict[str, float] | None:
        """Return the limits "min" and "max" in a child of <aerodynamics>, rad, or None."""
        element = self.element.find(kind) if self.element else None
        if element is None:
            return None
        unit = element.attributes.get("unit", "") or "RAD"
        factor = 1.0 if unit == "RAD" else element.factor(unit, "RAD")
        return {name: element.need(name).number() * factor for name in ("min", "max")}

    def _sum(self, component: int, at_center: bool) -> ca.SX:
        """Return one component of the aerodynamic force or moment, as the sum of its functions.

        component: 0 to 2 of the force, 3 to 5 of the moment
        at_center: whether those that act at the center of gravity are summed, or the others
        """
        total = ca.SX(0.0)
        for function in self._functions.get(component, ()):
            if _acts_at_center(function) == at_center:
                total = total + function_value(function, self._properties)
        return total

    def _to_body(self, frame: str) -> ca.SX:
        """Return the rotation matrix (3, 3) from a frame to body axes."""
        if frame == "WIND":
            return self._motion.wind_to_body
        if frame == "STABILITY":
            return wind_axes(self._motion.alpha, 0.0)
        return ca.SX.eye(3)

    def _force(self, at_center: bool) -> ca.SX:
        """Return the sum of the forces at the center of gravity, or of all others, body axes."""
        # Except in the frame BODY, the first component is positive aft and the third up.
        sums = ca.vertcat(*(self._sum(component, at_center) for component in range(3)))
        if self._force_frame != "BODY":
            sums = ca.vertcat(-sums[0], sums[1], -sums[2])
        return ca.mtimes(self._to_body(self._force_frame), sums)

    def _lift(self) -> Any:
        """Return the lift, lb: the upward force normal to the airflow."""
        if self._force_frame == "WIND":  # the third sum is the lift
            return self._sum(2, at_center=False) + self._sum(2, at_center=True)
        force = self._force(at_center=False) + self._force(at_center=True)
        return -ca.dot(self._motion.wind_to_body[:, 2], force)  # the third wind axis is down

    def loads(self) -> Loads:
        """Return the aerodynamic force, and the moment about the center of gravity."""
        force = self._force(at_center=False)
        sums = ca.vertcat(*(self._sum(component, at_center=False) for component in range(3, 6)))
        moment = ca.mtimes(self._to_body(self._moment_frame), sums)
        where = self.element.where if self.element else ""
        arm = self._body.mass.arm(self._body.reference_point(where))
        shift = None if self.element is None else self.element.find("aero_ref_pt_shift_x")
        if shift is not None:
            # The function gives the shift aft, in chords.
            aft = function_value(shift.need("function"), self._properties) * self._wings.chord
            arm = arm - ca.vertcat(aft, 0.0, 0.0)
        # Forces at the center of gravity have no moment about it.
        return Loads(force + self._force(at_center=True), moment + ca.cross(arm, force))


def _acts_at_center(function: Element) -> bool:
    """Return whether a function acts at the center of gravity instead of the reference point."""
    return bool(function.attributes.get("apply_at_cg") == "true")


def _frames(element: Element | None) -> tuple[str, str]:
    """Return the frame of the forces and the frame of the moments."""
    # The first force axis that defines a frame determines the frame of the forces, by default WIND:
    # - DRAG, LIFT: WIND
    # - AXIAL, NORMAL: AXIAL
    # - X, Y, Z: attribute `frame`, by default BODY
    # - SIDE: no frame
    # The attribute `frame` of the first moment axis determines the frame of the moments, by default
    # BODY.
    chosen = {"force": "", "moment": ""}
    for axis in element.children if element else ():
        if axis.name != "axis":
            continue
        name = axis.attributes.get("name", "")
        frame = axis.attributes.get("frame") or "BODY"
        if name in _FRAMES or name == "SIDE":
            frame = _FRAMES.get(name, "")
        elif frame not in ("BODY", "STABILITY", "WIND"):
            raise axis.error(
                f"the frame {shortened(frame)} of <axis> is unknown; use BODY, STABILITY or WIND"
            )
        kind = "moment" if _COMPONENTS[name] > 2 else "force"
        chosen[kind] = chosen[kind] or frame
    return chosen["force"] or "WIND", chosen["moment"] or "BODY"


def _functions_along_axes(element: Element | None) -> dict[int, list[Element]]:
    """Return index of a component (forces 0 to 2, moments 3 to 5) -> its functions."""
    # JSBSim ignores all but the last axis of a component, and moments with apply_at_cg.
    functions: dict[int, list[Element]] = {}
    if element is None:
        return functions
    for axis in element.all("axis"):
        name = axis.attributes.get("name", "")
        if name not in _COMPONENTS:
            raise axis.error(
                f"the name {shortened(name)} of <axis> is unknown; use {', '.join(_COMPONENTS)}"
            )
        component = _COMPONENTS[name]
        functions[component] = list(axis.all("function"))
    return functions


class Reactions:
    """External forces and moments of an aircraft."""

    def __init__(self, section: Element | None, properties: Properties) -> None:
        self._properties = properties
        self._initial: dict[str, float] = {}
        self._forces = list(section.all("force")) if section is not None else []
        self._moments = list(section.all("moment")) if section is not None else []
        for force in self._forces:
            self._define(force, "xyz")
            names = [f"{_prefix(force)}/location-{axis}-in" for axis in "xyz"]
            place = force.find("location")
            self._set_initial(names, None if place is None else place.vector("IN"))
        for moment in self._moments:
            self._define(moment, "lmn")

    def _set_initial(self, names: list[str], vector: np.ndarray | None) -> None:
        """Set the initial values of three properties to the components of a vector (3,)."""
        # Without a vector in the file, they are 0, unless something else has set a value.
        values = np.zeros(3) if vector is None else vector
        for name, value in zip(names, values, strict=True):
            self._initial[name] = value
            if vector is not None or not self._properties.is_known(name):
                self._properties.define_initial(name, value)

    def _define(self, element: Element, axes: str) -> None:
        """Define the properties for the magnitude and direction of a force or moment.

        axes: letters of the components, "xyz" or "lmn"
        """
        magnitude = f"{_prefix(element)}/{_magnitude_name(element)}"
        if not self._properties.is_known(magnitude):
            self._properties.define_initial(magnitude, 0.0)
        self._set_initial([f"{_prefix(element)}/{axis}" for axis in axes], _direction(element))

    def loads(self, motion: Motion, arm: Callable[[Any], Any]) -> Loads:
        """Return the total of the external forces and moments.

        arm: function (location, inches) -> vector from the center of gravity, body axes, ft
        """
        total = ca.SX.zeros(3)
        moment = ca.SX.zeros(3)
        for element in self._forces:
            force = self._force_or_moment(element, "xyz", motion)
            names = [f"{_prefix(element)}/location-{axis}-in" for axis in "xyz"]
            total += force
            moment += ca.cross(arm(self._read(names, element)), force)
        for element in self._moments:
            moment += self._force_or_moment(element, "lmn", motion)
        return Loads(total, moment)

    def _force_or_moment(self, element: Element, axes: str, motion: Motion) -> ca.SX:
        """Return an external force, lb, or moment, ft lb, in body axes, (3,)."""
        names = [f"{_prefix(element)}/{axis}" for axis in axes]
        self._properties.names_read.update(names)  # a file may set them, also with a magnitude of 0
        magnitude = self._magnitude(element)
        if is_zero(magnitude):
            return ca.SX.zeros(3)
        direction = self._read(names, element)
        return ca.mtimes(_to_body(element, motion), direction) * magnitude

    def _magnitude(self, element: Element) -> Any:
        """Return the magnitude of a force, lb, or moment, ft lb, from its function or property."""
        function = element.find("function")
        if function is not None:
            return function_value(function, self._properties)
        name = f"{_prefix(element)}/{_magnitude_name(element)}"
        return self._properties.read_or(name, 0.0, element.where)

    def _read(self, names: list[str], element: Element) -> ca.SX:
        """Return the values of properties as a column, by default their initial values."""
        values = []
        for name in names:
            own_value = self._initial[name]
            values.append(ca.SX(self._properties.read_or(name, own_value, element.where)))
        return ca.vertcat(*values)


def _prefix(element: Element) -> str:
    """Return the folder of the properties of an external force or moment."""
    return f"external_reactions/{element.attributes.get('name', '')}"


def _magnitude_name(element: Element) -> str:
    """Return the last part of the name of the property for the magnitude of a force or moment."""
    return "magnitude" if element.name == "force" else "magnitude-lbsft"


def _direction(element: Element) -> np.ndarray | None:
    """Return <direction> as a unit vector (3,), or None without <direction>."""
    child = element.find("direction")
    if child is None:
        return None
    vector = child.vector("IN")
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector


def _to_body(element: Element, motion: Motion) -> ca.SX:
    """Return the rotation matrix (3, 3) from the frame of a force to body axes."""
    frame = element.attributes.get("frame", "BODY")
    if frame == "LOCAL":
        return motion.to_body
    if frame == "WIND":
        return motion.wind_to_body
    if frame == "INERTIAL":
        raise element.error(
            f"the frame {shortened(frame)} is not supported; use BODY, LOCAL or WIND"
        )
    return ca.SX.eye(3)  # JSBSim interprets any other frame as body axes
