"""argparse as `hfa` wants it: commands and options declared as data, and one line for each
complaint."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn

from hfa_support.errors import BadInputError, shortened


@dataclass(frozen=True)
class Option:
    """One option of a command.

    about: its help. form: how help shows its value; "" for a switch. kind: word -> value; its
    BadInputError is the rest of a sentence that begins with the option. default: its value where it
    is not given, {} where `named`: then its words are NAME=VALUE, it may be repeated, and kind
    takes the name and the word. more: further arguments of `add_argument`."""

    about: str
    form: str = ""
    kind: Callable[..., Any] = str
    default: Any = None
    named: bool = False
    more: Mapping[str, Any] = field(default_factory=dict)


#: Names of an option, as in "-o --output" -> what it is.
Options = Mapping[str, Option]


class Command(NamedTuple):
    """What makes the options of a command, and what runs it: its docstring is the help, its result
    the exit code."""

    options: Callable[[], Options]
    run: Callable[[argparse.Namespace], int]


def command(
    options: Callable[[], Options],
) -> Callable[[Callable[[argparse.Namespace], int]], Command]:
    """Makes a `Command` of the function that runs it."""
    return lambda run: Command(options, run)


#: Options that `--help` lists by name only; `--help more` explains them.
RARE = (
    "Q R basis condition delay disturbance effectiveness envelope error fault free inputs limit network noise "
    "parameters quiet resume samples seed set start turbulence units workers"
)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises BadInputError."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, add_help=False, **options)
        self.add_argument("-h", "--help", nargs="?", const="", action=_Help, help=argparse.SUPPRESS)
        # "-5:5:1" and "-.5,1" are values too.
        self._negative_number_matcher = re.compile(r"-[\d.]")
        self._otherwise: dict[str, Any] = {}

    def declare(self, options: Options) -> None:
        """Add the options."""
        for names, each in options.items():
            how: dict[str, Any] = (
                {"type": each.kind, "metavar": each.form} if each.form else {"action": "store_true"}
            )
            if each.named:
                how = {"action": _Named, "value": each.kind, "metavar": each.form}
            if names.startswith("-"):
                how["default"] = argparse.SUPPRESS
            action = self.add_argument(*names.split(), help=each.about, **how, **each.more)
            usual: Any = {} if each.named else None if each.form else False
            self._otherwise[action.dest] = usual if each.default is None else each.default
        places = "".join(f" [{each.metavar}]" for each in self._actions if not each.option_strings)
        self.usage = f"{self.prog}{places} [options]"

    def format_help(self, more: bool = False) -> str:
        """Usage, description and options; without `more` the rare ones by name only."""
        words = {f"--{word}" for word in RARE.split()} if not more else set()
        rare = [each for each in self._actions if words.intersection(each.option_strings)]
        kept = [each.help for each in rare]
        for each in rare:
            each.help = argparse.SUPPRESS
        text = super().format_help()
        for each, about in zip(rare, kept, strict=True):
            each.help = about
        named = ", ".join(each.option_strings[-1] for each in rare)
        return text + (
            textwrap.fill(f"more ({self.prog} --help more): {named}", 80) + "\n" if rare else ""
        )

    def parse_words(self, words: list[str]) -> argparse.Namespace:
        """The options and their values, of an option that comes twice the last; `given`: the names
        of those typed, `line`: the whole command line."""
        for word in words[: words.index("--")] if "--" in words else words:
            option = word.partition("=")[0]
            if option.startswith("--") and option not in self._option_string_actions:
                known = self._option_string_actions
                raise BadInputError(
                    unknown(f"option {shortened(option)}", option, known, self.prog)
                )
        # A stray word is named before an option that is missing: `hfa trim 15`.
        required = [action for action in self._actions if action.required]
        for action in required:
            action.required = False
        arguments, strays = self.parse_known_intermixed_args(words)
        if strays:
            self.error(f"unrecognized arguments: {' '.join(map(shortened, strays))}")
        typed = {name: value for name, value in vars(arguments).items() if value is not None}
        missing = [action.option_strings[-1] for action in required if action.dest not in typed]
        if missing:
            self.error(f"the following arguments are required: {', '.join(missing)}")
        line = shlex.join([*self.prog.split(), *words])
        return argparse.Namespace(**{**self._otherwise, **typed}, given=frozenset(typed), line=line)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return self._registry_get("type", action.type, action.type)(arg_string)
        except BadInputError as error:
            raise argparse.ArgumentError(action, str(error)) from error
        except (
            ValueError,
            RecursionError,
        ) as error:  # a file of digits, or of brackets, without end
            reason = f"{shortened(arg_string)}: cannot be read ({shortened(str(error))})"
            raise argparse.ArgumentError(action, reason) from error

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        if action.option_strings and arg_strings == [
            "--"
        ]:  # argparse would make an empty list of it
            raise argparse.ArgumentError(action, "is '--'; give a value")
        return super()._get_values(action, arg_strings)

    def error(self, message: str) -> NoReturn:
        """The complaint of argparse about one option, or about the words as a whole."""
        named = re.sub(r"^argument (?:\S+/)?(\S+): ", r"\1 ", message)
        raise BadInputError(named if named != message else f"{message} (see `{self.prog} --help`)")


class _Help(argparse.Action):
    """`--help`, `--help more`."""

    def __call__(
        self, parser: Any, _: argparse.Namespace, values: Any, option_string: str | None = None
    ) -> None:
        sys.stdout.write(parser.format_help(more=values == "more"))
        parser.exit()


class _Named(argparse.Action):
    """`NAME=VALUE` words of a repeatable option, as name -> value(name, text)."""

    def __init__(self, *, value: Callable[[str, str], Any], **options: Any) -> None:
        super().__init__(**options)
        self._value = value

    def __call__(
        self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None
    ) -> None:
        name, separator, text = values.partition("=")
        if not separator:
            raise argparse.ArgumentError(self, f"{shortened(values)!r} is not NAME=VALUE")
        try:
            found = self._value(name, text)
        except BadInputError as error:
            raise argparse.ArgumentError(self, f"{shortened(name)} {error}") from error
        setattr(namespace, self.dest, {**getattr(namespace, self.dest, {}), name: found})


def unknown(what: str, name: str, known: Iterable[str], program: str) -> str:
    """The complaint that an option or a command does not exist, with the one that was probably
    meant."""
    import difflib

    close = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return f"unknown {what}" + (
        f"; did you mean {close[0]}?" if close else f" (see `{program} --help`)"
    )
