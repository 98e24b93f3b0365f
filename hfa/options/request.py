"""Requests: the input of a run, each field declared with its option.

A command has one class of requests. The parser makes one from the command line; no other part of
the program reads the command line.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_support.provenance import Provenance


class OfModel(NamedTuple):
    """Kind of option whose function takes the model first, because words are in its names and
    units."""

    kind: Callable[..., Any]


@dataclass(frozen=True)
class Option:
    """Option of the command line that sets a field.

    about: its help; "" hides it
    form: the value as shown in the help, or "" for a switch
    kind: word -> value; its BadInputError continues a sentence that begins with the option
    names: as in "-o --output"; a name without dashes is a positional argument
    named: whether the words are NAME=VALUE[,NAME=VALUE...], repeatable; kind then takes both
    repeated: whether it may be repeated; the field then contains all values
    count: number of its words, as argparse's nargs, or None for one
    required: whether it must be typed
    aliases: other names of a model's names, for an option that is `named`
    rare: whether only `--help more` explains it; `--help` lists its name
    part: name in `hfa.parts` of the part that implements it; without that part the help omits it

    about, form, names and required may also be functions of the model that return these.
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
    part: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)

    def of(self, model: Model | None, name: str) -> Option:
        """Return this option for a model, with the functions of the model replaced by their values.

        model: None for an option that does not depend on one
        name: name of the field, from which the option has its name unless it declares another
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
        """Return the names of the option; the last is the one used in messages."""
        return str(self.names).split()


def _resolved(value: Any, model: Model | None) -> Any:
    return value(model) if callable(value) else value


def option(
    about: str | Callable[[Model], str],
    form: str | Callable[[Model], str] = "",
    kind: Callable[..., Any] | OfModel = str,
    default: Any = None,
    **more: Any,
) -> Any:
    """Return a field of a request that an option sets.

    about, form, kind: as in `Option`
    default: value of a field whose option is not typed; switches, `named` and `repeated` options
        have their own
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

    model: the aircraft, whose names and units the other fields use
    line: the command line, as typed
    date: beginning of the run, UTC, as printed in outputs
    typed: names of the fields that were typed; the others have their defaults
    quiet: whether notes and progress are suppressed
    """

    model: Model
    line: str = ""
    date: str = ""
    typed: frozenset[str] = frozenset()
    quiet: bool = option("print no notes and no progress", names="-q --quiet", rare=True)

    @classmethod
    def declared(cls) -> dict[str, Option]:
        """Return field -> option, the fields of the bases first."""
        options = {field.name: field.metadata["option"] for field in fields(cls) if field.metadata}
        classes = (*cls.__mro__[1:], cls)
        names = [name for field in classes for name in inspect.get_annotations(field)]
        return {name: options[name] for name in dict.fromkeys(names) if name in options}

    @classmethod
    def options(cls, model: Model) -> dict[str, Option]:
        """Return field -> option, in the names and units of a model."""
        return {name: option.of(model, name) for name, option in cls.declared().items()}

    @cached_property
    def provenance(self) -> Provenance:
        """Return the provenance of the outputs of this run."""
        from hfa_support.provenance import Provenance

        return Provenance(self.line, date=self.date, **self.origin())

    def origin(self) -> Mapping[str, Any]:
        """Return the entries of the provenance besides the command line."""
        return {}

    def refuse(self, names: Iterable[str], reason: str) -> None:
        """Raise BadInputError where one of these options was typed but has no effect.

        names: fields of the options
        reason: why they have no effect
        """
        options = self.options(self.model)
        for name in names:
            if name in self.typed:
                raise BadInputError(f"{options[name].flags[-1]} {reason}")
