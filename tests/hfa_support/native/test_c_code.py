"""C code of CasADi Functions: no warnings of a compiler, whatever a Function uses."""

from itertools import product

import casadi as ca
import numpy as np
from c_files import called, needs_gcc, written

from hfa_support.native.c_code import c_function
from hfa_support.native.row_code import RowCode, row_code

x, xx = ca.SX.sym("x", 2), ca.SX.sym("xx")


def comparisons(a, b):
    """Return operations that are special where operands are equal, 0 or of opposite signs."""
    return ca.vertcat(
        a < b, a <= b, a > b, a >= b, ca.eq(a, b), ca.ne(a, b), ca.sign(a), ca.logic_not(a),
        ca.logic_and(a, b), ca.logic_or(a, b), ca.if_else(a, b, -1.0), ca.fmin(a, b), ca.fmax(a, b),
        ca.floor(a), ca.ceil(a), ca.fabs(a), ca.copysign(a, b), ca.atan2(a, b), ca.hypot(a, b),
    )  # fmt: skip


@needs_gcc
def test_comparisons_are_those_of_casadi(tmp_path):
    """`comparisons` of operands that are equal, 0 or of opposite signs have the results of CasADi,
    in plain C and in the machine code for one row and for many rows at once.
    """
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    function = ca.Function("compare", [a, b], [comparisons(a, b)])
    values = (-2.5, -0.5, 0.0, 0.5, 2.5)
    pairs = np.array([*product(values, values)])
    expected = [np.asarray(function(*pair)).ravel() for pair in pairs]

    for one_row in (True, False):
        compiled = row_code(function, one_row)
        assert isinstance(compiled, RowCode)
        (found,) = compiled(pairs[:, :1], pairs[:, 1:])
        np.testing.assert_allclose(found, expected, rtol=1e-15)

    text = "#include <math.h>\n" + c_function(function, "compare", ("a", "b"), ("y",))
    caller = "int g(const double *a, const double *b, double *y)"
    text += f"{caller};\n{caller} {{ compare(a, b, y); return 0; }}\n"
    folder = written(tmp_path, {"f.c": text}, "f.c")
    for pair, results in zip(pairs, expected, strict=True):
        y = np.zeros(results.size)
        called(folder, "g", pair[:1], pair[1:], y)
        np.testing.assert_allclose(y, results, rtol=1e-15)
