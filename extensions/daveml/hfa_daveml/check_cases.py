"""Check cases of a DAVE-ML file, recomputed from its tables and formulas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca

from hfa_aircraft.rigid.tables import Interpolator
from hfa_daveml.document import CheckCase, Document, Signal, Variable
from hfa_daveml.functions import Expressions
from hfa_support.errors import BadInputError
from hfa_support.units import conversion_factor

_AXES = ("Roll", "Pitch", "Yaw")
#: Unit as spelled in the standard or in older files -> spelling in reports.
_SPELLINGS: Mapping[str, str] = {
    **dict.fromkeys(("nd", "frac", "fracMAC"), ""),
    "pct": "%",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "f": "ft",
    "ft_s": "ft/s",
    "f_s": "ft/s",
    "m_s": "m/s",
    "nmi_h": "nmi/h",
    "ft2": "ft^2",
    "f2": "ft^2",
    "m2": "m^2",
    "slugft2": "slug ft^2",
    "kgm2": "kg m^2",
    "ftlbf": "ft lbf",
    "Nm": "N m",
    "lbf_ft2": "lbf/ft^2",
    "slug_ft3": "slug/ft^3",
}
#: Units of the model, "" of numbers without unit.
_UNITS = (
    *("", "%", "rad", "rad/s", "ft", "ft/s", "ft^2", "slug", "slug ft^2", "lbf", "ft lbf"),
    *("lbf/ft^2", "slug/ft^3"),
)

#: Inputs that follow from the motion and the air -> name of their value in `read._motion_values`.
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

#: Outputs that every aircraft must have.
MASS = "totalMass"
INERTIA = tuple(f"bodyMomentOfInertia_{axis}" for axis in _AXES)
PRODUCTS = tuple(f"bodyProductOfInertia_{axes}" for axes in ("XY", "ZX", "YZ"))
AREA = "referenceWingArea"
SPAN = "referenceWingSpan"
CHORD = "referenceWingChord"
MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in _AXES)
#: Aerodynamic forces, in body axes, or lift and drag in stability axes.
FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
LIFT = "totalCoefficientOfLift"
DRAG = "totalCoefficientOfDrag"
#: Outputs that are 0 if no file defines them.
THRUST = tuple(f"thrustBodyForce_{axis}" for axis in "XYZ")
THRUST_MOMENT = tuple(f"thrustBodyMoment_{axis}" for axis in _AXES)
CENTER = tuple(f"bodyPositionOfCmWrtMrc_{axis}" for axis in "XYZ")
#: Outputs that must be positive.
POSITIVE = (MASS, *INERTIA, AREA, SPAN, CHORD)

_BY_UNIT = {
    "": ("mach", *MOMENTS, *FORCES, LIFT, DRAG),
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
#: Variable used by the equations of motion -> its unit in them.
UNIT_OF: Mapping[str, str] = {name: unit for unit, group in _BY_UNIT.items() for name in group}


def spelled(units: str) -> str:
    """Return a unit of a file in the spelling of reports, for example ft/s for ft_s or f_s."""
    return _SPELLINGS.get(units, units)


class ModelUnit(NamedTuple):
    """Unit of the model, and the factor to it from a unit of a file."""

    unit: str
    factor: float


def model_unit(units: str) -> ModelUnit | None:
    """Return the model's unit of the quantity that a unit of a file measures, or None for a unit
    that is unknown or of a quantity that the model does not have.
    """
    for unit in _UNITS:
        factor = conversion_factor(spelled(units), unit)
        if factor is not None:
            return ModelUnit(unit, factor)
    return None


class CheckedOutput(NamedTuple):
    """One output of a check case, with its printed and its computed value.

    case: name of the check case
    output: name of the output
    printed: value printed in the file
    computed: value computed from the tables and formulas of the file
    tolerance: largest permitted difference, from the file
    """

    case: str
    output: str
    printed: float
    computed: float
    tolerance: float

    @property
    def ok(self) -> bool:
        """True if the printed and computed values differ by at most the tolerance."""
        return abs(self.computed - self.printed) <= self.tolerance


def value_of(document: Document, output: str, inputs: Mapping[str, float | ca.SX]) -> ca.SX:
    """Return a variable of a file at numbers or expressions for others, all by varID.

    Raises BadInputError if the variable cannot be computed from these.
    """
    given = {key: ca.SX(value) for key, value in inputs.items()}
    return ca.SX(Expressions(document, given, Interpolator())[output])


def checked_outputs(document: Document) -> list[CheckedOutput]:
    """Return the outputs of all check cases of a file with their computed values.

    Raises BadInputError if a case names an unknown variable, uses another unit than the variable,
    or contains an output that cannot be computed from the inputs.
    """
    return [output for case in document.cases for output in _outputs_of_case(document, case)]


def refuse_wrong(document: Document) -> None:
    """Raise BadInputError if an output of a check case is not that of the tables and formulas."""
    wrong = [output for output in checked_outputs(document) if not output.ok]
    if wrong:
        case, output, printed, computed, tolerance = wrong[0]
        raise BadInputError(
            f"{document.path}: {len(wrong)} outputs of the check cases differ from the tables and "
            f"formulas, as {output} of {case}: {printed:.10g} in the check case, computed "
            f"{computed:.10g}, tolerance {tolerance:.3g}; correct the file"
        )


def _outputs_of_case(document: Document, case: CheckCase) -> list[CheckedOutput]:
    """Return the outputs of one check case."""
    inputs = {_variable(document, case, given).key: given.value for given in case.inputs}
    outputs = []
    for signal in case.outputs:
        variable = _variable(document, case, signal)
        computed = float(ca.evalf(value_of(document, variable.key, inputs)))
        outputs.append(
            CheckedOutput(case.name, variable.name, signal.value, computed, signal.tolerance)
        )
    return outputs


def _variable(document: Document, case: CheckCase, signal: Signal) -> Variable:
    """Return the variable of a signal. Raises BadInputError for an unknown one or another unit."""
    place = f"check case {case.name}"
    variable = document.by_name(signal.name)
    if variable is None:
        raise document.error(
            place,
            f"signal {signal.name} is not a variable of the file; correct the name of the signal",
        )
    units = [spelled(named.units) for named in (signal, variable) if named.units]
    if len(set(units)) > 1:
        raise document.error(
            place,
            f"{signal.name} is in {signal.units} in the check case but in {variable.units} in "
            "the definition; give the same unit in both",
        )
    return variable
