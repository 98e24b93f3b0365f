"""First lines of reports on trims and linear models: condition, unstable modes, controls, modes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from hfa_aircraft.model import Model, recognized
from hfa_aircraft.signals import ISA
from hfa_support.reporting.text import ROUNDING, WIDTH, beside_unit, digits, shown_value, wrapped
from trim.point.status import BALANCE

if TYPE_CHECKING:
    from trim.linear.modes import Mode
    from trim.point.margins import Margin
    from trim.point.operating_point import OperatingPoint

#: Growth of a mode relative to the fastest mode that rounding and the tolerance of a trim cause.
_NEUTRAL = 1e-8
#: Smaller flight-path angles and turn rates, rad and rad/s, are those of level, straight flight.
_LEVEL = 1e-7
#: Smaller differences of the load factor from cos γ are those of definitions.
_LOAD = 1e-3
#: Largest usual angle of attack, deg, and least negative drag that is doubted, per lift.
_STEEPEST = 60.0
_NEGATIVE = 1e-6
#: Largest numbers of imposed values and of modes in first lines.
_MOST_VALUES = 4
_MOST_MODES = 6


def without_lines(notes: Iterable[str]) -> list[str]:
    """Return notes without numbers of lines, as in "<input> 899 896" and "f16.xml: 406"."""
    return [re.sub(r"(?<=>)(?: \d+)+|(?<=\.xml:) \d+", "", note) for note in notes]


def first_line(point: OperatingPoint, done: str, modes: Iterable[Mode] | None) -> str:
    """Return what was done, the equations and the condition, and below it the unstable modes: "HFA
    (published) trimmed: level, 68 ft/s, 40,000 ft, dihedral 10 deg", "unstable: none".

    done: "trimmed" or "linearized"
    modes: modes of the linear model at the point, or None for a point that is not a trim
    """
    model = point.model
    subject, equations = model.subject, model.about.equations
    if equations and equations not in subject:
        subject += f" ({equations})"
    condition = ", ".join(condition_words(point))
    lines = [f"{subject} {done}" + f": {condition}" * bool(condition)]
    if modes is not None:
        lines.append(_unstable([*modes], model.time_unit))
    lines += [f"Check: {doubt}" for doubt in (*model.about.doubts, *doubts_at(point))]
    return wrapped("\n".join(lines), WIDTH)


def doubts_at(point: OperatingPoint) -> Iterator[str]:
    """Yield sentences on values of a point that data in wrong units cause: alpha, drag."""
    point = point.in_radians
    model = point.model
    alpha = recognized(model.states).get("alpha", "")
    size = abs(math.degrees(point[alpha])) if alpha else 0.0
    if size > _STEEPEST:
        yield f"alpha is {size:.4g} deg in size; the data may have degrees without a unit"
    if "drag" in model.outputs and "lift" in model.outputs:
        drag, lift = point["drag"], point["lift"]
        if drag < -_NEGATIVE * abs(lift):
            yield f"the drag is {_number(model, 'drag', drag)}, below 0; check signs and units"


def _unstable(modes: Sequence[Mode], time: str) -> str:
    """Return a line with the unstable modes and their times to double, and with the modes that are
    neutral within the accuracy of A."""
    least = _NEUTRAL * max((abs(mode.eigenvalue) for mode in modes), default=0.0)
    timed, neutral = [], []
    for mode in modes:
        growth = mode.eigenvalue.real
        if growth > least:
            timed.append(f"{mode.name} (2x in {mode.time_to_double:.3g} {time})")
        elif growth > 0.0:
            neutral.append(f"; neutral: {mode.name} ({growth:.1e} 1/{time})")
    return f"unstable: {', '.join(timed) or 'none'}{''.join(neutral)}"


def condition_words(point: OperatingPoint) -> Iterator[str]:
    """Yield the condition of an operating point as texts: "level", "68 ft/s", "40,000 ft".

    The texts are flight path, turn, speed, altitude, scheduling variable, imposed load factor and
    imposed rates. For a model without a speed, they are the first imposed values.
    """
    model = point.model
    condition = None if point.problem is None else point.problem.asked
    imposed = {} if condition is None else condition.imposed
    speed = recognized(model.states).get("speed", "")
    if speed:
        yield from _path_words(point)
        groups = [group for group in model.alternatives if speed in group]
        typed = [name for group in groups for name in group[1:] if name in imposed]
        named = [f"{name} {_number(model, name, imposed[name])}" for name in typed]
        yield from named or [_number(model, speed, point[speed])]
        if "altitude" in model.states:
            yield _number(model, "altitude", point["altitude"])
        if ISA in model.parameters and model.parameters[ISA].start:
            yield f"ISA {model.parameters[ISA].start:+g} K"
        names = [model.schedule] if model.schedule in (*model.states, *model.inputs) else []
        names += ["load_factor"] if "load_factor" in imposed or _has_other_load(point) else []
        yield from (_named(point, name) for name in names if name not in (speed, "altitude"))
    else:
        yield from (_named(point, name) for name in [*imposed][:_MOST_VALUES])
    if condition is not None:
        for name, rate in condition.rates.items():
            if rate:
                yield f"{name}_dot {_number(model, f'{name}_dot', rate)}"


def _path_words(point: OperatingPoint) -> Iterator[str]:
    """Yield texts on the flight path and the turn: "climb 2 deg", "turn 3 deg/s", "accelerated"."""
    point = point.in_radians
    model = point.model
    roles = recognized(model.states)
    gamma = _flight_path(point)
    if abs(gamma) < _LEVEL:
        yield "level"
    elif math.isfinite(gamma):
        yield f"{'climb' if gamma > 0 else 'descent'} {digits(math.degrees(abs(gamma)))} deg"
    turn = point["turn_rate"] if "turn_rate" in model.outputs else 0.0
    if abs(turn) >= _LEVEL:
        yield f"turn {_number(model, 'turn_rate', turn)}"
    rates = model.rates_at(point.states, point.inputs)
    if any(abs(rates[name]) > BALANCE * model.rate_scale(name) for name in roles.values()):
        yield "accelerated"


def _flight_path(point: OperatingPoint) -> float:
    """Return the flight-path angle, in the unit of the point's angles, or nan if it is unknown."""
    roles = recognized(point.model.states)
    if "gamma" in point.model.outputs:
        return point["gamma"]
    if {"theta", "alpha"} <= {*roles}:
        return point[roles["theta"]] - point[roles["alpha"]]
    return math.nan


