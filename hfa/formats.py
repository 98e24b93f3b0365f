"""JSON Schema of the output of `--json` and of files written by `-o FILE.json`."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Literal

from hfa.entry_points import commands
from hfa_support.provenance import Provenance
from hfa_support.reporting.json_schema import json_schema, parts_of
from hfa_support.reporting.results import Result


@dataclass(frozen=True)
class Stamp(Result):
    """Entries that every written result has in addition to its own.

    units: unit system of all numbers: english (ft, slug, lbf) or si (m, kg, N).
    provenance: version, command, date, equations, parameters with a hash, condition.
    """

    units: Literal["english", "si"] | None = None
    provenance: Provenance | None = None


def written() -> tuple[str, ...]:
    """Return the declarations of all results that commands write, and of entries that options add.

    Each declaration has the form of `CommandEntry.results`.
    """
    return tuple(text for entry in commands().values() for text in entry.results)


def classes_of(text: str) -> list[type[Result]]:
    """Return the classes of a declaration such as "module:Class module:Class?".

    A word without ":" is the name of a format and is omitted.
    """
    places = (place.removesuffix("?").split(":") for place in text.split() if ":" in place)
    return [getattr(import_module(module), name) for module, name in places]


@cache
def formats() -> dict[str, Any]:
    """Return the JSON Schema of all outputs.

    The list `oneOf` contains one schema for each format, such as trim.
    """
    results = {_name(classes_of(text)[0]): _joined(text) for text in written() if _is_whole(text)}
    for text in written():
        if not _is_whole(text):
            name = text.removeprefix("hfa.").partition("/")[0]
            for kind in classes_of(text):
                results[name]["properties"] |= json_schema(kind)["properties"]
    kinds: set[type[Result]] = {Stamp, *(kind for text in written() for kind in classes_of(text))}
    parts = {part.__name__: _part(part) for kind in kinds for part in parts_of(kind)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "hfa.formats/1",
        "title": "What hfa prints with --json and writes into files",
        "description": "Units: ft, slug, lbf, s, rad, unless a name ends in _deg, or `units` is "
        "si. Keys are added, never renamed.",
        "type": "object",
        "required": ["schema"],
        "oneOf": [{"$ref": f"#/$defs/{name}"} for name in results],
        "$defs": results | dict(sorted(parts.items())),
    }


def _is_whole(text: str) -> bool:
    """Return whether a declaration defines a complete result."""
    return ":" in text.split()[0]


def _name(result: type[Result]) -> str:
    """Return the name of the format of a class of results, such as "trim" for hfa.trim/1."""
    return result.schema.removeprefix("hfa.").partition("/")[0]


def _part(result: type[Result]) -> dict[str, Any]:
    """Return the schema of a class of results without its title, for use inside another result."""
    return {key: value for key, value in json_schema(result).items() if key != "title"}


def _joined(text: str) -> dict[str, Any]:
    """Return the schema of a declared result, with the entries of all its classes."""
    first, *added = classes_of(text)
    schema = json_schema(first)
    for kind, place in zip((*added, Stamp), (*text.split()[1:], ""), strict=True):
        more = json_schema(kind)
        schema["properties"] = schema["properties"] | more["properties"]
        if not place.endswith("?"):
            schema["required"] += more["required"]
    schema["required"] = list(dict.fromkeys(schema["required"]))
    return schema


if __name__ == "__main__":
    sys.stdout.write(json.dumps(formats(), indent=1, ensure_ascii=False) + "\n")
