"""Entries of a table of derivatives: their names and units, and which are required."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

#: Name -> unit in the two systems of `units`. Numbers without a unit are "1", angles "rad".
GEOMETRY = {"wing_area": ("ft^2", "m^2"), "span": ("ft", "m"), "chord": ("ft", "m")}
INERTIA = dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixz"), ("slug ft^2", "kg m^2"))
MASS = {"mass": ("slug", "kg"), "weight": ("lbf", "N")}
CONDITION = {"speed": ("ft/s", "m/s"), "altitude": ("ft", "m"), "alpha": ("rad", "rad")}
THRUST = {
    "thrust_angle": ("rad", "rad"),
    "thrust_height": ("ft", "m"),
    "thrust_slope": ("lbf/(ft/s)", "N/(m/s)"),
}
#: Center of gravity of the file's moments, in chords behind the leading edge of the mean chord, and
#: distance from it back to the tail that causes the derivatives with respect to q and alphadot.
CENTER = "cg"
#: Foremost and rearmost center of gravity; a larger number is one in percent or in a length.
CENTERS = (-2.0, 3.0)
TAIL_ARM = "tail_arm"
PLACES = {CENTER: ("chord", "chord"), TAIL_ARM: ("ft", "m")}
#: Free words about the configuration, which reports repeat.
WORDS = ("flap", "gear")
#: Largest lift coefficient, from which reports of trims compute the stall margin.
LARGEST_LIFT = "CL_max"
UNITS = GEOMETRY | INERTIA | MASS | CONDITION | THRUST | PLACES | {LARGEST_LIFT: ("1", "1")}
#: Required entries. In addition, either mass or weight is required.
REQUIRED = (*GEOMETRY, "Ixx", "Iyy", "Izz", "speed", "CL_0", "CD_0", "CL_alpha", "Cm_alpha")

#: The coefficients of lift, drag, side force, rolling, pitching and yawing moment.
COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
#: Variables on which coefficients depend, in addition to control surfaces: suffix -> whether it is
#: an angle.
ARGUMENTS = {
    "0": False,
    "alpha": True,
    "beta": True,
    "p": False,
    "q": False,
    "r": False,
    "alphadot": False,
    "mach": False,
    "u": False,
}
#: Suffixes of the variables that are neither angles nor rates.
_WITHOUT_ANGLE = ("0", "mach", "u", "CL2")
#: Induced drag: C_D contains this value times C_L².
INDUCED = "CD_CL2"
#: Derivative of the thrust coefficient with respect to u, the relative change of the speed.
THRUST_BY_SPEED = "CT_u"
#: The input that is a force along the thrust line, not a control surface.
THRUST_INPUT = "thrust"


@dataclass(frozen=True)
class Derivative:
    """Parts of the name of a derivative, such as CL_alpha.

    coefficient: the coefficient, such as CL
    argument: suffix of the variable, such as alpha, or name of a control surface
    is_by_angle: whether the argument is an angle. The derivative is then per rad or per deg.
    """

    coefficient: str
    argument: str
    is_by_angle: bool

    @property
    def name(self) -> str:
        """Name of the derivative."""
        return f"{self.coefficient}_{self.argument}"

    @property
    def unit(self) -> str:
        """Unit of the derivative: 1/rad with respect to angles and rates."""
        return "1" if self.argument in _WITHOUT_ANGLE else "1/rad"


def derivative_of(name: str, surfaces: Iterable[str]) -> Derivative | None:
    """Return the parts of the name of a derivative, or None for any other name.

    surfaces: names of the control surfaces
    """
    if name == INDUCED:
        return Derivative("CD", "CL2", False)
    if name == THRUST_BY_SPEED:
        return Derivative("CT", "u", False)
    match = re.fullmatch(rf"({'|'.join(COEFFICIENTS)})_(\w+)", name)
    if match is None:
        return None
    coefficient, argument = match.groups()
    if argument in ARGUMENTS:
        return Derivative(coefficient, argument, ARGUMENTS[argument])
    if argument in surfaces:
        return Derivative(coefficient, argument, True)
    return None
