"""Options of a learning run, and the run itself."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.learn import LAWS, learn
from hfa_cli.argument_types import number, whole
from hfa_cli.output import check_target
from hfa_cli.parser import add_named, add_value
from hfa_model.support.errors import BadInputError

DEFAULT_LAW = "certified"


def add_learning(parser: argparse.ArgumentParser) -> None:
    """--law, --seed, --set, --save, --resume."""
    parser.add_argument("--law", metavar="NAME", help=f"{', '.join(LAWS)}; default {DEFAULT_LAW}")
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data; default 0")
    add_settings(parser)
    parser.add_argument("--save", metavar="FILE", help="keep the state of the run in this .npz file")
    parser.add_argument("--resume", metavar="FILE", help="continue from a kept state")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """--set, whose words wait until the law is known."""
    about = "a setting of the law, for example predefined_time=2"
    add_named(parser, "--set", lambda _, text: text, "NAME=VALUE", about)


def run_learning(arguments: argparse.Namespace, game: Game) -> LearningResult:
    """Run the law that the options name, with progress on a terminal."""
    check_target(arguments.save, (".npz",))
    if arguments.save is not None and Path(arguments.save) == arguments.output:
        raise BadInputError(f"--save and --output are both {arguments.save}; give two names")
    return learn(
        game,
        _law(arguments),
        arguments.seed or 0,
        progress=show_learning if sys.stderr.isatty() else None,
        save_state=arguments.save,
        resume=arguments.resume,
        **law_settings(arguments),
    )


def law_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The --set words, each converted to the kind of value that its setting has."""
    law = _law(arguments)
    if law not in LAWS:
        raise BadInputError(f"unknown law {law!r}; choose one of: {', '.join(LAWS)}")
    defaults = {field.name: field.default for field in fields(LAWS[law].settings)}  # type: ignore[arg-type]
    result = {}
    for name, text in (arguments.set or {}).items():
        if name not in defaults:
            raise BadInputError(f"law {law!r} has no setting {name!r}; choose from: {', '.join(defaults)}")
        try:
            result[name] = _converted(text, defaults[name])
        except argparse.ArgumentTypeError as error:
            raise BadInputError(f"{name} {error}") from error
    return result


def _law(arguments: argparse.Namespace) -> str:
    return DEFAULT_LAW if arguments.law is None else str(arguments.law)


def _converted(text: str, default: Any) -> Any:
    if isinstance(default, bool):
        if text not in ("yes", "no"):
            raise argparse.ArgumentTypeError(f"is {text!r}; give yes or no")
        return text == "yes"
    if isinstance(default, str):
        return text
    if isinstance(default, int):
        return whole(0)(text)
    values = tuple(number(word) for word in text.split(","))
    return values[0] if len(values) == 1 and not isinstance(default, tuple) and default is not None else values


def show_learning(fraction: float, message: str) -> None:
    """One line on standard error, gone when done."""
    end = "\r\033[K" if fraction >= 1.0 else ""
    print(f"\r\033[Klearn: {100 * fraction:3.0f} %  {message}", end=end, file=sys.stderr, flush=True)
