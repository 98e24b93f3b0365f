"""The trim of a request, or its trims: the condition, in the names and units of the aircraft."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from hfa.options.argument_types import (
    Range,
    array_of,
    each_of,
    option_errors,
    quantity,
    span,
    value_range,
)
from hfa.options.conditions import (
    ListedCondition,
    airplane_class,
    chosen_row,
    flight_category,
    listed_conditions,
)
from hfa.options.parser import PAPER, option
from hfa.options.plants import AircraftOptions, loaded_aircraft
from hfa_aircraft.model import Model
from hfa_aircraft.signals import ISA
from hfa_aircraft.units import in_si
from hfa_support.errors import BadInputError, prefix_errors, refuse_unknown
from hfa_support.provenance import Change
from trim.hfa.level_flight import CONDITIONS, load_condition
from trim.point.condition import (
    StatedValues,
    TrimCondition,
    freed_parameters,
    release,
    usual_condition,
)
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim

if TYPE_CHECKING:
    from trim.reports.models import AskedTrim, Conditions

#: Fields of the options of a trim condition, without the scheduling variable.
OF_THE_TRIM = ("condition", "conditions", "free", "hold", "isa", "limit", "row", "start")
#: Forms of one or several values of a variable, for helps.
SEVERAL = "a number, a list a,b,c or a range start:stop:step"


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimOptions(AircraftOptions):
    """The condition of a trim.

    needs_dihedral: whether a value of the scheduling variable of the HFA must be given
    """

    needs_dihedral: ClassVar[bool] = False

    at: str | None = option("scheduling variable of the aircraft", "VALUE")
    dihedral: str | None = option(
        "dihedral angle, the scheduling variable, degrees", "DEG", group=PAPER, first=True
    )
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
    conditions: Path | None = option("a .csv file of conditions; --row names one", "FILE")
    row: str | None = option("name of the condition of --conditions, or of models", "NAME")
    start: str | None = option(
        "initial point of the trim search: an operating point (.json), or NAME=VALUE,NAME=VALUE",
        "FILE",
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SeveralTrims(TrimOptions):
    """The condition of trims at one or several values of the scheduling variable."""

    at: str | None = option(f"scheduling variable: {SEVERAL}", "RANGE")
    dihedral: str | None = option(
        f"dihedral angle: {SEVERAL}, degrees", "RANGE", group=PAPER, first=True
    )


class GivenTrim(NamedTuple):
    """A trim that the options of a request define.

    model: the aircraft, with the parameters that the options set
    condition: condition of the trim, with the value of the scheduling variable
    common: condition without this value, which all trims of a request have in common; its model is
        the aircraft as loaded
    at: value of the scheduling variable, or None for that of the condition
    hold: variable or parameter -> value of --hold and --isa
    start: point at which the search begins, or None
    source: entries of the provenance of the results: aircraft, parameters, condition
    """

    model: Model
    condition: TrimCondition
    common: TrimCondition
    at: float | None
    hold: Mapping[str, float]
    start: OperatingPoint | None
    source: Mapping[str, Any]


class TrimInput(NamedTuple):
    """What the options of a request say about trims, in the units of the model.

    model: the aircraft as loaded
    aircraft: entries of the provenance on the aircraft as loaded
    condition: condition of --condition, or the default of the model
    free: variables of --free
    limits: variable -> (lowest, highest) of --limit
    at: values of the scheduling variable, or None for that of the condition
    hold: variable or parameter -> values of --hold and --isa
    begin: variable -> value of --start
    start: point of --start, or None
    rows: conditions of --conditions, of which --row leaves one
    """

    model: Model
    aircraft: Mapping[str, Any]
    condition: TrimCondition
    free: tuple[str, ...] = ()
    limits: Mapping[str, tuple[float, float]] = MappingProxyType({})
    at: Range | None = None
    hold: Mapping[str, Range] = MappingProxyType({})
    begin: Mapping[str, float] = MappingProxyType({})
    start: OperatingPoint | None = None
    rows: tuple[ListedCondition, ...] = ()

    def single(self) -> GivenTrim:
        """Return the only trim.

        Raises BadInputError for several values of a variable, or several conditions.
        """
        if self.rows:
            if len(self.rows) > 1:
                names = ", ".join(row.name for row in self.rows if row.name)
                known = f"; choose from {names}" if names else "; add a column name"
                raise BadInputError(f"--row is required for {len(self.rows)} conditions{known}")
            (row,) = self.rows
            with prefix_errors(row.where):
                return self.for_row(row).single()  # without rows
        at = self.at
        if at is not None and len(at) > 1:
            raise _several_values(f"--{at_name(self.model)}", at)
        return self.trim(None if at is None else float(at[0]), self.held())

    def for_row(self, row: ListedCondition) -> TrimInput:
        """Return the options of the trim of one condition: those of the request, and its cells.

        Raises BadInputError for a variable that an option and a condition give.
        """
        by_option = dict.fromkeys(self.hold, "--hold")
        if self.at is not None:
            by_option[self.model.schedule] = f"--{at_name(self.model)}"
        for name, flag in by_option.items():
            if any(name in other.values for other in self.rows):
                raise BadInputError(f"give {name} either in the file of --conditions or by {flag}")
        free = tuple(name for name in self.free if name not in row.values)
        return self._replace(
            hold={**self.hold, **{name: (value,) for name, value in row.values.items()}},
            free=tuple(dict.fromkeys((*free, *row.free))),
            limits={**self.limits, **row.limits},
            rows=(),
        )

    def trim_of(self, row: ListedCondition) -> GivenTrim:
        """Return the trim of a condition, of a file or of a grid, which states all values."""
        return self.for_row(row).single() if self.rows else self.trim(None, row.values)

    def stated(self, row: ListedCondition) -> StatedValues:
        """Return what a condition, of a file or of a grid, and the options state."""
        if not self.rows:  # the row of a point of a grid already has the values of the options
            return StatedValues(row.values, self.free, self.limits)
        given = self.for_row(row)
        held = given.held()
        if given.at is not None:
            held = {self.model.schedule: given.at[0], **held}
        return StatedValues(held, given.free, given.limits)

    def asked(
        self,
        find: Callable[[GivenTrim], OperatingPoint],
        class_: str = "",
        category: str = "B",
    ) -> list[AskedTrim]:
        """Return the trims of the conditions of a file.

        find: function that returns the point of a trim
        class_, category: where a condition states none

        Raises BadInputError for a variable that an option gives, too.
        """
        from trim.reports.models import AskedTrim

        def found(row: ListedCondition) -> OperatingPoint:
            return find(self.trim_of(row))

        return [
            AskedTrim(
                row.name or str(number),
                self.stated(row),
                partial(found, row),
                row.where,
                row.airplane(class_, category),
            )
            for number, row in enumerate(self.rows, start=1)
        ]

    def held(self) -> dict[str, float]:
        """Return variable or parameter -> its value of --hold or --isa.

        Raises BadInputError for several values.
        """
        for name, values in self.hold.items():
            if len(values) > 1:
                raise _several_values(f"--hold {name}", values)
        return {name: float(values[0]) for name, values in self.hold.items()}

    def trim(self, at: float | None, hold: Mapping[str, float]) -> GivenTrim:
        """Return the trim at one value of each variable.

        at: value of the scheduling variable, or None for that of the condition
        hold: variable or parameter -> value
        """
        model = self.model
        values = hold if at is None else {**hold, model.schedule: at}
        changed = tuple((name, values[name]) for name in model.parameters if name in values)
        common = self.common_condition(hold)
        # A parameter is part of the model, and not of the condition.
        condition = common.at(None if model.schedule in model.parameters else at)
        return GivenTrim(
            model=_with_parameters(model, changed) if changed else model,
            condition=condition,
            common=common,
            at=at,
            hold=hold,
            start=self.start,
            source=self.source(common, values, None if at is None else condition),
        )

    def common_condition(self, hold: Mapping[str, float]) -> TrimCondition:
        """Return the condition without the value of the scheduling variable.

        hold: variable or parameter -> value

        Raises BadInputError as `release` does.
        """
        held = {name: value for name, value in hold.items() if name not in self.model.parameters}
        released = release(self.condition, free=self.free, hold=held, limits=self.limits)
        return replace(released, begin={**released.begin, **self.begin})

    def source(
        self,
        common: TrimCondition,
        values: Mapping[str, float],
        single: TrimCondition | None = None,
    ) -> dict[str, Any]:
        """Return the entries of the provenance on the aircraft and its trim, or trims.

        common: condition without the value of the scheduling variable
        values: values that the options set, of which those of parameters are entries
        single: condition with a value of the scheduling variable that an option gives, or None
        """
        model = self.model
        parameters = {name: values[name] for name in model.parameters if name in values}
        changed = dict(self.aircraft["changed"])
        for name, value in parameters.items():
            loaded = model.parameters[name]
            if value != loaded.start:
                changed[name] = Change(value, loaded.start, loaded.unit)
        source = {**self.aircraft, "changed": changed}
        # The default condition of a user's aircraft is in its file, whose digest is an entry.
        if model.source.text:
            return source | {"condition": {**common.changes, "parameters": parameters}}
        condition: Mapping[str, Any] = common.changes
        if single is not None:
            limits = {name: list(single.limits_of(name)) for name in single.free}
            condition = {
                "imposed": dict(single.imposed),
                "free": list(single.free),
                "limits": limits,
            }
        return source | {"condition": condition, "flight": common.in_words()}


@lru_cache(maxsize=16)
def _with_parameters(model: Model, values: tuple[tuple[str, float], ...]) -> Model:
    """Return a model with other values of parameters, one object for the same values."""
    return model.with_parameters(**dict(values))


def given_trim(request: TrimOptions) -> GivenTrim:
    """Return the single trim that the options define.

    Raises BadInputError for an unknown name, an invalid value, or options that contradict.
    """
    given = trim_input(request).single()
    if freed := freed_parameters(given.condition):
        raise _free_parameter(freed[0])
    return given


def _free_parameter(name: str) -> BadInputError:
    """Return the error of a command that sets no parameters free."""
    return BadInputError(
        f"{name} is a parameter, which only `hfa trim` and `hfa linearize` set free; find its "
        f"value there, and give --hold {name}=VALUE"
    )


def _several_values(option: str, values: Range) -> BadInputError:
    """Return the error of an option that gives several values where one is required."""
    return BadInputError(
        f"{option} has {len(values):,} values; give one (`hfa trim` and `hfa sweep` take several)"
    )


def trim_input(
    request: TrimOptions, scheduled: Callable[[Model, str, str], Range] = value_range
) -> TrimInput:
    """Return what the options say about trims.

    scheduled: function (model, name, text) -> values of the scheduling variable; that of a proof
        returns the ends of an interval

    Raises BadInputError for an unknown name, an invalid value, or options that contradict.
    """
    model, aircraft, _ = loaded_aircraft(request)
    texts = request.hold
    if request.isa is not None:
        if ISA in texts:
            raise BadInputError(f"--isa and --hold {ISA} are the same; give one of them")
        texts = {**texts, ISA: request.isa}
    hold = each_of("--hold", model, texts, value_range)
    free = tuple(_freed(model, text) for text in request.free)
    for name in free:
        if name in hold:
            raise BadInputError(
                f"{name} is both free and held; remove --free or --hold for this variable"
            )
    begin, start = ({}, None) if request.start is None else _start(request.start, model)
    condition = usual_condition(model)
    if request.condition is not None:
        with option_errors("--condition"):
            condition = load_condition(request.condition, condition)
    rows: tuple[ListedCondition, ...] = ()
    if request.conditions is not None:
        rows = tuple(listed_conditions(request.conditions, model))
        if request.row is not None:
            rows = (chosen_row(rows, request.row, request.conditions),)
    elif request.row is not None:
        raise BadInputError("--row names a condition of --conditions FILE; add this option")
    return TrimInput(
        model=model,
        aircraft=aircraft,
        condition=condition,
        free=free,
        limits=each_of("--limit", model, request.limit, span),
        at=_scheduled(request, model, scheduled, free, hold),
        hold=hold,
        begin=begin,
        start=start,
        rows=rows,
    )


def conditions(
    model: Model,
    path: str | Path,
    *,
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    units: str = "",
    class_: str = "",
    category: str = "B",
) -> Conditions:
    """Return the trims and linear models of a file of conditions, a row for each condition.

    model: model of the aircraft
    path: CSV file: a row of names, then a row of values for each condition, which may hold and
        free other variables than the other rows
    states, inputs, outputs: names, as in `linearize`
    units: "si" for results and cells in SI units, or "" for those of the model
    class_, category: of MIL-F-8785C, for rows that state none; "" the class by weight

    A condition without a trim has the reason in `reasons`.

    Raises BadInputError with the row, the column and the name of the condition for a wrong cell.

    >>> import hfa
    >>> uav = hfa.load_model("examples/uav.toml")
    >>> book = hfa.conditions(uav, "examples/uav_conditions.csv")
    >>> book["cruise"]["altitude"], book.A["alpha", "pitch_rate"].shape
    (100.0, (8,))
    """
    from trim.reports.models import linear_models

    if units not in ("", "si"):
        raise BadInputError(f"units is {units!r}; give 'si', or leave it out")
    model = in_si(model) if units else model
    rows = tuple(listed_conditions(path, model))
    given = TrimInput(model, {"changed": {}}, usual_condition(model), rows=rows)
    with option_errors("class_"):
        class_ = airplane_class(class_) if class_ else ""
    with option_errors("category"):
        category = flight_category(category)
    asked = given.asked(lambda each: trim(each.model, each.condition, each.start), class_, category)
    return linear_models(model, asked, states=states, inputs=inputs, outputs=outputs)


class GivenTrims(NamedTuple):
    """Trims at each value of the scheduling variable, in the order given.

    trims: at least one; without a value of the variable, the trim of the condition
    source: entries of the provenance of results on all trims: aircraft and common condition
    """

    trims: list[GivenTrim]
    source: Mapping[str, Any]


def given_trims(request: SeveralTrims, most: int) -> GivenTrims:
    """Return the trims that the options define.

    most: largest number of trims

    Raises BadInputError for more trims, and as `given_trim` does.
    """
    given = trim_input(request)
    if given.rows or given.at is None:
        trims = [given.single()]
        source = trims[0].source
    else:
        hold = given.held()
        values = array_of(f"--{at_name(given.model)}", given.at, most)
        trims = [given.trim(value, hold) for value in values.tolist()]
        source = given.source(trims[0].common, hold)
    # The trims have the same condition but for the scheduling variable: one is checked for all.
    if freed := freed_parameters(trims[0].condition):
        raise _free_parameter(freed[0])
    return GivenTrims(trims, source)


def at_name(model: Model) -> str:
    """Return the name of the option for the scheduling variable: "dihedral" of the HFA, or "at"."""
    return model.schedule if model.about.names_schedule else "at"


def _scheduled(
    request: TrimOptions,
    model: Model,
    values_of: Callable[[Model, str, str], Range],
    free: Sequence[str],
    hold: Mapping[str, Range],
) -> Range | None:
    """Return the values of --at or --dihedral, or None.

    values_of: function (model, name of the scheduling variable, text) -> values

    Raises BadInputError also if --hold or --free gives the scheduling variable, too.
    """
    schedule, is_hfa = model.schedule, model.about.names_schedule
    if request.dihedral is not None and not is_hfa:
        raise BadInputError(f"--dihedral applies only to the HFA; {model.name} takes --at VALUE")
    text = request.dihedral if request.at is None else request.at
    if text is None:
        if request.needs_dihedral and is_hfa and request.conditions is None:
            raise BadInputError(f"no value of {schedule} is given; add --{schedule} DEG")
        return None
    option = f"--{at_name(model)}"
    if request.at is not None and request.dihedral is not None:
        raise BadInputError(f"--at and {option} are the same; give one of them")
    if not schedule:
        raise BadInputError(
            f"--at must be removed, because {model.name} declares no scheduling variable"
        )
    with option_errors(option):
        values = values_of(model, schedule, text)
    is_guess = len(values) == 1  # at which the search begins, if the variable is free
    other = "--hold" if schedule in hold else "--free"
    if schedule in hold or (schedule in free and not is_guess):
        raise BadInputError(
            f"{schedule} is given by both {option} and {other}; remove one of these options"
        )
    return values


def _freed(model: Model, text: str) -> str:
    """Return the model's name of the variable that --free gives."""
    if "," in text:
        options = " ".join(f"--free {name.strip()}" for name in text.split(","))
        raise BadInputError(f"--free takes one variable; write {options}")
    return model.about.name_of(text)


def _start(text: str, model: Model) -> tuple[dict[str, float], OperatingPoint | None]:
    """Return variable -> initial value, and the initial point: --start gives values or a point."""
    with option_errors("--start"):
        if "=" not in text or Path(text).exists():  # a file, whose name may contain =
            return {}, OperatingPoint.load(Path(text), model)
        begin = {}
        for word in text.split(","):
            typed, _, value = word.partition("=")
            name = model.about.name_of(typed)
            refuse_unknown("no variable is called", name, model.variables)
            begin[name] = quantity(model, name, value)
    return begin, None
