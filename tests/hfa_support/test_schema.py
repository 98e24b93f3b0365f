"""Validation of users' files: valid data are returned, and an error names the invalid entry."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hfa import BadInputError
from hfa_support.schema import NUMBER, POSITIVE, Number, checked

DECLARED = {
    "name*": str,
    "kind": ("state", "output"),
    "sizes": [[NUMBER]],
    "limits": {str: POSITIVE},
    "delta": Number(0.0, above=True, infinite=True),
    "open": {"a*": Number(0.0, 1e100), ...: None},
}


def test_declared_numbers_are_read_as_floats() -> None:
    """Data that match the declaration are returned with numbers as floats."""
    value = {
        "name": "x",
        "sizes": [[1, 2.5]],
        "delta": math.inf,
        "limits": {"any": 3},
        "open": {"a": 0, "b": []},
    }
    accepted = checked("f.toml", value, DECLARED)
    assert accepted == value
    assert isinstance(accepted["limits"]["any"], float)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": 3}, "f.toml: name is 3; give a text in quotes"),
        ({"kind": "stat"}, "f.toml: kind is 'stat'; give one of state, output"),
        ({"sizes": [[1], ["x"]]}, "f.toml: sizes[1][0] is 'x'; give a finite number"),
        ({"sizes": 1}, "f.toml: sizes is 1; give a list of lists of numbers"),
        ({"limits": {"any": 0}}, "f.toml: limits.any is 0; give a finite number above 0"),
        ({"limits": 5}, "f.toml: limits is 5; give a table [limits]"),
        ({"delta": math.nan}, "f.toml: delta is nan; give a number above 0"),
        ({"delta": True}, "f.toml: delta is True; give"),
        ({"delta": 10**400}, "f.toml: delta is 1000"),
        ({"open": {"b": 1}}, "f.toml: open.a is missing; add this entry"),
        (
            {"open": {"a": 1e200}},
            "f.toml: open.a is 1e+200; give a finite number of at least 0, at most 1e+100",
        ),
        ({"limit": {}}, "f.toml: unknown entry limit; did you mean limits?"),
        ({"zzz\x1b": 1}, "f.toml: unknown entry zzz\\x1b; choose from name, kind, sizes"),
    ],
)
def test_undeclared_data_are_refused_by_name(change: dict[str, Any], said: str) -> None:
    """Data that do not match the declaration are refused in one line that names the entry."""
    with pytest.raises(BadInputError) as refusal:
        checked("f.toml", {"name": "x"} | change, DECLARED)
    assert str(refusal.value).startswith(said)
    assert str(refusal.value).isprintable()
