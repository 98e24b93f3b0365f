"""The `Model` of DAVE-ML files with aerodynamics, mass properties and propulsion.

Files are joined by their standard names: an input that is an output of another file is that output,
one of `names.MOTION` follows from the motion and the air, one with an initial value is a parameter,
and any other is an input of the aircraft. With q̄ the dynamic pressure, S, b, c the reference area,
span and chord and r the position of the centre of mass from the moment reference centre:

    F = q̄ S (C_X, C_Y, C_Z),  M = q̄ S (b C_l, c C_m, b C_n) - r x F

Lift and drag are along the stability axes. Thrust and its moment act at the centre of mass.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca

from hfa_aircraft.atmosphere import FT_TO_M, SEA_LEVEL, air_at
from hfa_aircraft.extras import Extras
from hfa_aircraft.model import Model
from hfa_aircraft.rigid_body import (
    STATES,
    acceleration,
    angular_acceleration,
    angular_velocity,
    rotation,
    state_rates,
    turn_rate,
    wind_axes,
)
from hfa_aircraft.signals import Signal
from hfa_aircraft.tables import Interpolator
from hfa_daveml import names
from hfa_daveml.document import Document, Variable, read_document
from hfa_daveml.functions import Expressions
from hfa_support.errors import BadInputError, shortened

_GRAVITY = 9.80665 / FT_TO_M
#: Angle of attack at which the aircraft carries its weight at the speed of its usual trim.
_ALPHA = math.radians(5.0)
#: Words in the name of an input that a pilot moves, although the file gives its initial value.
_MOVED = ("deflection", "powerlever", "throttle", "pilotcontrol")


def read_model(text: str) -> Model:
    """The aircraft of one or several files, AERO.dml+INERTIA.dml+PROPULSION.dml.

    BadInputError names the file and the variable that is missing, unknown or given twice, has
    another unit, or is not positive.
    """
    paths = text.split("+")
    try:
        contents = [Path(path).read_bytes() for path in paths]
        documents = [read_document(path) for path in paths]
    except OSError as error:
        raise BadInputError(
            f"{error.filename} cannot be read ({error.strerror}); give files joined by +"
        ) from error
    digest = hashlib.sha256(b"".join(contents)).hexdigest()
    return _Files(documents).model((text, digest))


class _Files:
    """The files of an aircraft, joined by the names of their variables."""

    def __init__(self, documents: Sequence[Document]) -> None:
        self._documents = documents
        self._outputs: dict[str, tuple[Document, Variable]] = {}
        for document in documents:
            for variable in document.variables.values():
                if variable.is_output:
                    self._add_output(document, variable)
        self._refuse_missing()
        free = [
            (document, variable)
            for document in documents
            for variable in document.variables.values()
            if variable.is_input
            and variable.name not in names.MOTION
            and variable.name not in self._outputs
        ]
        self.inputs = {
            each.name: (document, each) for document, each in free if self._is_moved(each)
        }
        self.parameters = {
            each.name: (document, each) for document, each in free if not self._is_moved(each)
        }

    def _add_output(self, document: Document, variable: Variable) -> None:
        if variable.name in self._outputs:
            other = self._outputs[variable.name][0].path
            raise document.error(f"variable {variable.key}", f"is an output of {other} too")
        self._outputs[variable.name] = (document, variable)

    def _is_moved(self, variable: Variable) -> bool:
        if variable.initial is None:
            return True
        return any(word in variable.name.lower() for word in _MOVED)

    def _refuse_missing(self) -> None:
        needed = [names.MASS, *names.INERTIA, names.AREA, names.SPAN, names.CHORD, *names.MOMENTS]
        needed.append(names.FORCES[1])
        if not {names.LIFT, names.DRAG} <= set(self._outputs):
            needed += [names.FORCES[0], names.FORCES[2]]
        missing = [name for name in needed if name not in self._outputs]
        if missing:
            files = "+".join(document.path for document in self._documents)
            raise BadInputError(
                f"{files}: no output is {', '.join(missing)}; add the file that gives it, "
                "joined by +"
            )

    def model(self, source: tuple[str, str]) -> Model:
        """The declaration of the aircraft."""
        inputs = SimpleNamespace(**dict.fromkeys(self.inputs, 0.0))
        parameters = {name: _start(*each) for name, each in self.parameters.items()}
        constants = self._values(_standing(), inputs, SimpleNamespace(**parameters))
        self._refuse_not_positive(constants)
        speed = self._usual_speed(constants)
        steady = tuple(name for name in STATES if name not in ("yaw", "altitude"))
        imposed = {
            **{"speed": speed, "altitude": 0.0, "yaw": 0.0, "gamma": 0.0, "turn_rate": 0.0},
            "beta": 0.0,
        }
        return Model(
            self._documents[0].title or Path(self._documents[0].path).stem,
            self._states(speed),
            {name: self._signal(*each) for name, each in self.inputs.items()},
            self._equations,
            parameters={name: self._signal(*each) for name, each in self.parameters.items()},
            outputs={
                "gamma": Signal("rad", 0.1),
                "turn_rate": Signal("rad/s", 0.1),
                "load_factor": Signal(),
                "mach": Signal(nominal=0.1),
            },
            trim=imposed,
            steady=steady,
            linear=steady,
            schedule="speed",
            extras=Extras(
                source=source, notes=("read from DAVE-ML over a flat Earth in standard air",)
            ),
        )

    def _refuse_not_positive(self, constants: Callable[[str], Any]) -> None:
        """BadInputError for a mass, moment of inertia or reference length that is not positive."""
        for name in names.POSITIVE:
            size = _number(constants(name))
            if not size > 0.0:
                document, variable = self._outputs[name]
                raise document.error(
                    f"variable {variable.key}", f"{name} is {size:g}; give a positive number"
                )

    def _usual_speed(self, constants: Callable[[str], Any]) -> float:
        """The speed, ft/s, at which the lift at sea level is the weight, with alpha `_ALPHA` and
        all else 0."""
        upward = -_number(self._coefficients(constants, _ALPHA)[2])
        if not upward > 0.0:
            files = "+".join(document.path for document in self._documents)
            raise BadInputError(
                f"{files}: the force of the air at an angle of attack of 5 deg is not upward; check"
                " the signs of its coefficients"
            )
        weight = _number(constants(names.MASS)) * _GRAVITY
        area = _number(constants(names.AREA))
        return math.sqrt(2.0 * weight / (SEA_LEVEL.density * area * upward))

    def _states(self, speed: float) -> dict[str, Signal]:
        """Signals of the states; alpha and beta within the breakpoints of every table."""
        angle = Signal("rad", 0.1, -3.1, 3.1)
        rate = Signal("rad/s", 0.1, rate=1.0)
        low, high = self._range("angleOfAttack", 0.6)
        left, right = self._range("angleOfSideslip", 0.5)
        signals = {
            "speed": Signal("ft/s", speed, 0.3 * speed, 5.0 * speed, speed, rate=_GRAVITY),
            "alpha": Signal("rad", 0.1, low, high, min(_ALPHA, high)),
            "beta": Signal("rad", 0.1, left, right),
            **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), rate),
            "roll": angle,
            "pitch": Signal("rad", 0.1, -1.5, 1.5, _ALPHA),
            "yaw": Signal("rad", 0.1),
            "altitude": Signal("ft", 10000.0, -1000.0, 150000.0),
        }
        return {name: signals[name] for name in STATES}

    def _range(self, name: str, widest: float) -> tuple[float, float]:
        """The narrowest range of the tables over a variable, rad; within ± widest."""
        low, high = -widest, widest
        for document in self._documents:
            variable = document.by_name(name)
            if variable is None:
                continue
            _, factor = _unit(document, variable)
            for function in document.functions.values():
                for axis, points in zip(function.axes, function.table.breakpoints, strict=True):
                    if axis.key == variable.key:
                        low = max(low, factor * max(axis.least, points[0]))
                        high = min(high, factor * min(axis.most, points[-1]))
        return float(low), float(high)

    def _signal(self, document: Document, variable: Variable) -> Signal:
        """Return its unit, the initial value of a search, and its limits: those of the file and of
        the tables over it."""
        unit, factor = _unit(document, variable)
        low, high = variable.least, variable.most
        for function in document.functions.values():
            for axis, points in zip(function.axes, function.table.breakpoints, strict=True):
                if axis.key == variable.key:
                    low = max(low, axis.least, points[0])
                    high = min(high, axis.most, points[-1])
        start = _start(document, variable)
        nominal = 0.1 if unit in ("rad", "1") else max(abs(start), 1.0)
        low, high = factor * low, factor * high
        return Signal("" if unit == "1" else unit, nominal, low, high, start)

    def _equations(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Rates by state and outputs by name."""
        air = air_at(x.altitude)
        velocity = x.speed * wind_axes(x.alpha, x.beta)[:, 0]
        to_body = rotation(x.roll, x.pitch, x.yaw).T
        rates = angular_velocity(x)
        pressure = 0.5 * air.density * x.speed**2
        motion = {name: getattr(x, name) for name in STATES} | {
            "mach": x.speed / air.sound,
            "density": air.density,
            "dynamic_pressure": pressure,
            "equivalent_airspeed": x.speed * ca.sqrt(air.density / SEA_LEVEL.density),
        }
        value = self._values(motion, u, p)
        mass = value(names.MASS)
        air_force = pressure * value(names.AREA) * self._coefficients(value, x.alpha)
        arms = ca.vertcat(value(names.SPAN), value(names.CHORD), value(names.SPAN))
        about_reference = pressure * value(names.AREA) * arms * self._vector(value, names.MOMENTS)
        center = self._vector(value, names.CENTER)
        moment = about_reference - ca.cross(center, air_force)
        specific = (air_force + self._vector(value, names.THRUST)) / mass
        turning = angular_acceleration(
            rates, moment + self._vector(value, names.THRUST_MOMENT), self._inertia(value)
        )
        down = to_body[:, 2]
        velocity_rate = acceleration(velocity, rates, specific, _GRAVITY * down)
        climb = -ca.dot(down, velocity)
        outputs = {
            "gamma": ca.asin(climb / x.speed),
            "turn_rate": turn_rate(x),
            "load_factor": -specific[2] / _GRAVITY,
            "mach": motion["mach"],
        }
        return state_rates(x, velocity, velocity_rate, turning, climb), outputs

    def _coefficients(self, value: Callable[[str], Any], alpha: Any) -> Any:
        """(3,) of the force of the air, body axes."""
        side = value(names.FORCES[1])
        if names.FORCES[0] in self._outputs:
            return ca.vertcat(value(names.FORCES[0]), side, value(names.FORCES[2]))
        along = ca.vertcat(-value(names.DRAG), side, -value(names.LIFT))
        return ca.mtimes(wind_axes(alpha, 0.0), along)

    def _vector(self, value: Callable[[str], Any], three: Sequence[str]) -> Any:
        """Three outputs, 0 where no file gives one."""
        return ca.vertcat(*(value(name) if name in self._outputs else 0.0 for name in three))

    def _inertia(self, value: Callable[[str], Any]) -> Any:
        """(3, 3), slug ft²; products of inertia are ∫ xy dm and so on."""
        xx, yy, zz = (value(name) for name in names.INERTIA)
        xy, zx, yz = ca.vertsplit(self._vector(value, names.PRODUCTS))
        return ca.vertcat(
            ca.horzcat(xx, -xy, -zx), ca.horzcat(-xy, yy, -yz), ca.horzcat(-zx, -yz, zz)
        )

    def _values(self, motion: Mapping[str, Any], u: Any, p: Any) -> Callable[[str], Any]:
        """A function: name of an output -> its value in the units of the model."""
        table = Interpolator()
        made: dict[str, Expressions] = {}

        def value(name: str) -> Any:
            document, variable = self._outputs[name]
            if document.path not in made:
                made[document.path] = Expressions(document, given(document), table)
            _, factor = _unit(document, variable)
            return factor * made[document.path][variable.key]

        def given(document: Document) -> dict[str, Any]:
            values = {}
            for variable in document.variables.values():
                if variable.is_input:
                    _, factor = _unit(document, variable)
                    values[variable.key] = taken(variable) / factor
            return values

        def taken(variable: Variable) -> Any:
            if variable.name in names.MOTION:
                return motion[names.MOTION[variable.name]]
            if variable.name in self._outputs:
                return value(variable.name)
            return getattr(u if variable.name in self.inputs else p, variable.name)

        return value


