"""Requests: the input of a run, each field declared with its option.

A command has one class of requests. The parser makes one from the command line, and nothing else of
the command line is seen by the rest of the program."""

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
    """A kind of option whose first argument is the model, whose names and units are typed."""

    kind: Callable[..., Any]


@dataclass(frozen=True)
class Option:
    """The option that types a field.

    about: its help; "" hides it.
    form: how help shows its value, or "" for a switch.
    kind: word -> value; its BadInputError is the rest of a sentence that begins with the option.
    names: as in "-o --output"; a name without dashes is a positional argument.
    named: its words are NAME=VALUE[,NAME=VALUE...], repeatable; kind takes the name and the value.
    repeated: it may be repeated; the field has all values.
    count: how many words it has, as argparse's nargs, or None for one.
    required: whether it must be typed.
    aliases: other names of a model's names, of those that are `named`.
    rare: `--help` lists it by name only; `--help more` explains it.
    part: name in `hfa.parts` of the part that answers it; without that part it is not in the help.

    about, form, names and required may also be functions of the model that return these."""

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
        """Return this option for a model: each function of the model is replaced by its value, in
        the help where it is shown.

        model: None for an option that does not depend on one
        name: of the field, from which the option has its name unless it declares another
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
    """A field of a request that is typed by an option. more: further entries of `Option`."""
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

    model: the aircraft, in whose names and units the other fields are.
    line: the command line, as typed.
    date: beginning of the run, UTC, as printed in outputs.
    typed: the names of the fields that were typed; the others have their default values.
    quiet: no notes and no progress."""

    model: Model
    line: str = ""
    date: str = ""
    typed: frozenset[str] = frozenset()
    quiet: bool = option("print no notes and no progress", names="-q --quiet", rare=True)

    @classmethod
    def declared(cls) -> dict[str, Option]:
        """Field -> its option: those of its bases first, then those of this class."""
        options = {field.name: field.metadata["option"] for field in fields(cls) if field.metadata}
        classes = (*cls.__mro__[1:], cls)
        names = [name for field in classes for name in inspect.get_annotations(field)]
        return {name: options[name] for name in dict.fromkeys(names) if name in options}

    @classmethod
    def options(cls, model: Model) -> dict[str, Option]:
        """Field -> its option, in the names and units of a model."""
        return {name: option.of(model, name) for name, option in cls.declared().items()}

    @cached_property
    def provenance(self) -> Provenance:
        """Provenance of the outputs of this run."""
        from hfa_support.provenance import Provenance

        return Provenance(self.line, date=self.date, **self.origin())

    def origin(self) -> Mapping[str, Any]:
        """Return the entries of the provenance besides the command line."""
        return {}

    def refuse(self, names: Iterable[str], reason: str) -> None:
        """Raise BadInputError for the first of these options that was typed: it would change
        nothing."""
        options = self.options(self.model)
        for name in names:
            if name in self.typed:
                raise BadInputError(f"{options[name].flags[-1]} {reason}")
