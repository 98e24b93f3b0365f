"""Waveforms: values, sums, rates and matrices against their formula."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hfa import BadInputError
from hfa_aircraft.waveform import Harmonic, channel, stacked
from hfa_flight import Waveform

TIMES = np.linspace(0.0, 5.0, 23)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("7", lambda t: 7.0 + 0.0 * t),
        ("-.5", lambda t: -0.5 + 0.0 * t),
        ("t", lambda t: t),
        ("1 - 0.01t", lambda t: 1.0 - 0.01 * t),
        ("2sin(0.5t)", lambda t: 2.0 * np.sin(0.5 * t)),
        ("-cos(t) + 3*cos(2*t)", lambda t: -np.cos(t) + 3.0 * np.cos(2.0 * t)),
        ("1e-1+2t-3sin(.2t)", lambda t: 0.1 + 2.0 * t - 3.0 * np.sin(0.2 * t)),
    ],
)
def test_a_text_is_a_signal_with_its_rate(text: str, value) -> None:  # type: ignore[no-untyped-def]
    """The signal, its expression and its rate are those of the formula."""
    wave = channel(text)
    np.testing.assert_allclose(wave.sampled(TIMES)[:, 0], value(TIMES), atol=1e-12)
    t = ca.SX.sym("t")
    function = ca.Function("s", [t], [wave.at(t)])
    assert [float(function(each)) for each in TIMES] == pytest.approx(value(TIMES))
    slope = (value(TIMES + 1e-6) - value(TIMES - 1e-6)) / 2e-6
    np.testing.assert_allclose(wave.rate().sampled(TIMES)[:, 0], slope, atol=1e-7)
    assert wave.moving.tolist() == [bool(np.ptp(value(TIMES)) > 0.0)]
    assert wave.until == (np.inf if "(" in text else 0.0)


def test_sums_and_matrices_act_on_the_values() -> None:
    """A sum joins equal frequencies; M s(t) and the stack of channels have their values."""
    a, b = channel("1+2t+sin(t)"), channel("3-t+2sin(t)+cos(4t)")
    both = a + b
    assert len(both.harmonics) == 2
    np.testing.assert_allclose(both.sampled(TIMES), a.sampled(TIMES) + b.sampled(TIMES))
    two = stacked({"y": a, "x": b}, ("x", "z", "y"))
    expected = np.column_stack([b.sampled(TIMES), 0.0 * TIMES, a.sampled(TIMES)])
    np.testing.assert_allclose(two.sampled(TIMES), expected)
    M = np.array([[1.0, 2.0, -3.0], [0.5, 0.0, 4.0]])
    np.testing.assert_allclose(two.through(M).sampled(TIMES), expected @ M.T)


@pytest.mark.parametrize(
    "text", ["", " ", "7 8", "2x", "sin(t", "sin(x)", "--1", "1+", "sin(t)cos(t)"]
)
def test_another_text_is_refused(text: str) -> None:
    """Only sums of numbers, ramps, sines and cosines are signals."""
    with pytest.raises(BadInputError, match="signal"):
        channel(text)


def test_parts_of_a_waveform_have_equal_lengths_and_are_finite() -> None:
    """Each part of other length, and each entry that is not finite, is refused."""
    two, three = np.zeros(2), np.zeros(3)
    for parts in ((two, three, ()), (two, two, (Harmonic(1.0, two, three),)), (np.eye(2), two, ())):
        with pytest.raises(BadInputError, match="shapes"):
            Waveform(*parts)
    with pytest.raises(BadInputError, match="not finite"):
        Waveform(two, two, (Harmonic(1.0, two, np.array([0.0, np.nan])),))
