"""Options of the aircraft, of a trim and of outputs, with the model and condition they define."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from hfa.options.argument_types import (
    PICTURES,
    breakpoint_value,
    one_of,
    output_file,
    quantity,
    span,
)
from hfa.options.request import OfModel, Request, option
from hfa_aircraft.model import Model
from hfa_model.choice import aircraft
from hfa_model.parameters import NAMED, ParameterSet, default_parameters, load_parameters
from hfa_model.variants import variant_named
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.files import note_read
from hfa_support.reporting.report import SUFFIXES, Report
from hfa_support.units import SYSTEMS
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, explained, trim

#: Options of the trim condition, without the scheduling variable.
OF_THE_TRIM = ("condition", "free", "hold", "limit", "start")
#: Suffix -> function that writes the report as text. HTML embeds its pictures; Markdown has none.
REPORTS: dict[str, Callable[[Report], str]] = {
    ".md": Report.markdown,
    ".html": lambda report: f'<!doctype html>\n<meta charset="utf-8">\n{report.html()}',
}


# Aircraft.
def is_own(model: Model | None) -> bool:
    """Return whether a model was loaded from a file or another source that the user named.

    The result is False for the paper's flexible aircraft and for None.
    """
    return model is not None and model.extras.source[0] != ""


def of_hfa(about: str, otherwise: str = "") -> Callable[[Model | None], str]:
    """Return a help text of an option that depends on the model, as a function of the model.

    about: help for the paper's flexible aircraft
    otherwise: help for an aircraft of the user, or "" to hide the option
    """
    return lambda model: otherwise if is_own(model) else about


@dataclass(frozen=True, kw_only=True, eq=False)
class UnitsOption(Request):
    """Option for the units of input and output."""

    units: str = option(
        of_hfa(
            "units of input and output: english (ft, slug, lbf; default) or si (m, kg, N)",
            "units of input and output: si (m, kg, N); default: units of the aircraft",
        ),
        "UNITS",
        one_of(*SYSTEMS),
        default="english",
        rare=True,
    )


def _dynamics_help(model: Model | None) -> str:
    """Return the help of --dynamics, or "" for an aircraft of the user."""
    if is_own(model):
        return ""
    return (
        "equations of motion: published (regenerates the printed matrices; default), "
        "newton (exact mechanics, the same air loads), unsteady"
    )


def _parameters(model: Model | None, text: str) -> ParameterSet | Path:
    """Return the parameters that --parameters gives: those of the HFA, or the file for an aircraft
    of the user.

    model: None while the model is unknown, which `named_model` loads with the parameters
    """
    return Path(text) if model is None or is_own(model) else load_parameters(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class HfaOptions(Request):
    """Options for the dynamics and parameters of the paper's flexible aircraft (HFA)."""

    dynamics: str = option(_dynamics_help, "VARIANT", default="published")
    parameters: ParameterSet | Path | None = option(
        of_hfa(
            f"parameters of the HFA: a file, {' or '.join(NAMED)} (default: identified)",
            "new values of parameters: a file that hfa identify -o FILE.toml wrote",
        ),
        "FILE",
        OfModel(_parameters),
        rare=True,
    )

    @property
    def own(self) -> bool:
        """True if the model is an aircraft that the user loaded, and not the HFA."""
        return is_own(self.model)

    @property
    def parameter_set(self) -> ParameterSet:
        """Parameters of the HFA, from --parameters or the default."""
        known = self.parameters
        return known if isinstance(known, ParameterSet) else default_parameters()

    @property
    def hfa(self) -> Model:
        """The HFA with the chosen dynamics and parameters.

        Raises BadInputError if the dynamics are not in `VARIANTS`.
        """
        variant_named(self.dynamics)
        return self.model

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the aircraft.

        The provenance is the aircraft's file, or the dynamics and parameters of the HFA.
        """
        if self.own:
            return self._origin_of_file({})
        return self._origin(self.model, condition={})

    def _origin_of_file(self, condition: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the provenance of an aircraft that was loaded from a file.

        The entry "model" contains the file and its digest. A file of --parameters is named with
        the digest of its content.

        condition: entry for the trim condition
        """
        file, digest = self.model.extras.source
        origin: dict[str, Any] = {
            "model": f"{file} (SHA-256 {digest[:12]})",
            "condition": condition,
        }
        if isinstance(self.parameters, Path):
            content = hashlib.sha256(self.parameters.read_bytes()).hexdigest()
            origin |= {"parameters": str(self.parameters), "parameter_hash": content[:12]}
        return origin

    def _origin(self, model: Model, **of_the_trim: Any) -> Mapping[str, Any]:
        """Return the provenance of the HFA: dynamics, parameters, and changed parameters.

        model: the HFA with the parameter values of the trim
        of_the_trim: further entries
        """
        from hfa_model.parameters import changed_parameters
        from hfa_support.provenance import Change, parameter_hash

        chosen = self.parameter_set
        changed = changed_parameters(chosen)
        for name, signal in model.parameters.items():
            usual = self.model.parameters[name].start
            if signal.start != usual:
                changed[name] = Change(signal.start, usual, signal.unit)
        return {
            "dynamics": self.dynamics,
            "parameters": chosen.name,
            "parameter_hash": parameter_hash(chosen.values),
            "changed": changed,
            **of_the_trim,
        }


