"""Sampled loop, margins and cost, compared with python-control and SciPy."""

import math
import warnings

import casadi as ca
import control
import numpy as np
import pytest
from policy_cases import GTM, Q, R, gtm_deployment, model_of
from scipy.signal import cont2discrete

import hfa
from hfa import assess

DT = 0.02


@pytest.fixture(scope="module")
def gtm_lqr():
    """Return the assessment of the GTM's LQR at 45 m/s, its linear model, and the gain."""
    model = model_of(GTM)
    point = hfa.trim(model, at=45.0)
    linear = hfa.linearize(model, point)
    K = hfa.solve(hfa.game(linear, Q=Q, R=R)).K
    o = ca.SX.sym("o", 4)
    gain = {"file": ca.Function("gain", [o], [-ca.DM(K) @ o])}
    deployment = gtm_deployment(gain, cost={"Q": Q, "R": R})
    (found,) = assess(model, deployment, [point], samples=0).points
    np.testing.assert_allclose(found.equilibrium.K, K, rtol=1e-10)
    return found, linear, K


def zero_order_hold(A, B, dt):
    """Return A and B of a sample with held inputs, by SciPy."""
    Phi, Gamma, *_ = cont2discrete((A, B, np.eye(len(A)), 0.0 * B), dt)
    return Phi, Gamma


def test_margins_equal_python_control(gtm_lqr):
    """Gain, phase and disk margins agree with python-control."""
    assessed, linear, K = gtm_lqr
    found = assessed.margins
    Phi, Gamma = zero_order_hold(linear.A, linear.B, DT)
    grid = np.geomspace(1e-3, math.pi / DT, 4000)
    for loop in range(2):
        other = 1 - loop
        closed = Phi - Gamma[:, [other]] @ K[[other]]
        single = control.ss(closed, Gamma[:, [loop]], K[[loop]], 0, DT)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            gain, phase, *_ = control.stability_margins(single)
        if math.isfinite(gain):  # at half the sampling rate, python-control finds no margin
            assert found.inputs[loop].gain_high == pytest.approx(gain, rel=1e-9)
        assert found.inputs[loop].phase == pytest.approx(phase, rel=1e-9)
        disk = control.disk_margins(single, grid)[0]
        assert found.inputs[loop].disk == pytest.approx(disk, rel=1e-5)
    both = control.ss(Phi, Gamma, K, 0, DT)
    disk = control.disk_margins(both, np.geomspace(0.1, math.pi / DT, 300))[0]
    assert found.disk.disk <= disk * (1.0 + 1e-9)
    assert found.disk.disk == pytest.approx(disk, rel=1e-3)
