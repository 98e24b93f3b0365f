"""Options of a game and of learning on it: the aircraft at a trim, or a plant of the user's own."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from controller.game.zero_sum import Game, usual_game
from hfa.options import trims
from hfa.options.argument_types import OWN, input_file, number, one_of, whole
from hfa.options.parser import Option, Options
from hfa.output import ProgressLine
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, said_of
from hfa_support.files import MATRIX_FILES
from hfa_support.reporting.text import numbered
from hfa_support.reporting.unit_system import entries_in_force
from trim.linear.linear_model import LinearModel, linearize
from trim.point.operating_point import at_scheduled

if TYPE_CHECKING:
    from controller.game.learning_result import LearningResult
    from controller.game.user_files import PlantNames

DEFAULT_LAW = "certified"


def _delta(text: str) -> float:
    return math.inf if text.strip().lower() in ("inf", "infinity") else number(text)


def diagonal(text: str) -> np.ndarray:
    """diag(a, b, ...) from "a,b,...", (n, n): how Q and R are given."""
    return np.diag([number(entry) for entry in text.split(",")])


#: The weights of the game.
WEIGHTS: Options = {
    "--delta": Option(
        "disturbance weight, inf for none; default: the paper's 200", "NUMBER", _delta
    ),
    **{
        f"--{name}": Option(f"diagonal of {name}; default: the paper's", "a,b,...", diagonal)
        for name in ("Q", "R")
    },
}
MODEL: Options = {
    "--model": Option(
        f"a plant of your own: A, B, optionally E, Q, R ({' '.join(MATRIX_FILES)})",
        "FILE",
        input_file(*MATRIX_FILES),
    )
}
SEED: Options = {
    "--seed": Option(
        "seed of the recorded data and of what else is random; default 0", "N", whole(0), 0
    )
}


def learning(
    *laws: str, about: str = "", own: Mapping[str, Callable[[str], Any]] | None = None
) -> Options:
    """--law, one of `laws` and the one that learns, its --seed and --set.

    about: help of --set. own: further settings, and how a word becomes the value of each.
    """

    def setting(name: str, text: str) -> Any:
        from controller.learning.certified import CertifiedSettings

        kinds: dict[str, Callable[[str], Any]] = {
            **{
                field.name: partial(_converted, str(field.type))
                for field in fields(CertifiedSettings)
            },
            **(own or {}),
        }
        if name not in kinds:
            raise BadInputError(
                f"is no setting of law {DEFAULT_LAW!r}; choose from {', '.join(kinds)}"
            )
        return kinds[name](text)

    choices = (*laws, DEFAULT_LAW)
    said = (
        f"{', '.join(choices)}; default {DEFAULT_LAW}"
        if laws
        else f"only {DEFAULT_LAW} (irl: studies/update_law)"
    )
    about = about or "a setting of the law, for example predefined_time=2"
    return {
        "--law": Option(said, "NAME", one_of(*choices), DEFAULT_LAW),
        **SEED,
        "--set": Option(about, "NAME=VALUE", setting, named=True),
    }


def game_options() -> Options:
    """--at, with a design or without, or --model, and the weights."""
    return {**trims.trim(), **trims.design(), **MODEL, **WEIGHTS}


@dataclass(frozen=True, eq=False)
class NamedGame:
    """A game with the names of its states and inputs, and where it comes from.

    nonlinear: where there is a trim, makes (z, u) -> z', the aircraft about it.
    """

    game: Game
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    origin: str
    warnings: tuple[str, ...] = ()
    plant_provenance: Mapping[str, str] = field(default_factory=dict)
    nonlinear: Callable[[], ca.Function] | None = None

    @property
    def names(
        self,
    ) -> tuple[tuple[str, ...], tuple[str, ...], str, tuple[str, ...], tuple[str, ...]]:
        """States, inputs, what the plant is called, units of states and inputs: how reports take
        them."""
        return self.states, self.inputs, self.origin, self.state_units, self.input_units

    @property
    def plant(self) -> PlantNames:
        """What a file of a critic is read against."""
        from controller.game.user_files import PlantNames

        return PlantNames(self.states, self.inputs, self.state_units)

    def labels(self) -> dict[str, Any]:
        """What the numbers of a result are about; units are "" for a plant of the user's own."""
        named = {
            name: list(getattr(self, name))
            for name in ("states", "inputs", "state_units", "input_units")
        }
        delta = self.game.delta if math.isfinite(self.game.delta) else None
        origin = {"plant_provenance": dict(self.plant_provenance)} if self.plant_provenance else {}
        return {
            "plant": self.origin,
            **origin,
            **named,
            "delta": delta,
            "warnings": list(self.warnings),
        }


