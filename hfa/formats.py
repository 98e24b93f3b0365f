"""The published formats of what `--json` prints and `-o FILE.json` writes: a JSON Schema."""

from __future__ import annotations

import json
import sys
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any, Literal

from hfa.doors import commands
from hfa_support.entry_points import PARTS, loaded, offered
from hfa_support.provenance import Provenance
from hfa_support.reporting.results import Result, json_schema, parts_of

#: Types of JSON.
_PLAIN = {"object", "array", "string", "number", "integer", "boolean", "null"}


#: Results that commands of the core write: module and class. Those of formats.toml wait to be
#: declared so.
RESULTS = (
    ("trim.point.trim_report", "TrimData"),
    ("trim.linear.linear_model", "LinearModelData"),
    ("trim.sweeps.sweep", "SweepData"),
)
#: Parts that only formats.toml refers to.
PARTS_OF_TABLES = (("hfa_support.provenance", "Provenance"),)


@dataclass(frozen=True)
class Stamp(Result):
    """What the command adds to every result.

    units: of every number here, english (ft, slug, lbf) or si (m, kg, N).
    provenance: version, command, date, equations, parameters with a hash, condition."""

    units: Literal["english", "si"] | None = None
    provenance: Provenance | None = None


def written_results() -> tuple[type[Result], ...]:
    """The results that commands write: of the core, and of the packages that are installed."""
    of_commands = (each.split(":") for entry in commands().values() for each in entry.results)
    named = [*RESULTS, *((module, name) for module, name in of_commands)]
    of_parts = [entry for name, entry in offered(PARTS).items() if name.startswith("result.")]
    return (
        *(getattr(import_module(module), name) for module, name in named),
        *(loaded(entry) for entry in of_parts),
    )


@cache
def formats() -> dict[str, Any]:
    """The schema of all outputs: every output is one of its `oneOf`, by the key `schema`."""
    declared = tomllib.loads(files("hfa").joinpath("formats.toml").read_text("utf-8"))
    tables = declared["parts"] | declared["outputs"]
    definitions = {name: _value(text) for name, text in declared["types"].items()}
    definitions |= {name: _object(table, declared["keys"]) for name, table in tables.items()}
    results = list(written_results())
    parts = [getattr(import_module(module), name) for module, name in PARTS_OF_TABLES]
    parts += [part for result in (*results, *parts) for part in parts_of(result)]
    for result in results:
        definitions[_name(result)] = _stamped(json_schema(result))
    definitions |= {part.__name__: json_schema(part) for part in parts}
    outputs = [*map(_name, results), *declared["outputs"]]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": declared["id"],
        "title": declared["title"],
        "description": declared["description"],
        "type": "object",
        "required": ["schema"],
        "oneOf": [{"$ref": f"#/$defs/{name}"} for name in outputs],
        "$defs": definitions,
    }


def _name(result: type[Result]) -> str:
    """trim of hfa.trim/1."""
    return result.schema.removeprefix("hfa.").partition("/")[0]


def _stamped(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of a result with what the command adds."""
    return schema | {"properties": schema["properties"] | json_schema(Stamp)["properties"]}


def _object(table: dict[str, Any], shared: dict[str, str]) -> dict[str, Any]:
    """The schema of a table of keys, those with * required."""
    schema = {"title": table["title"]} if "title" in table else {}
    properties = {"schema": {"const": table["schema"]}} if "schema" in table else {}
    names = table["keys"].split()
    meanings = table.get("own", {})
    for name in (key.removesuffix("*") for key in names):
        properties[name] = _value(meanings.get(name) or shared[name])
    required = ["schema"] * ("schema" in table) + [
        name.removesuffix("*") for name in names if name.endswith("*")
    ]
    return {**schema, "type": "object", "required": required, "properties": properties}


def _value(text: str) -> dict[str, Any]:
    """The schema of "type: meaning"."""
    kind, _, meaning = text.partition(": ")
    return _type(kind) | ({"description": meaning} if meaning else {})


def _type(kind: str) -> dict[str, Any]:
    """Of "number or null", "list of matrix", "by name value", "'english' or 'si'", the name of a
    table, "any"."""
    for begin, form, inside in (
        ("list of ", "array", "items"),
        ("by name ", "object", "additionalProperties"),
    ):
        if kind.startswith(begin):
            return {"type": form, inside: _type(kind.removeprefix(begin))}
    words = kind.split(" or ")
    if kind.startswith("'"):
        plain = [word.strip("'") for word in words]
        return {"const": plain[0]} if len(plain) == 1 else {"enum": plain}
    if set(words) <= _PLAIN:
        return {"type": kind if len(words) == 1 else words}
    if len(words) > 1:
        return {"oneOf": [_type(word) for word in words]}
    return {} if kind == "any" else {"$ref": f"#/$defs/{kind}"}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(formats(), indent=1, ensure_ascii=False) + "\n")
