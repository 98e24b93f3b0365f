"""Sizes of the wing, mass, center of gravity and inertia (`FGAircraft`, `FGMassBalance`,
`FGTank`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened

#: Standard gravity in ft/s^2: pounds in a slug.
SLUG_TO_LB = 32.174049


@dataclass(frozen=True)
class Metrics:
    """Sizes, ft and sq ft, and points in inches of the structural frame (x aft, y right, z up)."""

    area: float
    span: float
    chord: float
    incidence: float
    tail_area: float
    tail_arm: float
    fin_area: float
    fin_arm: float
    reference_point: np.ndarray
    eye_point: np.ndarray


def read_metrics(element: Element) -> Metrics:
    """Metrics of an aircraft."""
    points = {
        child.attributes.get("name", ""): child.vector("IN") for child in element.all("location")
    }
    nowhere = np.zeros(3)
    return Metrics(
        area=element.need("wingarea").number("FT2"),
        span=element.need("wingspan").number("FT"),
        chord=element.value_of("chord", 0.0, "FT"),
        incidence=element.value_of("wing_incidence", 0.0, "RAD"),
        tail_area=element.value_of("htailarea", 0.0, "FT2"),
        tail_arm=element.value_of("htailarm", 0.0, "FT"),
        fin_area=element.value_of("vtailarea", 0.0, "FT2"),
        fin_arm=element.value_of("vtailarm", 0.0, "FT"),
        reference_point=points.get("AERORP", nowhere),
        eye_point=points.get("EYEPOINT", nowhere),
    )


@dataclass(frozen=True)
class Body:
    """A part of the aircraft: weight in lb, place in inches, inertia about itself in slug ft^2."""

    weight: float
    location: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Tank:
    """A tank with its contents, lb.

    kind: FUEL or OXIDIZER.
    usable: whether it holds more than what cannot be used.
    """

    kind: str
    contents: float
    capacity: float
    density: float
    usable: bool
    body: Body


@dataclass(frozen=True)
class Mass:
    """weight: lb. center: of gravity, inches. inertia: (3, 3) in slug ft^2, in body axes."""

    weight: float
    empty_weight: float
    center: np.ndarray
    inertia: np.ndarray

    @property
    def slugs(self) -> float:
        """The mass."""
        return self.weight / SLUG_TO_LB

    def arm(self, location: np.ndarray) -> np.ndarray:
        """From the center of gravity to a place, ft, in body axes (x forward, z down)."""
        return structural_to_body(location - self.center)


def structural_to_body(offset: np.ndarray) -> np.ndarray:
    """Inches in the structural frame as ft in body axes."""
    return np.array([-offset[0], offset[1], -offset[2]]) / 12.0


def read_tanks(propulsion: Element | None) -> list[Tank]:
    """The tanks of an aircraft; a grain has no inertia of its own here."""
    return [] if propulsion is None else [_tank(element) for element in propulsion.all("tank")]


def _tank(element: Element) -> Tank:
    contents = element.value_of("contents", 0.0, "LBS")
    capacity = element.value_of("capacity", 0.00001, "LBS")
    fuel = element.find("type")
    density = element.value_of("density", 6.6, "LBS/GAL")
    if fuel is not None:
        density = _FUELS.get(fuel.text, 6.6)
    unusable = element.value_of("unusable-volume", 0.0) * density
    radius = element.value_of("radius", 0.0, "IN") / 12.0
    factor = element.value_of("inertia_factor", 1.0)
    inertia = contents / SLUG_TO_LB * factor * 0.4 * radius**2
    full = element.find("location")
    location = np.zeros(3) if full is None else full.vector("IN")
    drain = element.find("drain_location")
    if drain is not None and capacity > 0.0:
        lowest = drain.vector("IN")
        location = lowest + contents / capacity * (location - lowest)
    return Tank(
        element.attributes.get("type", ""),
        contents,
        capacity,
        density,
        contents > unusable,
        Body(contents, location, inertia * np.eye(3)),
    )


#: Name of a fuel -> lb a gallon.
_FUELS = {
    **{"AVGAS": 6.02, "JET-A": 6.74, "JET-A1": 6.74, "JET-B": 6.48, "JP-1": 6.76, "JP-2": 6.38},
    **{"JP-3": 6.34, "JP-4": 6.48, "JP-5": 6.81, "JP-6": 6.55, "JP-7": 6.61, "JP-8": 6.66},
    **{"JP-8+100": 6.66, "RP-1": 6.73, "T-1": 6.88, "ETHANOL": 6.58, "HYDRAZINE": 8.61},
    **{"F-34": 6.66, "F-35": 6.74, "F-40": 6.48, "F-44": 6.81, "AVTAG": 6.48, "AVCAT": 6.81},
}


def read_mass(element: Element, tanks: Sequence[Tank]) -> Mass:
    """Mass of the empty aircraft, its point masses and the contents of its tanks."""
    places = {child.attributes.get("name"): child.vector("IN") for child in element.all("location")}
    empty_weight = element.value_of("emptywt", 0.0, "LBS")
    bodies = [Body(empty_weight, places.get("CG", np.zeros(3)), _inertia(element))]
    bodies += [_point_mass(child) for child in element.all("pointmass")]
    bodies += [tank.body for tank in tanks]
    weight = sum(body.weight for body in bodies)
    if weight <= 0.0:
        raise element.error(f"the aircraft weighs {weight:g} lb; give its weight")
    moments = [body.weight * body.location for body in bodies]
    center = np.sum(moments, axis=0) / weight
    inertia = np.zeros((3, 3))
    for body in bodies:
        arm = structural_to_body(body.location - center)
        parallel = np.dot(arm, arm) * np.eye(3) - np.outer(arm, arm)
        inertia += body.inertia + body.weight / SLUG_TO_LB * parallel
    if np.linalg.eigvalsh(inertia)[0] <= 0.0:
        raise element.error("the moments of inertia are not positive; correct them")
    return Mass(weight, empty_weight, center, inertia)


def _inertia(element: Element) -> np.ndarray:
    """The matrix of ixx ... iyz; products change sign unless negated_crossproduct_inertia is
    "false"."""
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    xx, yy, zz, xy, xz, yz = (element.value_of(name, 0.0, "SLUG*FT2") for name in names)
    sign = -1.0 if element.attributes.get("negated_crossproduct_inertia") != "false" else 1.0
    return np.array(
        [
            [xx, sign * xy, -sign * xz],
            [sign * xy, yy, sign * yz],
            [-sign * xz, sign * yz, zz],
        ]
    )


def _point_mass(element: Element) -> Body:
    """A point mass, with the inertia of its form if it has one."""
    weight = element.need("weight").number("LBS")
    location = element.need("location").vector("IN")
    form = element.find("form")
    if form is None:
        return Body(weight, location, _inertia(element))
    radius = form.value_of("radius", 0.0, "FT")
    length = form.value_of("length", 0.0, "FT")
    slender = length**2 / 12.0
    shape = form.attributes.get("shape", "")
    shapes = {
        "tube": (radius**2, radius**2 / 2.0 + slender),
        "cylinder": (radius**2 / 2.0, radius**2 / 4.0 + slender),
        "sphere": (radius**2 * 2.0 / 3.0, radius**2 * 2.0 / 3.0),
        "ball": (radius**2 * 0.4, radius**2 * 0.4),
    }
    if shape not in shapes:
        raise form.error(f"{shortened(shape)!r} is no form; use {', '.join(shapes)}")
    along, across = shapes[shape]
    mass = weight / SLUG_TO_LB
    return Body(weight, location, mass * np.diag([along, across, across]))


def rotation(roll: Any, pitch: Any, yaw: Any) -> ca.SX:
    """Body axes from those of a thruster that is turned by these angles, rad (`FGForce`)."""
    cos_roll = ca.cos(roll)
    sin_roll = ca.sin(roll)
    cos_pitch = ca.cos(pitch)
    sin_pitch = ca.sin(pitch)
    cos_yaw = ca.cos(yaw)
    sin_yaw = ca.sin(yaw)
    first = ca.vertcat(cos_pitch * cos_yaw, cos_pitch * sin_yaw, -sin_pitch)
    second = ca.vertcat(
        sin_roll * sin_pitch * cos_yaw - cos_roll * sin_yaw,
        sin_roll * sin_pitch * sin_yaw + cos_roll * cos_yaw,
        sin_roll * cos_pitch,
    )
    third = ca.vertcat(
        cos_roll * cos_yaw * sin_pitch + sin_roll * sin_yaw,
        cos_roll * sin_yaw * sin_pitch - sin_roll * cos_yaw,
        cos_roll * cos_pitch,
    )
    return ca.SX(ca.horzcat(first, second, third))
