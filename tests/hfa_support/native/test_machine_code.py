"""Machine code: the same results without a working compiler, and a note."""

import math

import casadi as ca
import pytest

from hfa_support.native.row_code import machine_code


def test_a_function_is_evaluated_without_a_compiler(tmp_path, monkeypatch, capsys):
    """A compiler that fails is noted, CasADi evaluates the function, and no file remains."""
    monkeypatch.setattr("hfa_support.native.row_code.c_compiler", lambda: "false")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    function = machine_code(ca.Function("f", [x], [ca.sin(x)]))
    assert float(function(0.5)) == pytest.approx(math.sin(0.5), rel=1e-15)
    assert "cannot compile" in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_library_that_fails_without_a_reason_is_noted(tmp_path, monkeypatch, capsys):
    """An error without a text is noted by its kind, and CasADi evaluates the function."""

    def broken(*_):
        raise RuntimeError

    monkeypatch.setattr(ca, "external", broken)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    function = machine_code(ca.Function("f", [x], [ca.cos(x)]))
    assert float(function(0.5)) == pytest.approx(math.cos(0.5), rel=1e-15)
    assert "RuntimeError" in capsys.readouterr().err
