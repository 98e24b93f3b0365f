"""The trim of a request, or its trims: the condition, in the names and units of the aircraft."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from hfa.options.argument_types import each_of, option_errors, quantity, single_quantity, span
from hfa.options.option import PAPER, option
from hfa.options.plants import AircraftOptions, aircraft_source, is_own, loaded_model
from hfa.options.ranges import array_of, value_range
from hfa_aircraft.model import Model
from hfa_aircraft.signals import ISA
from hfa_support.errors import BadInputError, refuse_unknown
from trim.hfa.level_flight import CONDITIONS, load_condition
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint

#: Options of the trim condition, without the scheduling variable.
OF_THE_TRIM = ("condition", "free", "hold", "isa", "limit", "start")
#: Forms of several values of a variable, for helps.
SEVERAL = "a number, a list a,b,c or a range start:stop:step"

T = TypeVar("T")


def at_option(about: str, form: str = "VALUE") -> Any:
    """Return the option --at, the value of the aircraft's scheduling variable."""
    return option(about, form)


def dihedral_option(about: str, form: str = "DEG") -> Any:
    """Return the option --dihedral, which is --at of the paper's aircraft."""
    return option(f"{about}, degrees", form, group=PAPER, first=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimOptions(AircraftOptions):
    """The condition of a trim."""

    at: str | None = at_option("scheduling variable of the aircraft")
    dihedral: str | None = dihedral_option("dihedral angle, the scheduling variable")
    hold: Mapping[str, str] = option(
        "hold a variable at a value; repeatable", "NAME=VALUE", named=True
    )
    isa: str | None = option(
        "deviation of the air temperature from the standard atmosphere, K: +15; as --hold isa=15",
        "K",
        rare=True,
    )
    free: tuple[str, ...] = option(
        "variable that the trim solves for; repeatable", "NAME", repeated=True
    )
    limit: Mapping[str, str] = option(
        "limits of a free variable of the trim, degrees for angles; repeatable",
        "NAME=LOW:HIGH",
        named=True,
    )
    condition: str | None = option(
        f"trim condition that replaces the default: a file, or {', '.join(CONDITIONS)}",
        "FILE",
        rare=True,
    )
    start: str | None = option(
        "initial point of the trim search: an operating point (.json), or NAME=VALUE,NAME=VALUE",
        "FILE",
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SeveralTrims(TrimOptions):
    """The condition of trims at one or several values of the scheduling variable."""

    at: str | None = at_option(f"scheduling variable: {SEVERAL}", "RANGE")
    dihedral: str | None = dihedral_option(f"dihedral angle: {SEVERAL}", "RANGE")


def held_values(
    request: TrimOptions, model: Model, kind: Callable[[Model, str, str], T]
) -> dict[str, T]:
    """Return name -> value of --hold, and of --isa, which sets the parameter isa.

    kind: function (model, name, text) -> value

    Raises BadInputError if both give the parameter, and as `kind` does.
    """
    texts = request.hold
    if request.isa is not None:
        if ISA in texts:
            raise BadInputError(f"--isa and --hold {ISA} are the same; give one of them")
        texts = {**texts, ISA: request.isa}
    return each_of("--hold", model, texts, kind)


class GivenTrim(NamedTuple):
    """The trim that the options of a request define.

    model: the aircraft, with the parameters that the options set
    condition: condition of the trim, with the value of the scheduling variable
    common: condition without this value, of the aircraft without these parameters
    at: value of the scheduling variable, or None for that of the condition
    hold: variable or parameter -> value of --hold
    parameters: parameter -> value, for the parameters that the options set
    start: point at which the search begins, or None
    is_started: whether --start is given
    source: entries of the provenance
    """

    model: Model
    condition: TrimCondition
    common: TrimCondition
    at: float | None
    hold: Mapping[str, float]
    parameters: Mapping[str, float]
    start: OperatingPoint | None
    is_started: bool
    source: Mapping[str, Any]


def given_trim(request: TrimOptions, *, required: bool = False) -> GivenTrim:
    """Return the single trim that the options define.

    required: whether the paper's aircraft requires --dihedral

    Raises BadInputError for an unknown name, an invalid value, or options that contradict.
    """
    model = loaded_model(request)
    at = at_value(request, model, single_quantity, required=required)
    return trim_with(request, model, at, held_values(request, model, quantity))


class GivenTrims(NamedTuple):
    """Trims at each value of the scheduling variable, in the order given.

    trims: at least one; without a value of the variable, the trim of the condition
    source: entries of the provenance on all of them
    """

    trims: list[GivenTrim]
    source: Mapping[str, Any]


def given_trims(request: SeveralTrims, most: int) -> GivenTrims:
    """Return the trims that the options define.

    most: largest number of trims

    Raises BadInputError for more trims, and as `given_trim` does.
    """
    model = loaded_model(request)
    at = at_value(request, model, value_range)
    hold = held_values(request, model, quantity)
    values = [None] if at is None else array_of(f"--{at_name(model)}", at, most).tolist()
    trims = [trim_with(request, model, value, hold) for value in values]
    return GivenTrims(trims, trim_source(request, trims[0].common, at, hold))


def trim_with(
    request: TrimOptions, model: Model, at: float | None, hold: Mapping[str, float]
) -> GivenTrim:
    """Return the trim of the options, at one value of the scheduling variable.

    model: model of the aircraft, without the parameters of --hold
    at: value of the scheduling variable, or None
    hold: variable or parameter -> value
    """
    parameters = _parameters_in(model, {**hold, model.schedule: at})
    common, start = common_condition(request, model, at, hold)
    return GivenTrim(
        model=model.with_parameters(**parameters),
        condition=common.at(None if model.schedule in model.parameters else at),
        common=common,
        at=at,
        hold=hold,
        parameters=parameters,
        start=start,
        is_started=request.start is not None,
        source=trim_source(request, common, at, hold),
    )


def at_name(model: Model) -> str:
    """Return the name of the option for the scheduling variable: "dihedral" of the HFA, or "at"."""
    return model.schedule if model.about.names_schedule else "at"


def at_value(
    request: TrimOptions,
    model: Model,
    kind: Callable[[Model, str, str], T],
    *,
    required: bool = False,
) -> T | None:
    """Return the value of --at or --dihedral, or None.

    kind: function (model, name, text) -> value
    required: whether the option is mandatory for the paper's aircraft

    Raises BadInputError if the model has no such option, and as `kind` does.
    """
    if request.dihedral is not None and not model.about.names_schedule:
        raise BadInputError(f"--dihedral applies only to the HFA; {model.name} takes --at VALUE")
    given = {text for text in (request.at, request.dihedral) if text is not None}
    if len(given) > 1:
        raise BadInputError(
            f"--{at_name(model)} is given twice ({' and '.join(sorted(given))}); give one value"
        )
    if given and not model.schedule:
        raise BadInputError(
            f"--at must be removed, because {model.name} declares no scheduling variable"
        )
    if required and not given and model.about.names_schedule:
        raise BadInputError(f"no value of {model.schedule} is given; add --{model.schedule} DEG")
    for text in given:
        with option_errors(f"--{at_name(model)}"):
            return kind(model, model.schedule, text)
    return None


def _named_condition(request: TrimOptions, model: Model) -> TrimCondition:
    """Return the condition of --condition, or the default of the model.

    Raises BadInputError for a list of conditions.
    """
    usual = usual_condition(model)
    if request.condition is None:
        return usual
    if request.condition.lower().endswith(".csv"):
        raise BadInputError(
            f"--condition {request.condition} is a list of conditions; give one condition, or "
            "`hfa trim --conditions FILE` or `hfa sweep --conditions FILE`"
        )
    with option_errors("--condition"):
        return load_condition(request.condition, usual)


def common_condition(
    request: TrimOptions, model: Model, at: object, hold: Mapping[str, Any]
) -> tuple[TrimCondition, OperatingPoint | None]:
    """Return the condition of the options without the value of the scheduling variable, and the
    point of --start.

    at: value or values of the scheduling variable, or None
    hold: variable or parameter -> value or values of --hold, of which only single values of
        variables are imposed

    Raises BadInputError if a variable is given twice, and as `release` does.
    """
    usual = _named_condition(request, model)
    free = [_freed(model, text) for text in request.free]
    refuse_doubles(model, free, at, hold)
    held = {name: value for name, value in hold.items() if name not in model.parameters}
    held = {name: value for name, value in held.items() if isinstance(value, float)}
    limits = each_of("--limit", model, request.limit, span)
    condition = release(usual, free=free, hold=held, limits=limits)
    start = _start_of(request, model)
    if isinstance(start, dict):
        return replace(condition, begin={**condition.begin, **start}), None
    return condition, start


def _freed(model: Model, text: str) -> str:
    """Return the model's name of the variable that --free gives."""
    if "," in text:
        options = " ".join(f"--free {name.strip()}" for name in text.split(","))
        raise BadInputError(f"--free give one variable; write {options}")
    return model.about.aliases.get(text, text)


def refuse_doubles(model: Model, free: Sequence[str], at: object, hold: Mapping[str, Any]) -> None:
    """Raise BadInputError if two of --free, --hold and --at give the same variable."""
    for name in free:
        if name in hold:
            raise BadInputError(
                f"{name} is both free and held; remove --free or --hold for this variable"
            )
    by = model.schedule
    others = {"--hold": by in hold, "--free": by in free and not isinstance(at, float)}
    for other, gives_it in others.items():
        # A single value of a free variable is the initial guess of the search.
        if at is not None and gives_it:
            raise BadInputError(
                f"{by} is given by both --{at_name(model)} and {other}; remove one of these options"
            )


def _start_of(request: TrimOptions, model: Model) -> OperatingPoint | dict[str, float] | None:
    """Return the initial point of the trim search that --start gives, or some of its values."""
    text = request.start
    if text is None:
        return None
    with option_errors("--start"):
        if "=" not in text or Path(text).exists():
            return OperatingPoint.load(Path(text), model)
        values = {}
        for word in text.split(","):
            typed, _, value = word.partition("=")
            name = model.about.aliases.get(typed, typed)
            refuse_unknown("no variable is called", name, model.variables)
            values[name] = quantity(model, name, value)
    return values


def _parameters_in(model: Model, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the parameters of a model among values that are single numbers, name -> value."""
    return {name: values[name] for name in model.parameters if isinstance(values.get(name), float)}


def trim_source(
    request: TrimOptions, common: TrimCondition, at: object, hold: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the entries of the provenance on an aircraft and its trim, or trims.

    common: condition without the value of the scheduling variable
    at: value or values of the scheduling variable, or None
    hold: variable or parameter -> value or values of --hold
    """
    model = common.model
    held = _parameters_in(model, {**hold, model.schedule: at})
    source = aircraft_source(request, model, held)
    if is_own(model):
        return source | {"condition": {**common.changes, "parameters": held}}
    condition: Mapping[str, Any] = common.changes
    if isinstance(at, float):
        single = common.at(at)
        limits = {name: list(single.limits_of(name)) for name in single.free}
        condition = {
            "imposed": dict(single.imposed),
            "free": list(single.free),
            "limits": limits,
        }
    return source | {"condition": condition, "flight": common.in_words()}
