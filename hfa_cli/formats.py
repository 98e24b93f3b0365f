"""The published formats of what `--json` prints and `-o FILE.json` writes: a JSON Schema, and the same for people."""

from __future__ import annotations

import json
import sys
import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from hfa_support.reporting.report import markdown_table
from hfa_support.reporting.text import Table

#: Types of JSON.
_PLAIN = {"object", "array", "string", "number", "integer", "boolean", "null"}
_HEAD = """# Formats of the outputs

What every command prints with `--json` and writes into files, key by key, in ft, slug, lbf, s and rad unless a name
ends in `_deg`. The same as a JSON Schema (draft 2020-12), against which the tests validate every output:

```sh
python -m hfa_cli.formats > formats.json
```

Keys are added, never renamed or removed within a number after the `/`. A key marked * is always there. In files with
other suffixes: `.npz` has one array a leaf, keys joined by dots; `.mat` the same tree as structs, N matrices as
(rows, columns, N); `.csv` the numbers as a table with units in the names of its columns or a column of units, and where
it comes from in the first row of its last column, `about`.
"""


@cache
def formats() -> dict[str, Any]:
    """The schema of the declarations in formats.toml: every output is one of its `oneOf`, by the key `schema`."""
    declared = tomllib.loads(files("hfa_cli").joinpath("formats.toml").read_text("utf-8"))
    tables = declared["parts"] | declared["outputs"]
    objects = {name: _object(table, declared["keys"]) for name, table in tables.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": declared["id"],
        "title": declared["title"],
        "description": declared["description"],
        "type": "object",
        "required": ["schema"],
        "oneOf": [{"$ref": f"#/$defs/{name}"} for name in declared["outputs"]],
        "$defs": {name: _value(text) for name, text in declared["types"].items()} | objects,
    }


def _object(table: dict[str, Any], shared: dict[str, str]) -> dict[str, Any]:
    """The schema of a table of keys, those with * required."""
    found = {"title": table["title"]} if "title" in table else {}
    properties = {"schema": {"const": table["schema"]}} if "schema" in table else {}
    names, own = table["keys"].split(), table.get("own", {})
    for name in (each.removesuffix("*") for each in names):
        properties[name] = _value(own.get(name) or shared[name])
    required = ["schema"] * ("schema" in table) + [name.removesuffix("*") for name in names if name.endswith("*")]
    return {**found, "type": "object", "required": required, "properties": properties}


def _value(text: str) -> dict[str, Any]:
    """The schema of "type: meaning"."""
    kind, _, meaning = text.partition(": ")
    return _type(kind) | ({"description": meaning} if meaning else {})


def _type(kind: str) -> dict[str, Any]:
    """Of "number or null", "list of matrix", "by name value", "'english' or 'si'", the name of a table, "any"."""
    for begin, form, inside in (("list of ", "array", "items"), ("by name ", "object", "additionalProperties")):
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


def formats_markdown() -> str:
    """A table of keys for each output, then for the parts that outputs share."""
    definitions = formats()["$defs"]
    outputs = [entry["$ref"].rpartition("/")[2] for entry in formats()["oneOf"]]
    parts = [_HEAD]
    for name in outputs:
        what = definitions[name]
        parts.append(f"## {what['title']}\n\n`{what['properties']['schema']['const']}`\n\n{_keys(what)}\n")
    shared = [name for name in definitions if name not in outputs]
    rows = [(name, _kind(definitions[name]), definitions[name].get("description", "")) for name in shared]
    parts.append(f"## Types\n\n{markdown_table(Table(('type', 'is', 'note'), rows))}\n")
    parts += [f"### {name}\n\n{_keys(definitions[name])}\n" for name in shared if "properties" in definitions[name]]
    return "\n".join(parts)


def _keys(what: dict[str, Any]) -> str:
    rows = [
        (f"`{key}`{'*' * (key in what['required'])}", _kind(each), each.get("description", ""))
        for key, each in what["properties"].items()
        if key != "schema"
    ]
    return markdown_table(Table(("key", "type", "meaning"), rows))


def _kind(each: dict[str, Any]) -> str:
    """What a value is, in words."""
    if "$ref" in each:
        return str(each["$ref"].rpartition("/")[2])
    if "const" in each or "enum" in each:
        return " or ".join(f"`{word}`" for word in each.get("enum", [each.get("const")]))
    if "oneOf" in each:
        return " or ".join(map(_kind, each["oneOf"]))
    kinds = each.get("type", "any")
    if kinds == "array":
        return f"list of {_kind(each['items'])}"
    if kinds == "object" and "additionalProperties" in each:
        return f"object of {_kind(each['additionalProperties'])}"
    return " or ".join(kinds) if isinstance(kinds, list) else str(kinds)


if __name__ == "__main__":
    in_words = sys.argv[1:] == ["--markdown"]
    sys.stdout.write(formats_markdown() if in_words else json.dumps(formats(), indent=1, ensure_ascii=False) + "\n")
