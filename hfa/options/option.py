"""Options of the command line, declared as fields of frozen dataclasses of plain values."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, field, fields, replace
from importlib.util import find_spec
from typing import Any

from hfa_support.errors import BadInputError

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


def options_of(request: type) -> dict[str, Option]:
    """Return the options of a class of requests, field -> option.

    The order is that of the help: common options of the aircraft and the command, of the output, of
    other groups, and rare ones; in each group, required ones come first.
    """
    options: dict[str, Option] = {}
    for each in fields(request):
        if declared := each.metadata.get("option"):
            usual_name = "--" + each.name.strip("_").replace("_", "-")
            options[each.name] = replace(declared, names=declared.names or (usual_name,))

    def place(name: str) -> tuple[bool, ...]:
        """Return the sort key of a field, of which False comes first."""
        option = options[name]
        is_first = option.required or option.first
        return option.rare, bool(option.group), not is_first, name in _OUTPUT

    return {name: options[name] for name in sorted(options, key=place)}


def is_given(request: Any, name: str) -> bool:
    """Return whether a field of a request differs from its default."""
    declared = type(request).__dataclass_fields__[name]
    usual = declared.default
    if declared.default_factory is not MISSING:
        usual = declared.default_factory()
    value = getattr(request, name)
    return value is not usual and (type(value) is not type(usual) or value != usual)


def refuse(request: Any, names: Iterable[str], reason: str) -> None:
    """Raise BadInputError if one of these options was given.

    names: fields whose options have no effect
    reason: end of the message, which follows the name of the option
    """
    for name in names:
        if is_given(request, name):
            raise BadInputError(f"{options_of(type(request))[name].names[-1]} {reason}")


def is_installed(package: str) -> bool:
    """Return whether a package can be imported, without importing it.

    package: name of a top-level package, such as "hfa_flight"
    """
    return find_spec(package) is not None
