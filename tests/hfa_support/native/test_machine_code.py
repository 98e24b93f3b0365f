"""Machine code: the same results without a working compiler, and a note."""

import math

import casadi as ca
import pytest

from hfa_support.native.row_code import machine_code


def broken(*_):
    raise RuntimeError


@pytest.mark.parametrize(
    ("place", "replacement", "noted"),
    [
        ("hfa_support.native.row_code.c_compiler", lambda: "false", "cannot compile"),
        ("casadi.external", broken, "RuntimeError"),  # an error without a text
    ],
)
def test_a_function_is_evaluated_without_machine_code(
    place, replacement, noted, tmp_path, monkeypatch, capsys
):
    """With a compiler that fails, and a library that cannot be loaded, CasADi evaluates the
    function, the reason is printed, and no file remains.

    place, replacement: object of the project or of CasADi, and what replaces it
    """
    monkeypatch.setattr(place, replacement)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    function = machine_code(ca.Function("f", [x], [ca.sin(x)]))
    assert float(function(0.5)) == pytest.approx(math.sin(0.5), rel=1e-15)
    assert noted in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
