"""Whether an output has its published format."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from hfa_cli.formats import formats

#: What was validated in this process: the format and the keys. Numbers alone make no new shape.
_SEEN: set[tuple[str, ...]] = set()


def assert_published(text: str) -> None:
    """JSON with every key known and of its type; once for each set of keys."""
    data = json.loads(text)
    shape = (str(data.get("schema")), *data)
    if shape not in _SEEN:
        found = complaints_about(data)
        assert found == [], f"{found}: correct hfa_cli/formats.toml"
        _SEEN.add(shape)


def complaints_about(data: dict[str, Any]) -> list[str]:
    """What is wrong with an output: the errors of the schema, and keys that it does not list."""
    name = str(data.get("schema")).removeprefix("hfa.").partition("/")[0]
    definitions = formats()["$defs"]
    if name not in definitions:
        return [f"{data.get('schema')} is not published"]
    unknown = [f"{key} is not published" for key in data if key not in definitions[name]["properties"]]
    return unknown + [f"{error.json_path}: {error.message[:200]}" for error in _validator(name).iter_errors(data)]


@cache
def _validator(name: str) -> Any:
    from jsonschema import Draft202012Validator

    definitions = formats()["$defs"]
    return Draft202012Validator({**definitions[name], "$defs": definitions})
