"""Sampled loop, margins and cost, compared with python-control and SciPy."""

import math
import warnings

import casadi as ca
import control
import numpy as np
import pytest
from policy_cases import GTM, Q, R, gtm_deployment, model_of
from scipy.signal import cont2discrete
from small_plants import oscillator

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


@pytest.fixture
def nothing(folder):
    """Return a policy at 2 Hz that moves nothing."""
    np.savez("K.npz", K=np.zeros((1, 2)))
    return hfa.Deployment({"file": "K.npz"}, {"x": {}, "v": {}}, {"force": {}}, {"dt": 0.5})


def test_limits_passed_between_two_samples_count(nothing):
    """The sample time of .5 s is half the period of the oscillator of 1 Hz, which passes x = -1 m only
    between samples. This departure is found.

    Speeds up to 9 m/s give amplitudes up to 9 / (2 pi) = 1.44 m, and 6 m/s only .96 m: no departure.
    """
    passed, kept = (
        assess(oscillator(high), nothing, samples=4, box={"x": 0.1, "v": fastest}).points[0]
        for high, fastest in ((9.0, 9.0), (1.0, 6.0))
    )
    left = passed.flights.departure
    assert (left.state, left.limit, kept.flights.departure) == ("x", -1.0, None)
    assert -1.44 <= left.value < -1.0
