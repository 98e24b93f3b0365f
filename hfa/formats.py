"""JSON Schema of the output of `--json` and of files written by `-o FILE.json`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Literal

from hfa.entry_points import commands
from hfa.options.part import is_installed
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


def classes_of(places: Iterable[str]) -> list[type[Result]]:
    """Return the classes at locations "package.module:Class", without packages not installed."""
    found = []
    for place in places:
        module, _, name = place.partition(":")
        if is_installed(module.partition(".")[0]):
            found.append(getattr(import_module(module), name))
    return found


@cache
def formats() -> dict[str, Any]:
    """Return the JSON Schema of all outputs.

    The list `oneOf` contains one schema for each format, such as trim.
    """
    written = [each for entry in commands().values() for each in entry.results]
    kinds: set[type[Result]] = {Stamp}
    results = {}
    for each in written:
        required = classes_of((each.result, *each.more))
        optional = [*classes_of(each.optional), Stamp]
        results[_name(required[0])] = _joined(required, optional)
        kinds.update(required, optional)
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


def _name(result: type[Result]) -> str:
    """Return the name of the format of a class of results, such as "trim" for hfa.trim/1."""
    return result.schema.removeprefix("hfa.").partition("/")[0]


def _part(result: type[Result]) -> dict[str, Any]:
    """Return the schema of a class of results without its title, for use inside another result."""
    return {key: value for key, value in json_schema(result).items() if key != "title"}


def _joined(required: list[type[Result]], optional: list[type[Result]]) -> dict[str, Any]:
    """Return the schema of a result with the entries of all its classes."""
    schema = json_schema(required[0])
    for kind in (*required[1:], *optional):
        more = json_schema(kind)
        schema["properties"] = schema["properties"] | more["properties"]
        if kind not in optional:
            schema["required"] += more["required"]
    schema["required"] = list(dict.fromkeys(schema["required"]))
    return schema


if __name__ == "__main__":
    sys.stdout.write(json.dumps(formats(), indent=1, ensure_ascii=False) + "\n")
