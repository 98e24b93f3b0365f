"""Requests by inheritance, until every extension declares parts."""

# ruff: noqa
# mypy: ignore-errors
from __future__ import annotations

import hashlib
import inspect
import os
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.reading import Reading
from controller.game.linear_game import widths_within_limits
from controller.game.zero_sum import Game
from controller.hfa_game import plant_names, usual_game

from hfa.learning import law_option, setting_option
from hfa.options.aircraft import Aircraft, _parameters, aircraft_help, is_own, of_hfa
from hfa.options.argument_types import *
from hfa.options.game import USUAL_WEIGHTS, NamedGame, _delta, _diagonal_option, _rows
from hfa.options.output import ProgressLine, _write, output_option, picture_option
from hfa.options.part import Option, OfModel, option
from hfa.options.trim import (
    _name,
    _start,
    _usual,
    called_at,
    condition_help,
    condition_or_list,
    scheduled,
)
from hfa.options.workers import _workers
from hfa_aircraft.model import Model
from hfa_model.parameters import NAMED, ParameterSet, default_parameters, load_parameters
from hfa_model.variants import VARIANTS, variant_named
from hfa_support.errors import *
from hfa_support.files import MATRIX_FILES, note_read
from hfa_support.progress import print_flushed, print_notes, print_to_stderr
from hfa_support.reporting.report import Report
from hfa_support.units import SYSTEMS
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, explained, trim

OF_THE_TRIM = ("condition", "free", "hold", "limit", "start")


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """Input of one run.

    model: the aircraft, which defines the names and units of the other fields
    line: the command line as typed
    date: start of the run in UTC, as text
    typed: names of the fields given by the user, while all other fields have default values
    quiet: whether notes and progress are suppressed
    """

    model: Model
    line: str = ""
    date: str = ""
    typed: frozenset[str] = frozenset()
    quiet: bool = option("suppress notes and progress messages", names="-q --quiet", rare=True)

    @classmethod
    def declared(cls) -> dict[str, Option]:
        """Return the options of the request, field -> option. The fields of base classes come
        first.
        """
        options = {field.name: field.metadata["option"] for field in fields(cls) if field.metadata}
        classes = (*cls.__mro__[1:], cls)
        names = [name for field in classes for name in inspect.get_annotations(field)]
        return {name: options[name] for name in dict.fromkeys(names) if name in options}

    @classmethod
    def options(cls, model: Model) -> dict[str, Option]:
        """Return the options of the request in the names and units of a model, field -> option."""
        return {name: option.of(model, name) for name, option in cls.declared().items()}

    @cached_property
    def provenance(self) -> Provenance:
        """Provenance of the run, which is written into its outputs."""
        from hfa_support.provenance import Provenance

        return Provenance(self.line, date=self.date, **self.origin())

    def origin(self) -> Mapping[str, Any]:
        """Return the entries that this class adds to the provenance, by default none."""
        return {}

    def refuse(self, names: Iterable[str], reason: str) -> None:
        """Raise BadInputError if one of these options was given.

        names: fields whose options have no effect in this request
        reason: end of the message, which follows the name of the option
        """
        options = self.options(self.model)
        for name in names:
            if name in self.typed:
                raise BadInputError(f"{options[name].flags[-1]} {reason}")


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


def _dynamics_help(model):
    return Aircraft.declared()["dynamics"].about(model)


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
        file, digest = self.model.source.text, self.model.source.digest
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


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftOptions(HfaOptions):
    """Options for the aircraft: the HFA, or an aircraft of the user."""

    aircraft: str | None = option(aircraft_help, "FILE.py:NAME")


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


