"""Interpolation in tables with one to four arguments compared with SciPy."""

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from hfa_aircraft.rigid.tables import Interpolator


@pytest.mark.parametrize("shape", [(2,), (7,), (3, 5), (4, 2, 3), (2, 3, 2, 4)])
def test_tables_equal_scipys_linear_interpolation(shape):
    """Values agree with SciPy's linear interpolation, and slopes with central differences."""
    rng = np.random.default_rng(5)
    breakpoints = [np.sort(rng.uniform(-1.0, 1.0, count)) for count in shape]
    values = rng.normal(size=shape)
    symbols = ca.SX.sym("x", len(shape))
    expression = Interpolator()(values, breakpoints, ca.vertsplit(symbols))
    function = ca.Function("f", [symbols], [expression, ca.jacobian(expression, symbols)])
    reference = RegularGridInterpolator(breakpoints, values)
    for point in rng.uniform(-1.5, 1.5, (40, len(shape))):
        inside = [np.clip(x, b[0], b[-1]) for x, b in zip(point, breakpoints, strict=True)]
        value, slope = function(point)
        assert float(value) == pytest.approx(float(reference(inside)[0]), abs=1e-13)
        step = 1e-7
        ahead, behind = (float(function(point + side * step)[0]) for side in (1.0, -1.0))
        assert float(ca.sum2(slope)) == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-4)


def test_tables_with_equal_breakpoints_share_the_search():
    """Two tables with the same breakpoints share the search for the cell."""
    x = ca.SX.sym("x")
    interpolate = Interpolator()
    points = np.arange(5.0)
    first = interpolate(points**2, [points], [x])
    single = ca.Function("f", [x], [first]).n_instructions()
    both = ca.Function("f", [x], [first, interpolate(points**3, [points], [x])]).n_instructions()
    assert both < 2 * single - 10
