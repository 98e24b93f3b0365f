"""Signals that are known at every time: the same one at a time, at many, and as an expression."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.policy.signals import Harmonic, Signal


def test_a_signal_is_the_same_at_one_time_at_many_and_as_an_expression() -> None:
    rng = np.random.default_rng(2)
    constant, slope, sine, cosine = rng.normal(size=(4, 3))
    signal = Signal(constant, slope, (Harmonic(1.3, sine, cosine), Harmonic(0.2, cosine, -sine)))
    times, t = np.array([0.0, 0.7, 5.0]), ca.SX.sym("t")
    one = signal.sampled(times)
    compiled = ca.Function("s", [t], [signal.at(t)])
    for row, time in zip(one, times.tolist(), strict=True):
        first = sine * np.sin(1.3 * time) + cosine * np.cos(1.3 * time)
        second = cosine * np.sin(0.2 * time) - sine * np.cos(0.2 * time)
        np.testing.assert_allclose(row, constant + slope * time + first + second, rtol=1e-12)
        np.testing.assert_allclose(signal.at(time), row, rtol=1e-12)
        np.testing.assert_allclose(np.array(compiled(time)).ravel(), row, rtol=1e-12)
