"""First lines of reports on trims and linear models: condition, unstable modes, controls, modes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from hfa_aircraft.model import Model
from hfa_aircraft.signals import ISA
from hfa_support.errors import printable
from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import (
    WIDTH,
    beside_unit,
    digits,
    digits_with_unit,
    shown_value,
    without_rounding,
    wrapped,
)
from trim.linear.modes import Mode
from trim.point.condition import freed_parameters
from trim.point.margins import Margin
from trim.point.status import BALANCE
from trim.reports.figures import stall_lines
from trim.reports.trimmed import Quantity, Trimmed, named_value_text, value_text
from trim.reports.warnings import warnings_of

#: Difference of load factors that is stated: that of a bank of 8 deg.
_STATED_DIFFERENCE = 1e-2
#: Largest numbers of imposed values and of modes in first lines.
_MOST_VALUES = 4
_MOST_MODES = 6


def without_line_numbers(notes: Iterable[str]) -> list[str]:
    """Return notes without the numbers of lines in files of aircraft, as in "<input> 899 896" and
    "f16.xml: 406".
    """
    return [re.sub(r"(?<=>)(?: \d+)+|(?<=\.xml:) \d+", "", note) for note in notes]


def first_lines(trimmed: Trimmed, linearized: Sequence[Mode] | None = None) -> str:
    """Return the aircraft, what was done and the condition, and below it the unstable modes: "HFA
    (published) trimmed: level, 68 ft/s, 40,000 ft, dihedral 10 deg", "unstable: none".

    Further lines state a stall, what the trim does not determine, and warnings; in the report of a
    trim also that an angle without limits exceeds 90 deg, and that the search did not begin at the
    default initial point.

    linearized: modes of the reported linear model, or None for the report of the point
    """
    point, model = trimmed.point, trimmed.point.model
    done, modes = "linearized", linearized
    if linearized is None:
        done = str(point.status)
        modes = trimmed.modes if point.ok and not trimmed.fault else None
    condition = ", ".join(condition_words(trimmed))
    lines = [f"{subject(model)} {done}: {condition}" if condition else f"{subject(model)} {done}"]
    if modes is not None:  # a growth within the rounding of A is 0 (`trim.linear.modes.spectrum`)
        unstable = [
            f"{mode.name} (2x in {mode.time_to_double:.3g} {model.time_unit})"
            for mode in modes
            if mode.eigenvalue.real > 0.0
        ]
        lines.append(f"unstable: {', '.join(unstable) or 'none'}")
    lines += [*stall_lines(trimmed), *uniqueness_lines(trimmed), *changing_lines(trimmed)]
    lines += [f"Check: {warning}" for warning in warnings_of(trimmed)]
    if linearized is None:
        lines += [f"Far out: {angle}" for angle in point._large_angles[:1]]  # the sheet has all
        if point.initial_point:
            lines.append("Not from the default initial point")
    return "\n".join(lines)


def uniqueness_lines(trimmed: Trimmed) -> list[str]:
    """Return a line on the variables that keep their start values because no equation determines
    them, and one on the variables that remain free in a trim that is one of many.
    """
    point = trimmed.point
    lines = []
    if point.found_by is not None and point.found_by.kept:
        kept_names = point.found_by.kept
        kept = ", ".join(named_value_text(point, name) for name in kept_names)
        cure = f"--hold {kept_names[0]}=VALUE sets another"
        if trimmed.roles.get("theta") in kept_names and "gamma" not in point.model.outputs:
            cure += ", an output gamma with --hold gamma=0 level flight"
        lines.append(f"At its start value, as the trim does not determine it: {kept} ({cure})")
    names, count_to_hold = point._undetermined
    if names:
        verb = "is" if len(names) == 1 else "are"
        how_many = "one" if count_to_hold == 1 else str(count_to_hold)
        lines.append(
            f"One of many: {', '.join(names)} {verb} free; hold {how_many} "
            f"(--hold {names[0]}=VALUE)"
        )
    return lines


def changing_lines(trimmed: Trimmed) -> list[str]:
    """Return a line on the states that change in a trim, such as positions and fuel. States of the
    motion, the altitude and the heading are left out, because they may change in steady flight.
    """
    point, model = trimmed.point, trimmed.point.model
    of_flight = {*trimmed.roles.values(), "yaw"}
    balanced = point.trim_problem.asked.rates
    changing = [
        f"{name} by {value_text(model, f'{name}_dot', rate)}"
        for name, rate in trimmed.rates.items()
        if name not in balanced and name not in of_flight and not _is_steady(trimmed, name)
    ]
    return [f"Changing in this trim: {', '.join(changing)}"] if changing else []


def subject(model: Model) -> str:
    """Return the name of an aircraft and of its equations: "HFA (published)"."""
    name, equations = printable(model.subject), model.about.equations
    return f"{name} ({equations})" if equations and equations not in name else name


def condition_words(trimmed: Trimmed) -> Iterator[str]:
    """Yield the condition of an operating point as texts: "level", "68 ft/s", "40,000 ft".

    The texts are flight path, turn, speed, altitude, scheduling variable, load factor if a motion
    is accelerated, values that are imposed otherwise than by default, and imposed rates. For a
    model without a speed, they are the first imposed values.
    """
    point, model = trimmed.point, trimmed.point.model
    condition = None if point.found_by is None else point.found_by.asked
    imposed = {} if condition is None else condition.imposed
    changed = {} if condition is None else condition.changes.get("imposed", {})  # from the default
    if trimmed.airspeed is not None:
        yield from _flight_words(trimmed, trimmed.airspeed, imposed, changed)
    else:
        yield from (named_value_text(point, name) for name in [*imposed][:_MOST_VALUES])
    if condition is not None:
        for name in freed_parameters(condition):
            # The model of a trim has the value found as start value. `_flight_words` states ISA.
            if name != ISA:
                yield f"{name} {value_text(model, name, model.parameters[name].start)}"
        for name, rate in condition.rates.items():
            if rate:
                yield f"{name}_dot {value_text(model, f'{name}_dot', rate)}"


def _flight_words(
    trimmed: Trimmed, airspeed: Quantity, imposed: Mapping[str, Any], changed: Iterable[str]
) -> Iterator[str]:
    """Yield the texts of `condition_words` on an aircraft with an airspeed, except the rates.

    changed: names of the imposed values that are not those of the default trim
    """
    point, model = trimmed.point, trimmed.point.model
    speed = trimmed.airspeed_name
    yield from _path_words(trimmed)
    in_place_of_speed = [  # imposed airspeeds, such as mach
        name
        for alternatives in model.alternatives  # a trim imposes one of each group
        if speed in alternatives
        for name in alternatives[1:]
        if name in imposed
    ]
    for name in in_place_of_speed:
        yield f"{name} {value_text(model, name, imposed[name])}"
    if not in_place_of_speed:
        is_named = speed in model.signals
        yield value_text(model, speed, point[speed]) if is_named else digits_with_unit(*airspeed, 5)
    if "altitude" in model.states:
        yield value_text(model, "altitude", point["altitude"])
    if ISA in model.parameters and model.parameters[ISA].start:
        yield f"ISA {model.parameters[ISA].start:+g} K"
    names = [*changed]
    if "load_factor" in trimmed.model.outputs:
        gamma = 0.0 if math.isnan(trimmed.flight_path) else trimmed.flight_path
        # In steady straight flight, the load factor is cos γ.
        if abs(trimmed["load_factor"] - math.cos(gamma)) > _STATED_DIFFERENCE:
            names.insert(0, "load_factor")
    if model.schedule in (*model.states, *model.inputs):
        names.insert(0, model.schedule)
    has_words = {speed, "altitude", "gamma", "turn_rate", *in_place_of_speed}
    for name in dict.fromkeys(names):
        if name not in has_words:
            yield named_value_text(point, name)


def _path_words(trimmed: Trimmed) -> Iterator[str]:
    """Yield texts on the flight path and the turn: "climb 2 deg", "turn 3 deg/s", "accelerated"."""
    # Imposed values are exact, and computed ones have the tolerance of the equations.
    model, imposed, gamma = trimmed.model, trimmed.imposed, trimmed.flight_path
    if math.isfinite(gamma):
        if "gamma" in imposed:
            is_level = imposed["gamma"] == 0.0
        elif "altitude" in trimmed.rates:
            is_level = _is_steady(trimmed, "altitude")
        else:
            angle = "gamma" if "gamma" in model.signals else trimmed.roles["theta"]
            is_level = abs(gamma) <= BALANCE * model.signals[angle].nominal
        climb = f"{'climb' if gamma > 0 else 'descent'} {digits(math.degrees(abs(gamma)))} deg"
        yield "level" if is_level else climb
    elif any(model.unit(name) == "rad" for name in model.states):
        yield "flight path unknown"
    if "turn_rate" in model.outputs:
        nominal = model.outputs["turn_rate"].nominal
        tolerance = 0.0 if "turn_rate" in imposed else BALANCE * nominal
        if abs(imposed.get("turn_rate", trimmed["turn_rate"])) > tolerance:
            yield f"turn {value_text(model, 'turn_rate', trimmed['turn_rate'])}"
    moving = [name for role, name in trimmed.roles.items() if role != "altitude"]
    if not all(_is_steady(trimmed, name) for name in moving):
        yield "accelerated"


def _is_steady(trimmed: Trimmed, state: str) -> bool:
    """Return whether the rate of a state is 0 as accurately as equations balance."""
    return abs(trimmed.rates[state]) <= BALANCE * trimmed.point.model.rate_scale(state)


def title_with_controls(trimmed: Trimmed, rows: Iterable[Row]) -> str:
    """Return the first lines of a sheet: those of the point, and below them alpha, the inputs with
    their limits, and L/D: "alpha 2.8 deg, elevator -1.37 of ±30 deg, L/D 22.4". Inputs that are 0
    are left out, unless all are.

    rows: rows of the sheet
    """
    model, margins = trimmed.point.model, trimmed.point.margins
    words = []
    alpha = trimmed.roles.get("alpha")
    if alpha:
        angle = digits_with_unit(
            trimmed.point[alpha], model.unit(alpha), nominal=model.signal(alpha).nominal
        )
        words.append(f"{alpha} {angle}")
    moved = [
        name for name in model.inputs if without_rounding(margins[name].value, margins[name].scale)
    ]
    words += [_input_text(margins[name]) for name in moved or model.inputs]
    words += [f"L/D {digits(row.value)}" for row in rows if row.name == "L/D"]
    return f"{first_lines(trimmed)}\n{_listed(words, ', ')}".rstrip()


def _input_text(margin: Margin) -> str:
    """Return an input with its limits as text: "elevator -1.37 of ±30 deg"."""
    reached = without_rounding(margin.value, margin.scale)
    numbers = (reached, margin.lowest, margin.highest)
    value, low, high = (float(shown_value(number, margin.unit, ".12g")) for number in numbers)
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

    Modes with names that the model declares are listed alone, if there are any.

    modes: modes of a linear model
    """
    # The name of a mode is that of its family, with an addition if the family has several.
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


def _listed(words: Iterable[str], separator: str) -> str:
    """Return texts joined in lines of at most `WIDTH` characters, which end after a text."""
    joined = separator.join(word.replace(" ", "\0") for word in words)
    return wrapped(joined, WIDTH).replace("\0", " ")
