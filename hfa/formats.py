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
from hfa_support.reporting.results import Result
from hfa_support.reporting.schemas import json_schema, parts_of

#: Types of JSON.
_PLAIN = {"object", "array", "string", "number", "integer", "boolean", "null"}


#: Results that commands of the core write, "module:Class module:Class?": the class and those of
#: what is added to it, with ? where that is not always. Those of formats.toml wait to be declared.
RESULTS = (
    "trim.point.trim_report:TrimResult trim.point.trim_report:Performance"
    " hfa_model.trim_loads:TrimLoads?",
    "trim.linear.linear_model:LinearModel trim.hfa.printed:OfTheHfa"
    " trim.linear.handling_qualities:Qualities? trim.linear.frequency:Responses?",
    "trim.sweeps.sweep:Sweep",
    "verification.regeneration:Regeneration",
    "controller.riccati.solution_report:AnalysedGame hfa.options.games:NamedGame",
    "controller.riccati.discrete_report:AnalysedDiscreteGame hfa.options.games:NamedGame",
    "controller.game.training_run:TrainingRun hfa.options.games:NamedGame hfa.commands.game:Judged",
    "verification.critic.verdict:Verdict verification.critic.verdict:Details"
    " hfa.options.games:Weights hfa.options.games:NamedGame",
    "verification.critic.verdict:DiscreteVerdict verification.critic.verdict:Details"
    " hfa.options.games:Weights hfa.options.games:NamedGame",
    "verification.critic.verdict:Verdicts hfa.options.games:Weights hfa.options.games:NamedGame",
)
#: Parts that only formats.toml refers to.
PARTS_OF_TABLES = "hfa_support.provenance:Provenance trim.point.operating_point:OperatingPoint"


@dataclass(frozen=True)
class Stamp(Result):
    """What the command adds to every result.

    units: of every number here, english (ft, slug, lbf) or si (m, kg, N).
    provenance: version, command, date, equations, parameters with a hash, condition."""

    units: Literal["english", "si"] | None = None
    provenance: Provenance | None = None


def written() -> tuple[str, ...]:
    """The results that commands write, as in `RESULTS`: of the core and of what is installed."""
    of_commands = [text for entry in commands().values() for text in entry.results]
    of_parts = [entry for name, entry in offered(PARTS).items() if name.startswith("results.")]
    return (*RESULTS, *of_commands, *(text for entry in of_parts for text in loaded(entry)))


def classes_of(text: str) -> list[type[Result]]:
    """The classes of "module:Class module:Class?"."""
    places = (place.removesuffix("?").split(":") for place in text.split())
    return [getattr(import_module(module), name) for module, name in places]


@cache
def formats() -> dict[str, Any]:
    """The schema of all outputs: every output is one of its `oneOf`, by the key `schema`."""
    declared = tomllib.loads(files("hfa").joinpath("formats.toml").read_text("utf-8"))
    tables = declared["parts"] | declared["outputs"]
    definitions = {name: _value(text) for name, text in declared["types"].items()}
    definitions |= {name: _object(table, declared["keys"]) for name, table in tables.items()}
    parts = classes_of(PARTS_OF_TABLES)
    for kind in (*parts, *(kind for text in written() for kind in classes_of(text))):
        parts += parts_of(kind)
    results = {_name(classes_of(text)[0]): _joined(text) for text in written()}
    definitions |= results | {part.__name__: json_schema(part) for part in parts}
    outputs = [*results, *declared["outputs"]]
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


def _joined(text: str) -> dict[str, Any]:
    """The schema of a result with the entries that are added to it."""
    first, *added = classes_of(text)
    schema = json_schema(first)
    for kind, place in zip((*added, Stamp), (*text.split()[1:], ""), strict=True):
        more = json_schema(kind)
        schema["properties"] = schema["properties"] | more["properties"]
        if not place.endswith("?"):
            schema["required"] += more["required"]
    schema["required"] = list(dict.fromkeys(schema["required"]))
    return schema


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
