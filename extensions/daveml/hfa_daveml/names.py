"""Names and units of ANSI/AIAA S-119 variables that describe an aircraft."""

from __future__ import annotations

import math
from collections.abc import Mapping

_FOOT = 0.3048
_SLUG = 0.45359237 * 9.80665 / _FOOT
_POUND_FORCE = 0.45359237 * 9.80665
_KNOT = 1852.0 / 3600.0 / _FOOT
_AXES = ("Roll", "Pitch", "Yaw")

#: Unit of the standard, or an older spelling -> (unit of the model, how many of these it is).
UNITS: Mapping[str, tuple[str, float]] = {
    "nd": ("1", 1.0),
    "": ("1", 1.0),
    "frac": ("1", 1.0),
    "fracMAC": ("1", 1.0),
    "pct": ("%", 1.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "rad_s": ("rad/s", 1.0),
    "deg_s": ("rad/s", math.pi / 180.0),
    "ft": ("ft", 1.0),
    "f": ("ft", 1.0),
    "m": ("ft", 1.0 / _FOOT),
    "ft_s": ("ft/s", 1.0),
    "f_s": ("ft/s", 1.0),
    "m_s": ("ft/s", 1.0 / _FOOT),
    "nmi_h": ("ft/s", _KNOT),
    "ft2": ("ft^2", 1.0),
    "f2": ("ft^2", 1.0),
    "m2": ("ft^2", _FOOT**-2),
    "slug": ("slug", 1.0),
    "kg": ("slug", 1.0 / _SLUG),
    "slugft2": ("slug ft^2", 1.0),
    "kgm2": ("slug ft^2", 1.0 / (_SLUG * _FOOT**2)),
    "lbf": ("lbf", 1.0),
    "N": ("lbf", 1.0 / _POUND_FORCE),
    "ftlbf": ("ft lbf", 1.0),
    "Nm": ("ft lbf", 1.0 / (_POUND_FORCE * _FOOT)),
    "lbf_ft2": ("lbf/ft^2", 1.0),
    "slug_ft3": ("slug/ft^3", 1.0),
}

#: Inputs of a file that the motion and the air give: name -> name of the value in `aircraft.py`.
MOTION: Mapping[str, str] = {
    "trueAirspeed": "speed",
    "angleOfAttack": "alpha",
    "angleOfSideslip": "beta",
    "bodyAngularRate_Roll": "roll_rate",
    "bodyAngularRate_Pitch": "pitch_rate",
    "bodyAngularRate_Yaw": "yaw_rate",
    "eulerAngle_Roll": "roll",
    "eulerAngle_Pitch": "pitch",
    "eulerAngle_Yaw": "yaw",
    "altitudeMSL": "altitude",
    "altitudeMsl": "altitude",
    "heightOfCgWrtRwy": "altitude",
    "mach": "mach",
    "dynamicPressure": "dynamic_pressure",
    "airDensity": "density",
    "equivalentAirspeed": "equivalent_airspeed",
}

#: Outputs of which an aircraft needs every one.
MASS = "totalMass"
INERTIA = tuple(f"bodyMomentOfInertia_{axis}" for axis in _AXES)
PRODUCTS = tuple(f"bodyProductOfInertia_{axes}" for axes in ("XY", "ZX", "YZ"))
AREA = "referenceWingArea"
SPAN = "referenceWingSpan"
CHORD = "referenceWingChord"
MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in _AXES)
#: Forces of the air, in body axes, or lift and drag in stability axes.
FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
LIFT = "totalCoefficientOfLift"
DRAG = "totalCoefficientOfDrag"
#: Outputs that are 0 where no file gives them.
THRUST = tuple(f"thrustBodyForce_{axis}" for axis in "XYZ")
THRUST_MOMENT = tuple(f"thrustBodyMoment_{axis}" for axis in _AXES)
CENTER = tuple(f"bodyPositionOfCmWrtMrc_{axis}" for axis in "XYZ")
#: Outputs that must be positive.
POSITIVE = (MASS, *INERTIA, AREA, SPAN, CHORD)

_BY_UNIT = {
    "1": ("mach", *MOMENTS, *FORCES, LIFT, DRAG),
    "rad": ("angleOfAttack", "angleOfSideslip", *(f"eulerAngle_{axis}" for axis in _AXES)),
    "rad/s": tuple(f"bodyAngularRate_{axis}" for axis in _AXES),
    "ft": ("altitudeMSL", "altitudeMsl", "heightOfCgWrtRwy", SPAN, CHORD, *CENTER),
    "ft/s": ("trueAirspeed", "equivalentAirspeed"),
    "ft^2": (AREA,),
    "slug": (MASS,),
    "slug ft^2": (*INERTIA, *PRODUCTS),
    "lbf": THRUST,
    "ft lbf": THRUST_MOMENT,
    "lbf/ft^2": ("dynamicPressure",),
    "slug/ft^3": ("airDensity",),
}
#: Variable that the equations of an aircraft use -> its unit in them.
UNIT_OF: Mapping[str, str] = {name: unit for unit, group in _BY_UNIT.items() for name in group}
