"""Results declared once: their data and their JSON Schema follow from fields and docstrings."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from hfa.formats import written_results
from hfa_support.provenance import Provenance
from hfa_support.reporting.results import Matrix, Result, Roots, json_schema, meanings, parts_of


@dataclass(frozen=True)
class Leaf(Result):
    """A part.

    name: what it is called.
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


def test_the_data_are_the_fields() -> None:
    assert WHOLE.to_dict() == {
        "schema": "hfa.whole/1",
        "A": [[1.0, 0.0], [0.0, 1.0]],
        "size": None,
        "kind": "one",
        "leaves": [{"name": "a", "roots": [[1.0, 2.0]]}],
        "by_name": {"x": 1.0},
    }


def test_the_schema_says_types_and_meanings_and_accepts_the_data() -> None:
    schema = json_schema(Whole)
    assert meanings(Leaf)["roots"] == "(k,) complex, 1/s."
    assert schema["properties"]["size"]["description"] == "a number."
    assert schema["required"] == ["schema", "A", "size", "kind", "leaves", "by_name"]
    assert parts_of(Whole) == [Leaf]
    definitions = {"Leaf": json_schema(Leaf)}
    validator = Draft202012Validator(schema | {"$defs": definitions})
    data = json.loads(json.dumps(WHOLE.to_dict()))
    assert list(validator.iter_errors(data)) == []
    for fault in ({"A": [1.0]}, {"kind": "third"}, {"leaves": [{"name": "a"}]}, {"size": "1"}):
        assert list(validator.iter_errors(data | fault)) != []


@pytest.mark.parametrize("kind", [*written_results(), Provenance])
def test_every_field_that_is_written_has_a_meaning(kind: type[Result]) -> None:
    for part in (kind, *parts_of(kind)):
        json_schema(part)  # KeyError for a field whose docstring has no line
