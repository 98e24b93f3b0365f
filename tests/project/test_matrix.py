"""`make test-matrix` sees numbers that differ, and asks for the lower bounds that users are promised."""

from __future__ import annotations

import tomllib

import pytest
from matrix import ROOT, TESTS, differences, oldest, requirements

DATA = {"A": [[1.0, -2.0], [3e-3, 4.0]], "rows": [{"value": 5.0}, {"value": 0.0}], "provenance": {"day": 1}}
DATA |= {"checks": [{"value": 1e-16, "limit": 1e-9, "ok": True}], "residuals": {"speed": 0.0}}


def test_what_is_within_the_tolerance_is_equal() -> None:
    other = DATA | {"A": [[1.0 + 1e-11, -2.0], [3e-3, 4.0]], "provenance": {"day": 2}, "residuals": {"speed": 1e-16}}
    other |= {"checks": [{"value": 3e-16, "limit": 1e-9, "ok": True}], "rows": [{"value": 5.0}, {"value": 1e-17}]}
    assert differences(DATA, DATA) == differences(other, DATA) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"A": [[1.0, -2.0], [3e-3, 4.0 + 1e-9]]}, "/A: differs by 2.5e-10 of the largest"),
        ({"A": [[1.0, -2.0]]}, "/A: 2 numbers instead of 4"),
        ({"A": [[1.0, float("nan")], [3e-3, 4.0]]}, "/A: differs by nan of the largest"),
        ({"rows": [{"value": 5.0}, {"value": 1e-8}]}, "/rows/value: differs by 2.0e-09 of the largest"),
        ({"rows": [{"value": 5.0}]}, "/rows/value: 1 numbers instead of 2"),
        ({"rows": [{"name": "x"}]}, "/rows/value: only in one of them"),
        ({"checks": [{"value": 2e-16, "limit": 1e-9, "ok": False}]}, "/checks/ok: differs by 1.0e+00 of the largest"),
    ],
)
def test_a_planted_difference_is_seen(change: dict[str, object], said: str) -> None:
    assert differences(DATA | change, DATA) == [said]


def test_the_tests_that_it_runs_are_there() -> None:
    assert [each for each in TESTS if not (ROOT / each).exists()] == []


def test_the_oldest_are_the_lower_bounds_of_what_users_install() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = [oldest(each) for each in requirements(project)]
    assert all(each.count("==") == 1 and ">" not in each for each in found)
    assert {each.partition("==")[0] for each in found} >= {"casadi", "numpy", "scipy", "zarr", "python-flint"}
