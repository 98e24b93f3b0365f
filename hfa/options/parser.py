"""Parser of command lines. Options are declared as data, and each error message is one line."""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, NoReturn

from hfa_support.errors import BadInputError, advice, shortened

#: Fields whose options follow those of the aircraft and the command in the help.
_OUTPUT = ("output", "picture", "json", "quiet")
#: Group of the options that only the paper's flexible aircraft has.
PAPER = "the paper's aircraft"


@dataclass(frozen=True)
class Option:
    """A command-line option that sets a field of a request.

    about: help of the option, or a function that returns it
    form: placeholder of the value in the help, or "" for a switch
    kind: function word -> value, or (name, text) -> value for a `named` option. The message of its
        BadInputError completes a sentence that begins with the option.
    names: names, for example ("-o", "--output"), of which messages use the last; or one word
      without dashes for a positional argument
    named: whether the words are NAME=VALUE[,NAME=VALUE...]
    repeated: whether the option is repeatable and the field contains all values
    count: number of words, as argparse's nargs, or None for one word
    alone: value if no word follows the option, or None if a word is required
    required: whether the option is mandatory
    first: whether the option comes first in its group, as required ones do
    rare: whether only `--help more` explains the option, and `--help` lists its name
    group: heading in the help, or "" for the common options
    """

    about: str | Callable[[], str]
    form: str = ""
    kind: Callable[..., Any] = str
    names: tuple[str, ...] = ()
    named: bool = False
    repeated: bool = False
    count: str | None = None
    alone: Any = None
    required: bool = False
    first: bool = False
    rare: bool = False
    group: str = ""


def option(
    about: str | Callable[[], str],
    form: str = "",
    kind: Callable[..., Any] | None = None,
    default: Any = None,
    *,
    names: str = "",
    **more: Any,
) -> Any:
    """Return a field of a request, together with the command-line option that sets it.

    about, form: as in `Option`
    kind: as in `Option`; by default the word, or the text of a `named` option, is the value
    default: value without the option, ignored for switches and for `named` or `repeated` options
    names: names separated by blanks, "-o --output"; by default that of the field
    more: further fields of `Option`
    """
    if kind is None:
        kind = _text if more.get("named") else str
    declared = Option(about, form, kind, tuple(names.split()), **more)
    metadata = {"option": declared}
    if declared.named:
        return field(default_factory=dict, metadata=metadata)
    if declared.repeated:
        return field(default=(), metadata=metadata)
    return field(default=default if form else False, metadata=metadata)


def _text(_: str, text: str) -> str:
    """Return the text of NAME=TEXT, the value of a `named` option without a kind."""
    return text


#: Options of a trim that are rare in commands that name their usual options.
_OF_OTHER_TRIMS = ("free", "limit", "conditions", "row", "parameters")


def options_of(request: type) -> dict[str, Option]:
    """Return the options of a class of requests, field -> option.

    The order is that of the help: common options of the aircraft and the command, of the output, of
    other groups, and rare ones; in each group, required ones come first, then those that the class
    names as `usual`.
    """
    options: dict[str, Option] = {}
    usual: Sequence[str] = getattr(request, "usual", ())
    for of_option in fields(request):
        if declared := of_option.metadata.get("option"):
            usual_name = "--" + of_option.name.strip("_").replace("_", "-")  # class_: --class
            rare = declared.rare or (bool(usual) and of_option.name in _OF_OTHER_TRIMS)
            options[of_option.name] = replace(
                declared,
                names=declared.names or (usual_name,),
                rare=rare and of_option.name not in usual,
            )
    places = {  # compared from left to right, False before True
        name: (
            option.rare,
            bool(option.group),
            not (option.required or option.first),
            usual.index(name) if name in usual else len(usual),
            name in _OUTPUT,
        )
        for name, option in options.items()
    }
    return {name: options[name] for name in sorted(options, key=places.__getitem__)}