def aircraft_help(model: Model | None) -> str:
    """Return the help of --aircraft, with the formats of the core and of installed packages."""
    from hfa_aircraft.loading import forms_of_packages

    forms = ("aircraft: a Python file (executed) or package.module:NAME", *forms_of_packages())
    return ", ".join(forms) + of_hfa("; default: the HFA")(model)


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftOptions(HfaOptions):
    """Options for the aircraft: the HFA, or an aircraft of the user."""

    aircraft: str | None = option(aircraft_help, "FILE.py:NAME")


def named_model(typed: Mapping[str, Any]) -> Model:
    """Return the model that the options define.

    - the discrete-time plant in `steps`, if given
    - the aircraft in `aircraft`, if given
    - otherwise the HFA with the given dynamics and parameters

    typed: field of the request -> value, for the options given by the user

    Raises BadInputError if --dynamics is combined with --aircraft.
    """
    if "steps" in typed:
        from controller.discrete.step_model import step_model

        return step_model(typed["steps"])
    if "aircraft" in typed:
        from hfa_aircraft.loading import load_model

        if "dynamics" in typed:
            raise BadInputError(
                "--dynamics applies only to the HFA; remove this option or --aircraft"
            )
        note_read(typed["aircraft"].rpartition(":")[0])
        return load_model(typed["aircraft"], typed.get("parameters"))
    known = load_parameters(typed.get("parameters", "identified"))
    return aircraft(typed.get("dynamics", HfaOptions.dynamics), known.values)


# Trim.
def called_at(model: Model) -> str:
    """Return the name of the option for the scheduling variable.

    The name is that of the variable if the model has `names_schedule`, otherwise "at".
    """
    return model.schedule if model.extras.names_schedule else "at"


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
        name = model.schedule or "the scheduling variable"
        shown_unit = "degrees" if unit(model) == "deg" else unit(model)
        more = about(model) if callable(about) else about
        return f"{name}, {shown_unit}".rstrip(", ") + f"; {more}".rstrip("; ")

    return option(
        words,
        lambda model: form or ("DEG" if unit(model) == "deg" else "VALUE"),
        OfModel(convert),
        names=lambda model: f"--at --{model.schedule}" if model.extras.names_schedule else "--at",
        required=lambda model: required and model.extras.names_schedule,
    )


def _usual(model: Model) -> str:
    """Return the help of --hold, which lists up to four of the variables that a trim holds by
    default.
    """
    held = [
        f"{name} {model.describe(name, value)}"
        for name, value in model.trim.items()
        if name != model.schedule
    ]
    usual = f"; default: {', '.join(held[:4])}" if held else ""
    return f"hold a variable at a value (repeatable){usual}"


def condition_or_list(model: Model, text: str) -> TrimCondition | Path:
    """Return the trim condition named by --condition, or the path of a CSV file of trim points.

    text: name or file of a condition, or path of a .csv file
    """
    from trim.hfa.level_flight import load_condition

    if text.lower().endswith(".csv"):
        return Path(text)
    return load_condition(text, usual_condition(model))