def _has_other_load(point: OperatingPoint) -> bool:
    """Return whether the load factor is not that of steady, straight flight, cos γ."""
    point = point.in_radians
    if "load_factor" not in point.model.outputs:
        return False
    return abs(point["load_factor"] - math.cos(_flight_path(point))) > _LOAD


def _named(point: OperatingPoint, name: str) -> str:
    return f"{name} {_number(point.model, name, point[name])}"


def _number(model: Model, name: str, value: float) -> str:
    """Return a value with its unit as text, "40,000 ft"."""
    unit = model.unit(name)
    return beside_unit(digits(float(shown_value(value, unit, ".12g")), 5), unit)


def control_lines(
    point: OperatingPoint, margins: dict[str, Margin], lift_over_drag: float | None
) -> str:
    """Return alpha, each input that is not 0 with its limits, and L/D: "alpha 2.8 deg, elevator
    -1.37 of ±30 deg, throttle 40.1 of 200, L/D 22.4".

    margins: margins of the point
    lift_over_drag: lift divided by drag, or None if the model has no forces
    """
    model = point.model
    words = []
    alpha = recognized(model.states).get("alpha")
    if alpha:
        words.append(f"{alpha} {_short(model, alpha, point[alpha])}")
    moved = [name for name in model.inputs if abs(margins[name].value) >= ROUNDING]
    words += [_of_limits(margins[name]) for name in moved or model.inputs]
    if lift_over_drag is not None:
        words.append(f"L/D {digits(lift_over_drag)}")
    return _listed(words, ", ")


def _short(model: Model, name: str, value: float) -> str:
    unit = model.unit(name)
    return beside_unit(digits(float(shown_value(value, unit, ".12g"))), unit)


def _of_limits(margin: Margin) -> str:
    """Return an input with its limits as text: "elevator -1.37 of ±30 deg"."""
    numbers = (margin.value, margin.lowest, margin.highest)
    value, low, high = (float(shown_value(each, margin.unit, ".12g")) for each in numbers)
    if math.isinf(low) and math.isinf(high):
        limits = ""
    elif low == -high:
        limits = f" of ±{digits(high)}"
    elif low == 0.0:
        limits = f" of {digits(high)}"
    else:
        limits = f" of {digits(low)} to {digits(high)}"
    return beside_unit(f"{margin.name} {digits(value)}{limits}", margin.unit)


def mode_lines(modes: Sequence[Mode], model: Model) -> str:
    """Return the modes as text: "short period 11.2 rad/s, damping 0.412; spiral -0.0277 1/s".

    Modes that the model declares come alone, if there are any.

    modes: modes of a linear model
    """
    declared = [mode for mode in modes if mode.name.partition(" (")[0] in model.modes]
    time = model.time_unit
    words = []
    for mode in (declared or [*modes])[:_MOST_MODES]:
        if mode.eigenvalue.imag:
            words.append(
                f"{mode.name} {digits(mode.frequency)} rad/{time}, damping {digits(mode.damping)}"
            )
        else:
            words.append(f"{mode.name} {digits(mode.eigenvalue.real)} 1/{time}")
    return _listed(words, "; ")


def _listed(words: Sequence[str], separator: str) -> str:
    """Return texts joined in lines of at most `WIDTH` characters, which end after a text."""
    lines = [""]
    for word in words:
        joined = f"{lines[-1]}{separator}{word}" if lines[-1] else word
        if len(joined) + len(separator.rstrip()) > WIDTH and lines[-1]:
            lines[-1] += separator.rstrip()
            lines.append(word)
        else:
            lines[-1] = joined
    return "\n".join(lines)
