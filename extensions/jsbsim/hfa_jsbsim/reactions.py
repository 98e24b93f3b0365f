"""External forces and moments in <external_reactions> (`FGExternalForce`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from hfa_jsbsim.air import Motion
from hfa_jsbsim.airframe import Loads
from hfa_jsbsim.functions import function_value
from hfa_jsbsim.notes import Note
from hfa_jsbsim.properties import LoopError, Properties, is_zero
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened


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
        """Set the initial values of three properties to the components of a vector (3,).

        Without a vector, a property that has no value is set to 0.
        """
        values = np.zeros(3) if vector is None else vector
        for name, value in zip(names, values, strict=True):
            self._initial[name] = value
            if vector is not None or not self._properties.is_known(name):
                self._properties.define_initial(name, value)

    def _define(self, element: Element, axes: str) -> None:
        """Define the properties for the magnitude and direction of a force or moment."""
        element.attributes.get("frame")  # is read, though it acts only if the magnitude is not 0
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
        self._properties.names_read.update(names)
        magnitude = self._magnitude(element)
        if is_zero(magnitude):
            return ca.SX.zeros(3)
        direction = self._read(names, element)
        return ca.mtimes(_to_body(element, motion), direction) * magnitude

    def _magnitude(self, element: Element) -> Any:
        """Return the magnitude of a force, lb, or moment, ft lb, from its function or property."""
        function = element.find("function")
        name = f"{_prefix(element)}/{_magnitude_name(element)}"
        if function is None:
            return self._properties.read_or(name, 0.0, element.where)
        try:
            return function_value(function, self._properties)
        except LoopError as error:
            statement = f"this external {element.name} is omitted"
            name = shortened(element.attributes.get("name", ""))
            note = Note(statement, f"{name} ({error.cause})", element.where)
            self._properties.notes.append(note)
            return 0.0

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
    """Return the rotation matrix (3, 3) from the frame of a force to body axes.

    Raises BadInputError for the frame INERTIAL.
    """
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