def _name(model: Model, text: str) -> str:
    """Return the model's name of a variable.

    text: this name, or an alias of the variable
    """
    return model.extras.aliases.get(text, text)


def _start(model: Model, text: str) -> OperatingPoint | dict[str, float]:
    """Return the initial point of the trim search that --start gives.

    - a file: the operating point in it
    - NAME=VALUE,NAME=VALUE: name -> value, in internal units

    Raises BadInputError for an unreadable file, an unknown variable or an invalid value.
    """
    if "=" not in text or Path(text).exists():
        return OperatingPoint.load(Path(text), model)
    values = {}
    for word in text.split(","):
        typed, _, value = word.partition("=")
        name = _name(model, typed)
        refuse_unknown("no variable is called", name, model.variables)
        values[name] = quantity(model, name, value)
    return values


def condition_help(model: Model | None) -> str:
    """Return the help of --condition, which lists the named conditions for the HFA."""
    from trim.hfa.level_flight import CONDITIONS

    names = of_hfa(f", or {', '.join(CONDITIONS)}")(model)
    return f"trim condition that replaces the default: a file{names}"


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimOptions(HfaOptions):
    """Options for the condition of a trim."""

    at: Any = scheduled(breakpoint_value)
    condition: TrimCondition | Path | None = option(
        condition_help, "FILE", OfModel(condition_or_list), rare=True
    )
    free: tuple[str, ...] = option(
        "variable that the trim solves for; repeatable",
        "NAME",
        OfModel(_name),
        repeated=True,
        rare=True,
    )
    glide: bool = option("trim a glide: lowest throttle, free flight-path angle", rare=True)
    hold: Mapping[str, Any] = option(_usual, "NAME=VALUE", OfModel(quantity), named=True)
    limit: Mapping[str, tuple[float, float]] = option(
        "limits of a free variable of the trim, degrees for angles; repeatable",
        "NAME=LOW:HIGH",
        OfModel(span),
        named=True,
        rare=True,
    )
    start: OperatingPoint | Mapping[str, float] | None = option(
        "initial point of the trim search: an operating point (.json), or NAME=VALUE,NAME=VALUE",
        "FILE",
        OfModel(_start),
        rare=True,
    )

    def held_parameters(self) -> dict[str, float]:
        """Return parameter -> value, for the parameters that options set to a single value."""
        held = {**self.hold, self.model.schedule: self.at}
        return {
            name: held[name] for name in self.model.parameters if isinstance(held.get(name), float)
        }

    def flown_aircraft(self) -> Model:
        """Return the model with the parameter values that options set."""
        return self.model.with_parameters(**self.held_parameters())

    @cached_property
    def common_condition(self) -> TrimCondition:
        """The trim condition shared by all points, without the value of the scheduling variable.

        The condition is --condition or the default, changed by --hold, --free, --limit, --glide and
        --start.

        Raises BadInputError if a variable is given twice, if --condition is a list of points, and
        as `release` does.
        """
        self._refuse_doubles()
        model = self.model
        usual = self.condition or usual_condition(model)
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
        free = self.free
        if self.glide:
            free = (*free, "gamma")
            if "throttle" in model.inputs:
                held["throttle"] = model.inputs["throttle"].min
        condition = release(usual, free=free, hold=held, limits=self.limit)
        if isinstance(self.start, Mapping):
            return replace(condition, begin={**condition.begin, **self.start})
        return condition

    def _refuse_doubles(self) -> None:
        """Raise BadInputError if the same variable is given by two of the options --free, --hold
        and --at.

        --free and a single value of --at may give the same variable. The value is then the initial
        guess.
        """
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
        values = self.hold[name]
        one_value = isinstance(values, tuple) and len(values) == 1
        return one_value and name not in self.model.parameters

    @cached_property
    def trim_condition(self) -> TrimCondition:
        """The condition of a single trim, with the value of the scheduling variable."""
        is_parameter = self.model.schedule in self.model.parameters
        return self.common_condition.at(None if is_parameter else self.at)

    @property
    def start_point(self) -> OperatingPoint | None:
        """The operating point from the file given by --start, or None if --start gives no file."""
        return self.start if isinstance(self.start, OperatingPoint) else None

    def operating_point(self, aircraft: Model) -> OperatingPoint:
        """Return the trim of an aircraft at the condition set by the options.

        If --start gives a point, the search begins there.

        aircraft: the model with the parameter values of the options

        Raises TrimError with an explanation if no trim is found.
        """
        condition = self.trim_condition
        by = self.model.schedule
        if self.at is not None and by in condition.free:
            from hfa_support.errors import warn

            typed = f"--{called_at(self.model)} {self.model.describe(by, self.at)}"
            begins = typed if self.start is None else "--start"
            warn(f"{by} is free: the search begins at {begins}")
        try:
            return trim(aircraft, condition, self.start_point)
        except TrimError as failure:
            raise advised(failure, self, aircraft, condition) from None

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the aircraft and of its trim condition."""
        common = self.common_condition
        condition: dict[str, Any] = common.changes
        if self.own:
            condition["parameters"] = self.held_parameters()
            return self._origin_of_file(condition)
        if isinstance(self.at, float):
            single = common.at(self.at)
            limits = {name: list(single.limits_of(name)) for name in single.free}
            condition = {
                "imposed": dict(single.imposed),
                "free": list(single.free),
                "limits": limits,
            }
        held = self.model.with_parameters(**self.held_parameters())
        return self._origin(held, condition=condition, flight=common.in_words())


@dataclass(frozen=True, kw_only=True, eq=False)
class OneTrimOptions(UnitsOption, AircraftOptions, TrimOptions):
    """Options for one trim of any aircraft."""

    at: float | None = scheduled(breakpoint_value, required=True)


# Outputs.
@dataclass(frozen=True, kw_only=True, eq=False)
class JsonOption(Request):
    """Option for output in JSON."""

    json: bool = option("print JSON (angles in radians) instead of text")


def output_option(
    *more: str, stores: Sequence[str] = (), purpose: str | Callable[[], str] = ""
) -> Any:
    """Return the request field `output`, whose option -o names a file or store to write.

    more: accepted suffixes besides those of a report
    stores: accepted suffixes of stores
    purpose: text on the additional suffixes for the help, or a function that returns it
    """
    suffixes = (*SUFFIXES, *REPORTS, *more)

    def about(_: Model) -> str:
        """Return the help of -o, with the accepted suffixes."""
        use = purpose() if callable(purpose) else purpose
        return f"write results: {', '.join((*suffixes, *stores))}{use}"

    return option(about, "FILE", output_file(*suffixes, stores=stores), names="-o --output")


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputOptions(JsonOption):
    """Options for the output files of a command."""

    output: Path | None = output_option()
    picture: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class OneTrimRequest(OneTrimOptions, OutputOptions):
    """Options of a command on one trim, including the options for its output files."""


def picture_option(shows: str, *, only_hfa: bool = False) -> Any:
    """Return the request field `picture`, whose option names the image file to write.

    shows: content of the picture, for the help
    only_hfa: True to hide the option for all aircraft except the HFA
    """
    about = f"draw {shows} ({', '.join(PICTURES)})"
    return option(of_hfa(about, "" if only_hfa else about), "FILE", output_file(*PICTURES))


def advised(
    failure: TrimError, request: TrimOptions, aircraft: Model, condition: TrimCondition
) -> TrimError:
    """Return the error of a failed trim, with the reason and advice on options added.

    If alpha is held and a trim with free alpha exists, the message also advises --free alpha.

    failure: error of the trim search
    request: the options
    aircraft: the model
    condition: condition of the failed trim
    """
    error = explained(failure, aircraft, condition)
    if "alpha" not in condition.imposed:
        return error
    freed = release(condition, free=("alpha",))
    try:
        free_point = trim(aircraft, freed, request.start_point)
    except NoSolutionError:
        return error
    trimmed = request.model.describe("alpha", free_point.states.alpha)
    is_typed = "alpha" in request.hold
    advice = "replace --hold alpha by --free alpha" if is_typed else "add --free alpha"
    return TrimError(
        f"{error}; with alpha free, the trim is at {trimmed}: {advice}",
        error.attempt,
    )
