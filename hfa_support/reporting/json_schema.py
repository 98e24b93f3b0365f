"""The JSON Schema of results, from the annotations and docstrings of their classes."""

from __future__ import annotations

import ast
import inspect
import re
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from importlib import import_module
from typing import Annotated, Any, Literal, get_args, get_origin

from hfa_support.reporting.results import Result, declared_entries, getter_of

#: A number; null where it is not finite or does not exist.
NUMBER = {"type": ["number", "null"]}
_PLAIN: dict[Any, dict[str, Any]] = {
    Any: {},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: NUMBER,
    str: {"type": "string"},
    complex: {"type": "array", "items": NUMBER},
    types.NoneType: {"type": "null"},
}


def meaning(kind: Any, path: tuple[str, ...]) -> str:
    """Return the description of an entry.

    The description is the line "name: ..." in the docstring of the entry's class or of a base
    class. Without this line, the docstring of the property is the description. Raises KeyError if
    both are missing.

    kind: class of the result
    path: names of the fields that lead to the entry, such as ("leaf", "name")
    """
    kind = _without_none(annotation(kind, path[:-1]))
    name = path[-1]
    for ancestor in kind.__mro__:
        text = inspect.cleandoc(vars(ancestor).get("__doc__") or "")
        line = re.search(rf"^{name}: (.+(?:\n +.+)*)", text, re.MULTILINE)
        if line:
            return " ".join(line[1].split())
        of_property = getattr(vars(ancestor).get(name), "__doc__", None)
        if of_property:
            return " ".join(of_property.split())
    raise KeyError(
        f"{kind.__name__}.{name} has no description; add '{name}: ...' to the class docstring"
    )


def annotation(kind: Any, path: tuple[str, ...]) -> Any:
    """Return the annotation of the field or property at the end of a path of names.

    The annotation includes None if any step of the path may be None. For an empty path, the result
    is the class itself.
    """
    none = types.NoneType
    is_optional = False
    for name in path:
        kind = _annotation(_without_none(kind), name)
        is_optional |= none in get_args(kind)
    return typing.Union[kind, None] if is_optional else kind  # noqa: UP007


def _annotation(kind: Any, name: str) -> Any:
    """Return the evaluated annotation of a field or property of a class or its bases."""
    # Raises KeyError if no class declares the name.
    for ancestor in kind.__mro__:
        written = _written_annotation(ancestor, name)
        if written is not None:
            module = import_module(ancestor.__module__)
            known = _imported_for_type_checkers(module, str(written)) | vars(module)
            holder = types.SimpleNamespace(__annotations__={name: written})
            return typing.get_type_hints(holder, known, include_extras=True)[name]
    raise KeyError(f"{kind.__name__} has no entry {name}; add a field or property with this name")


def _written_annotation(kind: type, name: str) -> Any:
    """Return the unevaluated annotation of a field or property that a class itself declares."""
    # The annotation of a property is the return annotation of its function. The result is None if
    # the class does not declare the name.
    getter = getter_of(vars(kind).get(name))
    if getter is not None:
        return getter.__annotations__.get("return")
    return vars(kind).get("__annotations__", {}).get(name)


def _imported_for_type_checkers(module: types.ModuleType, annotation: str) -> dict[str, Any]:
    """Return name -> class for each class in an annotation that is imported under TYPE_CHECKING."""
    classes = {}
    for name, defined_in in _type_checking_imports(module).items():
        if name in annotation:
            classes[name] = getattr(import_module(defined_in), name)
    return classes


@cache
def _type_checking_imports(module: types.ModuleType) -> dict[str, str]:
    """Return name -> defining module for names that a module imports under `if TYPE_CHECKING`."""
    defined_in: dict[str, str] = {}
    for block in ast.parse(inspect.getsource(module)).body:
        if not (isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"):
            continue
        for statement in block.body:
            if isinstance(statement, ast.ImportFrom) and statement.module:
                for imported in statement.names:
                    defined_in[imported.name] = statement.module
    return defined_in


def json_schema(kind: type[Result]) -> dict[str, Any]:
    """Return the JSON Schema of a class of results.

    A field that is itself a result is a reference "#/$defs/NAME".
    """
    properties: dict[str, Any] = {}
    required = []
    if kind.schema:
        properties["schema"] = {"const": kind.schema}
        required.append("schema")
    for name, path, is_optional in declared_entries(kind):
        hint = annotation(kind, path)
        if is_optional:
            hint = _without_none(hint)
        else:
            required.append(name)
        properties[name] = type_schema(hint) | {"description": meaning(kind, path)}
    title = {"title": kind.made_by} if kind.made_by else {}
    return title | {"type": "object", "required": required, "properties": properties}


def type_schema(hint: Any) -> dict[str, Any]:
    """Return the JSON Schema of the values with a given annotation.

    Raises TypeError if results do not support the annotation.
    """
    if isinstance(hint, type) and issubclass(hint, Result):
        return {"$ref": f"#/$defs/{hint.__name__}"}
    if hint in _PLAIN:
        return _PLAIN[hint]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [str(each.value) for each in hint]}
    if hasattr(hint, "_fields"):
        inside = typing.get_type_hints(hint, include_extras=True).items()
        properties = {name: type_schema(each) for name, each in inside}
        return {"type": "object", "required": [*properties], "properties": properties}
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is Annotated:
        return _nested(arguments[1]) if isinstance(arguments[1], int) else type_schema(arguments[1])
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (types.UnionType, typing.Union):
        kinds = [type_schema(argument) for argument in arguments]
        return kinds[0] if kinds[0] in (NUMBER, {}) else {"anyOf": kinds}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": type_schema(arguments[1])}
    if origin is not None and issubclass(origin, Sequence):
        return {"type": "array", "items": type_schema(arguments[0])}
    raise TypeError(
        f"the annotation {hint} is not supported in results; add this type to "
        "hfa_support.reporting.results"
    )


def parts_of(kind: type[Result]) -> list[type[Result]]:
    """Return all classes of results that a class of results contains, directly or indirectly."""
    parts: list[type[Result]] = []
    waiting = list(_annotations(kind))
    while waiting:
        hint = waiting.pop()
        if isinstance(hint, type) and issubclass(hint, Result) and hint not in parts:
            parts.append(hint)
            waiting += _annotations(hint)
        waiting += get_args(hint)
    return parts


def _without_none(hint: Any) -> Any:
    """Return the annotation without `| None`."""
    kinds = tuple(each for each in get_args(hint) if each is not types.NoneType)
    return typing.Union[kinds] if types.NoneType in get_args(hint) else hint  # noqa: UP007


def _annotations(kind: type[Result]) -> Iterator[Any]:
    return (annotation(kind, entry.path) for entry in declared_entries(kind))


def _nested(axes: int) -> dict[str, Any]:
    return NUMBER if axes == 0 else {"type": "array", "items": _nested(axes - 1)}
