"""Compiled functions that are evaluated for many rows of arguments at once."""

from __future__ import annotations

import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support.native import machine_code as generated
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import RowCode, row_code

pytestmark = pytest.mark.skipif(
    generated.c_compiler() is None, reason="no C compiler on this machine"
)
_SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, np.inf, -np.inf, np.nan)


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    generated._print_once.cache_clear()


def of_every_operation() -> ca.Function:
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    of_one = (
        *(ca.sqrt, ca.exp, ca.log, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.tanh),
        *(ca.fabs, ca.floor, ca.ceil, ca.sign, ca.logic_not),
    )
    entries = [operation(a) for operation in of_one]
    entries += [a + b, a - b, a * b, a / b, -a, 1 / a, 2 * a, a**b, a**2, a**2.5, ca.atan2(a, b)]
    entries += [ca.fmin(a, b), ca.fmax(a, b), a < b, a <= b, a == b, a != b]
    entries += [ca.logic_and(a, b), ca.logic_or(a, b), ca.if_else(a < b, a, 7 * b)]
    return ca.Function("operations", [a, b], [ca.vertcat(*entries)])


@pytest.mark.parametrize("one_row", [False, True])
def test_compiled_rows_equal_casadi_for_every_operation(one_row: bool) -> None:
    """Compiled code and CasADi agree for every operation, also at special values such as nan and
    infinity.
    """
    function = of_every_operation()
    random = np.random.default_rng(0)
    pairs = [(a, b) for a in _SPECIAL for b in _SPECIAL]
    pairs += random.normal(0.0, 3.0, (50, 2)).tolist()
    a, b = (np.array(column)[:, None] for column in zip(*pairs, strict=True))
    code = row_code(function, one_row)
    assert isinstance(code, RowCode)
    in_turn = pickle.loads(pickle.dumps(RowFunction(function)))
    np.testing.assert_allclose(code(a, b)[0], in_turn(a, b)[0], rtol=1e-15)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 17])
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


def test_a_table_of_another_width_is_refused() -> None:
    """A table with a wrong number of columns raises ValueError with the expected shape."""
    code = row_code(of_every_operation())
    with pytest.raises(ValueError, match=r"a table has the shape \(3, 2\), not \(3, 1\)"):
        code(np.zeros((3, 2)), np.zeros((3, 1)))


def test_unsupported_operations_are_evaluated_by_casadi() -> None:
    """A function with an operation that the generated code lacks is evaluated by CasADi."""
    x = ca.SX.sym("x")
    function = ca.Function("error", [x], [ca.erf(x)])
    code = row_code(function)
    assert isinstance(code, RowFunction)
    assert code([[0.5]])[0][0, 0] == pytest.approx(0.5204998778130465, rel=1e-15)


def test_without_a_compiler_casadi_is_used(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """Without a C compiler, the function is evaluated by CasADi and a note is printed."""
    # The compiler is searched once per process.
    monkeypatch.setattr(generated, "c_compiler", lambda: None)
    assert isinstance(row_code(of_every_operation()), RowFunction)
    assert "no C compiler found" in capsys.readouterr().err
