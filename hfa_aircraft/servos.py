"""Servos of the inputs of a model: their positions become states, and the inputs commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from hfa_aircraft.batch_simulation import saturated
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal, record
from hfa_support.errors import BadInputError, refuse_unknown, refuse_unless_positive


@dataclass(frozen=True)
class Servo:
    """Servo of an input: its position s follows the command u, within the limits of the input.

      s' = sat((sat(u, min, max) - s) / lag, ±rate)

    lag: s, > 0
    rate: largest |s'|, in the unit of the input per s; inf for none

    Raises BadInputError for a number that is not positive.

    >>> import hfa
    >>> hfa.Servo(0.02).rate
    inf
    """

    lag: float
    rate: float = math.inf

    def __post_init__(self) -> None:
        """Raise BadInputError for a number that is not positive."""
        refuse_unless_positive("the lag of a servo", self.lag, " s")
        if not self.rate > 0.0:
            raise BadInputError(f"the rate of a servo is {self.rate}; give a positive rate")


def with_servos(model: Model, servos: Servo | Mapping[str, Servo]) -> Model:
    """Return the model with servos: each position is a state INPUT_servo, at trim its command.

    Lag and finite rate are parameters, INPUT_servo_lag and INPUT_servo_rate.

    servos: of all inputs, or input -> servo; an input without one acts at once

    Raises BadInputError for an unknown input, and for a model whose equations are a program.

    >>> import hfa
    >>> hfa.with_servos(hfa.aircraft(), hfa.Servo(0.02)).linear[-1]
    'elevator_outer_servo'
    """
    of_input = dict.fromkeys(model.inputs, servos) if isinstance(servos, Servo) else dict(servos)
    for name in of_input:
        refuse_unknown("a servo moves the unknown input", name, tuple(model.inputs))
    native = model.source.native
    if native is not None:  # a model in converted units
        units = {name: model.native_factor(name) for name in of_input}
        in_units = {name: replace(s, rate=s.rate / units[name]) for name, s in of_input.items()}
        converted: Model = model.source.reload(with_servos(native, in_units))  # type: ignore[misc]
        return converted
    if model.domain.flown is not None:
        raise BadInputError(f"{model.title} is a program, whose inputs have no servos")
    positions = {f"{name}_servo": model.inputs[name] for name in of_input}
    parameters: dict[str, Signal] = {}
    for name, servo in of_input.items():
        parameters[f"{name}_servo_lag"] = Signal("s", servo.lag, min=0.0, start=servo.lag)
        if math.isfinite(servo.rate):
            unit = f"{model.unit(name)}/s"
            parameters[f"{name}_servo_rate"] = Signal(unit, servo.rate, min=0.0, start=servo.rate)
    return replace(
        model,
        equations=_WithServos(model, tuple(of_input)),
        states={**model.states, **positions},
        parameters={**model.parameters, **parameters},
        steady=(*model.steady, *positions),
        linear=(*model.linear, *positions),
        source=replace(model.source, reload=None),
    )


def positions_of_servos(model: Model) -> tuple[str, ...]:
    """Return the states of a model that are the positions of its servos."""
    return tuple(name for name in model.linear if name.removesuffix("_servo") in model.inputs)


@dataclass(frozen=True)
class _WithServos:
    """Equations (x, u, p, w) -> (rates by state, outputs by name) of a model with servos."""

    model: Model
    moved: tuple[str, ...]

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Any]:
        """Return the rates by state and the outputs by name, of a model moved by its servos."""
        names = self.model.layout.names
        commands = {name: getattr(u, name) for name in names.inputs}
        positions = {name: getattr(x, f"{name}_servo") for name in self.moved}
        rates, outputs = self.model.equations(
            record(names.states)(*(getattr(x, name) for name in names.states)),
            record(names.inputs)(*(commands | positions).values()),
            record(names.parameters)(*(getattr(p, name) for name in names.parameters)),
            w,
        )
        moving = {}
        for name, position in positions.items():
            signal = self.model.inputs[name]
            command = saturated(commands[name], signal.min, signal.max)
            speed = (command - position) / getattr(p, f"{name}_servo_lag")
            fastest = getattr(p, f"{name}_servo_rate", None)
            moving[f"{name}_servo"] = (
                speed if fastest is None else saturated(speed, -fastest, fastest)
            )
        return {**rates, **moving}, outputs
