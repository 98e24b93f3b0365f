"""The trim of a request: its condition, and the search for its operating point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import isclose
from pathlib import Path
from typing import Any

from hfa.options.aircraft import is_own
from hfa.options.argument_types import breakpoint_value, quantity, span
from hfa.options.part import OfModel, Part, option
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, refuse_unknown, warn
from hfa_support.reporting.text import shown_value
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, explained, trim

#: Largest number of options that help a failed trim.
_MOST_ADVICE = 3
#: States that change in a steady climb, and the state that changes in a pull-up.
_CLIMBING = ("altitude", "alt", "h")
_PULLED_UP = ("pitch", "theta")
#: Options of the trim condition, without the scheduling variable.
OF_THE_TRIM = ("given", "free", "hold", "limit", "start")


def called_at(model: Model) -> str:
    """Return the name of the option for the scheduling variable.

    The name is that of the variable if the model has `names_schedule`, otherwise "at".
    """
    return model.schedule if model.about.names_schedule else "at"


def scheduled(
    kind: Callable[[Model, str], Any],
    form: str = "",
    about: str | Callable[[Model], str] = "",
    *,
    required: bool = False,
) -> Any:
    """Return the request field `at`, whose option sets the scheduling variable.

    The option is --at. If the model has `names_schedule`, the option is also --NAME with the name
    of the variable, for example --dihedral.

    kind: function (model, word) -> value
    form: placeholder of the value in the help, or "" for DEG or VALUE
    about: text added to the help
    required: whether the option is mandatory for a model with `names_schedule`
    """

    def convert(model: Model, text: str) -> Any:
        if not model.schedule:
            raise BadInputError(
                f"must be removed, because {model.name} declares no scheduling variable"
            )
        return kind(model, text)

    def unit(model: Model) -> str:
        return model.schedule_unit if model.schedule else ""

    def words(model: Model) -> str:
        shown_unit = "degrees" if unit(model) == "deg" else unit(model)
        more = about(model) if callable(about) else about
        return f"scheduling variable, of the HFA {model.schedule}, {shown_unit}; {more}".rstrip(
            "; "
        )

    return option(
        words,
        lambda model: form or ("DEG" if unit(model) == "deg" else "VALUE"),
        OfModel(convert),
        names=lambda model: f"--at --{model.schedule}" if model.about.names_schedule else "--at",
        required=lambda model: required and model.about.names_schedule,
    )


def limits_option(about: str, *, rare: bool = False) -> Any:
    """Return a request field whose option --limit sets limits, signal -> (lowest, highest).

    about: whose limits they are
    """
    return option(
        f"{about}, degrees for angles; repeatable",
        "NAME=LOW:HIGH",
        OfModel(span),
        names="--limit",
        named=True,
        rare=rare,
    )


def condition_or_list(model: Model, text: str) -> TrimCondition | Path:
    """Return the trim condition named by --condition, or the path of a CSV file of trim points.

    text: name or file of a condition, or path of a .csv file
    """
    from trim.hfa.level_flight import load_condition

    if text.lower().endswith(".csv"):
        return Path(text)
    return load_condition(text, usual_condition(model))


def _name(model: Model, text: str) -> str:
    """Return the model's name of a variable."""
    return model.about.aliases.get(text, text)


def _free(model: Model, text: str) -> str:
    """Return the model's name of the variable that --free gives."""
    if "," in text:
        options = " ".join(f"--free {name.strip()}" for name in text.split(","))
        raise BadInputError(f"give one variable; write {options}")
    return _name(model, text)


def _start(model: Model, text: str) -> OperatingPoint | dict[str, float]:
    """Return the initial point of the trim search that --start gives."""
    if "=" not in text or Path(text).exists():
        return OperatingPoint.load(Path(text), model)
    values = {}
    for word in text.split(","):
        typed, _, value = word.partition("=")
        name = _name(model, typed)
        refuse_unknown("no variable is called", name, model.variables)
        values[name] = quantity(model, name, value)
    return values


def condition_help(_: Model | None) -> str:
    """Return the help of --condition, with the named conditions of the HFA."""
    from trim.hfa.level_flight import CONDITIONS

    return f"trim condition that replaces the default: a file, or {', '.join(CONDITIONS)}"


