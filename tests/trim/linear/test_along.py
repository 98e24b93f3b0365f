"""Linear models along a flight, compared with the difference of two flights and python-control."""

from __future__ import annotations

from itertools import pairwise

import control
import numpy as np
import pytest
from own_models import F16, NAVION, trimmed
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hfa import BadInputError
from hfa_aircraft import to_control
from trim import models_along


@pytest.mark.slow
def test_small_deviations_follow_the_linear_model() -> None:
    """The difference of two Navion flights follows δx' = A(t) δx to second order.

    Both flights have the same step input and differ in the initial state. With A constant at its
    initial value, the error is more than twice as large.
    """
    point = trimmed(NAVION)
    u = np.array(point.inputs) + np.array([0.0, -0.05, 0.0, 0.05])
    function = NAVION.functions(())

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        return np.array(function(x, u, [])[0]).ravel()

    def simulated(x: np.ndarray) -> np.ndarray:
        times = np.linspace(0.0, 3.0, 121)
        return solve_ivp(rates, (0.0, 3.0), x, t_eval=times, rtol=1e-10, atol=1e-12).y.T

    states = simulated(np.array(point.states))
    start = np.array([1.0, 0.01, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
    along = models_along(NAVION, states, np.tile(u, (len(states), 1)))
    np.testing.assert_allclose(along.rates, [rates(0.0, x) for x in states], rtol=1e-12, atol=1e-12)

    def predicted(A: np.ndarray) -> np.ndarray:
        """Return δx(3 s) by matrix exponentials, with A at the middle of each time step.

        A: state matrices along the flight, (N, n, n)
        """
        deviation = start
        for before, after in pairwise(A):
            deviation = expm((before + after) / 2 * 3.0 / (len(A) - 1)) @ deviation
        return deviation

    sizes = np.array([signal.nominal for signal in NAVION.states.values()])
    errors = []
    for size in (1e-2, 1e-3):
        difference = (simulated(np.array(point.states) + size * start) - states)[-1] / size
        varying = predicted(along.A)
        frozen = predicted(along.A[:1].repeat(121, 0))
        errors.append(
            [np.abs((deviation - difference) / sizes).max() for deviation in (varying, frozen)]
        )
    (large, large_frozen), (small, _) = errors
    assert small < 0.2 * large < 0.1 * large_frozen


def test_a_linear_model_along_flight_equals_python_control() -> None:
    """The linear model at a state of a flight equals that of `control.linearize`.

    Wrong shapes are refused.
    """
    model = F16.with_parameters(xcg=0.3)
    x = np.array(trimmed(model).states) + 0.01
    u = np.array([0.2, -1.5, 0.5, 0.5])
    along = models_along(model, [x + 0.1, x], [u - 0.1, u])
    peer = control.linearize(to_control(model), x, u)
    np.testing.assert_allclose(along.A[1], peer.A, rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(along.B[1], peer.B, rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(along.rates[1], model.at(x, u).f)
    stopped = x * (np.arange(13) > 0)
    with pytest.raises(BadInputError, match="state 1 of the flight: F-16: "):
        models_along(model, [x, stopped, x], [u] * 3)
    with pytest.raises(BadInputError, match=r"give \(N, 13\) and \(N, 4\)"):
        models_along(model, x, u[:3])
