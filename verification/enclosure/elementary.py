"""Elementary functions with proved error bounds.

The bounds require only operations that IEEE 754 rounds correctly. The error of a function is at
most a constant of this module, or the bound that the function returns. Arguments outside the
stated range give nan. u = 2⁻⁵³.
"""

from __future__ import annotations

import numpy as np

#: Largest relative error of `exp`. The error of 16 terms of the Taylor series of exp(r), |r| <=
#: 5/8, is at most 5 u. Six squarings multiply it by 64 and add 6 u. The sum is below 4e-14.
EXP_ERROR = 1e-13
_LARGEST_EXP = 40.0
#: Largest error of `tanh`. The error of (1 - E) / (1 + E) is at most half that of E plus 3 u.
TANH_ERROR = 1e-13
#: Beyond it tanh is 1 within 1e-17.
_SATURATED = 20.0
#: Largest error of `sin_cos`. The error of 16 terms of the series, |r| <= 2, is at most 20 u. Each
#: of three doublings of the angle multiplies it by 4 and adds 4 u. The sum is below 1.6e-13.
SIN_ERROR = 1e-12
_LARGEST_ANGLE = 16.0
#: Relative error of a few roundings of a number.
ROUNDING = 1e-15


def exp(t: np.ndarray) -> np.ndarray:
    """Return e^t with a relative error of at most `EXP_ERROR`.

    The result is nan for |t| > 40.
    """
    r = t / 64.0
    value = np.ones_like(r)
    for k in range(16, 0, -1):
        value = 1.0 + r / k * value
    for _ in range(6):
        value = value * value
    return np.asarray(np.where(np.abs(t) <= _LARGEST_EXP, value, np.nan))


def tanh(t: np.ndarray) -> np.ndarray:
    """Return tanh t with an absolute error of at most `TANH_ERROR`."""
    power = exp(-2.0 * np.minimum(np.abs(t), _SATURATED))
    value = np.copysign((1.0 - power) / (1.0 + power), t)
    return np.asarray(np.where(np.isnan(t), np.nan, value))


def sin_cos(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sin t and cos t with absolute errors of at most `SIN_ERROR`.

    The results are nan for |t| > 16.
    """
    r = t / 8.0
    square = r * r
    sine = np.ones_like(r)
    cosine = np.ones_like(r)
    for k in range(16, 0, -1):
        sine = 1.0 - square / ((2 * k) * (2 * k + 1)) * sine
        cosine = 1.0 - square / ((2 * k - 1) * (2 * k)) * cosine
    sine = r * sine
    for _ in range(3):
        sine, cosine = 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
    within = np.abs(t) <= _LARGEST_ANGLE
    return np.where(within, sine, np.nan), np.where(within, cosine, np.nan)


def log(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an approximation y of log t and a bound of its error.

    Both are nan unless t > 0. The bound is also nan for |y| > 40.

    log t = y + log(1 + e) with e = t e^-y - 1, and |log(1 + e)| <= |e| / (1 - |e|).
    """
    y = np.log(np.where(t > 0.0, t, np.nan))
    e = np.abs(t * exp(-y) - 1.0) + 2.0 * EXP_ERROR
    return y, np.where(e < 0.5, e / (1.0 - e), np.nan) * (1.0 + 4.0 * ROUNDING)


def atan(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an approximation y of atan t and a bound of its error.

    tan(atan t - y) = (t cos y - sin y) / (cos y + t sin y), and |atan e| <= |e|.
    """
    y = np.arctan(t)
    sine, cosine = sin_cos(y)
    size = 1.0 + np.abs(t)
    above = np.abs(t * cosine - sine) + 2.0 * SIN_ERROR * size
    below = cosine + t * sine - 2.0 * SIN_ERROR * size
    return y, np.where(below > 0.0, above / below, np.nan) * (1.0 + 4.0 * ROUNDING)
