"""The `Model` of DAVE-ML files with aerodynamics, mass properties and propulsion.

Files are connected by the standard names of their variables. The value of an input is determined
by the first of these rules that applies:

- An input listed in `names.MOTION` follows from the motion and the air.
- An input that is an output of a file has the value of that output.
- An input without initial value, or with a word of `_COMMANDS` in its name, is an input of the
  model.
- Any other input is a parameter of the model.

An input that several variables declare has one initial value, and the narrowest of their limits.

  F = q̄ S (C_X, C_Y, C_Z),  M = q̄ S (b C_l, c C_m, b C_n) - r x F

q̄ is the dynamic pressure. S, b and c are the reference area, span and chord. r is the position
of the center of mass relative to the moment reference center. Lift and drag are along the
stability axes. Thrust and its moment act at the center of mass.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import casadi as ca

import hfa_daveml.check_cases as names
from hfa_aircraft.about import About, Domain, Source
from hfa_aircraft.loading import joined_files
from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import (
    GRAVITY,
    STATES,
    Motion,
    inertia_matrix,
    inertia_warning,
    rigid_aircraft,
    wind_axes,
)
from hfa_aircraft.rigid.atmosphere import SEA_LEVEL
from hfa_aircraft.rigid.tables import Interpolator
from hfa_aircraft.signals import ISA, Signal
from hfa_daveml.check_cases import refuse_wrong
from hfa_daveml.document import Document, Variable, read_document
from hfa_daveml.functions import Expressions
from hfa_support.errors import BadInputError, file_faults, shortened
from hfa_support.files import regular_file

_GRAVITY = GRAVITY["english"]
#: Angle of attack, rad, at which the lift equals the weight at the default speed.
_ALPHA = math.radians(5.0)
#: Largest angle of attack and sideslip without a table that depends on them, rad.
_WIDEST_ALPHA = 0.6
_WIDEST_BETA = 0.5
#: An input whose name contains one of these words is an input of the model, even if it has an
#: initial value.
_COMMANDS = ("deflection", "powerlever", "throttle", "pilotcontrol")


def read_model(text: str) -> Model:
    """Return the aircraft of one or several files, such as AERO.dml+INERTIA.dml+PROPULSION.dml.

    text: paths, joined by +

    Raises BadInputError if

    - a file cannot be read or is not a valid DAVE-ML file,
    - an output of a check case differs from the tables and formulas,
    - a required output is missing, defined twice, in a wrong unit or not positive,
    - an input has another initial value, or another quantity as its unit, in another file,
    - the aerodynamic force at alpha = 5 deg is not upward.
    """
    contents, documents = [], []
    for path in joined_files(text):
        with file_faults(path):
            contents.append(regular_file(path).read_bytes())
            documents.append(read_document(path))
    source = Source(text, hashlib.sha256(b"".join(contents)).hexdigest())
    model = _Files(documents).model(source)
    for document in documents:
        refuse_wrong(document)
    return model


class _FileVariable(NamedTuple):
    """Variable of one of the files of an aircraft."""

    document: Document
    variable: Variable

    @property
    def unit(self) -> names.ModelUnit:
        """The model's unit for the variable, and the factor to it."""
        units, name = self.variable.units, self.variable.name
        known = names.model_unit(units)
        if known is None:
            raise self.error(f"the unit {shortened(units)!r} is unknown; use a unit of S-119")
        expected = names.UNIT_OF.get(name, known.unit)
        if known.unit != expected:
            raise self.error(
                f"{name} is in {units!r}, which cannot be converted to {expected!r}; correct the "
                "unit"
            )
        return known

    @property
    def start(self) -> float:
        """The initial value in the unit of the model, by default 0."""
        return self.unit.factor * (self.variable.initial or 0.0)

    def signal(self) -> Signal:
        """Return unit, nominal value, limits and initial value in the model's units."""
        # The limits are the narrower of the variable's own and the ranges of the tables that depend
        # on it. The nominal value is 0.1 for an angle or a number without unit, and otherwise
        # max(|initial value|, 1).
        unit, factor = self.unit
        variable = self.variable
        least, most = self.document.range_of_tables(variable)
        low = factor * max(variable.least, least)
        high = factor * min(variable.most, most)
        nominal = 0.1 if unit in ("rad", "") else max(abs(self.start), 1.0)
        return Signal(unit, nominal, low, high, self.start)

    def error(self, fault: str) -> BadInputError:
        """Return a BadInputError that names the file, the variable and the fault."""
        return self.document.error(f"variable {self.variable.key}", fault)


