"""Six degrees of freedom of an aircraft from the entries of a table, in numpy alone.

Forces are summed at the point of the file's moments and moved to the center of gravity by r x F.
Source of the equations: B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation,
3rd ed., 2016, Table 2.5-1. The air is that of the package `ambiance`; a temperature deviation
leaves the pressure unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from ambiance import Atmosphere
from scipy.optimize import root

GRAVITY = 9.80665
_GAS, _SOUND0, _PRESSURE0, _DENSITY0 = 287.05287, 340.294, 101325.0, 1.225
KNOT = 1852.0 / 3600.0


class Air(NamedTuple):
    density: float
    sound: float
    pressure: float


def air(altitude: float, warmer: float = 0.0) -> Air:
    """Return the air at an altitude, m, warmer by some K than the standard."""
    there = Atmosphere(altitude)
    pressure, warmth = float(there.pressure[0]), float(there.temperature[0]) + warmer
    return Air(pressure / (_GAS * warmth), math.sqrt(1.4 * _GAS * warmth), pressure)


def calibrated(speed: float, at: Air) -> float:
    """Return the calibrated airspeed, kt, of subsonic flow at a true airspeed, m/s."""
    impact = at.pressure * ((1.0 + 0.2 * (speed / at.sound) ** 2) ** 3.5 - 1.0)
    mach = math.sqrt(5.0 * ((impact / _PRESSURE0 + 1.0) ** (2.0 / 7.0) - 1.0))
    return mach * _SOUND0 / KNOT


def equivalent(speed: float, at: Air) -> float:
    """Return the equivalent airspeed, kt."""
    return speed * math.sqrt(at.density / _DENSITY0) / KNOT


class Trimmed(NamedTuple):
    """A steady flight. alpha and surfaces in rad, thrust in N, modes in 1/s (sorted)."""

    alpha: float
    pitch: float
    roll: float
    thrust: float
    elevator: float
    load_factor: float
    lift_over_drag: float
    static_margin: float
    kcas: float
    modes: np.ndarray


class SixDof:
    """An aircraft with the entries of a table in SI units and rad, about body axes."""

    def __init__(self, table: Mapping[str, Any], cg: float | None = None, warmer: float = 0.0):
        self.of = {key: each for key, each in table.items() if not isinstance(each, Mapping)}
        for group in table.values():
            self.of |= group if isinstance(group, Mapping) else {}
        self.moved = 0.0 if cg is None else (cg - self.of["cg"]) * self.of["chord"]
        self.warmer = warmer
        of = self.of
        xz = of.get("Ixz", 0.0)
        self.inertia = np.array([[of["Ixx"], 0, -xz], [0, of["Iyy"], 0], [-xz, 0, of["Izz"]]])

    def get(self, name: str) -> float:
        return self.of.get(name, 0.0)

    def coefficients(self, flow: np.ndarray, rates: np.ndarray, u: np.ndarray, at: Air) -> dict:
        """Return the steady coefficients by name; without C_alphadot.

        flow: alpha, beta and speed
        u: thrust, elevator, aileron, rudder
        """
        alpha, beta, speed = flow
        p, _, r = rates * self.of["span"] / (2.0 * speed)
        q = rates[1] * self.of["chord"] / (2.0 * speed)
        mach = speed / at.sound - self.of["speed"] / air(self.get("altitude")).sound
        by = {"0": 1.0, "alpha": alpha - self.get("alpha"), "beta": beta, "p": p, "q": q, "r": r}
        by |= {"mach": mach, "elevator": u[1], "aileron": u[2], "rudder": u[3]}
        found = {}
        for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
            found[name] = sum(self.get(f"{name}_{key}") * value for key, value in by.items())
        found["CD"] += self.get("CD_CL2") * found["CL"] ** 2
        return found

    def loads(self, flow: np.ndarray, rates: np.ndarray, u: np.ndarray, at: Air) -> Any:
        """Return force without weight and moment about the center of gravity, body axes, and CL, CD
        and the aerodynamic pitching moment; all without C_alphadot.
        """
        alpha, _, speed = flow
        S, b, c = (self.of[name] for name in ("wing_area", "span", "chord"))
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

    def rates(self, x: np.ndarray, u: np.ndarray, altitude: float) -> np.ndarray:
        """Return the rates of x = (u, v, w, p, q, r, roll, pitch)."""
        velocity, omega, (phi, theta) = x[:3], x[3:6], x[6:]
        speed = float(np.linalg.norm(velocity))
        flow = np.array([math.atan2(x[2], x[0]), math.asin(x[1] / speed), speed])
        at = air(altitude, self.warmer)
        force, moment, *_ = self.loads(flow, omega, u, at)
        mass, S, c = self.of["mass"], self.of["wing_area"], self.of["chord"]
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

    def state(self, speed: float, alpha: float, phi: float, theta: float, omega: Any) -> np.ndarray:
        velocity = speed * np.array([math.cos(alpha), 0.0, math.sin(alpha)])
        return np.array([*velocity, *omega, phi, theta])

    def trim(self, speed: float, altitude: float, gamma: float = 0.0, turn: float = 0.0) -> Trimmed:
        """Return the steady flight without sideslip at a climb angle and a turn rate, rad/s."""

        def unpacked(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            alpha, phi, theta, thrust, *surfaces = z
            cos = math.cos(theta)
            omega = turn * np.array([-math.sin(theta), math.sin(phi) * cos, math.cos(phi) * cos])
            weight = self.of["mass"] * GRAVITY
            return self.state(speed, alpha, phi, theta, omega), np.array(
                [thrust * weight, *surfaces]
            )

        def missing(z: np.ndarray) -> np.ndarray:
            x, u = unpacked(z)
            f = self.rates(x, u, altitude)
            _, _, theta = z[:3]
            a, phi = z[0], z[1]
            climb = math.cos(a) * math.sin(theta) - math.sin(a) * math.cos(phi) * math.cos(theta)
            return np.array([*f[:3] / GRAVITY, *f[3:6], climb - math.sin(gamma)])

        guess = np.array([0.05, math.atan(turn * speed / GRAVITY), 0.05 + gamma, 0.1, 0, 0, 0])
        z = root(missing, guess, tol=1e-13).x
        assert np.abs(missing(z)).max() < 1e-9
        x, u = unpacked(z)
        at = air(altitude, self.warmer)
        flow, omega = np.array([z[0], 0.0, speed]), x[3:6]
        force, _, lift, drag, _ = self.loads(flow, omega, u, at)
        step = np.array([1e-5, 0.0, 0.0])
        above, below = (self.loads(flow + each, omega, u, at) for each in (step, -step))
        pressure = 0.5 * at.density * speed**2 * self.of["wing_area"] * self.of["chord"]
        margin = -(above[4] - below[4]) / pressure / (above[2] - below[2])
        normal = (force[0] * math.sin(z[0]) - force[2] * math.cos(z[0])) / self.of["mass"]
        return Trimmed(
            *z[:1], z[2], z[1], u[0], u[1], normal / GRAVITY, lift / drag, margin,
            calibrated(speed, at), self.modes(x, u, altitude),
        )  # fmt: skip

    def modes(self, x: np.ndarray, u: np.ndarray, altitude: float) -> np.ndarray:
        """Return the eigenvalues of central differences."""
        steps = np.maximum(1.0, np.abs(x)) * 1e-5
        columns = [
            (self.rates(x + h, u, altitude) - self.rates(x - h, u, altitude)) / (2.0 * h.sum())
            for h in np.diag(steps)
        ]
        return np.sort_complex(np.linalg.eigvals(np.array(columns).T))
