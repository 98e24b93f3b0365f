"""argparse as `hfa` wants it: one line for each complaint, the unknown option before the missing one."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable
from typing import Any, NoReturn

from hfa_support.errors import BadInputError, shortened


class _Once(argparse.Action):
    """Store the value of an option that is given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        setattr(namespace, self.dest, values)


class _Named(argparse.Action):
    """`NAME=VALUE` words of a repeatable option, as name -> value(name, text); a name that comes twice is refused.

    alone: a word that stands for all of them, and comes alone.
    """

    def __init__(self, *, value: Callable[[str, str], Any], alone: str | None = None, **options: Any) -> None:
        super().__init__(**options)
        self._value, self._alone = value, alone
        self._texts: dict[str, str] = {}

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        name, separator, text = values.partition("=")
        if self._alone is not None and (values == self._alone or self._alone in self._texts):
            if self._texts:
                raise argparse.ArgumentError(self, f"{self._alone} goes alone; leave the others out")
            self._texts[values] = ""
            setattr(namespace, self.dest, self._alone)
            return
        if not separator:
            raise argparse.ArgumentError(self, f"{shortened(values)!r} is not NAME=VALUE")
        if name in self._texts:
            raise argparse.ArgumentError(self, f"{shortened(name)} {_twice(self._texts[name], text)}")
        self._texts[name] = text
        try:
            value = self._value(name, text)
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentError(self, f"{shortened(name)} {error}") from error
        setattr(namespace, self.dest, (getattr(namespace, self.dest) or {}) | {name: value})


class Parser(argparse.ArgumentParser):
    """An argument parser that raises BadInputError."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, exit_on_error=False, **options)
        self.register("action", None, _Once)

    def parse_words(self, words: list[str]) -> argparse.Namespace:
        """The options and their values."""
        words = _attached(words)
        self._check_options(words)
        try:
            return self.parse_args(words)
        except argparse.ArgumentError as error:
            if error.argument_name is None:
                self.error(error.message)
            raise BadInputError(f"{error.argument_name.rpartition('/')[2]} {error.message}") from error

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the words as a whole."""
        raise BadInputError(f"{message} (see `{self.prog} --help`)")

    def _check_options(self, words: list[str]) -> None:
        """What argparse does not see or sees too late: options unknown or given twice, and "--" as a value."""
        known = self._option_string_actions
        given: dict[str, str] = {}
        for word, following in zip(words, [*words[1:], ""], strict=False):
            if word == "--":
                return  # only positional words follow
            if not re.match(r"-[^\d.]", word):
                continue
            short = word[:2], word[2:], word[2:].removeprefix("=")
            option, equals, value = word.partition("=") if word.startswith("--") else short
            if option not in known:
                raise BadInputError(unknown(f"option {shortened(option)}", option, known, self.prog))
            if equals and value == "--":
                raise BadInputError(f"{option} is '--'; give a value")
            action, text = known[option], value if equals else following
            if isinstance(action, _Once):
                if action.dest in given:
                    raise BadInputError(f"{option} {_twice(given[action.dest], text)}")
                given[action.dest] = text


def add_value(
    parser: argparse._ActionsContainer, option: str, kind: Callable[[str], Any], form: str, about: str, **more: Any
) -> None:
    """An option with one value. kind: word -> value; form: how `--help` shows the value."""
    parser.add_argument(option, type=kind, metavar=form, help=about, **more)


def add_named(
    parser: argparse._ActionsContainer,
    option: str,
    kind: Callable[[str, str], Any],
    form: str,
    about: str,
    alone: str | None = None,
) -> None:
    """A repeatable option whose words name what they are about. kind: name, word -> value; alone: as in `_Named`."""
    parser.add_argument(option, action=_Named, value=kind, alone=alone, metavar=form, help=about)


def add_refused(parser: argparse.ArgumentParser, option: str, refusal: str) -> None:
    """An option that is not in the help; with or without a word, it is answered with `refusal`."""

    class Refuse(argparse.Action):
        def __call__(self, *_: Any, **__: Any) -> NoReturn:
            raise BadInputError(f"{option} {refusal}")

    parser.add_argument(option, nargs="?", action=Refuse, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def unknown(what: str, name: str, known: Iterable[str], program: str) -> str:
    """Says that an option or a command does not exist, with the one that was probably meant."""
    import difflib

    close = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return f"unknown {what}" + (f"; did you mean {close[0]}?" if close else f" (see `{program} --help`)")


def _twice(first: str, second: str) -> str:
    return f"is given twice, as {shortened(first)!r} and as {shortened(second)!r}; give it once"


def _attached(words: list[str]) -> list[str]:
    """`--option -5:5:1` as `--option=-5:5:1`: argparse takes a word with a "-" for an option, plain numbers apart."""
    result: list[str] = []
    for word in words:
        if result and re.fullmatch(r"--[\w-]+", result[-1]) and re.match(r"-[\d.]", word):
            result[-1] += f"={word}"
        else:
            result.append(word)
    return result
