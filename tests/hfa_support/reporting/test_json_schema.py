"""Data and JSON Schema of results, derived from the fields and docstrings of their classes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from hfa.entry_points import commands
from hfa.formats import classes_of
from hfa_support.provenance import Provenance
from hfa_support.reporting.json_schema import json_schema, meaning, parts_of
from hfa_support.reporting.results import (
    Matrix,
    Result,
    Roots,
)


@dataclass(frozen=True)
class Leaf(Result):
    """A part.

    name: name of the part.
    roots: (k,) complex,
        1/s."""

    name: str
    roots: Roots


@dataclass(frozen=True)
class Whole(Result):
    """A result.

    A: (n, n) a matrix.
    size: a number.
    kind: one of two words.
    leaves: its parts.
    by_name: numbers by name.
    more: only sometimes there."""

    schema = "hfa.whole/1"

    A: Matrix
    size: float
    kind: Literal["one", "other"]
    leaves: Sequence[Leaf]
    by_name: Mapping[str, float]
    more: int | None = None


WHOLE = Whole(np.eye(2), math.inf, "one", (Leaf("a", np.array([1 + 2j])),), {"x": 1.0})


def test_data_contain_the_fields() -> None:
    """The data of a result contain its fields, with arrays as lists and nan as null."""
    assert WHOLE.to_dict() == {
        "schema": "hfa.whole/1",
        "A": [[1.0, 0.0], [0.0, 1.0]],
        "size": None,
        "kind": "one",
        "leaves": [{"name": "a", "roots": [[1.0, 2.0]]}],
        "by_name": {"x": 1.0},
    }


def test_schema_contains_types_and_meanings() -> None:
    """The schema contains types and descriptions, accepts valid data and rejects wrong types."""
    schema = json_schema(Whole)
    assert meaning(Leaf, ("roots",)) == "(k,) complex, 1/s."
    assert schema["properties"]["size"]["description"] == "a number."
    assert schema["required"] == ["schema", "A", "size", "kind", "leaves", "by_name"]
    assert parts_of(Whole) == [Leaf]
    definitions = {"Leaf": json_schema(Leaf)}
    validator = Draft202012Validator(schema | {"$defs": definitions})
    data = json.loads(json.dumps(WHOLE.to_dict()))
    assert list(validator.iter_errors(data)) == []
    for fault in ({"A": [1.0]}, {"kind": "third"}, {"leaves": [{"name": "a"}]}, {"size": "1"}):
        assert list(validator.iter_errors(data | fault)) != []


WRITTEN = chain.from_iterable(entry.results for entry in commands().values())
CLASSES = chain.from_iterable((each.result, *each.more, *each.optional) for each in WRITTEN)


@pytest.mark.parametrize("kind", [*classes_of(dict.fromkeys(CLASSES)), Provenance])
def test_every_field_has_a_description(kind: type[Result]) -> None:
    """Each field of each result has a line in the docstring of its class."""
    for part in (kind, *parts_of(kind)):
        json_schema(part)  # KeyError for a field whose docstring has no line
