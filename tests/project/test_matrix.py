"""`make test-matrix` sees numbers that differ, and asks for the lower bounds that users are promised."""

from __future__ import annotations

import tomllib

import pytest
from matrix import ROOT, differences, oldest, requirements

DATA = {"A": [[1.0, -2.0], [3e-3, 4.0]], "rows": [{"name": "x", "value": 5.0}], "ok": True, "provenance": {"day": 1}}


def test_what_is_within_the_tolerance_is_equal() -> None:
    other = DATA | {"A": [[1.0 + 1e-11, -2.0], [3e-3, 4.0]], "provenance": {"day": 2}}
    assert differences(DATA, DATA) == differences(other, DATA) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"A": [[1.0, -2.0], [3e-3, 4.0 + 1e-9]]}, "/A: differs by 2.5e-10 of the largest"),
        ({"A": [[1.0, -2.0]]}, "/A: 2 numbers instead of 4"),
        ({"A": [[1.0, float("nan")], [3e-3, 4.0]]}, "/A: differs by nan of the largest"),
        ({"rows": [{"name": "x", "value": 5.1}]}, "/rows/0/value: differs by 2.0e-02 of the largest"),
        ({"rows": [{"name": "x"}]}, "/rows/0/value: only in one of them"),
    ],
)
def test_a_planted_difference_is_seen(change: dict[str, object], said: str) -> None:
    assert differences(DATA | change, DATA) == [said]


def test_the_oldest_are_the_lower_bounds_of_what_users_install() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = [oldest(each) for each in requirements(project)]
    assert all(each.count("==") == 1 and ">" not in each for each in found)
    assert {each.partition("==")[0] for each in found} >= {"casadi", "numpy", "scipy", "zarr", "python-flint"}
