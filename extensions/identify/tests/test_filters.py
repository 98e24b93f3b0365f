"""Steady-state filters and rotating air, compared with SciPy and with the equations by hand."""

from __future__ import annotations

import numpy as np
import pytest
from project import ROOT
from scipy.linalg import expm, solve_discrete_are

import hfa
from hfa_identify.filter_gain import gain_with_slopes
from hfa_identify.rotating_air import LAG, in_rotating_air

DT = 0.05


def matrices(theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return an oscillator of frequency a with noise b, of which position and rate are measured."""
    a, b = theta.T
    count = len(theta)
    A = np.zeros((count, 2, 2))
    A[:, 0, 1] = 1.0
    A[:, 1, 0] = -(a**2)
    A[:, 1, 1] = -0.4
    C = np.tile([[1.0, 0.0], [0.5, 2.0]], (count, 1, 1))
    W = np.zeros((count, 2, 2))
    W[:, 1, 1] = b
    W[:, 0, 0] = 0.1 * b
    R = np.column_stack([0.02 * np.ones(count), 0.3 * b])
    return A, C, W, R


def known(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K and the covariance of the innovations by SciPy."""
    A, C, W, R = (each[0] for each in matrices(theta[None]))
    both = expm(np.block([[-A, W], [np.zeros((2, 2)), A.T]]) * DT)
    Phi = both[2:, 2:].T
    P = solve_discrete_are(Phi.T, C.T, Phi @ both[:2, 2:], np.diag(R))
    S = C @ P @ C.T + np.diag(R)
    return P @ C.T @ np.linalg.inv(S), S


def test_the_steady_gain_is_that_of_the_riccati_equation() -> None:
    """T D T' are the innovations with T of unit diagonal; slopes agree with differences."""
    theta = np.array([3.0, 0.5])
    gain, slopes = gain_with_slopes(matrices, theta, np.ones(2), DT)
    K, S = known(theta)
    np.testing.assert_allclose(gain.K, K, rtol=1e-6)
    T = np.linalg.inv(gain.whiten)
    np.testing.assert_allclose(np.diag(T), 1.0)
    assert T[0, 1] == 0.0
    np.testing.assert_allclose(T @ np.diag(gain.variances) @ T.T, S, rtol=1e-6)
    for column in range(2):
        step = 1e-4 * np.eye(2)[column]
        above, below = (
            gain_with_slopes(matrices, theta + s, np.ones(2), DT)[0] for s in (step, -step)
        )
        for name, change in (
            ("K", above.K - below.K),
            ("whiten", above.whiten - below.whiten),
            ("logarithms", np.log(above.variances / below.variances)),
        ):
            found = getattr(slopes, name)[..., column]
            np.testing.assert_allclose(found, change / 2e-4, rtol=1e-3, atol=1e-6, err_msg=name)


def test_a_gain_that_is_no_number_is_refused() -> None:
    with pytest.raises(FloatingPointError, match="the filter gain is not finite"):
        gain_with_slopes(matrices, np.array([np.nan, 0.5]), np.ones(2), DT)
    with pytest.raises(FloatingPointError, match="the filter gain is not finite"):
        gain_with_slopes(matrices, np.array([3.0, -0.5]), np.ones(2), DT)


def test_air_that_rotates_adds_its_rate_to_the_aircrafts() -> None:
    """z' = -z / tau of each axis, 3/4 of tau in yaw; p + z_p', q - z_q' and r + z_r' act.

    Forces are those of air that does not rotate.
    """
    model = hfa.load_model(str(ROOT / "examples" / "uav.toml"))
    turning = in_rotating_air(model)
    assert list(turning.states)[-3:] == ["gust_roll", "gust_pitch", "gust_yaw"]
    tau = 0.2
    given = turning.with_parameters(**{LAG: np.log(tau)})
    x = [33.0, 0.05, 0.03, 0.1, -0.2, 0.15, 0.3, 0.1, 0.0, 100.0]
    u = [20.0, -0.05, 0.02, 0.01]
    z = np.array([0.01, -0.02, 0.03])
    found = given.rates_at([*x, *z], u)
    rates = -z / (tau * np.array([1.0, 1.0, 0.75]))
    np.testing.assert_allclose([found[name] for name in list(turning.states)[-3:]], rates)
    seen = np.array(x)
    seen[3:6] -= np.array([1.0, -1.0, 1.0]) * rates
    still, turned = model.rates_at(x, u), model.rates_at(seen.tolist(), u)
    for name in model.states:
        expected = turned if name in ("roll_rate", "pitch_rate", "yaw_rate") else still
        assert found[name] == pytest.approx(expected[name], rel=1e-12), name
    assert turned["pitch_rate"] != pytest.approx(still["pitch_rate"], rel=1e-3)
