"""One aircraft in radians and degrees, meters and feet, and both: every figure is equal."""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from sheet_values import values

import hfa
from hfa import Model, Signal
from hfa_support.units import conversion

STATES = ("speed", "alpha", "pitch", "pitch_rate")


class Units(NamedTuple):
    """Units of angles, lengths and forces, and those of the chord and the thrust if different."""

    angle: str
    length: str
    force: str
    chord: str = ""
    thrust: str = ""

    def sizes(self):
        """Return how many of these units a radian, a meter and a newton are."""
        sizes = [conversion(si, unit) for si, unit in zip(("rad", "m", "N"), self[:3], strict=True)]
        return tuple(sizes)  # type: ignore[return-value]  # the units are known


ALL = [Units(angle, *rest) for angle in ("rad", "deg") for rest in (("m", "N"), ("ft", "lbf"))]
MIXED = [Units("rad", "m", "N", "cm", "lbf"), Units("deg", "ft", "lbf", "in", "N")]


def aircraft(units):
    """Return a small aircraft whose signals are in some units."""
    angle, length, force = units.sizes()
    of_chord, of_thrust = units.chord or units.length, units.thrust or units.force
    thrust_size = conversion("N", of_thrust) or math.nan
    chord_size = conversion("m", of_chord) or math.nan

    def equations(x, u, p, w):
        speed, alpha, pitch = x.speed / length, x.alpha / angle, x.pitch / angle
        pitch_rate, elevator = x.pitch_rate / angle, u.elevator / angle
        thrust = u.thrust / thrust_size
        weight, area, chord, gravity = 12262.5, 17.1, 1.74, 9.81
        pressure = 0.5 * 1.225 * speed**2
        lift = pressure * area * (0.41 + 4.44 * alpha + 0.355 * elevator)
        drag = pressure * area * (0.05 + 0.33 * alpha)
        damping = 9.96 * chord / (2 * speed) * pitch_rate
        moment = pressure * area * chord * (-0.683 * alpha - 0.923 * elevator - damping)
        gamma = pitch - alpha
        across = (thrust * ca.sin(alpha) + lift) / weight
        along = (thrust * ca.cos(alpha) - drag) / weight
        rates = {
            "speed": gravity * (along - ca.sin(gamma)) * length,
            "alpha": (pitch_rate + gravity / speed * (ca.cos(gamma) - across)) * angle,
            "pitch": pitch_rate * angle,
            "pitch_rate": moment / 4000.0 * angle,
        }
        return rates, {
            "gamma": gamma * angle,
            "lift": lift * force,
            "drag": drag * force,
            "weight": weight * force,
            "pitching_moment": moment * force * length,
            "dynamic_pressure": pressure * force / length**2,
            "reference_area": area * length**2,
            "reference_chord": chord * chord_size,
            "largest_lift_coefficient": 1.5,
            "load_factor": across,
            "mach": speed / 340.0,
        }

    turned = Signal(units.angle, nominal=0.1 * angle, min=-0.4 * angle, max=0.4 * angle)
    forces = Signal(units.force, nominal=1000.0 * force)
    fast = Signal(f"{units.length}/s", 50.0 * length, 20.0 * length, 100.0 * length, 50.0 * length)
    return Model(
        "craft",
        {
            "speed": fast,
            "alpha": turned,
            "pitch": turned,
            "pitch_rate": Signal(f"{units.angle}/s", nominal=0.1 * angle),
        },
        {
            "thrust": Signal(of_thrust, 1000.0 * thrust_size, 0.0, 6000.0 * thrust_size),
            "elevator": turned,
        },
        equations,
        outputs={
            "gamma": turned,
            **dict.fromkeys(("lift", "drag", "weight"), forces),
            "pitching_moment": Signal(f"{units.length} {units.force}"),
            "dynamic_pressure": Signal(f"{units.force}/{units.length}^2"),
            "reference_area": Signal(f"{units.length}^2"),
            "reference_chord": Signal(of_chord),
            **dict.fromkeys(("largest_lift_coefficient", "load_factor", "mach"), Signal()),
        },
        trim={"speed": 50.0 * length, "gamma": 0.05 * angle, "pitch_rate": 0.0},
    )


