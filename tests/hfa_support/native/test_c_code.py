"""C code of CasADi Functions: no warnings of a compiler, whatever a Function uses."""

import casadi as ca
import numpy as np
import pytest
from c_files import called, needs_gcc, written

from hfa_support.native.c_code import c_function

x, xx = ca.SX.sym("x", 2), ca.SX.sym("xx")


@needs_gcc
@pytest.mark.parametrize(
    ("result", "computed"), [(2.0 * xx, 6.0), (ca.SX(0, 1), -1.0)], ids=["x unused", "empty"]
)
def test_unused_arguments_and_empty_results_compile_without_warnings(result, computed, tmp_path):
    """The compiled function computes 2 xx, and an empty result leaves the memory as it was."""
    function = c_function(ca.Function("f", [x, xx], [result]), "f", ("x", "xx"), ("y",))
    caller = "int g(const double *x, const double *xx, double *y)"
    text = f"{function}{caller};\n{caller} {{ f(x, xx, y); return 0; }}\n"
    y = np.array([-1.0])
    called(written(tmp_path, {"f.c": text}, "f.c"), "g", np.zeros(2), np.array([3.0]), y)
    assert y == [computed]
