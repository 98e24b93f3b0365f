"""Options of a learning run, and the run."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from typing import Any

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.certified import CertifiedSettings, known_law, learn
from hfa_cli.options.argument_types import number, whole
from hfa_cli.options.parser import add_named, add_value
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError, refuse_unknown

DEFAULT_LAW = "certified"


def add_learning(parser: argparse.ArgumentParser) -> None:
    """--law, --seed, --set."""
    parser.add_argument("--law", metavar="NAME", help=f"only {DEFAULT_LAW} (irl: studies/update_law)")
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data; default 0")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """--set, whose words wait until the law is known."""
    about = "a setting of the law, for example predefined_time=2"
    add_named(parser, "--set", lambda _, text: text, "NAME=VALUE", about)


def law_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The --set words, each converted to the kind of value that its setting has."""
    law = law_name(arguments)
    kinds = {field.name: str(field.type) for field in fields(CertifiedSettings)}
    result = {}
    for name, text in (arguments.set or {}).items():
        refuse_unknown(f"law {law!r} has no setting", name, kinds)
        try:
            result[name] = _converted(text, kinds[name])
        except argparse.ArgumentTypeError as error:
            raise BadInputError(f"{name} {error}") from error
    return result


def run_learning(arguments: argparse.Namespace, game: Game) -> LearningResult:
    """Run the law that the options name, with progress on a terminal."""
    return learn(game, law_name(arguments), arguments.seed or 0, progress=shown_learning(), **law_settings(arguments))


def shown_learning() -> ProgressLine | None:
    """Progress of learning: one line on a terminal, gone when done; none elsewhere."""
    return ProgressLine("learn") if sys.stderr.isatty() else None


def law_name(arguments: argparse.Namespace) -> str:
    """The learning law that the options name."""
    return known_law(DEFAULT_LAW if arguments.law is None else str(arguments.law))


def _converted(text: str, kind: str) -> Any:
    """The value of a setting whose field is annotated with `kind`, for example "float | tuple[float, ...]"."""
    if kind.startswith("str"):
        return text
    if kind.startswith("int"):
        return whole(0)(text)
    values = tuple(number(word) for word in text.split(","))
    return values[0] if len(values) == 1 and kind.startswith("float") else values
