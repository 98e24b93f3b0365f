"""Written JSON: a row of a table a line, the same values."""

from __future__ import annotations

import numpy as np

from hfa_support.jsonable import jsonable, records_text


def test_a_table_has_one_row_a_line() -> None:
    value = {"schema": "x", "A": np.eye(2), "rows": [{"n": 1, "of": {"a": [1.0, np.nan]}}, {"n": 2, "of": {}}]}
    assert records_text(value) == (
        '{\n "schema": "x",\n "A": [[1.0, 0.0], [0.0, 1.0]],\n "rows": [\n'
        '  {"n": 1, "of": {"a": [1.0, null]}},\n  {"n": 2, "of": {}}\n ]\n}\n'
    )


def test_numbers_of_every_width_are_numbers() -> None:
    kinds = (np.float16, np.float32, np.longdouble, np.int8, np.uint64)
    found = jsonable([[kind(3), np.array([kind(3)])] for kind in kinds] + [np.longdouble("inf"), np.bool_(True)])
    assert found == [*[[3, [3]]] * len(kinds), None, True]
    assert {type(number) for number, _ in found[:5]} == {float, int}


def test_what_is_not_finite_is_null() -> None:
    assert jsonable({"a": (np.float64(np.inf), np.int64(3), True, None, "x")}) == {"a": [None, 3, True, None, "x"]}
