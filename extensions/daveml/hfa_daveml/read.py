"""The `Model` of DAVE-ML files with aerodynamics, mass properties and propulsion.

Files are connected by the standard names of their variables. The value of an input is determined
by the first of these rules that applies:

- An input listed in `names.MOTION` follows from the motion and the air.
- An input that is an output of a file has the value of that output.
- An input without initial value, or with a word of `_COMMANDS` in its name, is an input of the
  model.
- Any other input is a parameter of the model.

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
from typing import Any

import casadi as ca

import hfa_daveml.names as names
from hfa_aircraft.about import About, Domain, Source
from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import GRAVITY, Motion, rigid_aircraft
from hfa_aircraft.rigid.atmosphere import SEA_LEVEL
from hfa_aircraft.rigid.motion import STATES, inertia_doubt, inertia_matrix, wind_axes
from hfa_aircraft.rigid.tables import Interpolator
from hfa_aircraft.signals import ISA, Signal
from hfa_daveml.check_cases import refuse_wrong
from hfa_daveml.document import Document, Variable, read_document
from hfa_daveml.functions import Expressions
from hfa_support.errors import BadInputError, shortened
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
    - the aerodynamic force at alpha = 5 deg is not upward.
    """
    paths = text.split("+")
    try:
        contents = [regular_file(path).read_bytes() for path in paths]
        documents = [read_document(path) for path in paths]
    except OSError as error:
        raise BadInputError(
            f"{error.filename} cannot be read ({error.strerror}); give readable files joined by +"
        ) from error
    digest = hashlib.sha256(b"".join(contents)).hexdigest()
    model = _Files(documents).model(Source(text, digest))
    for document in documents:
        refuse_wrong(document)
    return model


