"""Dimensional derivatives, such as Xu, Zw, Mwdot and Lp, as coefficients of the table.

With the forces X, Z about stability axes, and û = (V - V_0)/V_0, at the reference condition:

  X̂_u = -2 C_D0 - C_Du       X̂_w = C_L0 - C_Dα        M̂_u = 2 C_m0 + C_mu
  Ẑ_u = -2 C_L0 - C_Lu       Ẑ_w = -C_Lα - C_D0

X̂ is the derivative with respect to û or α = w/V_0, divided by q̄ S. All other derivatives are
those of one coefficient. Source: J. Roskam, *Airplane Flight Dynamics and Automatic Flight
Controls*, Part I, Chapter 5.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from hfa_aircraft.readers.derivatives.names import Derivative
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_aircraft.rigid.motion import inertia_matrix, rotation

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
#: Suffix -> argument of the coefficient, and unit of the variable ("v": speed).
_VARIABLES = {
    "u": ("u", "v"),
    "w": ("alpha", "v"),
    "v": ("beta", "v"),
    "alpha": ("alpha", "rad"),
    "beta": ("beta", "rad"),
    "p": ("p", "rad/s"),
    "q": ("q", "rad/s"),
    "r": ("r", "rad/s"),
    "wdot": ("alphadot", "v/s"),
    "alphadot": ("alphadot", "rad/s"),
}
#: Longitudinal derivative of a coefficient -> coefficient at the reference condition and factor
#: that a dimensional derivative contains.
_STEADY = {
    "CD_u": ("CD_0", -2.0),
    "CL_u": ("CL_0", -2.0),
    "Cm_u": ("Cm_0", -2.0),
    "CD_alpha": ("CL_0", 1.0),
    "CL_alpha": ("CD_0", -1.0),
}
#: The two definitions: derivatives divided by the mass or the moment of inertia, or not divided.
DIVIDED = ("divided by mass", "not divided")


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
        return Derivative(_LOADS[self.load][0], argument, unit == "rad")

    def unit(self, system: str, divided: str) -> str:
        """Return the unit of the derivative.

        system: system of units, english or si
        divided: one of `DIVIDED`
        """
        length, force = ("ft", "lbf") if system == "english" else ("m", "N")
        base = f"{length}/s^2" if divided == DIVIDED[0] else force
        if self.load in _MOMENTS:
            base = "rad/s^2" if divided == DIVIDED[0] else f"{force} {length}"
        _, variable = _VARIABLES.get(self.variable, ("", "rad"))
        return f"({base})/({variable.replace('v', f'{length}/s')})"

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
        scale = 0.5 * density * speed**2 * values["wing_area"]
        arm = values["chord"] if self.load == "M" else values["span"]
        if self.load in _MOMENTS:
            scale *= arm
        if divided == DIVIDED[0]:
            number *= _inertia(self.load, values, axes)
        if self.variable in ("u", "w", "v", "wdot"):
            number *= speed
        if argument in ("p", "r"):
            number *= 2.0 * speed / values["span"]
        if argument in ("q", "alphadot"):
            number *= 2.0 * speed / values["chord"]
        name, factor = _STEADY.get(f"{coefficient}_{argument}", ("", 0.0))
        return sign * number / scale + factor * steady.get(name, 0.0)


def dimensional_of(name: str, surfaces: Iterable[str]) -> DimensionalDerivative | None:
    """Return the parts of the name of a dimensional derivative, or None for any other name.

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
    return [DimensionalDerivative(load, each).name for load in _LOADS for each in variables]


def _inertia(load: str, values: Mapping[str, float], axes: str) -> float:
    """Return the mass for a force, or the moment of inertia for a moment, about its axes."""
    if load not in _MOMENTS:
        return values["mass"]
    moments = (values["Ixx"], values["Iyy"], values["Izz"])
    inertia = inertia_matrix(moments, (0.0, values.get("Ixz", 0.0), 0.0))
    if axes == "stability":
        turn = rotation(0.0, values.get("alpha", 0.0), 0.0)
        inertia = turn @ inertia @ turn.T
    place = _MOMENTS.index(load)
    return float(inertia[place, place])
