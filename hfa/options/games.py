"""The game of a request: its plant, an aircraft at a trim or a plant file, and its weights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from controller.critic.critic_file import critic_suffixes
from controller.critic.reading import CriticFile, Reading
from controller.game.held_game import held
from controller.game.linear_game import (
    game as game_of,
    names_of_linear,
    sizes_text,
    weights_line,
    weights_of_flights,
)
from controller.game.zero_sum import Game
from controller.hfa_game import plant_names
from controller.tracking import tracked
from hfa.options.advice import trimmed
from hfa.options.argument_types import (
    among,
    each_of,
    input_file,
    linear_state,
    listed_numbers,
    number,
    option_errors,
    positive,
    seconds,
    typed_unit_of,
)
from hfa.options.parser import option, refuse
from hfa.options.trims import OF_THE_TRIM, GivenTrim, TrimOptions, given_trim
from hfa_aircraft.model import Model
from hfa_aircraft.signals import PlantNames
from hfa_aircraft.waveform import Waveform, channel, stacked
from hfa_support.errors import BadInputError, choice_of, prefix_errors
from hfa_support.files import MATRIX_FILES, POSITIVE, Number
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result, without_empty
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize

if TYPE_CHECKING:
    from controller.riccati.gare import Solution


#: Times of at least 0 s.
AT_LEAST_0 = Number(0.0)
#: Setting of --set -> type of its value, for files of --weights.
_SETTINGS: dict[str, Callable[[str], Any]] = {
    "activation": str,
    "scale": listed_numbers,
}


def critic_path(text: str) -> Path:
    """Return the path of a critic file.

    text: path of an existing file with a supported suffix

    Raises BadInputError if the file does not exist, or if its suffix is not supported.
    """
    if Path(text).suffix.lower() in MATRIX_FILES:  # known without reading the installed packages
        return input_file(*MATRIX_FILES)(text)
    return input_file(*critic_suffixes())(text)


def _setting(name: str, text: str) -> Any:
    """Return the value of --set NAME=TEXT."""
    if name not in _SETTINGS:
        raise BadInputError(f"is not a setting of a critic; {choice_of(name, _SETTINGS)}")
    return _SETTINGS[name](text)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingOptions:
    """How the critic file of --weights is read."""

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

    set: Mapping[str, Any] = option(
        "setting of a network: scale=a,b,... (factor on each state), activation=HIDDEN[,OUTPUT] "
        "(state dict)",
        "NAME=VALUE",
        _setting,
        named=True,
        rare=True,
    )


def reading_of(request: ReadingOptions, linear: LinearModel | None = None) -> Reading:
    """Return the settings for reading a critic file.

    linear: linear model of the game at a trim of an aircraft, or None
    """
    activation, scale = request.set.get("activation"), request.set.get("scale")
    return Reading(request.basis, request.network, activation, scale, linear)


#: Reason why an option is refused for a discrete-time plant.
CONTINUOUS_ONLY = (
    "applies only to continuous time; remove this option for a plant with time = discrete"
)


def _delta(text: str) -> float:
    """Return the disturbance weight that a word states, which may be inf."""
    return math.inf if text.strip().lower() in ("inf", "infinity") else number(text)


def diagonal(text: str) -> np.ndarray | dict[str, float]:
    """Return the matrix diag(a, b, ...), (n, n), or name -> weight of the text "name=a,name=b".

    Raises BadInputError if an entry is not a number.
    """
    if "=" not in text:
        return np.diag(listed_numbers(text))
    pairs = [word.partition("=") for word in text.split(",")]
    return {name.strip(): number(value) for name, _, value in pairs}


def _rows(text: str) -> np.ndarray:
    """Return the matrix with the rows in the text "a,b;c,d", (2, 2)."""
    rows = [listed_numbers(row) for row in text.split(";")]
    if len({len(row) for row in rows}) > 1:
        raise BadInputError(f"is {text}; give rows of equal length, a,b;c,d")
    return np.array(rows)


def _diagonal_option(name: str, signals: str) -> Any:
    """Return the option of Q or R, whose diagonal has an entry for each of these signals."""
    return option(
        f"diagonal of {name} in the order of the {signals}, or NAME=a,...; default: of the paper "
        "for the HFA, else of the file of the plant or of the critic",
        "a,b,...",
        diagonal,
        names=f"--{name}",
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightOptions:
    """The weights Q, R, delta and N of a game."""

    delta: float | None = option(
        "disturbance weight; default: 200 for the HFA, else inf (LQR)",
        "NUMBER",
        _delta,
    )
    Q: np.ndarray | Mapping[str, float] | None = _diagonal_option("Q", "states")
    R: np.ndarray | Mapping[str, float] | None = _diagonal_option("R", "inputs")
    sizes: Mapping[str, str] = option(
        "in place of Q and R: deviations of states and inputs that are as bad as one another, with "
        "the weights 1/size^2 (Bryson's rule); degrees for angles",
        "NAME=SIZE,...",
        named=True,
        rare=True,
    )
    N: np.ndarray | None = option(
        "cross weights of the cost 2 z'Nu, one row for each state; default 0",
        "a,b;c,d",
        _rows,
        names="--N",
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class TimingOptions:
    """When a policy is computed, and when its commands act."""

    rate: float | None = option(
        "samples of the policy a second; a game is then that of these samples",
        "HZ",
        positive,
        rare=True,
    )
    delay: float = option(
        "time from a sample to the effect of its command, s or 10ms; default 0",
        "S",
        partial(seconds, declared=AT_LEAST_0),
        default=0.0,
        rare=True,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class GameOptions(WeightOptions, TrimOptions, TimingOptions):
    """The game: on an aircraft at a trim, or on a plant read from a file.

    usual: fields whose options the help shows first, in this order
    """

    usual: ClassVar = ("Q", "R", "sizes", "delta", "plant", "aircraft", "at", "hold")

    plant: Path | None = option(
        "file with a plant: A, B and optionally E, Q, R, N (.json .npz .mat, or A.csv or A.npy, "
        "with B beside it)",
        "FILE",
        input_file(*MATRIX_FILES),
        names="--model",
    )


def given_weights(request: WeightOptions, model: Model | None) -> dict[str, Any]:
    """Return the weights that options set, argument of `controller.game` -> value, in model units.

    model: the aircraft; with None for a plant file, "sizes" is a function of the file's names
    """
    given = {"Q": request.Q, "R": request.R, "delta": request.delta, "N": request.N}
    given = {name: value for name, value in given.items() if value is not None}
    if not request.sizes:
        return given
    if replaced := [name for name in ("Q", "R") if name in given]:
        raise BadInputError(f"--sizes and --{replaced[0]} both define weights; remove one of them")
    if model is None:
        return given | {"sizes": partial(_sizes_of_file, request.sizes)}
    names = (*model.linear, *model.inputs)  # of deviations; Q and R are 1/size²
    kind = partial(among, names, declared=POSITIVE)
    return given | {"sizes": each_of("--sizes", model, request.sizes, kind)}


def _sizes_of_file(texts: Mapping[str, str], names: PlantNames) -> dict[str, float]:
    """Return name -> size typed for a plant file, in its units; angles are typed in degrees."""
    units = dict(zip(names.states, names.state_units, strict=True))
    units |= zip(names.inputs, names.input_units, strict=True)
    sizes = {}
    for name, text in texts.items():
        with option_errors(f"--sizes {name}"):
            sizes[name] = positive(text) * typed_unit_of(units.get(name, ""))
    return sizes


def given_game(
    request: GameOptions, inputs: Sequence[str] = (), critic: CriticFile | None = None
) -> NamedGame:
    """Return the game of the options, on a plant file or on an aircraft at a trim.

    inputs, critic: as for `weighted_game`; a deployment is not used with a plant file

    Raises BadInputError in these cases:
    - The plant file is not valid, or is combined with an option of the aircraft.
    - Neither a dihedral angle nor a plant file is given for the paper's flexible aircraft.
    Raises NoSolutionError if the aircraft has no trim.
    """
    if request.plant is not None:
        return _flown(request, _game_of_file(request, request.plant, inputs, critic))
    if request.aircraft is None and request.at is None and request.dihedral is None:
        raise BadInputError(
            "no plant is given; add --dihedral DEG, --aircraft FILE or --model FILE"
        )
    given = given_trim(request)
    weights = given_weights(request, given.model)
    return _flown(request, game_at(given, weights, inputs, critic))


def _flown(request: GameOptions, named: NamedGame) -> NamedGame:
    """Return the game of --rate and --delay."""
    if request.rate is None and not request.delay:
        return named
    game = held(named.game, request.rate, request.delay)
    return replace(named, game=game, linear=None, of_rates=named.game)


def game_at(
    given: GivenTrim,
    weights: Mapping[str, Any],
    inputs: Sequence[str] = (),
    critic: CriticFile | None = None,
) -> NamedGame:
    """Return the game on the linear model of an aircraft at a trim (`weighted_game`)."""
    point = trimmed(given)
    linear = linearize(point.model, point)
    named = weighted_game(weights, linear, inputs, critic)
    warnings = (*linear.point.warnings, *linear.nonsmooth_points, *named.warnings)
    return replace(named, warnings=warnings, source=given.source)


def weighted_game(
    weights: Mapping[str, Any],
    linear: LinearModel,
    inputs: Sequence[str] = (),
    critic: CriticFile | None = None,
    *,
    of_flights: bool = False,
) -> NamedGame:
    """Return the game on a linear model, with notes on weights that no option gives.

    weights: given weights; others are those of the critic's file, else of the model's file, else of
        the paper for its aircraft
    inputs: inputs that move, or () for those of the deployment, else all; the weights of others are
        not used
    critic: critic file whose weights are used, those of a deployment if it weighs linear states
    of_flights: whether Q and R may be `weights_of_flights`, which reports of flights print

    Raises BadInputError if Q or R has no value.
    """
    cost: Mapping[str, Any] = {}  # of the critic's file
    if critic is not None and set(critic.inputs) < set(linear.inputs):
        inputs = inputs or critic.inputs
    if critic is not None and set(critic.cost.get("Q", ())) <= set(linear.states):
        cost = critic.cost or critic.game(names_of_linear(linear))
    cost = _left_of(cost, weights)
    used = {**cost, **weights}
    if of_flights and "sizes" not in used:
        used |= weights_of_flights(linear, used.get("Q"), used.get("R"))
    not_moved = [name for name in linear.inputs if inputs and name not in inputs]
    for name in ("R", "sizes"):
        # A mapping must name every input. One that does not move gets any weight, here 1.
        if isinstance(used.get(name), Mapping):
            used[name] = dict.fromkeys(not_moved, 1.0) | used[name]
    game = replace(game_of(linear, **used), names=plant_names(linear))

    # Notes on the weights that no option gives.
    about = linear.model.about
    is_file = about.weights_source == "file"  # otherwise the HFA with the weights of the paper
    sources = weight_sources(weights, cost, about.weights if is_file else ())
    notes: tuple[str, ...] = ()
    if of_file := [name for name, source in sources.items() if source == "file"]:
        notes += (f"used: {' and '.join(of_file)} of {linear.model.name}",)
    missing = [name for name, source in sources.items() if source == "default"] if is_file else []
    if missing:
        usual = {"delta": "inf (no disturbance)"}
        listed = [f"{name} {usual.get(name, '1/nominal^2 on the diagonal')}" for name in missing]
        notes += (f"{' and '.join(missing)} not given; used: {', '.join(listed)}",)
    named = NamedGame(game, notes, linear=linear, weights_from=sources)
    return named.with_inputs(inputs) if inputs else named


#: Given weight -> weights of a critic's file that it replaces, too: N belongs to both Q and R.
_REPLACED = {"Q": ("N",), "R": ("N",), "sizes": ("Q", "R", "N")}


def _left_of(game: Mapping[str, Any], given: Iterable[str]) -> dict[str, Any]:
    """Return the weights of a critic's game that given ones do not replace."""
    replaced = {"dt", "discount"}.union(*({name, *_REPLACED.get(name, ())} for name in given))
    return {name: value for name, value in game.items() if name not in replaced}