@dataclass(frozen=True, kw_only=True, eq=False)
class JsonOption(Request):
    """Option for output in JSON."""

    json: bool = option("print JSON (angles in radians) instead of text")


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputOptions(JsonOption):
    """Options for the output files of a command."""

    output: Path | None = output_option()
    picture: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class OneTrimRequest(OneTrimOptions, OutputOptions):
    """Options of a command on one trim, including the options for its output files."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightOptions(Request):
    """Options for the weights Q, R and delta of the game."""

    delta: float | None = option(
        of_hfa(
            "disturbance weight; default: 200 for the paper's aircraft, else inf (LQR)",
            "disturbance weight; default inf (LQR)",
        ),
        "NUMBER",
        _delta,
    )
    Q: np.ndarray | None = _diagonal_option("Q")
    R: np.ndarray | None = _diagonal_option("R")

    def changed_weights(self) -> dict[str, Any]:
        """Return the weights set by options, "Q", "R" or "delta" -> value, in the model's units."""
        typed: dict[str, Any] = {"Q": self.Q, "R": self.R, "delta": self.delta}
        return {name: value for name, value in typed.items() if value is not None}

    def game_on(self, linear: LinearModel) -> Game:
        """Return the game on a linear model, with the weights from options and default values for
        the others.
        """
        changes = self.changed_weights()
        names = plant_names(linear)
        game = usual_game(linear.model, linear.A, linear.B, names, **changes)
        return replace(game, half_widths=widths_within_limits(linear))


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedOption(Request):
    """Option for the seed of random numbers."""

    seed: int = option(
        "seed of all random numbers; default 0",
        "N",
        whole(0),
        default=0,
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LearningOptions(SeedOption):
    """Options of the learning law."""

    law: str = law_option()
    set: Mapping[str, Any] = setting_option()

    def learned(self, game: Game) -> TrainingRun:
        """Return the training run of the selected learning law on a game."""
        from controller.learning.certified import learn

        return learn(game, self.law, self.seed, progress=ProgressLine("learn"), **self.set)


def plant_option() -> Any:
    """Return the request field `plant`, whose option --model names a plant file."""
    return option(
        f"file with a plant: A, B and optionally E, Q, R, N ({' '.join(MATRIX_FILES)})",
        "FILE",
        input_file(*MATRIX_FILES),
        names="--model",
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantOptions(WeightOptions, AircraftOptions, TrimOptions):
    """Options of a game on an aircraft at a trim, or on a plant read from a file."""

    plant: Path | None = plant_option()
    design: Any = None
    N: np.ndarray | None = option(
        "cross weights of the cost 2 z'Nu, one row for each state; default 0",
        "a,b;c,d",
        _rows,
        names="--N",
        rare=True,
    )

    def changed_weights(self) -> dict[str, Any]:
        """Return the weights set by options, "Q", "R", "delta" or "N" -> value, in the model's
        units.
        """
        cross = {} if self.N is None else {"N": self.N}
        return super().changed_weights() | cross

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the game.

        The provenance is {"model": path} for a plant file, and otherwise the provenance of the
        aircraft and the trim.
        """
        return super().origin() if self.plant is None else {"model": str(self.plant)}

    def game(
        self, read: dict[str, Any] | None = None, *, may_be_discrete: bool = False
    ) -> NamedGame:
        """Return the game specified by the options, on a plant file or on an aircraft at a trim.

        read: entries of the plant file, if it has been read already, or None
        may_be_discrete: whether the command accepts a discrete-time plant

        Raises BadInputError in these cases:
        - The plant file is not valid, or is combined with an option of the aircraft.
        - The plant is in discrete time, and `may_be_discrete` is False.
        - Neither a dihedral angle nor a plant file is given for the paper's flexible aircraft.
        Raises NoSolutionError if the aircraft has no trim.
        """
        if self.plant is not None:
            named = self._game_of_file(self.plant, read)
            if named.discrete is not None and not may_be_discrete:
                raise BadInputError(
                    f"{self.plant} is in discrete time; give a plant in continuous time, or use hfa"
                    " solve, hfa learn or hfa verify --weights"
                )
            return named
        if not self.own and self.dynamics in VARIANTS and self.at is None:
            raise BadInputError("no plant is given; add --dihedral DEG or --model FILE")
        aircraft = self.flown_aircraft()
        point = self.operating_point(aircraft)
        return self.game_at(point.linearize())

    def game_at(self, linear: LinearModel) -> NamedGame:
        """Return the game on the linear model of an aircraft at a trim."""
        warnings = (*linear.point.warnings, *linear.kinks)
        missing = [name for name in ("Q", "R", "delta") if name not in self.changed_weights()]
        if self.own and missing:
            taken = [f"{name} {USUAL_WEIGHTS[name]}" for name in missing]
            warnings += (f"{' and '.join(missing)} not given; used: {', '.join(taken)}",)
        whose = self.weights_from("default")
        return NamedGame(self.game_on(linear), warnings, linear=linear, weights_from=whose)

    def weights_from(self, else_from: str, of_file: Collection[str] = ()) -> dict[str, str]:
        """Return the source of each weight.

        The result is "Q", "R" and "delta" -> "given", "file" or `else_from`, and "N" if given.

        else_from: source of the weights that are neither given by an option nor in the file
        of_file: names of the weights that the plant file contains
        """
        whose = dict.fromkeys(("Q", "R", "delta"), else_from)
        whose |= {name: "file" for name in of_file if name in (*whose, "N")}
        return whose | dict.fromkeys(self.changed_weights(), "given")

    def _game_of_file(self, plant: Path, read: dict[str, Any] | None) -> NamedGame:
        from controller.game.game_file import stored_game
        from controller.hfa_files import paper_defaults

        self.refuse_of_the_aircraft()
        stored = stored_game(plant, found=read, defaults=paper_defaults, **self.changed_weights())
        return NamedGame(
            stored.game,
            warnings=stored.notes,
            plant_provenance=stored.provenance,
            discrete=stored.discrete,
            has_time=stored.has_time,
            weights_from=self.weights_from("default", stored.stated),
        )

    def refuse_of_the_aircraft(self) -> None:
        """Raise BadInputError if an option of the aircraft or its trim is combined with --model."""
        if self.at is not None:
            raise BadInputError(
                "--dihedral and --model both define the plant; remove one of these options"
            )
        of_the_aircraft = ("aircraft", *OF_THE_TRIM, "parameters", "design", "units", "dynamics")
        self.refuse(of_the_aircraft, "applies only to the aircraft; remove this option or --model")


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingOptions(Request):
    """Options for reading a critic file (--weights)."""

    basis: str | None = option(
        "basis functions of W: a name (default quadratic), or a list 'x1**2, x1*x2, sin(x3)'",
        "BASIS",
        rare=True,
    )
    network: str = option(
        "roles of network parts, such as V=critic,policy=actor; default: by number of outputs",
        "[V=]NAME",
        default="",
        rare=True,
    )
    set: Mapping[str, Any]

    def reading(self) -> Reading:
        """Return the settings for reading a critic file, from the options."""
        return Reading(self.basis, self.network, self.set.get("activation"), self.set.get("scale"))


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkersOptions(Request):
    """Options for the worker processes of a run."""

    workers: int | str = option(
        "number of processes, or address of a Dask scheduler (tcp://host:port); default 1",
        "N|URL",
        _workers,
        default=1,
        rare=True,
    )
    resume: bool = option("continue an interrupted run with the same options", rare=True)


# Results.


def stated(report: Report, request: Request) -> Report:
    """Return the report with the provenance of the run and the unit system of --units."""
    units = getattr(request, "units", None)
    if units is not None:
        report = report.with_data(units=units)
    origin = request.provenance
    return replace(report, source=origin.text()).with_data(provenance=origin.to_dict())


def show(
    report: Report,
    request: OutputOptions,
    *,
    figure: Callable[[], Figure] | None = None,
    printed: Report | None = None,
    only_in_files: Mapping[str, Any] | None = None,
    notes: Iterable[str] = (),
) -> None:
    """Write the files of -o and --picture, then print the report or, with --json, its data.

    Either both files are written or none. Notes are printed after the report.

    report: the report
    request: the options of the command
    figure: function that draws the picture, or None if there is none
    printed: shorter report to print in place of `report`, or None
    only_in_files: data added to the file of -o only, or None
    notes: notes on the result

    Raises NoSolutionError with `report.failure` if this text is not empty.
    """
    from hfa_support.files import all_or_none

    picture = None if figure is None else request.picture
    with all_or_none():
        if request.output is not None:
            _write(stated(report.with_data(**(only_in_files or {})), request), request.output)
        if picture is not None and figure is not None:
            from hfa_support.reporting.figure import save

            save(figure(), picture, request.provenance.text())
    print_report(printed or report, request, notes=notes)
    for written in filter(None, (request.output, picture)):
        print_to_stderr(f"wrote {printable(written)}")
    if report.failure:
        raise NoSolutionError(report.failure)


def print_report(report: Report, request: JsonOption, *, notes: Iterable[str] = ()) -> None:
    """Print the report or, with --json, its data, and then the notes.

    The text is colored only on a terminal, unless NO_COLOR is set or TERM is "dumb".

    report: the report
    request: the options of the command
    notes: notes on the result
    """
    report = stated(report, request)
    if request.json:
        print_flushed(report.json())
    elif sys.stdout is None or not sys.stdout.isatty():
        print_flushed(report.text())
    else:
        # Colors are turned off by NO_COLOR (no-color.org).
        plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        print_flushed(report.text(not plain, shutil.get_terminal_size().columns))
    print_notes(notes)


def trimmed(request: OneTrimRequest, aircraft: Model) -> OperatingPoint:
    """Return the operating point at the trim condition given by the options.

    If no trim is found, the command reports the reason. With --json, the report of the nearest
    point within the limits, with the active limits, is printed before the error is raised.

    Raises TrimError if no trim is found.
    """
    from trim.point.solve import TrimError
    from trim.point.trim_report import trim_report

    try:
        return request.operating_point(aircraft)
    except TrimError as error:
        if request.json:
            report = trim_report(aircraft, request.trim_condition, error.attempt)
            print_report(report.with_data(reason=str(error)), request)
        raise


def inherited_spread(request):
    from hfa_aircraft.uncertain import spread_of

    file = request.parameters or request.model.source.text
    known = str(file) if request.own else request.parameter_set
    return spread_of(request.model, known, request.held_parameters())
