"""Requests: the input of a run, in which each field is declared with its option.

Each command has a class of requests. The parser converts a command line to a request.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_support.provenance import Provenance


class OfModel(NamedTuple):
    """Option type that needs the model, which defines the names and units of the typed value.

    kind: function (model, word) -> value, or (model, name, text) -> value for a `named` option
    """

    kind: Callable[..., Any]


@dataclass(frozen=True)
class Option:
    """A command-line option that sets a field of a request.

    about: help of the option, or "" to hide the option
    form: placeholder of the value in the help, or "" for a switch
    kind: function word -> value, or (name, text) -> value for a `named` option
    names: names separated by blanks, as in "-o --output", or one word without dashes for a
      positional argument
    named: whether the words are NAME=VALUE[,NAME=VALUE...]
    repeated: whether the option is repeatable and the field contains all values
    count: number of words, as argparse's nargs, or None for one word
    required: whether the option is mandatory
    aliases: alias -> name in the model, for a `named` option
    rare: whether only `--help more` explains the option, and `--help` lists its name
    package: package of an extension that the option requires, or "". Without the package, the help
        omits the option

    about, form, names and required may be functions of the model that return the value. The message
    of a BadInputError of `kind` completes a sentence that begins with the option.
    """

    about: str | Callable[..., str]
    form: str | Callable[[Model], str] = ""
    kind: Callable[..., Any] | OfModel = str
    names: str | Callable[[Model], str] = ""
    named: bool = False
    repeated: bool = False
    count: str | None = None
    required: bool | Callable[[Model], bool] = False
    rare: bool = False
    package: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)

    def of(self, model: Model | None, name: str) -> Option:
        """Return a copy of this option for a model.

        - form, names, required: functions are evaluated for the model
        - about: a function is bound to the model
        - kind: the function of an `OfModel` is bound to the model
        - aliases: those of the model, or {} without a model

        model: None for an option that does not depend on the model
        name: name of the field, which determines the option's name if `names` is empty
        """
        kind = partial(self.kind.kind, model) if isinstance(self.kind, OfModel) else self.kind
        names = _resolved(self.names, model) or "--" + name.replace("_", "-")
        return replace(
            self,
            about=partial(self.about, model) if callable(self.about) else self.about,
            form=_resolved(self.form, model),
            kind=kind,
            names=names,
            required=_resolved(self.required, model),
            aliases={} if model is None else model.extras.aliases,
        )

    @property
    def flags(self) -> list[str]:
        """Names of the option, for example ["-o", "--output"].

        Messages use the last name.
        """
        return str(self.names).split()


def is_installed(package: str) -> bool:
    """Return whether a package can be imported, without importing it.

    package: name of a top-level package, such as "hfa_flight"
    """
    return find_spec(package) is not None


def _resolved(value: Any, model: Model | None) -> Any:
    return value(model) if callable(value) else value


def option(
    about: str | Callable[[Model], str],
    form: str | Callable[[Model], str] = "",
    kind: Callable[..., Any] | OfModel = str,
    default: Any = None,
    **more: Any,
) -> Any:
    """Return a field of a request, together with the command-line option that sets it.

    about, form, kind: as in `Option`
    default: value without the option, ignored for switches and for `named` or `repeated` options
    more: further fields of `Option`
    """
    declared = Option(about, form, kind, **more)
    metadata = {"option": declared}
    if declared.named:
        return field(default_factory=dict, metadata=metadata)
    if declared.repeated:
        return field(default=(), metadata=metadata)
    if not form:
        return field(default=False, metadata=metadata)
    return field(default=default, metadata=metadata)


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


R = TypeVar("R", bound=Request)


class Command(NamedTuple):
    """A command of `hfa`.

    request: class whose fields are the options
    run: function that maps a request to the exit code, with the help as its docstring
    install: optional packages that the command requires, as pip names them
    example: last line of the help
    """

    request: type[Request]
    run: Callable[[Any], int]
    install: tuple[str, ...] = ()
    example: str = ""


def command(request: type[R]) -> Callable[[Callable[[R], int]], Command]:
    """Return a decorator that makes a `Command` from a function (request) -> exit code.

    request: class of the requests, whose fields are the options
    """
    return lambda run: Command(request, run)