def weight_sources(
    given: Iterable[str], of_critic: Iterable[str], of_file: Iterable[str]
) -> dict[str, str]:
    """Return name of a weight -> its source: "default", "file", "critic", "given" by an option, or
    "sizes" of Q and R. N has an entry if a source gives it.

    given, of_critic, of_file: names of the weights of options, the critic's file, the plant's file;
        of a weight in several, the first counts
    """
    sources = dict.fromkeys(("Q", "R", "delta"), "default")
    for source, names in (("file", of_file), ("critic", of_critic), ("given", given)):
        sources |= {name: source for name in names if name in (*sources, "N")}
    return sources | dict.fromkeys(("Q", "R") if "sizes" in given else (), "sizes")


def _game_of_file(
    request: GameOptions, plant: Path, inputs: Sequence[str], critic: CriticFile | None
) -> NamedGame:
    """Return the game on a plant file, in which the inputs move, or all of them for ().

    critic: critic file, whose weights are used where neither an option nor the plant file has them
    """
    from controller.game.linear_game import Defaults, stored_game
    from controller.hfa_game import paper_defaults

    of_critic: dict[str, Any] = {}

    def defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
        """Return the weights of the critic's file, else of the paper for its aircraft."""
        usual = paper_defaults(parts, names)
        if critic is None:
            return usual
        of_critic.update(_left_of(critic.game(names.completed(*parts["B"].shape)), parts))
        words = {**usual.words, **dict.fromkeys(of_critic, "of the critic's file")}
        return Defaults({**usual.values, **of_critic}, words)

    for name in ("at", "dihedral"):
        if getattr(request, name) is not None:
            raise BadInputError(
                f"--{name} and --model both define the plant; remove one of these options"
            )
    of_trim = [name for name in OF_THE_TRIM if name != "row"]
    of_aircraft = ("aircraft", *of_trim, "parameters", "units", "dynamics")
    refuse(request, of_aircraft, "applies only to the aircraft; remove this option or --model")
    weights = given_weights(request, None)
    stored = stored_game(plant, defaults=defaults, row=request.row, **weights)
    named = NamedGame(
        stored.game,
        warnings=stored.notes,
        weights_from=weight_sources(weights, of_critic, stored.declared),
        source={"model": str(plant)},
    )
    return named.with_inputs(inputs) if inputs else named


