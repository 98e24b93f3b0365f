"""Entries of a table of derivatives: their names and units, and which are required."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from hfa_aircraft.rigid.aircraft import inertia_matrix, rotation
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_support.errors import BadInputError, shortened, shown
from hfa_support.units import si_unit, split_unit, stated_factor


@dataclass(frozen=True)
class Entry:
    """Unchecked entry of a table.

    value: a number, a text with a unit, or a list of two of these
    where: place in the file, for messages
    """

    value: Any
    where: str

    def error(self, message: str) -> BadInputError:
        """Return a BadInputError whose message begins with the place of the entry."""
        return BadInputError(f"{self.where}: {message}")


def number(name: str, entry: Entry, unit: str, factor_without_unit: float = 1.0) -> float:
    """Return the value of an entry, converted to `unit`.

    factor_without_unit: factor on a number without a unit

    Raises BadInputError unless the value is a finite number, with or without a unit.
    """
    value: Any = entry.value
    stated = ""
    if isinstance(value, str):
        text, stated = split_unit(value)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise entry.error(
            f"{name} is {shown(entry.value)}; give a finite number, optionally with a unit"
        )
    factor = stated_factor(stated, unit) if stated else factor_without_unit
    if factor is None:
        other = unit.replace("rad", "deg") if "rad" in unit else si_unit(unit)
        known = " or ".join(dict.fromkeys((unit, other)))
        raise entry.error(f"{name} is in {shortened(stated)}; give {name} in {known}")
    return float(value) * factor


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
#: Suffixes of the variables on which coefficients depend, in addition to control surfaces.
ARGUMENTS = ("0", "alpha", "beta", "p", "q", "r", "alphadot", "mach", "u")
_ANGLES = ("alpha", "beta")
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
    is_by_angle: bool = False

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
        return Derivative("CD", "CL2")
    if name == THRUST_BY_SPEED:
        return Derivative("CT", "u")
    match = re.fullmatch(rf"({'|'.join(COEFFICIENTS)})_(\w+)", name)
    if match is None:
        return None
    coefficient, argument = match.groups()
    if argument in ARGUMENTS:
        return Derivative(coefficient, argument, is_by_angle=argument in _ANGLES)
    if argument in surfaces:
        return Derivative(coefficient, argument, is_by_angle=True)
    return None


#: Force or moment -> coefficient and its sign.
_LOADS = {
    "X": ("CD", -1.0),
    "Y": ("CY", 1.0),
    "Z": ("CL", -1.0),
    "L": ("Cl", 1.0),
    "M": ("Cm", 1.0),
    "N": ("Cn", 1.0),
}
_MOMENTS = ("L", "M", "N")
#: Suffix -> argument of the coefficient, and unit of the variable.
_VARIABLES = {
    "u": ("u", "{speed}"),
    "w": ("alpha", "{speed}"),
    "v": ("beta", "{speed}"),
    "alpha": ("alpha", "rad"),
    "beta": ("beta", "rad"),
    "p": ("p", "rad/s"),
    "q": ("q", "rad/s"),
    "r": ("r", "rad/s"),
    "wdot": ("alphadot", "{speed}/s"),
    "alphadot": ("alphadot", "rad/s"),
}
#: Longitudinal derivative of a coefficient -> coefficient at the reference condition, and the
#: factor with which it is added: X_u contains the change 2 C_D,0 u of q̄ C_D/q̄_0, for example, and
#: X_alpha a component of the lift, which turns with alpha.
_REFERENCE_TERMS = {
    "CD_u": ("CD_0", -2.0),
    "CL_u": ("CL_0", -2.0),
    "Cm_u": ("Cm_0", -2.0),
    "CD_alpha": ("CL_0", 1.0),
    "CL_alpha": ("CD_0", -1.0),
}
#: The two definitions: derivatives divided by the mass or the moment of inertia, or not divided.
BY_MASS, UNDIVIDED = DIVIDED = ("divided by mass", "not divided")


@dataclass(frozen=True)
class DimensionalDerivative:
    """Parts of the name of a dimensional derivative, such as Mwdot or N_rudder.

    load: the force X, Y, Z or the moment L, M, N
    variable: suffix, such as wdot, or name of a control surface
    """

    load: str
    variable: str

    @property
    def name(self) -> str:
        """Name of the entry in a table."""
        underscore = "" if self.variable in _VARIABLES else "_"
        return f"{self.load}{underscore}{self.variable}"

    @property
    def is_about_stability_axes(self) -> bool:
        """Whether the derivative is defined about stability axes: X, Z, and M of u, w and wdot."""
        return self.load in ("X", "Z") or self.variable in ("u", "w", "wdot")

    @property
    def coefficient(self) -> Derivative:
        """The derivative of a coefficient that it determines."""
        argument, unit = _VARIABLES.get(self.variable, (self.variable, "rad"))
        coefficient, _ = _LOADS[self.load]
        return Derivative(coefficient, argument, is_by_angle=unit == "rad")

    def unit(self, system: str, divided: str) -> str:
        """Return the unit of the derivative.

        system: system of units, english or si
        divided: one of `DIVIDED`
        """
        length, force = ("ft", "lbf") if system == "english" else ("m", "N")
        base = f"{length}/s^2" if divided == BY_MASS else force
        if self.load in _MOMENTS:
            base = "rad/s^2" if divided == BY_MASS else f"{force} {length}"
        _, by_unit = _VARIABLES.get(self.variable, ("", "rad"))
        return f"({base})/({by_unit.format(speed=f'{length}/s')})"

    def value(
        self,
        number: float,
        divided: str,
        values: Mapping[str, float],
        steady: Mapping[str, float],
        axes: str,
        system: str,
    ) -> float:
        """Return the derivative of the coefficient.

        number: the dimensional derivative
        divided: one of `DIVIDED`
        values: geometry, mass, inertias and reference condition, name -> value
        steady: coefficients at the reference condition, such as CL_0
        axes: axes of the moments, "body" or "stability"
        system: system of units, english or si
        """
        coefficient, sign = _LOADS[self.load]
        argument = self.coefficient.argument
        speed = values["speed"]
        density = float(air_at(values.get("altitude", 0.0), system).density)
        scale = 0.5 * density * speed**2 * values["wing_area"]  # q̄ S, or q̄ S b or c of a moment
        if self.load in _MOMENTS:
            scale *= values["chord"] if self.load == "M" else values["span"]
        if divided == BY_MASS:
            number *= _inertia(self.load, values, axes)
        # The arguments of coefficients are dimensionless: u/V, w/V, v/V, p b/(2V), q c/(2V).
        if self.variable in ("u", "w", "v", "wdot"):
            number *= speed
        if argument in ("p", "r"):
            number *= 2.0 * speed / values["span"]
        if argument in ("q", "alphadot"):
            number *= 2.0 * speed / values["chord"]
        of_reference, factor = _REFERENCE_TERMS.get(f"{coefficient}_{argument}", ("", 0.0))
        return sign * number / scale + factor * steady.get(of_reference, 0.0)


def dimensional_of(name: str, surfaces: Iterable[str]) -> DimensionalDerivative | None:
    """Return the parts of the name of a dimensional derivative, or None for any other name.

    The name of a control surface follows an underscore, M_elevator, unlike a variable, Mw.

    surfaces: names of the control surfaces
    """
    match = re.fullmatch(r"([XYZLMN])(_?)(\w+)", name)
    if match is None:
        return None
    load, underscore, variable = match.groups()
    known = surfaces if underscore else _VARIABLES
    return DimensionalDerivative(load, variable) if variable in known else None


def dimensional_names(surfaces: Iterable[str]) -> list[str]:
    """Return the names of all dimensional derivatives, for an aircraft with control surfaces."""
    variables = (*_VARIABLES, *surfaces)
    return [DimensionalDerivative(load, variable).name for load in _LOADS for variable in variables]


def _inertia(load: str, values: Mapping[str, float], axes: str) -> float:
    """Return the mass for a force, or the moment of inertia for a moment, about its axes."""
    if load not in _MOMENTS:
        return values["mass"]
    moments = (values["Ixx"], values["Iyy"], values["Izz"])
    inertia = inertia_matrix(moments, (0.0, values.get("Ixz", 0.0), 0.0))
    if axes == "stability":
        # The body axes are the stability axes, pitched by alpha.
        turn = rotation(0.0, values.get("alpha", 0.0), 0.0)
        inertia = turn @ inertia @ turn.T
    place = _MOMENTS.index(load)
    return float(inertia[place, place])