def _number(expression: Any) -> float:
    """The value of an expression without symbols."""
    return float(ca.evalf(ca.SX(expression)))


def _standing() -> dict[str, float]:
    """The motion at which the usual speed is sought."""
    motion = dict.fromkeys(names.MOTION.values(), 0.0)
    return motion | {"alpha": _ALPHA, "speed": 300.0, "density": float(SEA_LEVEL.density)}


def _start(document: Document, variable: Variable) -> float:
    """The initial value of a variable in the units of the model; 0 without one."""
    _, factor = _unit(document, variable)
    return factor * (variable.initial or 0.0)


def _unit(document: Document, variable: Variable) -> tuple[str, float]:
    """The unit of the model, and how many of these the unit of a variable is.

    BadInputError for an unknown unit, and for one of another quantity: a mass in ft.
    """
    place = f"variable {variable.key}"
    if variable.units not in names.UNITS:
        raise document.error(
            place, f"its unit {shortened(variable.units)!r} is unknown; use one of S-119"
        )
    unit, factor = names.UNITS[variable.units]
    expected = names.UNIT_OF.get(variable.name, unit)
    if unit != expected:
        raise document.error(
            place,
            f"{variable.name} in {variable.units!r} cannot be converted to {expected!r};"
            " correct its unit",
        )
    return unit, factor
