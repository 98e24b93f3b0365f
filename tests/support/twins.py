"""One aircraft in any units: the twins of which every answer must be the same."""

import math
import random
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa import Model, Signal

#: Kind of quantity -> its units, each with the number of SI units (NIST SP 811), SI first.
SIZES = {
    "speed": {"m/s": 1.0, "kt": 1852.0 / 3600.0, "km/h": 1.0 / 3.6, "mph": 0.44704},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "length": {"m": 1.0, "ft": 0.3048, "km": 1000.0, "nmi": 1852.0},
    "force": {"N": 1.0, "lbf": 4.4482216152605, "kN": 1000.0},
    "mass": {"kg": 1.0, "lbm": 0.45359237, "slug": 14.593902937206364},
    "pressure": {"N/m^2": 1.0, "lbf/ft^2": 47.88025898033584, "psi": 6894.757293168361},
    "power": {"W": 1.0, "hp": 745.6998715822702, "kW": 1000.0},
    "time": {"s": 1.0, "min": 60.0},
}
#: Unit of a signal of `PLANE` -> its kind.
KIND_OF = {
    **{"m/s": "speed", "rad": "angle", "rad/s": "turn", "m": "length", "kg": "mass", "N": "force"},
    **{"N m": "moment", "N/m^2": "pressure", "m^2": "area", "W": "power", "1": "number"},
}
STATES = ("speed", "alpha", "pitch", "pitch_rate")
AREA, CHORD = 16.2, 1.5  # m^2, m


def equations(x, u, p, w):
    """Rates and outputs of an aircraft in level or climbing flight, in SI units."""
    gravity, climb = 9.80665, x.pitch - x.alpha
    alpha = x.alpha + w.updraft / x.speed
    dynamic = 0.6125 * ca.exp(-x.altitude / 9000.0) * x.speed**2
    lift = dynamic * AREA * (0.31 + 4.9 * alpha + 0.43 * u.elevator)
    drag = dynamic * (0.5 + 3.0 * alpha**2)
    damping = 9.0 * x.pitch_rate / x.speed
    moment = dynamic * AREA * CHORD * (-0.015 - 0.89 * alpha - 1.28 * u.elevator - damping)
    across = (lift + u.thrust * ca.sin(x.alpha)) / p.mass
    rates = {
        "speed": (u.thrust * ca.cos(x.alpha) - drag) / p.mass - gravity * ca.sin(climb),
        "alpha": x.pitch_rate + (gravity * ca.cos(climb) - across) / x.speed,
        "pitch": x.pitch_rate,
        "pitch_rate": moment / 1824.0,
        "altitude": x.speed * ca.sin(climb),
    }
    return rates, {
        "gamma": climb,
        "lift": lift,
        "drag": drag,
        "dynamic_pressure": dynamic,
        "power": u.thrust * x.speed,
        "weight": p.mass * gravity,
        "pitching_moment": moment,
        "reference_area": AREA,
        "reference_chord": CHORD,
        "load_factor": across / gravity,
        "mach": x.speed / 340.0,
        "largest_lift_coefficient": 1.5,
    }


PLANE = Model(
    "plane",
    states={
        "speed": Signal("m/s", 10.0, 25.0, 90.0, 55.0),
        "alpha": Signal("rad", 0.1, -0.2, 0.3),
        "pitch": Signal("rad", 0.1, -0.6, 0.6),
        "pitch_rate": Signal("rad/s", 0.2, -1.0, 1.0),
        "altitude": Signal("m", 100.0, 0.0, 4000.0, 1000.0),
    },
    inputs={
        "elevator": Signal("rad", 0.1, -0.35, 0.35),
        "thrust": Signal("N", 500.0, 0.0, 3000.0, 1000.0),
    },
    parameters={"mass": Signal("kg", 1e3, 5e2, 2e3, 1043.0)},
    disturbances={"updraft": Signal("m/s")},
    outputs={
        "gamma": Signal("rad"),
        "power": Signal("W"),
        **dict.fromkeys(("lift", "drag", "weight"), Signal("N")),
        "pitching_moment": Signal("N m"),
        "dynamic_pressure": Signal("N/m^2"),
        "reference_area": Signal("m^2"),
        "reference_chord": Signal("m"),
        **dict.fromkeys(("load_factor", "mach", "largest_lift_coefficient"), Signal()),
    },
    equations=equations,
    trim={"speed": 55.0, "altitude": 1000.0},
    linear=STATES,
    schedule="speed",
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch")},
)
#: Kind of the unit of each signal of the aircraft.
KINDS = {
    name: KIND_OF[signal.unit]
    for group in (PLANE.states, PLANE.inputs, PLANE.parameters, PLANE.disturbances, PLANE.outputs)
    for name, signal in group.items()
}


