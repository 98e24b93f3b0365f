"""The trim that a request asks for; without one, the options with which a trim exists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

from hfa.options.trims import GivenTrim, at_name
from hfa_aircraft.signals import recognized
from hfa_support.errors import BadInputError, NoSolutionError, warn
from hfa_support.reporting.text import shown_value
from hfa_support.units import si_unit
from trim.hfa.reports import trim_report
from trim.point.condition import release, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.reasons import explained
from trim.point.solve import TrimError, trim
from trim.reports.balances import balances_of
from trim.reports.trimmed import Trimmed

#: Largest number of options that help a failed trim whose reason is not known.
_MOST_ADVICE = 3


def trimmed(given: GivenTrim) -> OperatingPoint:
    """Return the operating point of a given trim.

    Raises TrimError, with the reason and with options that help, if no trim is found.
    """
    schedule = given.model.schedule
    if given.at is not None and schedule in given.condition.free:
        typed = f"--{at_name(given.model)} {given.model.describe(schedule, given.at)}"
        warn(f"{schedule} is free: the search begins at {'--start' if given.start else typed}")
    try:
        return trim(given.model, given.condition, given.start)
    except TrimError as failure:
        raise _advised(given, failure) from None


def _advised(given: GivenTrim, failure: TrimError) -> TrimError:
    """Return the error of a failed trim with advice, and the report of the nearest point."""
    failure = explained(failure, given.model, given.condition)
    found = (*given.model.warnings, *balances_of(Trimmed(failure.attempt)).sentences)
    warnings = [f"check: {warning}" for warning in found]
    advice = ""
    with suppress(BadInputError, NoSolutionError, ArithmeticError):  # the reason stands alone
        advice = _advice(given, failure)
    said = "; ".join(filter(None, (str(failure), *warnings, advice)))
    advised = TrimError(said, failure.attempt, failure.required)
    advised.found = trim_report(failure.attempt).with_data(reason=said)
    advised.source = given.source
    return advised


def _advice(given: GivenTrim, failure: TrimError) -> str:
    """Return a sentence on the options with which a trim exists, or ""."""
    if advice_on_inputs := _free_inputs(given):
        return advice_on_inputs
    names = sorted(_releasable(given), key=lambda name: name != "gamma")  # steepest first
    most = _MOST_ADVICE if failure.saturated is None else 1
    model, condition = given.model, given.condition
    saturated = failure.saturated or {}
    options: list[str] = []  # with each of them a trim exists
    for name in names:
        is_rate = name not in condition.imposed
        # With the saturated input held at its limit, the value that is found is an extreme one: the
        # steepest climb at full thrust, and not a glide.
        freed = release(condition, free=(name,), hold={} if is_rate else saturated)
        try:
            point = trim(model, freed, given.start)
        except TrimError as obstacle:
            # Without this rate, the equations balance, so that a limit is what prevents a trim.
            if is_rate and obstacle.required and not failure.required:
                return f"with --free {name}, balanced only beyond a limit: {obstacle.required}"
            continue
        except BadInputError:
            continue
        options += _options(given, name, point, saturated)
        if len(options) >= most:
            break
    return f"a trim exists with {' or '.join(options)}" if options else ""


def _options(
    given: GivenTrim, name: str, point: OperatingPoint, saturated: Mapping[str, float]
) -> list[str]:
    """Return the options of a trim in which a rate or an imposed value is free, with the value that
    was found; [] if they are no advice.

    name: the rate or value
    point: the trim
    saturated: input -> limit at which it is held, or {}
    """
    model = given.model
    option = f"--free {name}" + " in place of --hold" * (name in given.hold)
    if name not in given.condition.imposed:  # a rate
        return [option]
    # An imposed airspeed, such as kcas, is not a variable of the trim: the speed is reported.
    found = name if name in point else recognized(model.states)["speed"]
    shown = model.describe(found, point[found])
    problem = point.trim_problem
    is_one_of_many = bool(problem.kept) or problem.count[1] > problem.count[0]
    is_other = name in given.hold and is_one_of_many
    if point._large_angles or is_other:  # a strange attitude, or away from what was asked
        return []
    held = "".join(
        f"--hold {input_name}={shown_value(value, model.unit(input_name))} "
        for input_name, value in saturated.items()
    )
    return [f"{held}{option} ({found} {shown})"]


def _releasable(given: GivenTrim) -> list[str]:
    """Return the rates and imposed values that advice may set free, those of the user last."""
    # The rates are those of lengths (altitude in a climb), of masses (fuel) and, with an imposed
    # load factor, of pitch (a pull-up).
    model, condition = given.model, given.condition
    changing = [name for name in model.states if si_unit(model.unit(name)) in ("m", "kg")]
    if "load_factor" in condition.imposed:
        changing.append(recognized(model.states).get("theta", ""))
    rates = [f"{name}_dot" for name in changing if name in condition.rates]
    # The dihedral angle of the HFA defines the aircraft: it is always given, and not released.
    dihedral = model.schedule if model.about.names_schedule else ""
    names = [name for name in (*rates, *condition.imposed) if name != dihedral]
    return sorted(names, key=lambda name: name in given.hold)


def _free_inputs(given: GivenTrim) -> str:
    """Return which inputs to free if the default trim holds all at their start values, or ""."""
    # The default trim of an FMU does. Inputs that start at another value than 0 are tried first.
    model = given.model
    usual = usual_condition(model).imposed
    held = [name for name in model.inputs if name in usual and name not in given.hold]
    if not held or any(name not in (*usual, *given.hold) for name in model.inputs):
        return ""
    for names in ([name for name in held if usual[name]], held):
        if _exists(given, names):
            options = " ".join(f"--free {name}" for name in names)
            return f"the trim holds the inputs at their start values; one exists with {options}"
    return ""


def _exists(given: GivenTrim, free: Sequence[str]) -> bool:
    """Return whether a trim exists if some names are set free."""
    try:
        trim(given.model, release(given.condition, free=free), given.start)
    except (BadInputError, TrimError):
        return False
    return True
