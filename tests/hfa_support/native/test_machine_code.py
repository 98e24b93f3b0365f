"""Machine code: the same results without a working compiler, and a note."""

import math

import casadi as ca
import pytest

from hfa_support.native.row_code import machine_code


def without_library(*_):
    raise RuntimeError


@pytest.mark.parametrize(
    ("place", "replacement", "noted"),
    [
        ("hfa_support.native.row_code.c_compiler", lambda: "false", "cannot compile"),
        ("casadi.external", without_library, "RuntimeError"),  # no text: its class is printed
    ],
)
def test_a_function_is_evaluated_without_machine_code(
    place, replacement, noted, tmp_path, monkeypatch, capsys
):
    """If the compiler fails, or if the compiled library cannot be loaded, CasADi evaluates the
    function, the reason is printed, and no file remains in the cache.

    place: name of the function that finds the compiler or loads the library
    replacement: function in its place, a compiler `false` that fails or one that raises an error
    """
    monkeypatch.setattr(place, replacement)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    function = machine_code(ca.Function("f", [x], [ca.sin(x)]))
    assert float(function(0.5)) == pytest.approx(math.sin(0.5), rel=1e-15)
    assert noted in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
