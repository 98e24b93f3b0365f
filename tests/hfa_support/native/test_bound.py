"""Functions of many rows, of one thread and of several."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from hfa_support.native.bound import RowFunction


class _Recorded(ca.Callback):
    """CasADi Function x -> 1/x in Python, which stores the arguments of its evaluations in `seen`.

    meanwhile: function that is called within the first evaluation
    """

    def __init__(self, meanwhile=lambda: None):
        ca.Callback.__init__(self)
        self.seen = []
        self.meanwhile = meanwhile
        self.construct("recorded", {})

    def eval(self, arguments):
        self.seen.append(float(arguments[0]))
        if len(self.seen) == 1:
            self.meanwhile()
        return [1.0 / arguments[0]]


@pytest.mark.parametrize("counts", [(1,), (5, 16, 37), (300, 1800, 7)])
def test_any_number_of_rows_has_the_results_of_its_arguments(counts):
    """Each row has the results of its own arguments, in several calls with these counts of rows.

    Rows are evaluated in blocks of 1, 16 or 250, and these counts leave some blocks partly filled.
    Blocks are built by another method (`by_columns`) when the sum of the counts reaches 2000.
    """
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    rows = RowFunction(ca.Function("f", [x, y], [ca.vertcat(x[0] - x[1], y * x[1]), y**2]))
    for count in counts:
        X, Y = np.random.default_rng(count).uniform(1.0, 2.0, (2, count, 2))
        first, second = rows(X, Y[:, :1])
        expected = np.column_stack([X[:, 0] - X[:, 1], Y[:, 0] * X[:, 1]])
        np.testing.assert_allclose(first, expected, rtol=1e-14)
        np.testing.assert_allclose(second, Y[:, :1] ** 2, rtol=1e-14)


def test_threads_have_their_own_memory():
    """If another thread calls a RowFunction at -x while a thread evaluates it at x, the results of
    the latter are those at x.
    """
    X = np.arange(1.0, 17.0)[:, None]
    with ThreadPoolExecutor(1) as other:
        recorded = _Recorded(lambda: other.submit(rows, -X).result())
        rows = RowFunction(recorded)
        (found,) = rows(X)
    np.testing.assert_allclose(found, 1.0 / X)
