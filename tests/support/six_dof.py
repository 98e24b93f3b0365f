"""Six degrees of freedom of an aircraft from the entries of a table, in numpy alone.

Forces are summed at the point of the file's moments and moved to the center of gravity by r x F.
Source of the equations: B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation,
3rd ed., 2016, Table 2.5-1. The air is that of the package `ambiance`; a temperature deviation
leaves the pressure unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from ambiance import Atmosphere

GRAVITY = 9.80665
_GAS, _SOUND0, _PRESSURE0, _DENSITY0 = 287.05287, 340.294, 101325.0, 1.225
KNOT = 1852.0 / 3600.0


class Air(NamedTuple):
    """Density, kg/m³, speed of sound, m/s, and pressure, Pa."""

    density: float
    sound: float
    pressure: float


def air(altitude, warmer=0.0):
    """Return the air at an altitude, m, warmer by some K than the standard."""
    there = Atmosphere(altitude)
    pressure, warmth = float(there.pressure[0]), float(there.temperature[0]) + warmer
    return Air(pressure / (_GAS * warmth), math.sqrt(1.4 * _GAS * warmth), pressure)


def calibrated(speed, at):
    """Return the calibrated airspeed, kt, of subsonic flow at a true airspeed, m/s."""
    impact = at.pressure * ((1.0 + 0.2 * (speed / at.sound) ** 2) ** 3.5 - 1.0)
    mach = math.sqrt(5.0 * ((impact / _PRESSURE0 + 1.0) ** (2.0 / 7.0) - 1.0))
    return mach * _SOUND0 / KNOT


def equivalent(speed, at):
    """Return the equivalent airspeed, kt."""
    return speed * math.sqrt(at.density / _DENSITY0) / KNOT


class SixDof:
    """An aircraft with the entries of a table in SI units and rad, about body axes.

    cg: center of gravity, chords, or None for that of the table, about which its moments are
    warmer: deviation of the temperature from the standard, K
    """

    def __init__(self, table, cg=None, warmer=0.0):
        self.entries = {key: each for key, each in table.items() if not isinstance(each, Mapping)}
        for group in table.values():
            self.entries |= group if isinstance(group, Mapping) else {}
        self.moved = 0.0 if cg is None else (cg - self.entries["cg"]) * self.entries["chord"]
        self.warmer = warmer
        of = self.entries
        xz = of.get("Ixz", 0.0)
        self.inertia = np.array([[of["Ixx"], 0, -xz], [0, of["Iyy"], 0], [-xz, 0, of["Izz"]]])

    def get(self, name):
        """Return an entry of the table, 0 if it is missing."""
        return self.entries.get(name, 0.0)

    def coefficients(self, flow, rates, u, at):
        """Return the steady coefficients by name; without C_alphadot.

        flow: alpha, beta and speed
        u: thrust, elevator, aileron, rudder
        """
        alpha, beta, speed = flow
        p, _, r = rates * self.entries["span"] / (2.0 * speed)
        q = rates[1] * self.entries["chord"] / (2.0 * speed)
        mach = speed / at.sound - self.entries["speed"] / air(self.get("altitude")).sound
        by = {"0": 1.0, "alpha": alpha - self.get("alpha"), "beta": beta, "p": p, "q": q, "r": r}
        by |= {"mach": mach, "elevator": u[1], "aileron": u[2], "rudder": u[3]}
        found = {}
        for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
            found[name] = sum(self.get(f"{name}_{key}") * value for key, value in by.items())
        found["CD"] += self.get("CD_CL2") * found["CL"] ** 2
        return found

    def loads(self, flow, rates, u, at):
        """Return force without weight and moment about the center of gravity, body axes, and CL, CD
        and the aerodynamic pitching moment; all without C_alphadot.
        """
        alpha, _, speed = flow
        S, b, c = (self.entries[name] for name in ("wing_area", "span", "chord"))
        pressure = 0.5 * at.density * speed**2
        C = self.coefficients(flow, rates, u, at)
        lift, drag, side = (pressure * S * C[name] for name in ("CL", "CD", "CY"))
        cos, sin = math.cos(alpha), math.sin(alpha)
        aerodynamic = np.array([lift * sin - drag * cos, side, -lift * cos - drag * sin])
        inclined = self.get("thrust_angle")
        thrust = u[0] * np.array([math.cos(inclined), 0.0, -math.sin(inclined)])
        point = np.array([self.moved, 0.0, 0.0])  # the file's point, from the center of gravity
        about_point = pressure * S * np.array([b * C["Cl"], c * C["Cm"], b * C["Cn"]])
        of_air = about_point + np.cross(point, aerodynamic)
        line = point + np.array([0.0, 0.0, -self.get("thrust_height")])
        return aerodynamic + thrust, of_air + np.cross(line, thrust), C["CL"], C["CD"], of_air[1]

    def rates(self, x, u, altitude):
        """Return the rates of x = (u, v, w, p, q, r, roll, pitch)."""
        velocity, omega, (phi, theta) = x[:3], x[3:6], x[6:]
        speed = float(np.linalg.norm(velocity))
        flow = np.array([math.atan2(x[2], x[0]), math.asin(x[1] / speed), speed])
        at = air(altitude, self.warmer)
        force, moment, *_ = self.loads(flow, omega, u, at)
        mass, S, c = self.entries["mass"], self.entries["wing_area"], self.entries["chord"]
        down = [-math.sin(theta), math.sin(phi) * math.cos(theta), math.cos(phi) * math.cos(theta)]
        free = force / mass + GRAVITY * np.array(down) - np.cross(omega, velocity)
        # The lift of alphadot is part of the equation of alphadot.
        pressure = 0.5 * at.density * speed**2
        per = c / (2.0 * speed) * pressure * S
        in_plane = x[0] ** 2 + x[2] ** 2
        cos, sin = math.cos(flow[0]), math.sin(flow[0])
        of_lift = self.get("CL_alphadot") * per / mass * (-x[0] * cos - x[2] * sin) / in_plane
        turning = (x[0] * free[2] - x[2] * free[0]) / in_plane / (1.0 - of_lift)
        lift = self.get("CL_alphadot") * per * turning * np.array([sin, 0.0, -cos])
        pitching = self.get("Cm_alphadot") * per * c * turning
        moment = moment + np.array([0.0, pitching, 0.0])
        moment = moment + np.cross([self.moved, 0.0, 0.0], lift)
        spin = np.linalg.solve(self.inertia, moment - np.cross(omega, self.inertia @ omega))
        p, q, r = omega
        yawing = q * math.sin(phi) + r * math.cos(phi)
        angles = [p + math.tan(theta) * yawing, q * math.cos(phi) - r * math.sin(phi)]
        return np.array([*(free + lift / mass), *spin, *angles])