#: Figures in fixed units; rate of climb and power have units of their own in feet.
SAME = (
    *("equivalent airspeed", "L/D", "lift coefficient", "drag coefficient"),
    "speed / stall speed",
)


def figures(units):
    """Return figures of the sheet, the levels, the modes, a game and a flight, in fixed units."""
    angle, length, _ = units.sizes()
    model = aircraft(units)
    point = hfa.trim(model)
    data = point.report().data
    found = {name: values(data)[name] for name in SAME}
    climb = data["sheet"]["rate of climb left"]["value"]
    found["rate of climb left"] = climb * conversion(
        data["sheet"]["rate of climb left"]["unit"], "m/s"
    )
    for name, value in values(data, "stability").items():
        unit = data["sheet"][name]["unit"]
        found[name] = value / length if unit == units.length else value
    found |= {
        name: value
        for name, value in values(data, "modes and levels").items()
        if "eigenvalue" not in name
    }
    levels = {name: row["level"] for name, row in data["sheet"].items() if "level" in row}
    found |= {f"level of {name}": level for name, level in levels.items()}
    linear = point.linearize()
    for mode in linear.modes:
        found[f"{mode.name} real"] = mode.eigenvalue.real
        found[f"{mode.name} imaginary"] = mode.eigenvalue.imag
    solution = hfa.solve(hfa.game(linear))
    for number, pole in enumerate(np.sort_complex(solution.poles())):
        found[f"closed-loop pole {number} real"] = pole.real
        found[f"closed-loop pole {number} imaginary"] = pole.imag
    flight = hfa.fly(model, point, solution, initial={"alpha": 0.02 * angle}, duration=1.0)
    sizes = {"speed": length, "alpha": angle, "pitch": angle, "pitch_rate": angle}
    for name, size in sizes.items():
        found[f"{name} at the end"] = flight.states[-1][STATES.index(name)] / size
    return found


@pytest.fixture(scope="module")
def reference():
    """Return the figures in SI units."""
    return figures(ALL[0])


def test_the_figures_are_those_of_the_coefficients(reference):
    """Slopes are those of the equations, and the rate of climb is (T_max - T) V cos α / W."""
    point = hfa.trim(aircraft(ALL[0]))
    climb = (6000.0 - point["thrust"]) * 50.0 * math.cos(point["alpha"]) / 12262.5
    exact = {
        "CL_alpha": 4.44,
        "Cm_alpha": -0.683,
        "static margin": 0.683 / 4.44,
        "rate of climb left": climb,
    }
    assert {name: reference[name] for name in exact} == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("units", [*ALL[1:], *MIXED], ids="-".join)
def test_figures_do_not_depend_on_units(units, reference):
    """Sheet, levels, modes, closed loop and flight are equal in degrees, in feet, and in mixed units."""
    assert figures(units) == pytest.approx(reference, rel=1e-6, nan_ok=True)


def test_handling_qualities_are_per_second():
    """The frequency of a model in minutes, 3 rad/min, is 0.05 rad/s; its eigenvalues are per
    minute.
    """
    model = Model(
        "slow",
        {"angle": Signal("rad"), "rate": Signal("rad/min")},
        {"torque": Signal()},
        lambda x, u, p, w: ({"angle": x.rate, "rate": -9.0 * x.angle - x.rate + u.torque}, {}),
        trim={"torque": 0.0},
        modes={"short period": ("angle", "rate")},
    )
    point = hfa.trim(model)
    frequency, eigenvalue = (
        point.sheet[f"short period {name}"] for name in ("frequency", "eigenvalue")
    )
    assert (frequency.value, frequency.unit) == (pytest.approx(0.05), "rad/s")
    assert (abs(eigenvalue.value), eigenvalue.unit) == (pytest.approx(3.0), "1/min")
