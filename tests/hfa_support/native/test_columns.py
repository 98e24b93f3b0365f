"""CasADi Functions of many rows: results by columns equal those of single rows bit by bit."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_support.native.bound import RowFunction

_SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, np.inf, -np.inf, np.nan)


def of_every_operation() -> ca.Function:
    """Return a Function of two numbers with elementary functions, arithmetic and logic."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    of_one = (
        *(ca.sqrt, ca.exp, ca.log, ca.log1p, ca.expm1, ca.erf, ca.fabs, ca.sign),
        *(ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.floor, ca.ceil),
        *(ca.sinh, ca.cosh, ca.tanh, ca.asinh, ca.acosh, ca.atanh, ca.logic_not),
    )
    of_two = (ca.atan2, ca.hypot, ca.fmod, ca.copysign, ca.fmin, ca.fmax, ca.remainder)
    entries = [operation(a) for operation in of_one]
    entries += [operation(a, b) for operation in of_two]
    entries += [a + b, a - b, a * b, a / b, -a, 1 / a, 2 * a, a**b, a**2, a**2.5, 0.1 - a]
    entries += [a < b, a <= b, a == b, a != b, ca.logic_and(a, b), ca.logic_or(a, b)]
    entries += [ca.if_else(a < b, a, 7 * b), ca.SX(1.5)]
    return ca.Function("operations", [a, b], [ca.densify(ca.vertcat(*entries)), a])


def one_by_one(function: ca.Function, *tables: np.ndarray) -> list[np.ndarray]:
    """Evaluate a Function for each row separately and return its results (N, entries)."""
    rows = [function.call([ca.DM(row) for row in each]) for each in zip(*tables, strict=True)]
    return [
        np.array([np.array(entry).ravel("F") for entry in side]) for side in zip(*rows, strict=True)
    ]


def test_every_operation_has_the_same_bits() -> None:
    """The operations of `of_every_operation` give equal numbers and signs by columns and by rows.

    Special values, an incomplete last block and a later call with a few rows are included.
    """
    function = of_every_operation()
    pairs = [(a, b) for a in _SPECIAL for b in _SPECIAL]
    pairs += np.random.default_rng(0).normal(0.0, 3.0, (2000, 2)).tolist()
    tables = [np.array(column)[:, None] for column in zip(*pairs, strict=True)]
    rows = RowFunction(function)
    expected = one_by_one(function, *tables)
    for found, wanted in zip(rows(*tables), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)
        numbers = ~np.isnan(wanted)
        np.testing.assert_array_equal(np.signbit(found)[numbers], np.signbit(wanted)[numbers])
    # A few rows, after many calls of the Function.
    few = [table[:20] for table in tables]
    np.testing.assert_array_equal(rows(*few)[0], expected[0][:20])


def test_columns_support_matrices_constants_and_empty_arguments() -> None:
    """Evaluation by columns supports matrices, constant results and empty arguments."""
    x, nothing = ca.SX.sym("x", 2, 3), ca.SX.sym("nothing", 0)
    function = ca.Function("matrix", [x, nothing], [x.T, ca.DM([[1.0, 2.0]]), ca.SX(0, 1)])
    table = np.random.default_rng(0).normal(size=(2101, 6))
    found = RowFunction(function)(table, np.empty((2101, 0)))
    np.testing.assert_array_equal(found[0], table[:, [0, 2, 4, 1, 3, 5]])
    np.testing.assert_array_equal(found[1], np.tile([1.0, 2.0], (2101, 1)))
    assert found[2].shape == (2101, 0)
