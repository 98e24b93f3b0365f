"""Lags of the lift of the unsteady dynamics, compared with the functions of Theodorsen and Sears."""

import numpy as np
import pytest
from scipy.special import hankel2, j0, j1

from hfa_model.unsteady import KUESSNER, WAGNER

#: Reduced frequencies.
K = np.linspace(0.05, 2.0, 400)
THEODORSEN = hankel2(1, K) / (hankel2(1, K) + 1j * hankel2(0, K))
#: With the phase of the gust referred to the leading edge.
SEARS = ((j0(K) - 1j * j1(K)) * THEODORSEN + 1j * j1(K)) * np.exp(-1j * K)


@pytest.mark.parametrize(
    ("lag", "exact", "largest_error"), [(WAGNER, THEODORSEN, 0.0144), (KUESSNER, SEARS, 0.1173)]
)
def test_lags_approximate_theodorsen_and_sears(lag, exact, largest_error):
    """The largest error of two lags, relative to the steady lift, is 1.4 % for motion, by Theodorsen's
    function of an oscillation, and 12 % for gusts, by Sears's function.

    Another share or rate would change the errors.
    """
    response = 1 - sum(
        A * 1j * K / (1j * K + b) for A, b in zip(lag.shares, lag.rates, strict=True)
    )
    assert np.abs(response - exact).max() == pytest.approx(largest_error, rel=0.01)
