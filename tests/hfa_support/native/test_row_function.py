"""CasADi Functions of many rows, compiled or by columns: the numbers of single rows."""

from __future__ import annotations

import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support.native import machine_code as generated
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import RowCode, row_code

needs_compiler = pytest.mark.skipif(
    generated.c_compiler() is None, reason="no C compiler on this machine"
)
_SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, np.inf, -np.inf, np.nan)


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def of_every_operation() -> ca.Function:
    """Return a Function of two numbers with elementary functions, arithmetic and logic."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    of_one = [ca.sqrt, ca.exp, ca.log, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.tanh]
    of_one += [ca.fabs, ca.floor, ca.ceil, ca.sign, ca.logic_not]
    of_two = [ca.atan2, ca.fmin, ca.fmax]
    of_one += [ca.log1p, ca.expm1, ca.erf, ca.sinh, ca.cosh, ca.asinh, ca.acosh, ca.atanh]
    of_two += [ca.hypot, ca.fmod, ca.copysign, ca.remainder]
    entries = [operation(a) for operation in of_one] + [operation(a, b) for operation in of_two]
    entries += [a + b, a - b, a * b, a / b, -a, 1 / a, 2 * a, a**b, a**2, a**2.5, 0.1 - a]
    entries += [a < b, a <= b, a == b, a != b, ca.logic_and(a, b), ca.logic_or(a, b)]
    entries += [ca.if_else(a < b, a, 7 * b), ca.SX(1.5)]
    return ca.Function("operations", [a, b], [ca.densify(ca.vertcat(*entries)), a])


@pytest.mark.parametrize("way", ["by columns", pytest.param("compiled", marks=needs_compiler)])
def test_every_operation_has_the_numbers_of_casadi(way: str) -> None:
    """Rows equal CasADi's single evaluations: by columns bit for bit with signs, compiled to 1e-15.

    Special values, an incomplete last block, few rows and a pickled copy are included.
    """
    function = of_every_operation()
    pairs = [(a, b) for a in _SPECIAL for b in _SPECIAL]
    pairs += np.random.default_rng(0).normal(0.0, 3.0, (2000, 2)).tolist()
    tables = [np.array(column)[:, None] for column in zip(*pairs, strict=True)]
    singly = [function.call([ca.DM(row) for row in each]) for each in zip(*tables, strict=True)]
    rows = pickle.loads(pickle.dumps(RowFunction(function)))
    if way == "compiled":
        rows = row_code(function)
        assert isinstance(rows, RowCode)
    for count in (20, len(pairs)):
        found = rows(*(table[:count] for table in tables))[0]
        wanted = np.array([np.array(entry[0]).ravel() for entry in singly[:count]])
        np.testing.assert_allclose(found, wanted, rtol=1e-15 if way == "compiled" else 0.0)
        numbers = ~np.isnan(wanted)
        if way == "by columns":
            np.testing.assert_array_equal(np.signbit(found)[numbers], np.signbit(wanted)[numbers])


def test_columns_support_matrices_constants_and_empty_arguments() -> None:
    """Evaluation by columns supports matrices, constant results and empty arguments."""
    x, nothing = ca.SX.sym("x", 2, 3), ca.SX.sym("nothing", 0)
    function = ca.Function("matrix", [x, nothing], [x.T, ca.DM([[1.0, 2.0]]), ca.SX(0, 1)])
    table = np.random.default_rng(0).normal(size=(2101, 6))
    found = RowFunction(function)(table, np.empty((2101, 0)))
    np.testing.assert_array_equal(found[0], table[:, [0, 2, 4, 1, 3, 5]])
    np.testing.assert_array_equal(found[1], np.tile([1.0, 2.0], (2101, 1)))
    assert found[2].shape == (2101, 0)


@needs_compiler
@pytest.mark.parametrize("count", [0, 1, 17])
def test_compiled_code_supports_rows_and_nested_functions(count: int) -> None:
    """Compiled code evaluates any number of rows, and functions may call other functions."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    inner = ca.Function("inner", [ca.vertcat(x, p)], [x[::-1] * p], {"never_inline": True})
    X, P, nothing = ca.MX.sym("x", 2), ca.MX.sym("p"), ca.MX.sym("nothing", 0)
    twice = inner(ca.vertcat(inner(ca.vertcat(X, P)), P + 1.0))
    code = row_code(ca.Function("twice", [X, P, nothing], [twice, P]))
    assert isinstance(code, RowCode)
    random = np.random.default_rng(count)
    rows, numbers = random.normal(size=(count, 2)), random.normal(size=(count, 1))
    after, same = code(rows, numbers, np.zeros((count, 0)))
    np.testing.assert_allclose(after, rows * numbers * (numbers + 1.0), rtol=1e-15)
    np.testing.assert_array_equal(same, numbers)
    with pytest.raises(ValueError, match="a table has the shape"):
        code(rows, rows, np.zeros((count, 0)))


@needs_compiler
def test_unsupported_operations_are_evaluated_by_casadi() -> None:
    """A function with an operation that the generated code lacks is evaluated by CasADi."""
    x = ca.SX.sym("x")
    code = row_code(ca.Function("error", [x], [ca.erfinv(x)]))
    assert isinstance(code, RowFunction)
    assert code([[0.5]])[0][0, 0] == pytest.approx(0.4769362762044699, rel=1e-9)
