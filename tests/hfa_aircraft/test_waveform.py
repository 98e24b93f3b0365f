"""Waveforms: values, sums, rates and matrices against their formula."""

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa import BadInputError

PLANT = hfa.LinearModel.of(-np.eye(2), np.eye(2))
SOLUTION = hfa.solve(hfa.Game(PLANT.A, PLANT.B, Q=np.eye(2), R=np.eye(2)))
TIMES = np.linspace(0.0, 5.0, 23)


def commanded(**texts):
    """Return the waveform (x1, x2) that texts describe, as the reference of a command to track.

    The plant x' = -x + u can follow every signal, so its reference is the command itself.
    """
    return hfa.track(PLANT, SOLUTION, texts).exact.reference


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-.5", lambda t: -0.5 + 0.0 * t),
        ("1 - 0.01t", lambda t: 1.0 - 0.01 * t),
        ("-cos(t) + 3*cos(2*t)", lambda t: -np.cos(t) + 3.0 * np.cos(2.0 * t)),
        ("1e-1+2t-3sin(.2t)", lambda t: 0.1 + 2.0 * t - 3.0 * np.sin(0.2 * t)),
    ],
)
def test_a_typed_signal_and_its_rate_equal_their_formula(text, value):
    """The signal, its expression and its rate are those of the formula."""
    wave = commanded(x1=text)
    np.testing.assert_allclose(wave.sampled(TIMES)[:, 0], value(TIMES), atol=1e-12)
    t = ca.SX.sym("t")
    function = ca.Function("s", [t], [wave.at(t)[0]])
    assert [float(function(each)) for each in TIMES] == pytest.approx(value(TIMES))
    slope = (value(TIMES + 1e-6) - value(TIMES - 1e-6)) / 2e-6
    np.testing.assert_allclose(wave.rate().sampled(TIMES)[:, 0], slope, atol=1e-7)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("7 8", "' 8' is no term"),
        ("1+", r"'\+' is no term"),
        ("sin(t)cos(t)", r"'cos\(t\)' is no term"),
    ],
)
def test_a_text_that_is_no_sum_of_terms_is_refused(text, says):
    """Only sums of numbers, ramps, sines and cosines are signals."""
    with pytest.raises(BadInputError, match=says):
        commanded(x1=text)
