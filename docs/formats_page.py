"""Generator of the documentation page on file formats, from the classes of results."""

from __future__ import annotations

import re
from typing import Any

from hfa.formats import formats
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table

_HEAD = """# Formats of the outputs

This page lists every key that commands print with `--json` and write into files. Units are ft, slug, lbf, s and rad
unless a name ends in `_deg`. The command below prints the same as a JSON Schema (draft 2020-12), against which the
tests validate every output:

```sh
python -m hfa.formats > formats.json
```

Within a format number (after the `/`) keys may be added but not renamed or removed. A key marked * is always present. A
`.npz` file contains one array for each leaf, with keys joined by dots. A `.mat` file contains the same tree as structs, with N
matrices as (rows, columns, N). A `.csv` file contains the numbers as a table, with units in the names of its columns or
in a column of units. The first row of its last column, `about`, names the source.
"""


def formats_page() -> str:
    """Return the Markdown page on file formats.

    The page contains a table of keys for each output of a command and for each type that outputs
    share.
    """
    definitions = formats()["$defs"]
    outputs = [entry["$ref"].rpartition("/")[2] for entry in formats()["oneOf"]]
    parts = [_HEAD]
    for name in outputs:
        what = definitions[name]
        title = re.sub(r"--[\w-]+", r"`\g<0>`", what["title"])
        parts.append(f"## {title}\n\n`{what['properties']['schema']['const']}`\n\n{_keys(what)}\n")
    shared = [name for name in definitions if name not in outputs]
    parts.append("## Types\n")
    parts += [f"### {name}\n\n{_keys(definitions[name])}\n" for name in shared]
    return "\n".join(parts)


def _keys(what: dict[str, Any]) -> str:
    rows = [
        (f"`{key}`{'*' * (key in what['required'])}", _kind(each), each.get("description", ""))
        for key, each in what["properties"].items()
        if key != "schema"
    ]
    return markdown_table(Table(("key", "type", "meaning"), rows))


def _kind(each: dict[str, Any]) -> str:
    """Return the type described by a JSON schema in words, for example "list of number"."""
    if "$ref" in each:
        return str(each["$ref"].rpartition("/")[2])
    if "const" in each or "enum" in each:
        return " or ".join(f"`{word}`" for word in each.get("enum", [each.get("const")]))
    if "anyOf" in each:
        return " or ".join(map(_kind, each["anyOf"]))
    kinds = each.get("type", "any")
    if kinds == "array":
        return f"list of {_kind(each['items'])}"
    if kinds == "object" and "additionalProperties" in each:
        return f"object of {_kind(each['additionalProperties'])}"
    return " or ".join(kinds) if isinstance(kinds, list) else str(kinds)