def is_given(request: Any, name: str) -> bool:
    """Return whether an option was given: whether its field differs from the default.

    name: the field
    """
    declared = type(request).__dataclass_fields__[name]
    usual = declared.default
    if declared.default_factory is not MISSING:
        usual = declared.default_factory()
    value = getattr(request, name)
    # A value of another type, such as an array, is not compared.
    return value is not usual and (type(value) is not type(usual) or value != usual)


def refuse(request: Any, names: Iterable[str], reason: str) -> None:
    """Raise BadInputError if one of these options was given.

    names: fields whose options have no effect
    reason: end of the message, which follows the name of the option
    """
    for name in names:
        if is_given(request, name):
            raise BadInputError(f"{options_of(type(request))[name].names[-1]} {reason}")


#: Heading of the options that only `--help more` explains.
RARE = "rarely used"


class Parser(argparse.ArgumentParser):
    """Argument parser that raises BadInputError instead of ending the process.

    options: field of the request -> its option
    example: last line of the help
    second_words: function that returns second word of the command -> summary, for the help
    """

    def __init__(
        self,
        options: Mapping[str, Option],
        *,
        example: str = "",
        second_words: Callable[[], Mapping[str, str]] = dict,
        **keywords_of_argparse: Any,
    ) -> None:
        super().__init__(allow_abbrev=False, add_help=False, **keywords_of_argparse)
        self.add_argument("-h", "--help", nargs="?", const="", action=_Help, help=argparse.SUPPRESS)
        # "-5:5:1" and "-.5,1" are values too.
        self._negative_number_matcher = re.compile(r"-[\d.]")
        self.options = options
        self.example = example
        self.second_words = second_words
        self._words: dict[str, list[str]] = {}  # as typed, for an option that is given twice
        groups: dict[str, Any] = {"": self}
        for name, option in options.items():
            keywords: dict[str, Any] = {"help": ""}  # `format_help` sets it
            if option.names[0].startswith("-"):
                required = option.required
                keywords |= {"dest": name, "default": argparse.SUPPRESS, "required": required}
            if option.named:  # NAME=VALUE
                keywords |= {"action": _Named, "const": option.kind, "metavar": option.form}
            elif option.form:  # with a value
                keywords |= {"type": option.kind, "metavar": option.form}
                if option.repeated:
                    keywords["action"] = "append"
                if option.count:
                    keywords["nargs"] = option.count
                if option.alone is not None:
                    keywords |= {"nargs": "?", "const": option.alone}
            else:  # a switch
                keywords["action"] = "store_true"
            heading = option.group or (RARE if option.rare else "")
            if heading not in groups:
                groups[heading] = self.add_argument_group(heading)
            groups[heading].add_argument(*option.names, **keywords)
        if self.usage is None:
            positional = [action for action in self._actions if not action.option_strings]
            words = "".join(f" [{action.metavar}]" for action in positional)
            self.usage = f"{self.prog}{words} [options]"

    def format_help(self, more: bool = False) -> str:
        """Return the help of the command: usage, description, options, subcommands and example.

        more: whether rare options are explained, or only listed by name
        """
        rare = []
        for action in self._actions:
            option = self.options.get(action.dest)
            if option is None:
                continue
            about = option.about() if callable(option.about) else option.about
            if about and option.rare and not more:
                rare.append(action.option_strings[-1])
                about = ""
            action.help = about or argparse.SUPPRESS
        text = super().format_help()
        if rare:
            text += textwrap.fill(f"more ({self.prog} --help more): {', '.join(rare)}", 80) + "\n"
        texts = [text]
        if words := self.second_words():
            lines = [f"  {self.prog} {word:<10}{about}\n" for word, about in words.items()]
            texts.append("".join(lines))
        if self.example:
            gap = " " if len(self.example) <= 70 else "\n"
            texts.append(f"example:{gap}{self.example}\n")
        return "\n".join(texts)

    def parse_words(self, words: list[str]) -> dict[str, Any]:
        """Return the values of the options in a command line, field of the request -> value.

        words: words of the command line after the name of the command

        Raises BadInputError for unknown options, invalid values, additional words and missing
        required options.
        """
        actions = self._option_string_actions
        option_words = words
        if "--" in words:
            option_words = words[: words.index("--")]
        for word in option_words:
            name = word.partition("=")[0]
            if name.startswith("--") and name not in actions:
                raise BadInputError(unknown(f"option {shortened(name)}", name, actions, self.prog))
        parsed, strays = self.parse_known_intermixed_args(words)
        if strays:
            self.error(f"unrecognized arguments: {' '.join(map(shortened, strays))}")
        return {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in vars(parsed).items()
            if value is not None
        }

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value of a word, with the fault of its type in an error of argparse."""
        try:
            return self._registry_get("type", action.type, action.type)(arg_string)
        except BadInputError as error:
            raise argparse.ArgumentError(action, str(error)) from error
        # For example, a file that contains only digits or brackets.
        except (ValueError, RecursionError) as error:
            reason = f"{shortened(arg_string)}: cannot be read ({shortened(str(error))})"
            raise argparse.ArgumentError(action, reason) from error

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        """Return the value of an option, and refuse another value of one that is given twice."""
        if action.option_strings and arg_strings == ["--"]:  # argparse converts it to an empty list
            raise argparse.ArgumentError(action, "is '--'; give a value")
        if action.option_strings and type(action) is argparse._StoreAction:
            before = self._words.setdefault(action.dest, arg_strings)
            if before != arg_strings:
                both = " and ".join(shortened(" ".join(words)) for words in (before, arg_strings))
                raise argparse.ArgumentError(action, f"is given twice ({both}); give one value")
        return super()._get_values(action, arg_strings)

    def error(self, message: str) -> NoReturn:
        """Raise BadInputError with a message of argparse in shorter form.

        A message on one option contains only the option and its fault. Other messages also name
        `--help`.
        """
        # "argument -o/--output: expected one argument" becomes "--output expected one argument".
        complaint = re.sub(r"^argument (?:\S+/)?(\S+): ", r"\1 ", message)
        raise BadInputError(
            complaint if complaint != message else f"{message} (see `{self.prog} --help`)"
        )


class _Help(argparse.Action):
    """Action of the option --help: print the short help, or the long one for `--help more`."""

    def __call__(
        self, parser: Any, _: argparse.Namespace, values: Any, option_string: str | None = None
    ) -> None:
        sys.stdout.write(parser.format_help(more=values == "more"))
        parser.exit()


class _Named(argparse.Action):
    """Action of a repeatable option `NAME=VALUE,NAME=VALUE`, whose value is a dictionary.

    const: function (name, text) -> value
    """

    def __call__(
        self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None
    ) -> None:
        for word in re.split(r",(?=\w+=)", values):
            name, separator, text = word.partition("=")
            if not separator:
                raise argparse.ArgumentError(
                    self, f"{shortened(word)!r} is not NAME=VALUE; give a name and a value"
                )
            (before,) = parser._words.setdefault(f"{self.dest} {name}", [text])  # as first typed
            if before != text:
                twice = (
                    f"is given twice ({shortened(before)} and {shortened(text)}); give one value"
                )
                raise argparse.ArgumentError(self, f"{shortened(name)} {twice}")
            try:
                value = self.const(name, text)
            except BadInputError as error:
                raise argparse.ArgumentError(self, f"{shortened(name)} {error}") from error
            setattr(namespace, self.dest, {**getattr(namespace, self.dest, {}), name: value})


def unknown(what: str, name: str, known: Iterable[str], program: str) -> str:
    """Return the error message for an unknown option or command, with the nearest known name.

    If no known name is near, the message names the help of `program`.

    what: kind of word, with the word
    name: the unknown name
    known: known names
    program: name of the command, such as "hfa trim"
    """
    return f"unknown {what}{advice(name, known) or f' (see `{program} --help`)'}"