class _Files:
    """The files of an aircraft, connected by the standard names of their variables."""

    def __init__(self, documents: Sequence[Document]) -> None:
        self._documents = documents
        self._outputs: dict[str, tuple[Document, Variable]] = {}
        for document in documents:
            for variable in document.variables.values():
                if variable.is_output:
                    self._add_output(document, variable)
        self._refuse_missing_outputs()
        free = [
            (document, variable)
            for document in documents
            for variable in document.variables.values()
            if variable.is_input
            and variable.name not in names.MOTION
            and variable.name not in self._outputs
        ]
        self.inputs = {
            each.name: (document, each) for document, each in free if self._is_command(each)
        }
        self.parameters = {
            each.name: (document, each) for document, each in free if not self._is_command(each)
        }

    def _add_output(self, document: Document, variable: Variable) -> None:
        if variable.name in self._outputs:
            other = self._outputs[variable.name][0].path
            raise document.error(
                f"variable {variable.key}",
                f"this output is also an output of {other}; remove one of the two outputs",
            )
        self._outputs[variable.name] = (document, variable)

    def _is_command(self, variable: Variable) -> bool:
        if variable.initial is None:
            return True
        return any(word in variable.name.lower() for word in _COMMANDS)

    def _refuse_missing_outputs(self) -> None:
        needed = [names.MASS, *names.INERTIA, names.AREA, names.SPAN, names.CHORD, *names.MOMENTS]
        needed.append(names.FORCES[1])
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
        parameters = {name: _start(*each) for name, each in self.parameters.items()}
        value_at_rest = self._values(_motion_at_rest(), inputs, SimpleNamespace(**parameters))
        self._refuse_not_positive(value_at_rest)
        low, high = self._range("angleOfAttack", _WIDEST_ALPHA)
        sideslip = self._range("angleOfSideslip", _WIDEST_BETA)
        alpha = Signal("rad", 0.1, low, high, min(_ALPHA, high), assumed=high == _WIDEST_ALPHA)
        beta = Signal("rad", 0.1, *sideslip, assumed=sideslip[1] == _WIDEST_BETA)
        return rigid_aircraft(
            self._documents[0].title or Path(self._documents[0].path).stem,
            self._equations,
            system="english",
            speed=self._usual_speed(value_at_rest),
            altitude=0.0,
            alpha=alpha,
            beta=beta,
            inputs={name: self._signal(*each) for name, each in self.inputs.items()},
            parameters={name: self._signal(*each) for name, each in self.parameters.items()},
            outputs={},
            holds_beta=True,
            source=source,
            about=About(
                notes=("read from DAVE-ML over a flat Earth in standard air",),
                doubts=self._doubts(value_at_rest),
                configuration=self._configuration,
            ),
            domain=Domain(self._table_ranges()),
        )

    def _refuse_not_positive(self, value_at_rest: Callable[[str], Any]) -> None:
        """Raise BadInputError if a mass, moment of inertia or reference length is not positive."""
        for name in names.POSITIVE:
            size = _number(value_at_rest(name))
            if not size > 0.0:
                document, variable = self._outputs[name]
                raise document.error(
                    f"variable {variable.key}", f"{name} is {size:g}; give a positive number"
                )

    def _doubts(self, value_at_rest: Callable[[str], Any]) -> tuple[str, ...]:
        """Return a sentence if no rigid body has the inertias of the files."""
        inertia = inertia_matrix(
            [_number(value_at_rest(name)) for name in names.INERTIA],
            [_number(self._vector(value_at_rest, (name,))) for name in names.PRODUCTS],
        )
        doubt = inertia_doubt(ca.DM(inertia).full())
        return (doubt,) if doubt else ()

    def _usual_speed(self, value_at_rest: Callable[[str], Any]) -> float:
        """Return the speed, ft/s, of level flight at sea level and alpha = `_ALPHA`."""
        upward = -_number(self._coefficients(value_at_rest, _ALPHA)[2])
        if not upward > 0.0:
            files = "+".join(document.path for document in self._documents)
            raise BadInputError(
                f"{files}: the aerodynamic force at alpha = 5 deg is not upward; check the signs "
                "of the force coefficients"
            )
        weight = _number(value_at_rest(names.MASS)) * _GRAVITY
        area = _number(value_at_rest(names.AREA))
        return math.sqrt(2.0 * weight / (SEA_LEVEL.density * area * upward))

    def _range(self, name: str, widest: float) -> tuple[float, float]:
        """Return the lower and upper limit of an angle in the model, rad."""
        # The angle is within ± widest and within the range of every table that depends on it.
        low = -widest
        high = widest
        for document in self._documents:
            variable = document.by_name(name)
            if variable is not None:
                _, factor = _unit(document, variable)
                least, most = document.range_of_tables(variable)
                low = max(low, factor * least)
                high = min(high, factor * most)
        return low, high

    def _table_ranges(self) -> dict[str, tuple[float, float, str]]:
        """Return the ranges of tables over alpha, Mach number and dynamic pressure, by name."""
        ranges = {}
        for own_name in ("angleOfAttack", "mach", "dynamicPressure"):
            low, high = self._range(own_name, math.inf)
            if math.isfinite(high - low):
                ranges[names.MOTION[own_name]] = (low, high, "the range of the tables")
        return ranges

    def _signal(self, document: Document, variable: Variable) -> Signal:
        """Return unit, nominal value, limits and initial value in the model's units."""
        # The limits are the narrower of the variable's own limits and the ranges of the tables that
        # depend on the variable. The nominal value is 0.1 for an angle or a number without unit,
        # and max(|initial value|, 1) otherwise.
        unit, factor = _unit(document, variable)
        least, most = document.range_of_tables(variable)
        low = factor * max(variable.least, least)
        high = factor * min(variable.most, most)
        start = _start(document, variable)
        nominal = 0.1 if unit in ("rad", "") else max(abs(start), 1.0)
        return Signal(unit, nominal, low, high, start)

    def _equations(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the rates of the states, and the outputs, each by name."""
        motion = Motion(x, _GRAVITY, "english", p.isa)
        value = self._values(_motion_values(x, motion), u, p)
        pressure_area = motion.pressure * value(names.AREA)
        air_force = pressure_area * self._coefficients(value, x.alpha)
        lengths = ca.vertcat(value(names.SPAN), value(names.CHORD), value(names.SPAN))
        about_reference = pressure_area * lengths * self._vector(value, names.MOMENTS)
        center = self._vector(value, names.CENTER)
        moment = about_reference - ca.cross(center, air_force)
        thrust = self._vector(value, names.THRUST)
        specific = (air_force + thrust) / value(names.MASS)
        inertia = inertia_matrix(
            [value(name) for name in names.INERTIA],
            ca.vertsplit(self._vector(value, names.PRODUCTS)),
        )
        rates, outputs = motion.rates_and_outputs(
            specific, moment + self._vector(value, names.THRUST_MOMENT), inertia
        )
        in_wind_axes = ca.mtimes(wind_axes(x.alpha, x.beta).T, air_force)
        forces = motion.forces(
            lift=-in_wind_axes[2],
            drag=-in_wind_axes[0],
            pitching_moment=moment[1],  # without that of the thrust
            thrust=thrust[0],
            mass=value(names.MASS),
            area=value(names.AREA),
            chord=value(names.CHORD),
        )
        return rates, outputs | forces

    def _configuration(self, x: Any, u: Any, p: Any) -> dict[str, tuple[float, str]]:
        """Return mass, center of gravity, inertias and sizes, name -> (value, unit)."""
        state, inputs, parameters = (
            SimpleNamespace(**dict(zip(known, vector, strict=True)))
            for known, vector in ((STATES, x), (self.inputs, u), ((*self.parameters, ISA), p))
        )
        motion = Motion(state, _GRAVITY, "english", parameters.isa)
        value = self._values(_motion_values(state, motion), inputs, parameters)
        inertias = zip(("Ixx", "Iyy", "Izz"), names.INERTIA, strict=True)
        of_file = {"mass": (names.MASS, "slug")} | {
            name: (moment, "slug ft^2") for name, moment in inertias
        }
        of_file |= {"Ixz": (names.PRODUCTS[1], "slug ft^2"), "reference_area": (names.AREA, "ft^2")}
        of_file |= {"reference_span": (names.SPAN, "ft"), "reference_chord": (names.CHORD, "ft")}
        for axis, name in zip("xyz", names.CENTER, strict=True):
            of_file[f"center_of_gravity_{axis}"] = name, "ft"
        return {
            name: (_number(self._vector(value, (own,))), unit)
            for name, (own, unit) in of_file.items()
        }

    def _coefficients(self, value: Callable[[str], Any], alpha: Any) -> Any:
        """Return the coefficients (C_X, C_Y, C_Z) of the aerodynamic force in body axes, (3,)."""
        # If no file defines C_X, C_X and C_Z are computed from lift and drag.
        side = value(names.FORCES[1])
        if names.FORCES[0] in self._outputs:
            return ca.vertcat(value(names.FORCES[0]), side, value(names.FORCES[2]))
        along = ca.vertcat(-value(names.DRAG), side, -value(names.LIFT))
        return ca.mtimes(wind_axes(alpha, 0.0), along)

    def _vector(self, value: Callable[[str], Any], three: Sequence[str]) -> Any:
        """Return three outputs as a vector, (3,), with 0 for one that no file defines."""
        return ca.vertcat(*(value(name) if name in self._outputs else 0.0 for name in three))

    def _values(self, motion: Mapping[str, Any], u: Any, p: Any) -> Callable[[str], Any]:
        """Return a function from the name of an output to its value in the units of the model.

        A file is built when its first output is needed: its inputs may be outputs of other files,
        which are then built first.
        """
        table = Interpolator()
        built: dict[str, Expressions] = {}

        def value(name: str) -> Any:
            document, variable = self._outputs[name]
            if document.path not in built:
                built[document.path] = Expressions(document, inputs_of(document), table)
            _, factor = _unit(document, variable)
            return factor * built[document.path][variable.key]

        def inputs_of(document: Document) -> dict[str, Any]:
            values = {}
            for variable in document.variables.values():
                if variable.is_input:
                    _, factor = _unit(document, variable)
                    values[variable.key] = input_value(variable) / factor
            return values

        def input_value(variable: Variable) -> Any:
            if variable.name in names.MOTION:
                return motion[names.MOTION[variable.name]]
            if variable.name in self._outputs:
                return value(variable.name)
            return getattr(u if variable.name in self.inputs else p, variable.name)

        return value


def _motion_values(x: Any, motion: Motion) -> dict[str, Any]:
    """Return the quantities of the motion that a file may use, by name."""
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


def _motion_at_rest() -> dict[str, float]:
    """Return the motion at which constant outputs, such as the mass, are evaluated."""
    # The speed is 300 ft/s, the angle of attack is `_ALPHA`, and the air density is that of sea
    # level. All other quantities of the motion are 0.
    motion = dict.fromkeys(names.MOTION.values(), 0.0)
    return motion | {"alpha": _ALPHA, "speed": 300.0, "density": float(SEA_LEVEL.density)}


def _start(document: Document, variable: Variable) -> float:
    """Return the initial value of a variable in the units of the model, by default 0."""
    _, factor = _unit(document, variable)
    return factor * (variable.initial or 0.0)


def _unit(document: Document, variable: Variable) -> tuple[str, float]:
    """Return the model's unit for a variable, and the factor to it."""
    place = f"variable {variable.key}"
    known = names.model_unit(variable.units)
    if known is None:
        raise document.error(
            place, f"the unit {shortened(variable.units)!r} is unknown; use a unit of S-119"
        )
    expected = names.UNIT_OF.get(variable.name, known[0])
    if known[0] != expected:
        raise document.error(
            place,
            f"{variable.name} is in {variable.units!r}, which cannot be converted to {expected!r};"
            " correct the unit",
        )
    return known
