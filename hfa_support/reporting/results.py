"""Results whose data are declared once: by the fields of a dataclass and its docstring.

A `Result` is a dataclass. Each field is a key of the data; its annotation says the type, and the
line "name: meaning" of the docstring says what it is. JSON, files, the JSON Schema and the page of
formats follow from these."""

from __future__ import annotations

import inspect
import math
import re
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

import numpy as np

#: Arrays with one, two and three axes.
Vector = Annotated[np.ndarray, 1]
Matrix = Annotated[np.ndarray, 2]
Stack = Annotated[np.ndarray, 3]
#: Complex numbers, in the data (re, im) each.
Roots = Annotated[np.ndarray, 2]

#: A number; null where it is not finite or does not exist.
NUMBER = {"type": ["number", "null"]}
_PLAIN: dict[Any, dict[str, Any]] = {
    Any: {},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: NUMBER,
    str: {"type": "string"},
    complex: {"type": "array", "items": NUMBER},
}


class Result:
    """A dataclass that is data, also within other data.

    A field whose default is None is left out of the data where it is None.

    schema: name and number of the format, of what is written by itself; "" of a part.
    made_by: the command that writes it."""

    schema: ClassVar[str] = ""
    made_by: ClassVar[str] = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: field -> value."""
        data: dict[str, Any] = {"schema": self.schema} if self.schema else {}
        for field in _fields(type(self)):
            value = getattr(self, field.name)
            if value is not None or not _is_optional(field):
                data[field.name] = plain(value)
        return data


def plain(value: Any) -> Any:
    """A value as JSON has it: results and named tuples as objects, a complex number as (re, im), a
    number that is not finite as None."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        parts = np.stack([value.real, value.imag], -1) if np.iscomplexobj(value) else value
        return parts.tolist()
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def meanings(kind: type) -> dict[str, str]:
    """Field -> its meaning: the lines "name: meaning" of the docstrings, bases first."""
    lines: dict[str, str] = {}
    for ancestor in reversed(kind.__mro__):
        text = inspect.cleandoc(ancestor.__doc__ or "")
        for name, meaning in re.findall(r"^(\w+): (.+(?:\n +.+)*)", text, re.MULTILINE):
            lines[name] = " ".join(meaning.split())
    return lines


def json_schema(kind: type[Result]) -> dict[str, Any]:
    """The JSON Schema of a class of results; parts are referred to by "#/$defs/" and their name."""
    said_of = meanings(kind)
    hints = typing.get_type_hints(kind, include_extras=True)
    properties: dict[str, Any] = {}
    required = []
    if kind.schema:
        properties["schema"] = {"const": kind.schema}
        required.append("schema")
    for field in _fields(kind):
        properties[field.name] = type_schema(hints[field.name]) | {
            "description": said_of[field.name]
        }
        if not _is_optional(field):
            required.append(field.name)
    title = {"title": kind.made_by} if kind.made_by else {}
    return title | {"type": "object", "required": required, "properties": properties}


def type_schema(hint: Any) -> dict[str, Any]:
    """The JSON Schema of an annotation."""
    if isinstance(hint, type) and issubclass(hint, Result):
        return {"$ref": f"#/$defs/{hint.__name__}"}
    if hint in _PLAIN:
        return _PLAIN[hint]
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is Annotated:
        return _nested(arguments[1])
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (types.UnionType, typing.Union):
        kinds = [argument for argument in arguments if argument is not type(None)]
        return type_schema(kinds[0])
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": type_schema(arguments[1])}
    if origin is not None and issubclass(origin, Sequence):
        return {"type": "array", "items": type_schema(arguments[0])}
    raise TypeError(f"{hint}: a result cannot have it; add it to hfa_support.reporting.results")


def parts_of(kind: type[Result]) -> list[type[Result]]:
    """The classes of results that a class refers to, directly or not."""
    parts: list[type[Result]] = []
    waiting = list(typing.get_type_hints(kind, include_extras=True).values())
    while waiting:
        hint = waiting.pop()
        if isinstance(hint, type) and issubclass(hint, Result) and hint not in parts:
            parts.append(hint)
            waiting += typing.get_type_hints(hint, include_extras=True).values()
        waiting += get_args(hint)
    return parts


def _nested(axes: int) -> dict[str, Any]:
    return NUMBER if axes == 0 else {"type": "array", "items": _nested(axes - 1)}


def _fields(kind: type) -> tuple[Field[Any], ...]:
    return tuple(field for field in fields(kind) if field.repr)


def _is_optional(field: Field[Any]) -> bool:
    return field.default is None and field.default is not MISSING