@dataclass(frozen=True, eq=False)
class NamedGame(Result):
    """A game, its plant, and the sources of its weights.

    game: the game
    warnings: notes to print with results
    linear: linear model of the aircraft, or None for a plant from a file
    of_rates: the game in continuous time of which `game` is that of --rate and --delay
    weights_from: name of a weight -> its source (`weight_sources`)
    source: entries of the provenance on the plant
    """

    game: Game
    warnings: tuple[str, ...] = ()
    linear: LinearModel | None = None
    of_rates: Game | None = None
    weights_from: Mapping[str, str] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    def weights_line(self) -> str:
        """Return one line of text with Q, R, delta, N unless it is 0, the source of each, and E."""
        return "; ".join((weights_line(self.game, self.weights_from), *self.sizes_line()))

    def sizes_line(self) -> tuple[str, ...]:
        """Return one line of text with the sizes of --sizes, or () if they are not given."""
        is_sized = self.weights_from.get("Q") == "sizes"
        return (f"Weights 1/size^2: {sizes_text(self.game)}",) if is_sized else ()

    def with_inputs(self, inputs: Sequence[str]) -> NamedGame:
        """Return the game in which only some inputs move (`Game.select`).

        inputs: the inputs that move

        Raises BadInputError, which names --inputs, for an unknown or repeated name.
        """
        with prefix_errors("--inputs"):
            linear = None if self.linear is None else self.linear.select(inputs=inputs)
            return replace(self, game=self.game.select(inputs), linear=linear)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        game, names = self.game, self.game.names
        return {
            "plant": names.origin,
            "states": names.states,
            "inputs": names.inputs,
            "state_units": names.state_units,
            "input_units": names.input_units,
            "Q": game.Q,
            "R": game.R,
            "E": game.E,
            "delta": game.delta,
            "warnings": self.warnings,
        } | without_empty(
            dt=game.dt or None,
            discount=game.discount if game.is_discrete else None,
            N=game.N if game.N.any() else None,
        )


