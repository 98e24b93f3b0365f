"""Options of a game and of learning. The plant is an aircraft at a trim, or is read from a file."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.discrete_game import DiscreteGame
from controller.game.linear_game import widths_within_limits
from controller.game.weights import weights_line
from controller.game.zero_sum import Game
from controller.hfa_game import plant_names, usual_game
from controller.riccati.smallest_delta import ModeError
from hfa.options.argument_types import input_file, number, one_of, whole
from hfa.options.critics import listed_numbers
from hfa.options.output import ProgressLine
from hfa.options.request import Request, option
from hfa.options.trims import OF_THE_TRIM, AircraftOptions, TrimOptions, of_hfa
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, NoSolutionError, choice_of
from hfa_support.files import MATRIX_FILES
from hfa_support.reporting.results import UNSTORED, Matrix, Result, stored, stored_as, stored_parts
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun

DEFAULT_LAW = "certified"
#: Default weights for an aircraft other than the HFA, for notes and helps.
USUAL_WEIGHTS = {
    "Q": "1/nominal^2 on the diagonal",
    "R": "1/nominal^2 on the diagonal",
    "delta": "inf (no disturbance)",
}
#: Reason why an option is refused for a discrete-time plant.
CONTINUOUS = "applies only to continuous time; remove this option for a plant with time = discrete"


def _delta(text: str) -> float:
    return math.inf if text.strip().lower() in ("inf", "infinity") else number(text)


def diagonal(text: str) -> np.ndarray:
    """Return the matrix diag(a, b, ...), (n, n), from the text "a,b,...".

    Raises BadInputError if an entry is not a number.
    """
    return np.diag(listed_numbers(text))


def _rows(text: str) -> np.ndarray:
    """Return the matrix with the rows in the text "a,b;c,d", (2, 2).

    Raises BadInputError if an entry is not a number, or if the rows have different lengths.
    """
    rows = [listed_numbers(row) for row in text.split(";")]
    if len({len(row) for row in rows}) > 1:
        raise BadInputError(f"is {text}; give rows of equal length, a,b;c,d")
    return np.array(rows)


def _diagonal_option(name: str) -> Any:
    """Return a request field whose option sets the diagonal of Q or R.

    name: "Q" or "R"
    """
    about = f"diagonal of {name}; default"
    help_text = of_hfa(f"{about}: values of the paper", f"{about} {USUAL_WEIGHTS[name]}")
    return option(help_text, "a,b,...", diagonal, names=f"--{name}", rare=True)


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


def law_option(*laws: str) -> Any:
    """Return the request field `law`, with the option --law that selects the learning law.

    laws: accepted names besides the default learning law
    """
    choices = (*laws, DEFAULT_LAW)
    about = f"learning law; the only choice is {DEFAULT_LAW}"
    if laws:
        about = f"policy: {', '.join(choices)}; default {DEFAULT_LAW}"
    return option(about, "NAME", one_of(*choices), default=DEFAULT_LAW)


def setting_option(
    about: str = "setting of the learning law, for example predefined_time=2",
    more: Mapping[str, Callable[[str], Any]] | None = None,
) -> Any:
    """Return the request field `set`, with the repeatable option --set NAME=VALUE.

    about: help of the option
    more: additional settings, name -> function that converts the text to the value; None for none
    """

    def setting(name: str, text: str) -> Any:
        from controller.learning.certified import CertifiedSettings

        kinds: dict[str, Callable[[str], Any]] = {
            field.name: partial(_converted, str(field.type)) for field in fields(CertifiedSettings)
        }
        kinds |= more or {}
        if name not in kinds:
            raise BadInputError(
                f"is not a setting of law {DEFAULT_LAW!r}; {choice_of(name, kinds)}"
            )
        return kinds[name](text)

    return option(about, "NAME=VALUE", setting, named=True, rare=True)


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


@dataclass(frozen=True, eq=False)
class Weights(Result):
    """Weights Q, R and N of a game, and where they come from.

    Q: state weight, (n, n)
    R: input weight, (m, m)
    N: cross weight, (n, m), or None for 0
    weights_from: name -> "given", "file", "design" or "default", for Q, R and delta, and N if given
    """

    Q: Matrix
    R: Matrix
    N: Matrix | None = field(metadata=stored_as(optional=True))
    weights_from: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class NamedGame(Result):
    """A game, its plant, and the sources of its weights.

    game: the game
    warnings: notes to print with results
    plant_provenance: provenance of a plant read from a file
    linear: linear model of the aircraft, or None for a plant from a file or a design
    discrete: game of a discrete-time plant, otherwise None
    has_time: False if the plant file does not state whether time is continuous or discrete
    weights_from: name -> "given", "file", "design" or "default", for Q, R and delta
    """

    game: Game = field(
        metadata=stored_parts(
            plant="names.origin",
            states="names.states",
            inputs="names.inputs",
            state_units="names.state_units",
            input_units="names.input_units",
            delta="delta",
        )
    )
    warnings: tuple[str, ...] = ()
    plant_provenance: Mapping[str, str] = field(default_factory=dict, metadata=UNSTORED)
    linear: LinearModel | None = field(default=None, metadata=UNSTORED)
    discrete: DiscreteGame | None = field(default=None, metadata=UNSTORED)
    has_time: bool = field(default=True, metadata=UNSTORED)
    weights_from: Mapping[str, str] = field(default_factory=dict, metadata=UNSTORED)

    @property
    @stored("plant_provenance", optional=True)
    def origins(self) -> dict[str, str] | None:
        """Provenance of a plant read from a file, or None if the plant has none."""
        return dict(self.plant_provenance) or None

    @property
    def weights(self) -> Weights:
        """Weights Q, R and N of the game, with their sources."""
        N = self.game.N if self.game.N.any() else None
        return Weights(self.game.Q, self.game.R, N, self.weights_from)

    def weights_line(self) -> str:
        """Return one line of text with Q, R, delta, N unless it is 0, and the source of each."""
        game = self.game
        return weights_line(game.Q, game.R, game.delta, self.weights_from, game.N)

    @contextmanager
    def asking_for_time(self) -> Iterator[None]:
        """Add a question on discrete time to a NoSolutionError that is raised in the `with` block.

        The question is added if the plant file does not state whether time is continuous or
        discrete, and if the game has a solution in discrete time. It is not added if a mode is the
        reason: a gain for discrete time would leave this mode unstable in continuous time.
        """
        try:
            yield
        except ModeError:
            raise
        except NoSolutionError as failure:
            if self.has_time or not _is_solvable_in_steps(self.game):
                raise
            raise NoSolutionError(
                f'{failure}; x⁺ = A x + B u has a solution: did you mean time = "discrete"?'
            ) from failure


def _is_solvable_in_steps(game: Game) -> bool:
    """Return whether the game x⁺ = A x + B u has a solution."""
    from controller.discrete.solution import solve_discrete

    try:
        solve_discrete(DiscreteGame(game))
    except NoSolutionError:
        return False
    return True


def _converted(kind: str, text: str) -> Any:
    """Return the value of a setting of the learning law, from its text.

    kind: annotation of the setting's field, for example "float | tuple[float, ...]"
    text: the value as typed

    Raises BadInputError if the text is not a number of this kind.
    """
    if kind.startswith("str"):
        return text
    if kind.startswith("int"):
        return whole(0)(text)
    values = tuple(listed_numbers(text))
    return values[0] if len(values) == 1 and kind.startswith("float") else values
