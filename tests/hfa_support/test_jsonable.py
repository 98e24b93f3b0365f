"""Conversion of values to JSON, with each innermost list or object on one line."""

from __future__ import annotations

import numpy as np

from hfa_support.reporting.data_files import jsonable


def test_numpy_numbers_become_python_numbers() -> None:
    """NumPy numbers of every width become Python numbers. Infinity becomes None."""
    kinds = (np.float16, np.float32, np.longdouble, np.int8, np.uint64)
    converted = jsonable(
        [[kind(3), np.array([kind(3)])] for kind in kinds] + [np.longdouble("inf"), np.bool_(True)]
    )
    assert converted == [*[[3, [3]] for _ in kinds], None, True]
    assert {type(number) for number, _ in converted[:5]} == {float, int}