def _is_equal(declared: object, value: float) -> bool:
    """Return whether a value is that of the default trim, which no option need set free."""
    return isinstance(declared, float) and isclose(value, declared, abs_tol=1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trim(Part):
    """The condition of a trim."""

    at: Any = scheduled(breakpoint_value)
    given: TrimCondition | Path | None = option(
        condition_help, "FILE", OfModel(condition_or_list), names="--condition", rare=True
    )
    free: tuple[str, ...] = option(
        "variable that the trim solves for; repeatable",
        "NAME",
        OfModel(_free),
        repeated=True,
        rare=True,
    )
    hold: Mapping[str, Any] = option(
        "hold a variable at a value (repeatable)", "NAME=VALUE", OfModel(quantity), named=True
    )
    limit: Mapping[str, tuple[float, float]] = limits_option(
        "limits of a free variable of the trim", rare=True
    )
    start: OperatingPoint | Mapping[str, float] | None = option(
        "initial point of the trim search: an operating point (.json), or NAME=VALUE,NAME=VALUE",
        "FILE",
        OfModel(_start),
        rare=True,
    )

    @property
    def held_parameters(self) -> dict[str, float]:
        """Parameter -> value, for the parameters that options set to a single value."""
        held = {**self.hold, self.model.schedule: self.at}
        return {
            name: held[name] for name in self.model.parameters if isinstance(held.get(name), float)
        }

    @cached_property
    def aircraft(self) -> Model:
        """The model with the parameter values that options set."""
        return self.model.with_parameters(**self.held_parameters)

    @cached_property
    def common_condition(self) -> TrimCondition:
        """The trim condition shared by all points, without the value of the scheduling variable.

        The condition is --condition or the default, changed by --hold, --free, --limit and --start.

        Raises BadInputError if a variable is given twice, if --condition is a list of points, and
        as `release` does.
        """
        self._refuse_doubles()
        model = self.model
        usual = self.given or usual_condition(model)
        if isinstance(usual, Path):
            raise BadInputError(
                f"--condition {usual} is a list of points; give one condition, or use `hfa sweep`"
            )
        held: dict[str, float] = {}
        for name, value in self.hold.items():
            if name in model.parameters:
                continue
            if isinstance(value, float):
                held[name] = value
            elif self.is_constant(name):
                held[name] = value[0]
        condition = release(usual, free=self.free, hold=held, limits=self.limit)
        if isinstance(self.start, Mapping):
            return replace(condition, begin={**condition.begin, **self.start})
        return condition

    def _refuse_doubles(self) -> None:
        """Raise BadInputError if two of --free, --hold and --at give the same variable."""
        for name in self.free:
            if name in self.hold:
                raise BadInputError(
                    f"{name} is both free and held; remove --free or --hold for this variable"
                )
        if self.at is None:
            return
        variable = self.model.schedule
        option_name = f"--{called_at(self.model)}"
        if variable in self.hold:
            raise BadInputError(
                f"{variable} is given by both {option_name} and --hold; remove one of these options"
            )
        # A single value of a free variable is the initial guess of the search.
        if variable in self.free and not isinstance(self.at, float):
            raise BadInputError(
                f"{variable} is given by both {option_name} and --free; remove one of these options"
            )

    def is_constant(self, name: str) -> bool:
        """Return whether --hold of a sweep gives only one value for a variable of the trim.

        The result is False for a parameter of the model. Parameters are always axes of the sweep.
        """
        from hfa.options.ranges import is_one_value

        return is_one_value(self.hold[name]) and name not in self.model.parameters

    @cached_property
    def condition(self) -> TrimCondition:
        """The condition of a single trim, with the value of the scheduling variable."""
        is_parameter = self.model.schedule in self.model.parameters
        return self.common_condition.at(None if is_parameter else self.at)

    @property
    def start_point(self) -> OperatingPoint | None:
        """The operating point from the file given by --start, or None if --start gives no file."""
        return self.start if isinstance(self.start, OperatingPoint) else None

    def point(self) -> OperatingPoint:
        """Return the operating point at the condition set by the options.

        If --start gives a point, the search begins there.

        Raises TrimError with an explanation if no trim is found.
        """
        by = self.model.schedule
        if self.at is not None and by in self.condition.free:
            typed = f"--{called_at(self.model)} {self.model.describe(by, self.at)}"
            begins = typed if self.start is None else "--start"
            warn(f"{by} is free: the search begins at {begins}")
        try:
            return trim(self.aircraft, self.condition, self.start_point)
        except TrimError as failure:
            raise self._advised(failure) from None

    def _advised(self, failure: TrimError) -> TrimError:
        """Return the error of a failed trim, with its reason, doubts, and options that help."""
        error = explained(failure, self.aircraft, self.condition)
        doubts = [f"check: {doubt}" for doubt in self.aircraft.about.doubts]
        advice = "" if error is not failure else self._advice(failure)  # the aircraft explains it
        said = "; ".join(filter(None, (str(error), *doubts, advice)))
        return TrimError(said, error.attempt, error.required)

    def _advice(self, failure: TrimError) -> str:
        """Return the imposed values of which one must be free, so that a trim exists, or "".

        Each is tried: first the rate of altitude, as in a climb, and with an imposed load factor
        that of pitch, as in a pull-up. Values that the user imposed come last. If only one input
        is too weak, it is held at its limit, so that the advice is the steepest climb and not a
        glide. If the equations balance only with a free rate, and beyond a limit, the advice is
        this rate and the limit.
        """
        if failure.attempt._unmoved:
            return ""
        changing = _CLIMBING + _PULLED_UP * ("load_factor" in self.condition.imposed)
        imposed = [f"{name}_dot" for name in self.condition.rates if name.lower() in changing]
        weak = self._too_weak(failure)
        typed = "".join(
            f"--hold {each}={shown_value(value, self.model.unit(each))} "
            for each, value in weak.items()
        )
        imposed += sorted(self.condition.imposed, key=lambda name: name in self.hold)
        declared = usual_condition(self.model).imposed
        found: list[str] = []
        for name in imposed:
            is_swept = name == self.model.schedule and self.model.about.names_schedule
            is_extra = name in self.hold and name not in declared  # without it: the default trim
            if is_swept or len(found) == _MOST_ADVICE or (is_extra and found):
                continue
            is_rate = name not in self.condition.imposed
            freed = release(self.condition, free=(name,), hold={} if is_rate else weak)
            try:
                point = trim(self.aircraft, freed, self.start_point)
            except TrimError as obstacle:
                if is_rate and obstacle.required and not failure.required:
                    return f"with --free {name}, balanced only beyond a limit: {obstacle.required}"
            except BadInputError:
                pass
            else:
                if is_rate:
                    found.append(f"--free {name}")
                elif not (point._far_out or _is_equal(declared.get(name), point[name])):
                    value = self.model.describe(name, point[name])
                    instead = " in place of --hold" if name in self.hold else ""
                    found.append(f"{typed}--free {name}{instead} ({name} {value})")
        if not found:
            return ""
        return f"a trim exists with {' or '.join(found)}"

    def _too_weak(self, failure: TrimError) -> dict[str, float]:
        """Return the only free input at a limit beyond which the equations balance, name -> limit.

        The result is {} if none or several are at a limit.
        """
        margins = failure.attempt.margins_under(self.condition).values()
        bound = [each for each in margins if each.at_limit and each.role == "free"]
        if not failure.required or len(bound) != 1 or bound[0].name not in self.model.inputs:
            return {}
        return {bound[0].name: bound[0].nearer_limit}

    def origin(self) -> dict[str, Any]:
        """Return the provenance of the trim condition."""
        common = self.common_condition
        if is_own(self.model):
            return {"condition": {**common.changes, "parameters": self.held_parameters}}
        condition: Mapping[str, Any] = common.changes
        if isinstance(self.at, float):
            single = common.at(self.at)
            limits = {name: list(single.limits_of(name)) for name in single.free}
            condition = {
                "imposed": dict(single.imposed),
                "free": list(single.free),
                "limits": limits,
            }
        return {"condition": condition, "flight": common.in_words()}