class _Files:
    """The files of an aircraft, connected by the standard names of their variables.

    inputs, parameters: standard name -> signal, of those that no file and no motion defines
    """

    def __init__(self, documents: Sequence[Document]) -> None:
        self._documents = documents
        self._outputs: dict[str, _FileVariable] = {}
        self.inputs: dict[str, Signal] = {}
        self.parameters: dict[str, Signal] = {}
        variables = [
            _FileVariable(document, variable)
            for document in documents
            for variable in document.variables.values()
        ]
        for file_variable in variables:
            if file_variable.variable.is_output:
                self._add_output(file_variable)
        self._refuse_missing_outputs()
        # After all outputs: an input with the name of an output is no input of the model.
        declarations: dict[str, list[_FileVariable]] = {}
        for file_variable in variables:
            name = file_variable.variable.name
            if file_variable.variable.is_input and name not in (*names.MOTION, *self._outputs):
                declarations.setdefault(name, []).append(file_variable)
        for name, declared in declarations.items():
            group = self.inputs if _is_command(declared[0].variable) else self.parameters
            group[name] = _common_signal(declared)

    def _add_output(self, output: _FileVariable) -> None:
        """Store an output by its name. Raises BadInputError if it is that of another file, too."""
        other = self._outputs.setdefault(output.variable.name, output)
        if other is not output:
            raise output.error(
                f"this output is also an output of {other.document.path}; remove one of the two "
                "outputs"
            )

    def _refuse_missing_outputs(self) -> None:
        """Raise BadInputError unless the files have the outputs that every aircraft requires."""
        needed = [
            names.MASS,
            *names.INERTIA,
            names.AREA,
            names.SPAN,
            names.CHORD,
            *names.MOMENTS,
            names.FORCES[1],
        ]
        # Lift and drag replace the forces along the axes X and Z.
        if not {names.LIFT, names.DRAG} <= set(self._outputs):
            needed += [names.FORCES[0], names.FORCES[2]]
        missing = [name for name in needed if name not in self._outputs]
        if missing:
            files = "+".join(document.path for document in self._documents)
            raise BadInputError(
                f"{files}: missing outputs: {', '.join(missing)}; add +FILE with the file that "
                "defines these outputs"
            )

    def model(self, source: Source) -> Model:
        """Return the aircraft as a `Model`, from paths joined by + and the hash of the files."""
        inputs = SimpleNamespace(**dict.fromkeys(self.inputs, 0.0))
        parameters = {name: signal.start for name, signal in self.parameters.items()}
        nominal_value = self._values(_nominal_motion(), inputs, SimpleNamespace(**parameters))
        self._refuse_not_positive(nominal_value)
        low, high = self._range("angleOfAttack", _WIDEST_ALPHA)
        sideslip = self._range("angleOfSideslip", _WIDEST_BETA)
        # Unit, nominal value and limits; limits that no table states are assumed.
        alpha = Signal(
            "rad", 0.1, low, high, start=min(_ALPHA, high), assumed=high == _WIDEST_ALPHA
        )
        beta = Signal("rad", 0.1, *sideslip, assumed=sideslip[1] == _WIDEST_BETA)
        return rigid_aircraft(
            self._documents[0].title or Path(self._documents[0].path).stem,
            self._equations,
            system="english",
            speed=self._usual_speed(nominal_value),
            altitude=0.0,
            alpha=alpha,
            beta=beta,
            inputs=self.inputs,
            parameters=self.parameters,
            outputs={},
            holds_beta=True,
            source=source,
            about=About(
                notes=("read from DAVE-ML over a flat Earth in standard air",),
                warnings=self._warnings(nominal_value),
                configuration=self._configuration,
            ),
            domain=Domain(self._table_ranges()),
        )

    def _refuse_not_positive(self, nominal_value: Callable[[str], Any]) -> None:
        """Raise BadInputError if a mass, moment of inertia or reference length is not positive."""
        for name in names.POSITIVE:
            size = _number(nominal_value(name))
            if not size > 0.0:
                raise self._outputs[name].error(f"{name} is {size:g}; give a positive number")

    def _warnings(self, nominal_value: Callable[[str], Any]) -> tuple[str, ...]:
        """Return a sentence if no rigid body has the inertias of the files."""
        # A product of inertia that no file defines is 0 (`_vector`).
        inertia = inertia_matrix(
            [_number(nominal_value(name)) for name in names.INERTIA],
            [_number(self._vector(nominal_value, (name,))) for name in names.PRODUCTS],
        )
        warning = inertia_warning(inertia)
        return (warning,) if warning else ()

    def _usual_speed(self, nominal_value: Callable[[str], Any]) -> float:
        """Return the speed, ft/s, of level flight at sea level and alpha = `_ALPHA`.

        nominal_value: name of an output -> its value at `_nominal_motion`
        """
        upward = -_number(self._coefficients(nominal_value, _ALPHA)[2])  # -C_Z
        if not upward > 0.0:
            files = "+".join(document.path for document in self._documents)
            raise BadInputError(
                f"{files}: the aerodynamic force at alpha = 5 deg is not upward; check the signs "
                "of the force coefficients"
            )
        weight = _number(nominal_value(names.MASS)) * _GRAVITY
        area = _number(nominal_value(names.AREA))
        return math.sqrt(2.0 * weight / (SEA_LEVEL.density * area * upward))

    def _range(self, name: str, widest: float) -> tuple[float, float]:
        """Return the range of a variable within ± `widest` and the ranges of all its tables.

        name: standard name of the variable; the range is in the model's unit
        """
        low = -widest
        high = widest
        for document in self._documents:
            variable = document.by_name(name)
            if variable is not None:
                factor = _FileVariable(document, variable).unit.factor
                least, most = document.range_of_tables(variable)
                low = max(low, factor * least)
                high = min(high, factor * most)
        return low, high

    def _table_ranges(self) -> dict[str, tuple[float, float, str]]:
        """Return the ranges of tables over alpha, Mach number and dynamic pressure, by name."""
        ranges = {}
        for standard_name in ("angleOfAttack", "mach", "dynamicPressure"):
            low, high = self._range(standard_name, math.inf)
            if math.isfinite(high - low):
                ranges[names.MOTION[standard_name]] = (low, high, "the range of the tables")
        return ranges

    def _equations(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the rates of the states, and the outputs, each by name."""
        motion = Motion(x, _GRAVITY, "english", p.isa)
        value = self._values(_motion_values(x, motion), u, p)

        # Aerodynamic force, and its moment about the center of gravity
        pressure_area = motion.pressure * value(names.AREA)
        air_force = pressure_area * self._coefficients(value, x.alpha)
        lengths = ca.vertcat(value(names.SPAN), value(names.CHORD), value(names.SPAN))
        moment_at_reference = pressure_area * lengths * self._vector(value, names.MOMENTS)
        center = self._vector(value, names.CENTER)  # relative to the moments' reference point
        aerodynamic_moment = moment_at_reference - ca.cross(center, air_force)

        thrust = self._vector(value, names.THRUST)
        specific_force = (air_force + thrust) / value(names.MASS)
        inertia = inertia_matrix(
            [value(name) for name in names.INERTIA],
            ca.vertsplit(self._vector(value, names.PRODUCTS)),
        )
        rates, outputs = motion.rates_and_outputs(
            specific_force, aerodynamic_moment + self._vector(value, names.THRUST_MOMENT), inertia
        )

        # Lift and drag are components of the aerodynamic force in wind axes.
        in_wind_axes = ca.mtimes(wind_axes(x.alpha, x.beta).T, air_force)
        forces = motion.forces(
            lift=-in_wind_axes[2],
            drag=-in_wind_axes[0],
            pitching_moment=aerodynamic_moment[1],  # without that of the thrust
            thrust=thrust[0],
            mass=value(names.MASS),
            area=value(names.AREA),
            chord=value(names.CHORD),
        )
        return rates, outputs | forces

    def _configuration(self, x: Any, u: Any, p: Any) -> dict[str, tuple[float, str]]:
        """Return mass, center of gravity, inertias and sizes, name -> (value, unit)."""
        # x, u, p: values of the states, of the inputs, and of the parameters followed by `ISA`
        state, inputs, parameters = (
            SimpleNamespace(**dict(zip(known, vector, strict=True)))
            for known, vector in ((STATES, x), (self.inputs, u), ((*self.parameters, ISA), p))
        )
        motion = Motion(state, _GRAVITY, "english", parameters.isa)
        value_of = self._values(_motion_values(state, motion), inputs, parameters)
        outputs = {
            "mass": names.MASS,
            **dict(zip(("Ixx", "Iyy", "Izz"), names.INERTIA, strict=True)),
            "Ixz": names.PRODUCTS[1],
            "reference_area": names.AREA,
            "reference_span": names.SPAN,
            "reference_chord": names.CHORD,
            **{
                f"center_of_gravity_{axis}": name
                for axis, name in zip("xyz", names.CENTER, strict=True)
            },
        }
        return {  # 0 for an output that no file defines
            name: (_number(self._vector(value_of, (output,))), names.UNIT_OF[output])
            for name, output in outputs.items()
        }

    def _coefficients(self, value: Callable[[str], Any], alpha: Any) -> Any:
        """Return the coefficients (C_X, C_Y, C_Z) of the aerodynamic force in body axes, (3,)."""
        # If no file defines C_X, C_X and C_Z are those of lift and drag.
        side = value(names.FORCES[1])
        if names.FORCES[0] in self._outputs:
            return ca.vertcat(value(names.FORCES[0]), side, value(names.FORCES[2]))
        along = ca.vertcat(-value(names.DRAG), side, -value(names.LIFT))
        return ca.mtimes(wind_axes(alpha, 0.0), along)

    def _vector(self, value: Callable[[str], Any], outputs: Sequence[str]) -> Any:
        """Return outputs as a vector, (k,), with 0 for each that no file defines."""
        return ca.vertcat(*(value(name) if name in self._outputs else 0.0 for name in outputs))

    def _values(self, motion: Mapping[str, Any], u: Any, p: Any) -> Callable[[str], Any]:
        """Return a function from the name of an output to its value in the units of the model.

        motion: name in `names.MOTION` -> value
        u, p: inputs and parameters, by attributes
        """
        # A file is built when its first output is needed: its inputs may be outputs of other files,
        # which are then built first.
        table = Interpolator()
        built: dict[str, Expressions] = {}  # path of a file -> its variables

        def value(name: str) -> Any:
            """Return the value of an output in the unit of the model."""
            output = self._outputs[name]
            path = output.document.path
            if path not in built:
                built[path] = Expressions(output.document, inputs_of(output.document), table)
            return output.unit.factor * built[path][output.variable.key]

        def inputs_of(document: Document) -> dict[str, Any]:
            """Return varID -> value of each input of a file, in the units of the file."""
            return {
                variable.key: input_value(variable.name)
                / _FileVariable(document, variable).unit.factor
                for variable in document.variables.values()
                if variable.is_input
            }

        def input_value(name: str) -> Any:
            """Return the value of an input in the unit of the model."""
            if name in names.MOTION:
                return motion[names.MOTION[name]]
            if name in self._outputs:
                return value(name)
            return getattr(u if name in self.inputs else p, name)

        return value


def _common_signal(declarations: Sequence[_FileVariable]) -> Signal:
    """Return the signal of an input that several variables declare, with the narrowest limits."""
    first, *others = declarations
    signals = [declaration.signal() for declaration in declarations]
    for other, signal in zip(others, signals[1:], strict=True):
        same_unit = signal.unit == signals[0].unit
        same_default = (first.variable.initial is None) == (other.variable.initial is None)
        if not (same_unit and same_default and signal.start == signals[0].start):
            raise other.error(
                f"this input has another unit or initial value in {first.document.path}; give "
                "both the same unit and the same initial value, or none"
            )
    return signals[0]._replace(
        min=max(signal.min for signal in signals), max=min(signal.max for signal in signals)
    )


def _is_command(variable: Variable) -> bool:
    """Return whether an input of a file is an input of the model, and not a parameter."""
    return variable.initial is None or any(word in variable.name.lower() for word in _COMMANDS)


def _motion_values(x: Any, motion: Motion) -> dict[str, Any]:
    """Return the quantities of the motion that a file may use, by their names in `names.MOTION`."""
    density = motion.air.density
    return {name: getattr(x, name) for name in STATES} | {
        "mach": motion.mach,
        "density": density,
        "dynamic_pressure": motion.pressure,
        "equivalent_airspeed": x.speed * ca.sqrt(density / SEA_LEVEL.density),
    }


def _number(expression: Any) -> float:
    """Return the value of a CasADi expression that contains no symbols."""
    return float(ca.evalf(ca.SX(expression)))


def _nominal_motion() -> dict[str, float]:
    """Return the motion, 300 ft/s at sea level and `_ALPHA`, at which constants are evaluated."""
    # Mass, inertias and lengths seldom depend on the motion: any usual flight condition serves.
    motion = dict.fromkeys(names.MOTION.values(), 0.0)
    return motion | {"alpha": _ALPHA, "speed": 300.0, "density": float(SEA_LEVEL.density)}