#: Field `reference` of a request, with the option --reference.
REFERENCE: Any = option(
    "track a reference: deviation of a state from the trim, a sum of terms such as 7, 0.01t, "
    "2sin(0.5t) with t in s, degrees for angles; repeatable",
    "NAME=SIGNAL",
    named=True,
    rare=True,
)


def deviation_signal(model: Model, name: str, text: str) -> Waveform:
    """Return the signal (1,) of a state's deviation from the trim, in the units of the model.

    text: the signal as typed, with angles in degrees
    """
    typed_unit = linear_state(model, name, "1")  # one degree, or 1 in the unit of the model
    return channel(text).through(np.array([[typed_unit]]))


def reference_of(texts: Mapping[str, str], named: NamedGame) -> dict[str, Waveform]:
    """Return state -> signal of its deviation from the trim, from the words of --reference.

    texts: state -> signal as typed

    named: game of an aircraft

    Raises BadInputError in discrete time, and for an unknown state or signal.
    """
    assert named.linear is not None
    named.game.refuse_steps("--reference")
    return each_of("--reference", named.linear.model, texts, deviation_signal)


def with_tracking(
    report: Report, reference: Mapping[str, Waveform], named: NamedGame, solution: Solution
) -> Report:
    """Return a report with a section on tracking with the exact gain.

    reference: state -> signal, as of `reference_of`
    named: game of an aircraft
    solution: exact solution of the game
    """
    assert named.linear is not None  # `reference_of` requires it
    commands = stacked(reference, named.linear.states)
    tracking = tracked(named.linear, solution, solution.K, commands)
    section = tracking.report()
    parts = (*report.parts, section.title, *section.parts)
    return replace(report, parts=parts).with_data(tracking=tracking)
