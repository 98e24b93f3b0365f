"""C code of CasADi Functions: no warnings of a compiler, whatever a Function uses."""

import casadi as ca
import pytest
from c_files import compiled, needs_gcc

from hfa_support.native.c_code import c_function

x, xx = ca.SX.sym("x", 2), ca.SX.sym("xx")


@needs_gcc
@pytest.mark.parametrize("result", [2.0 * xx, ca.SX(0, 1)], ids=["x unused", "empty"])
def test_unused_arguments_and_empty_results_compile_without_warnings(result, tmp_path):
    function = c_function(ca.Function("f", [x, xx], [result]), "f", ("x", "xx"), ("y",))
    caller = "void g(const double *x, double *y);\nvoid g(const double *x, double *y)"
    text = f"{function}{caller} {{ f(x, x, y); }}\n"
    (tmp_path / "f.c").write_text(text, encoding="utf-8")
    compiled(tmp_path, "-c", "f.c")
