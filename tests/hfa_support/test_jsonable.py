"""Conversion of values to JSON, with each innermost list or object on one line."""

from __future__ import annotations

import json

import numpy as np

from hfa_support.reporting.data_files import json_text, jsonable


def test_each_row_is_one_line() -> None:
    """Each row of a matrix and each entry of a list of objects is written on one line."""
    value = {
        "schema": "x",
        "A": np.eye(2),
        "rows": [{"n": 1, "of": "x\n  y"}, {"n": 2, "of": np.nan}],
    }
    assert json_text(value) == (
        '{\n "schema": "x",\n "A": [\n  [ 1.0, 0.0 ],\n  [ 0.0, 1.0 ]\n ],\n "rows": [\n'
        '  { "n": 1, "of": "x\\n  y" },\n  { "n": 2, "of": null }\n ]\n}\n'
    )


def test_numpy_numbers_become_python_numbers() -> None:
    """NumPy numbers of every width become Python numbers. Infinity becomes None."""
    kinds = (np.float16, np.float32, np.longdouble, np.int8, np.uint64)
    converted = jsonable(
        [[kind(3), np.array([kind(3)])] for kind in kinds] + [np.longdouble("inf"), np.bool_(True)]
    )
    assert converted == [*[[3, [3]] for _ in kinds], None, True]
    assert {type(number) for number, _ in converted[:5]} == {float, int}


def test_numbers_that_are_not_finite_become_none() -> None:
    """A number that is not finite becomes None, even inside nested values."""
    assert jsonable({"a": (np.float64(np.inf), np.int64(3), True, None, "x")}) == {
        "a": [None, 3, True, None, "x"]
    }


def test_brackets_in_a_text_change_no_value() -> None:
    """Brackets and line breaks inside texts are unchanged by the compact layout."""
    value = {"]{": ["[", "\n }", "\ud800"], "[": {"a": ["}\n ]", {"b": "[\n  {"}]}}
    assert json.loads(json_text(value)) == value
