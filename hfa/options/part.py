"""Options as fields of dataclasses, and the parts of a request: groups of options."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from functools import cache, partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_aircraft.model import Model


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
    alone: value if no word follows the option, or None if a word is required
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
    alone: Any = None
    required: bool | Callable[[Model], bool] = False
    rare: bool = False
    package: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)

    def of(self, model: Model | None, path: str) -> Option:
        """Return a copy of this option for a model.

        - form, names, required: functions are evaluated for the model
        - about: a function is bound to the model
        - kind: the function of an `OfModel` is bound to the model
        - aliases: those of the model, or {} without a model

        model: None for an option that does not depend on the model
        path: path of the field, such as "trim.hold", whose last name is the option's name if
            `names` is empty
        """
        kind = partial(self.kind.kind, model) if isinstance(self.kind, OfModel) else self.kind
        name = path.rpartition(".")[2].replace("_", "-")
        return replace(
            self,
            about=partial(self.about, model) if callable(self.about) else self.about,
            form=_resolved(self.form, model),
            kind=kind,
            names=_resolved(self.names, model) or f"--{name}",
            required=_resolved(self.required, model),
            aliases={} if model is None else model.about.aliases,
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


class _Declared(NamedTuple):
    """A part as a request declares it: its class, and the options that the command changes."""

    kind: type[Part]
    without: Sequence[str]
    changed: Mapping[str, Field[Any]]

    def options(self) -> dict[str, Option]:
        """Return path of the field in the part -> option."""
        kept: dict[str, Option] = {}
        for each in fields(self.kind):
            declared = self.changed.get(each.name, each)
            if each.name not in self.without:
                kept |= _options_of(declared, each.name)
        return kept

    def made(self, model: Model, values: Mapping[str, Any], flags: Mapping[str, str]) -> Part:
        """Return the part of a model with the given values, path -> value."""
        defaults = {}
        inner = {}
        for name, each in self.changed.items():
            if "part" in each.metadata:
                inner[name] = _made(each, name, model, values, flags)
            else:
                usual = each.default_factory
                defaults[name] = each.default if usual is MISSING else usual()
        return self.kind.of(model, {**defaults, **values}, flags, **inner)


def _options_of(each: Field[Any], name: str) -> dict[str, Option]:
    """Return the options of one field, path -> option: its own, those of its part, or none."""
    if "part" in each.metadata:
        inner = each.metadata["part"].options()
        return {f"{name}.{path}": declared for path, declared in inner.items()}
    return {name: each.metadata["option"]} if "option" in each.metadata else {}


def _made(
    each: Field[Any],
    name: str,
    model: Model,
    values: Mapping[str, Any],
    flags: Mapping[str, str],
) -> Part:
    """Return the part of a field, from the values and flags of all options, path -> value."""
    declared: _Declared = each.metadata["part"]
    return declared.made(model, _inside(name, values), _inside(name, flags))


def part(kind: type[Part], *, without: Sequence[str] = (), **changed: Any) -> Any:
    """Return a field of a request that has a group of options.

    kind: class of the group
    without: options of the group that the command does not offer
    changed: name -> `option` or `part` that replaces the one of the group, for example with
        another help
    """
    return field(metadata={"part": _Declared(kind, without, changed)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Options that belong together: a field of a request, declared by `part`.

    model: the aircraft, which defines the names and units of the options
    typed: path of each option that the user gave -> option in messages, such as "--hold"
    """

    model: Model
    typed: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    @cache
    def declared(cls) -> Mapping[str, Option]:
        """Return the options, path of the field -> option, in the order of the fields."""
        return _Declared(cls, (), {}).options()

    @classmethod
    def of(
        cls, model: Model, values: Mapping[str, Any], flags: Mapping[str, str], **more: Any
    ) -> Self:
        """Return the group with the given values; all others have their defaults.

        model: the aircraft
        values: path of the field -> value
        flags: path of each option that the user gave -> option
        more: fields that are no options, and parts that are made already
        """
        known = {path: value for path, value in values.items() if "." not in path}
        for each in fields(cls):
            if "part" in each.metadata and each.name not in more:
                known[each.name] = _made(each, each.name, model, values, flags)
        return cls(model=model, typed=flags, **known, **more)

    def refuse(self, names: Iterable[str], reason: str) -> None:
        """Raise BadInputError if one of these options was given.

        names: paths of fields whose options have no effect
        reason: end of the message, which follows the name of the option
        """
        for name in names:
            if name in self.typed:
                raise BadInputError(f"{self.typed[name]} {reason}")


def _inside(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a part, without the part's name in their paths."""
    begin = f"{name}."
    return {
        path.removeprefix(begin): value for path, value in values.items() if path.startswith(begin)
    }
