"""Gusts: the 1-cosine gust has its length and its peak, and turbulence has the right statistics."""

from __future__ import annotations

import numpy as np
import pytest
from random_points import random_points, rates, rising

from controller import Dryden, FlownLaw, OneMinusCosine, Scenario
from controller.flight.closed_loop import ClosedLoop, LinearPlant
from controller.flight.gusts import UPDRAFT
from controller.flight.simulation import CompiledLoop
from controller.policy.policies import OpenLoop
from hfa_model import VARIANTS, Input, Parameters, State
from hfa_model.variants import Variant


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_no_gust_changes_no_bit(parameters: Parameters, variant: Variant) -> None:
    for x, u in zip(*random_points(50, seed=1), strict=True):
        state, control = State(*x.tolist()), Input(*u.tolist())
        still = rates(state, control, parameters, variant)
        assert rates(state, control, parameters, variant, rising(0.0)) == still
        # A gust of 0 that is not known to be 0 goes the other way to the airspeed, and arrives at the same.
        np.testing.assert_allclose(
            rates(state, control, parameters, variant, rising(np.float64(0.0))), still, rtol=1e-13, atol=1e-13
        )


# The 1-cosine gust.


def test_one_minus_cosine_has_its_length_and_its_peak() -> None:
    gust = OneMinusCosine(length=400.0, peak=-10.0, speed=80.0, begin=2.0)
    times = np.linspace(0.0, 10.0, 1001)
    values = np.array([float(gust.updraft(t, None, None)) for t in times])
    assert values.min() == pytest.approx(-10.0)
    assert times[np.argmin(values)] == pytest.approx(2.0 + 400.0 / 80.0 / 2)
    assert np.all(values[(times <= 2.0) | (times >= 7.0)] == 0.0)
    assert np.all(values[(times > 2.01) & (times < 6.99)] < 0.0)
    assert values.sum() * 0.01 == pytest.approx(-10.0 * 5.0 / 2, rel=1e-6)


def sampled(gust: Dryden, interval: float, ticks: int) -> np.ndarray:
    """w at the ticks of a flight, by the integrator of the loop."""
    plant = LinearPlant(np.zeros((1, 1)), np.zeros((1, 1)), {UPDRAFT: np.zeros(1)})
    scenario = Scenario(ticks * interval, interval / 5, interval, np.zeros(1), gust=gust)
    loop = ClosedLoop(plant, FlownLaw("none", OpenLoop(1), np.zeros((1, 1))), scenario)
    return np.asarray(CompiledLoop(loop).fly().updrafts[::5])


def turbulence(interval: float, ticks: int, seed: int = 0) -> Dryden:
    return Dryden(intensity=5.0, scale=34.0, speed=68.0, interval=interval, ticks=ticks, seed=seed)


def test_turbulence_has_the_variance_that_was_asked_for_at_long_ticks_too() -> None:
    """Some 4,000 independent samples: the standard error of the variance is 2 percent."""
    gust = turbulence(0.5, 10_000)
    w = sampled(gust, 0.5, 10_000)
    assert np.var(w) == pytest.approx(gust.intensity**2, rel=0.08)
    assert abs(w.mean()) < 5 * gust.intensity / np.sqrt(4000)


def test_turbulence_has_the_dryden_spectrum() -> None:
    from scipy.signal import welch

    gust = turbulence(0.05, 160_000)
    frequencies, found = welch(sampled(gust, 0.05, gust.ticks), fs=20.0, nperseg=4096)
    reduced = gust.scale * 2 * np.pi * frequencies / gust.speed
    # One-sided in Hz: Φ(Ω) dΩ with Ω = 2π f / V. A first-order lag of the same variance and scale: the test can tell.
    dryden = gust.intensity**2 * 2 * gust.scale / gust.speed * (1 + 3 * reduced**2) / (1 + reduced**2) ** 2
    lag = gust.intensity**2 * 4 * gust.scale / gust.speed / (1 + reduced**2)
    for low, high in ((0.02, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, 2.0)):
        band = (frequencies >= low) & (frequencies < high)
        assert found[band].mean() == pytest.approx(dryden[band].mean(), rel=0.12)
        assert found[band].mean() != pytest.approx(lag[band].mean(), rel=0.12)


def test_turbulence_begins_stationary() -> None:
    gusts = [turbulence(0.05, 1, seed) for seed in range(400)]
    output = [float(gust.updraft(0.0, gust.start(), None)) for gust in gusts]
    assert np.std(output) == pytest.approx(5.0, rel=0.15)