def weights_of(arguments: argparse.Namespace, state_units: tuple[str, ...] = ()) -> dict[str, Any]:
    """Changes of the usual game that the options name; Q, typed in the units in force, in these
    units."""
    found = {
        name: value
        for name in ("Q", "R", "delta")
        if (value := getattr(arguments, name)) is not None
    }
    if "Q" in found and len(found["Q"]) == len(state_units):
        found["Q"] = entries_in_force(found["Q"], (state_units, 1), (state_units, 1))
    return found


def game_on(arguments: argparse.Namespace, model: LinearModel) -> Game:
    """The usual game on a linear model, with the weights that the options change."""
    return usual_game(
        model.point.model, model.A, model.B, **weights_of(arguments, model.state_units)
    )


def game_of(arguments: argparse.Namespace, found: dict[str, Any] | None = None) -> NamedGame:
    """The game that the options name; found: what has been read of --model already."""
    if arguments.model is not None:
        return _game_of_file(arguments, found)
    if OWN.get() is None and arguments.at is None:
        raise BadInputError("name the plant: either --dihedral DEG or --model FILE")
    aircraft = trims.aircraft_of(arguments)
    point = trims.point_of(arguments, aircraft)
    model, own = linearize(aircraft, point), aircraft
    warnings, origin = (*point.warnings, *model.kinks), own.name
    if arguments.aircraft is None:
        origin = f"the aircraft {at_scheduled(point)}, {own.title}"
    elif len(changed := weights_of(arguments)) < 3:
        missing = [name for name in ("Q", "R", "delta") if name not in changed]
        warnings += (
            f"{' and '.join(missing)} not given: Q, R are 1/nominal^2 on the diagonal, delta is inf (no disturbance)",
        )
    if arguments.design is not None:
        from controller.servo.design_model import design_model

        built = design_model(aircraft, model, arguments.design)
        with said_of(f"design {built.design.name}"):
            game = replace(built.game(), **weights_of(arguments, built.state_units))
        names = built.states, built.inputs, built.state_units, built.input_units
        return NamedGame(
            game, *names, f"design {built.design.name} of {origin}", tuple(point.warnings)
        )
    names = model.states, model.inputs, model.state_units, model.input_units
    return NamedGame(
        game_on(arguments, model),
        *names,
        origin,
        warnings,
        nonlinear=partial(_about_trim, own, model),
    )


def _game_of_file(arguments: argparse.Namespace, found: dict[str, Any] | None) -> NamedGame:
    """The game of --model."""
    from controller.game.user_files import stored_game

    refuse_of_the_aircraft(arguments)
    game, notes, names, provenance = stored_game(
        arguments.model, found=found, **weights_of(arguments)
    )
    n, m = game.B.shape
    plain = {"states": numbered("x", n), "inputs": numbered("u", m), "state_units": ("",) * n}
    labels = plain | {"input_units": ("",) * m} | names
    return NamedGame(
        game, **labels, origin=str(arguments.model), warnings=notes, plant_provenance=provenance
    )


def refuse_of_the_aircraft(arguments: argparse.Namespace) -> None:
    """BadInputError where an option of the aircraft comes with --model."""
    if arguments.at is not None:
        raise BadInputError("name the plant: either --dihedral DEG or --model FILE")
    of_the_aircraft = ("aircraft", *trims.OF_THE_TRIM, "parameters", "design", "units", "dynamics")
    trims.refuse(arguments, of_the_aircraft, "belongs to the aircraft; leave it out with --model")


def _about_trim(model: Model, linear: LinearModel) -> ca.Function:
    """(z, u) -> z' of the nonlinear model, deviations from the trim; states that the linear model
    lacks are held."""
    z, u = (
        ca.SX.sym(name, len(each)) for name, each in (("z", linear.states), ("u", linear.inputs))
    )
    moved = dict(
        zip((*linear.states, *linear.inputs), (*ca.vertsplit(z), *ca.vertsplit(u)), strict=True)
    )
    trim = linear.point.states._asdict(), linear.point.inputs._asdict()
    at = [[value + moved.get(name, 0.0) for name, value in each.items()] for each in trim]
    rates, _ = model.layout.expressions((*at, model.p.tolist()), ())
    return ca.Function(
        "plant", [z, u], [rates[[list(model.states).index(name) for name in linear.states]]]
    )


def run_learning(arguments: argparse.Namespace, game: Game) -> LearningResult:
    """Run the law that the options name."""
    from controller.learning.certified import learn

    return learn(
        game, arguments.law, arguments.seed, progress=ProgressLine("learn"), **arguments.set
    )


def _converted(kind: str, text: str) -> Any:
    """The value of a setting whose field is annotated with `kind`, for example "float |
    tuple[float, ...]"."""
    if kind.startswith("str"):
        return text
    if kind.startswith("int"):
        return whole(0)(text)
    values = tuple(number(word) for word in text.split(","))
    return values[0] if len(values) == 1 and kind.startswith("float") else values
