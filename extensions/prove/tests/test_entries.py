"""Entries of certificates: another type, shape or range is refused by its name."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from proofs import changed, put

import hfa
from hfa_prove.certificate import read_content
from hfa_prove.fields import Malformed
from hfa_prove.statements.plant import Subject
from hfa_support.errors import BadInputError

ROOT = Path(__file__).resolve().parents[3]
STORED = ROOT / "tests" / "nets" / "certificates"
#: Name of a stored certificate -> its aircraft.
CERTIFICATES = {
    "region_disturbed": lambda: hfa.load_model(f"{ROOT}/examples/pendulum.py:PENDULUM"),
    "schedule": hfa.aircraft,
}
#: Values that no entry has, but for texts.
OTHERS = [None, True, "1", [], {}, math.nan, math.inf, 2**53 + 1, 1.1e300]
#: Entries that may have fewer entries.
SHORTER = ("disturbances", "terms", "W")


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every entry of a certificate, also of lists and objects."""
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else entries:
        yield from leaves(entry, (*path, key))


def others(name: Any, value: Any) -> Iterator[Any]:
    """Yield values of another type or shape than that of an entry."""
    yield from (other for other in OTHERS if other != {} or name not in SHORTER)
    if isinstance(value, list) and value:
        yield [*value, value[-1]]
    if isinstance(value, list) and value and name not in SHORTER:
        yield value[:-1]
    if isinstance(value, dict):
        yield value | {"stray": 1.0}
    if isinstance(value, dict) and name not in SHORTER:
        yield dict(list(value.items())[1:])


@pytest.mark.parametrize("name", CERTIFICATES)
def test_an_entry_of_another_type_or_shape_is_refused(name: str) -> None:
    """Each entry, and the first two of each array, must have the type and the shape of its own."""
    whole = json.loads((STORED / f"{name}.json").read_text())
    subject = Subject(CERTIFICATES[name]())
    for path in leaves({part: whole[part] for part in ("statement", "witness")}):
        value: Any = whole
        for key in path:
            value = value[key]
        if any(isinstance(key, int) and key > 1 for key in path):
            continue
        for other in others(path[-1], value):
            if other == value and type(other) is type(value):
                continue
            made = copy.deepcopy(whole)
            put(other, *path)(made)
            with pytest.raises((Malformed, BadInputError)) as refused:
                read_content(made, subject)
            names = [key for key in path if isinstance(key, str)][-2:]
            named = any(key in str(refused.value) for key in names)
            assert named or path[-1] == "dynamics", (path, other)


#: Keys of an entry of each certificate, and values out of its range.
RANGES: dict[str, dict[str, list[Any]]] = {
    "region_disturbed": {
        "kind": ["motion"],
        "statement__piece__c": [0.0, -0.81],
        "statement__piece__W__0__1": [[3, -1], [2.0, 0], [13, 0], [1, 0], [0, 0]],
        "statement__extents__angle": [[0.1, 0.91], [-0.91, -0.1], [0.91, -0.91]],
        "statement__loop__limits__torque": [[0.5, -0.5], [0.5, 0.5]],
        "statement__loop__disturbances__push": [0.0, -0.1],
        "witness__multipliers__0__0": [-0.1],
        "witness__boxes": [-1, 1.5, 10**8 + 1],
    },
    "schedule": {
        "statement__flight__range": [[2.0, 1.0], [1.0, 1.0]],
        "statement__decay_rate": [-0.1],
        "statement__scheduled_rate": [0.0, -1.0, "any"],
        "witness__pieces": [-1, 1.5, 10**7 + 1],
    },
}


@pytest.mark.parametrize("name", CERTIFICATES)
def test_an_entry_out_of_its_range_is_refused(name: str) -> None:
    """Signs, orders, powers and counts are those that a proof can have."""
    whole = json.loads((STORED / f"{name}.json").read_text())
    subject = Subject(CERTIFICATES[name]())
    for keys, values in RANGES[name].items():
        entry = [key for key in keys.split("__") if not key.isdigit()][-1]
        for value in values:
            with pytest.raises(Malformed, match=entry):
                read_content(changed(whole, **{keys: value}), subject)