class Twin(NamedTuple):
    """The aircraft in some units.

    sizes: signal -> number of SI units in its unit
    second: number of seconds in a unit of time
    disturbance, cost: number of SI units in those of the disturbance and the cost of a game
    """

    model: Model
    sizes: dict
    second: float = 1.0
    disturbance: float = 1.0
    cost: float = 1.0

    def of(self, *names):
        """Return the sizes of the units of some signals."""
        return np.array([self.sizes[name] for name in names])

    @property
    def z(self):
        """Sizes of the units of the states of the linear model."""
        return self.of(*STATES)

    @property
    def u(self):
        """Sizes of the units of the inputs."""
        return self.of(*PLANE.inputs)

    @property
    def length(self):
        """Size of the unit of lengths of the air: of the altitude beside knots, else the meter."""
        return self.sizes["altitude"] if self.model.unit("speed") == "kt" else 1.0

    def typed(self, **numbers):
        """Return numbers in SI units in those of the twin."""
        return {name: number / self.sizes[name] for name, number in numbers.items()}


def in_units(sizes, words, second=1.0, **rest):
    """Return the twin whose signals have some units: its equations convert to SI units and back.

    sizes: signal -> number of SI units in its unit
    words: signal -> its unit
    """

    def signals(kind):
        found = {}
        for name, signal in kind.items():
            numbers = (number / sizes[name] for number in signal[1:5])
            found[name] = Signal(words[name], *numbers)
        return found

    def converted(x, u, p, w):
        values = (
            each._replace(**{name: getattr(each, name) * sizes[name] for name in each._fields})
            for each in (x, u, p, w)
        )
        rates, outputs = equations(*values)
        return (
            {name: second * rate / sizes[name] for name, rate in rates.items()},
            {name: value / sizes[name] for name, value in outputs.items()},
        )

    model = Model(
        PLANE.name,
        states=signals(PLANE.states),
        inputs=signals(PLANE.inputs),
        parameters=signals(PLANE.parameters),
        disturbances=signals(PLANE.disturbances),
        outputs=signals(PLANE.outputs),
        equations=converted,
        trim={name: value / sizes[name] for name, value in PLANE.trim.items()},
        linear=STATES,
        schedule="speed",
        modes=PLANE.modes,
    )
    return Twin(model, sizes, second, **rest)


SI = Twin(PLANE, dict.fromkeys(KINDS, 1.0))


def named(seed, seconds=False):
    """Return the twin in random units of physics that are not SI units, with rates per minute.

    seconds: whether rates are per second
    """
    choose = random.Random(seed)
    units = {kind: choose.choice([*sizes][1:]) for kind, sizes in SIZES.items()}
    if seconds:
        units["time"] = "s"
    size = {kind: SIZES[kind][unit] for kind, unit in units.items()}
    size["turn"], units["turn"] = size["angle"] / size["time"], "{angle}/{time}".format(**units)
    size["moment"], units["moment"] = (
        size["length"] * size["force"],
        "{force} {length}".format(**units),
    )
    size["area"], units["area"] = size["length"] ** 2, "{length}^2".format(**units)
    size["number"], units["number"] = 1.0, "1"
    sizes = {name: size[kind] for name, kind in KINDS.items()}
    words = {name: units[kind] for name, kind in KINDS.items()}
    return in_units(sizes, words, size["time"])


def scaled(seed, seconds=False):
    """Return the twin in random units without a name, 2^-20 to 2^20 SI units: conversion by a power
    of 2 does not round.

    seconds: whether the unit of time remains the second
    """
    rng = np.random.default_rng(seed)
    powers = (2.0 ** rng.integers(-20, 21, len(KINDS))).tolist()
    sizes = dict(zip(KINDS, powers, strict=True))
    sizes |= {name: 1.0 for name, kind in KINDS.items() if kind == "number"}
    second, disturbance, cost = (2.0 ** rng.integers(-20, 21, 3)).tolist()
    second = 1.0 if seconds else second
    words = dict.fromkeys(KINDS, "1")
    return in_units(sizes, words, second, disturbance=disturbance, cost=cost)
