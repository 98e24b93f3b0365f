"""Geometry, mass, center of gravity and inertia (`FGAircraft`, `FGMassBalance`, `FGTank`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened

#: Pounds per slug, which is standard gravity in ft/s².
SLUG_TO_LB = 32.174049


@dataclass(frozen=True)
class Metrics:
    """Geometry of the aircraft: lengths in ft, areas in ft², incidence of the wing in rad.

    Points are in inches in the structural frame (x aft, y right, z up).
    """

    area: float
    span: float
    chord: float
    incidence: float
    tail_area: float
    tail_arm: float
    fin_area: float
    fin_arm: float
    reference_point: np.ndarray


def read_metrics(element: Element) -> Metrics:
    """Return the geometry given by a <metrics> element."""
    points = {
        child.attributes.get("name", ""): child.vector("IN") for child in element.all("location")
    }
    return Metrics(
        area=element.need("wingarea").number("FT2"),
        span=element.need("wingspan").number("FT"),
        chord=element.value_of("chord", 0.0, "FT"),
        incidence=element.value_of("wing_incidence", 0.0, "RAD"),
        tail_area=element.value_of("htailarea", 0.0, "FT2"),
        tail_arm=element.value_of("htailarm", 0.0, "FT"),
        fin_area=element.value_of("vtailarea", 0.0, "FT2"),
        fin_arm=element.value_of("vtailarm", 0.0, "FT"),
        reference_point=points.get("AERORP", np.zeros(3)),
    )


@dataclass(frozen=True)
class Body:
    """Part of the aircraft, with numbers or expressions.

    weight: lb.
    location: structural frame, inches.
    inertia: matrix about the center of gravity of this part, slug ft².
    """

    weight: Any
    location: Any
    inertia: Any


@dataclass(frozen=True)
class Tank:
    """Tank for fuel or oxidizer, as described in the files.

    kind: "FUEL" or "OXIDIZER".
    contents: contents in the file, lb.
    capacity: lb.
    density: lb/gal.
    unusable: contents that cannot be used, lb.
    priority: 0 if the tank is closed. Engines use the tank with the lowest positive number first.
    full, drain: center of the contents of a full tank and of an empty one, structural frame,
        inches.
    radius: of the contents, ft.
    inertia_factor: on their inertia.
    """

    element: Element
    kind: str
    contents: float
    capacity: float
    density: float
    unusable: float
    priority: int
    full: np.ndarray
    drain: np.ndarray
    radius: float
    inertia_factor: float

    @property
    def usable(self) -> bool:
        """True if the contents in the file exceed the unusable part."""
        return self.contents > self.unusable

    def body(self, contents: Any) -> Body:
        """Return given contents, lb, as a part of the aircraft (`FGTank::CalculateInertias`).

        The inertia is that of a solid sphere, 2/5 m r², times a factor of the file.
        """
        filled = contents / self.capacity
        center = [
            low + filled * (high - low) for low, high in zip(self.drain, self.full, strict=True)
        ]
        moment = contents / SLUG_TO_LB * self.inertia_factor * 0.4 * self.radius**2
        return Body(contents, center, ca.diag(ca.vertcat(moment, moment, moment)))


@dataclass(frozen=True)
class PointMass:
    """Point mass of the aircraft, such as a pilot or a payload.

    weight: lb.
    location: structural frame, inches.
    inertia: matrix about the center of the point mass, slug ft².
    has_form: whether the inertia is proportional to the weight. Otherwise the inertia is constant.
    """

    weight: float
    location: np.ndarray
    inertia: np.ndarray
    has_form: bool

    def inertia_at(self, weight: Any) -> Any:
        """Return the inertia about the point mass's center for another weight, slug ft², (3, 3).

        weight: lb
        """
        if not self.has_form or self.weight == 0.0:
            return ca.SX(ca.DM(self.inertia))
        return ca.SX(ca.DM(self.inertia / self.weight)) * weight


@dataclass(frozen=True)
class Mass:
    """Mass of the aircraft, with numbers or expressions.

    weight: lb
    center: center of gravity, structural frame, inches, (3,)
    inertia: about the center of gravity, body axes, slug ft², (3, 3)
    """

    weight: Any
    center: Any
    inertia: Any

    @property
    def slugs(self) -> Any:
        """Mass of the aircraft, slug."""
        return self.weight / SLUG_TO_LB

    def arm(self, location: Any) -> Any:
        """Return the vector from the center of gravity to a point, body axes, ft.

        location: structural frame, inches
        """
        return structural_to_body(location - self.center)


class Loads(NamedTuple):
    """Force, lb, and moment about the center of gravity, ft lb, in body axes, (3,) each."""

    force: ca.SX
    moment: ca.SX


def structural_to_body(offset: Any) -> Any:
    """Convert a vector from inches in the structural frame to feet in body axes."""
    # The structural frame has x aft, y to the right and z up.
    return ca.vertcat(-offset[0], offset[1], -offset[2]) / 12.0


def read_tanks(propulsion: Element | None) -> list[Tank]:
    """Return the tanks in <propulsion>."""
    return [] if propulsion is None else [_tank(element) for element in propulsion.all("tank")]


def _tank(element: Element) -> Tank:
    """Return the tank that a <tank> element describes, with JSBSim's defaults."""
    contents = element.value_of("contents", 0.0, "LBS")
    capacity = element.value_of("capacity", 0.00001, "LBS")
    if capacity == 0.0:  # JSBSim divides by it
        capacity = 0.00001
        contents = 0.0
    fuel = element.find("type")
    density = element.value_of("density", 6.6, "LBS/GAL")
    if fuel is not None:
        density = _FUELS.get(fuel.text, 6.6)
    unusable = element.value_of("unusable-volume", 0.0, "GAL") * density
    for amount, what in ((contents, "contents"), (unusable, "unusable contents")):
        if amount > capacity:
            raise element.error(
                f"the {what} of the tank, {amount:g} lb, exceed the capacity, {capacity:g} lb; "
                "correct one of the two values"
            )
    full = element.find("location")
    location = np.zeros(3) if full is None else full.vector("IN")
    drain = element.find("drain_location")
    return Tank(
        element,
        element.attributes.get("type", ""),
        contents,
        capacity,
        density,
        unusable,
        int(element.value_of("priority", 1.0)),
        full=location,
        drain=location if drain is None else drain.vector("IN"),
        radius=element.value_of("radius", 0.0, "IN") / 12.0,
        inertia_factor=element.value_of("inertia_factor", 1.0),
    )


