"""Data of results: their fields, or what the class writes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

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