#: Name of a fuel -> density, lb per gallon.
_FUELS = {
    **{"AVGAS": 6.02, "JET-A": 6.74, "JET-A1": 6.74, "JET-B": 6.48, "JP-1": 6.76, "JP-2": 6.38},
    **{"JP-3": 6.34, "JP-4": 6.48, "JP-5": 6.81, "JP-6": 6.55, "JP-7": 6.61, "JP-8": 6.66},
    **{"JP-8+100": 6.66, "RP-1": 6.73, "T-1": 6.88, "ETHANOL": 6.58, "HYDRAZINE": 8.61},
    **{"F-34": 6.66, "F-35": 6.74, "F-40": 6.48, "F-44": 6.81, "AVTAG": 6.48, "AVCAT": 6.81},
}


def read_empty(element: Element) -> Body:
    """Return the empty aircraft given by <mass_balance>."""
    places = {child.attributes.get("name"): child.vector("IN") for child in element.all("location")}
    empty_weight = element.value_of("emptywt", 0.0, "LBS")
    return Body(empty_weight, places.get("CG", np.zeros(3)), _inertia(element))


def mass_of(empty: Body, others: Sequence[Body]) -> Mass:
    """Return weight, center of gravity and inertia of several bodies together, as expressions.

    empty: the empty aircraft
    others: tank contents and point masses
    """
    bodies = [empty, *others]
    weight = sum((ca.SX(body.weight) for body in bodies), start=ca.SX(0.0))
    moment = sum((_column(body.location) * body.weight for body in bodies), start=ca.SX.zeros(3))
    center = moment / weight
    inertia = ca.SX.zeros(3, 3)
    for body in bodies:  # by the parallel axis theorem
        arm = structural_to_body(_column(body.location) - center)
        of_unit_mass = ca.dot(arm, arm) * ca.SX.eye(3) - ca.mtimes(arm, arm.T)
        inertia += ca.SX(body.inertia) + body.weight / SLUG_TO_LB * of_unit_mass
    return Mass(weight, center, inertia)


def _column(values: Any) -> ca.SX:
    """Return three numbers or expressions as a column."""
    return ca.vertcat(*(ca.SX(value) for value in values))


def mass_in_file(
    element: Element, empty: Body, tanks: Sequence[Tank], points: Sequence[PointMass]
) -> Mass:
    """Return the mass for the tank contents and point masses in the file, in numbers.

    element: <mass_balance>
    empty: the empty aircraft

    Raises BadInputError if the weight is not positive and finite, or if the inertia matrix is not
    finite and positive definite.
    """
    bodies = [Body(point.weight, point.location, point.inertia) for point in points]
    bodies += [tank.body(tank.contents) for tank in tanks]
    weight = empty.weight + sum(body.weight for body in bodies)
    if weight <= 0.0:  # `mass_of` divides by it
        raise element.error(f"the weight of the aircraft is {weight:g} lb; give a positive weight")
    mass = mass_of(empty, bodies)
    weight = float(mass.weight)
    center = ca.DM(mass.center).full().ravel()
    inertia = ca.DM(mass.inertia).full()
    is_finite = math.isfinite(weight) and np.isfinite(inertia).all()
    if not is_finite or np.linalg.eigvalsh(inertia)[0] <= 0.0:
        raise element.error(
            "the inertia of the aircraft is not finite and positive definite; correct the moments "
            "of inertia, the weights and locations"
        )
    return Mass(weight, center, inertia)


def _inertia(element: Element) -> np.ndarray:
    """Return the inertia matrix given by ixx ... iyz, slug ft², (3, 3)."""
    # In JSBSim's convention, the elements xy and yz are -ixy and -iyz, and xz is ixz. If
    # negated_crossproduct_inertia is "false", these three elements have the opposite signs.
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


def read_point_mass(element: Element) -> PointMass:
    """Return the point mass of an element, with the inertia of <form> or ixx ... iyz."""
    weight = element.need("weight").number("LBS")
    location = element.need("location").vector("IN")
    form = element.find("form")
    if form is None:
        return PointMass(weight, location, _inertia(element), has_form=False)
    radius = form.value_of("radius", 0.0, "FT")
    length = form.value_of("length", 0.0, "FT")
    slender = length**2 / 12.0  # of a rod
    shape = form.attributes.get("shape", "")
    shapes = {
        "tube": (radius**2, radius**2 / 2.0 + slender),
        "cylinder": (radius**2 / 2.0, radius**2 / 4.0 + slender),
        "sphere": (radius**2 * 2.0 / 3.0, radius**2 * 2.0 / 3.0),
        "ball": (radius**2 * 0.4, radius**2 * 0.4),
    }
    if shape not in shapes:
        raise form.error(f"the shape {shortened(shape)!r} is unknown; use {', '.join(shapes)}")
    along, across = shapes[shape]  # moments about the axis x and across it, of a unit mass
    mass = weight / SLUG_TO_LB
    inertia = mass * np.diag([along, across, across])
    return PointMass(weight, location, inertia, has_form=True)
