"""Elementary functions with proved error bounds.

The bounds require only operations that IEEE 754 rounds correctly. The error of a function is at
most a constant of this module, or the bound that the function returns. Arguments outside the
stated range give nan. u = 2⁻⁵³.

The argument is reduced by a multiple of log 2 or π/2, whose leading parts have so few bits that
their multiples are exact (Cody and Waite, Software Manual for the Elementary Functions, 1980).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial

import numpy as np

#: Largest relative error of `exp`: 2 u of the reduced argument, and 4 u of the series.
#: Results below 1e-307 are off by less than `UNDERFLOW`.
EXP_ERROR = 2e-15
UNDERFLOW = 1e-300
_LARGEST_EXP = 709.0
#: log 2 in two parts, the first with 32 bits.
_LOG_2 = (0.693147180369123816490, 1.90821492927058770002e-10)
#: Largest error of `tanh`. The error of (1 - E) / (1 + E) is at most half that of E plus 3 u.
TANH_ERROR = 4e-15
#: Beyond it tanh is 1 within 1e-17.
_SATURATED = 20.0
#: Largest error of `sin_cos`: 3 u of the reduced argument, and 4 u of the series.
SIN_ERROR = 2e-15
_LARGEST_ANGLE = 2.0**16
#: π/2 in two parts with 33 bits each, up to 2e-21.
_HALF_PI = (1.57079632673412561417, 6.07710050630396597660e-11)
#: Coefficients of the series of e^r in r, and of sin r / r and cos r in r², highest first.
_FACTORIALS = [1.0 / factorial(k) for k in range(14, -1, -1)]
_ODD = [(-1.0) ** k / factorial(2 * k + 1) for k in range(10, -1, -1)]
_EVEN = [(-1.0) ** k / factorial(2 * k) for k in range(10, -1, -1)]
#: Relative error of a few roundings of a number.
ROUNDING = 1e-15
#: Unit of rounding.
UNIT = 2.0**-53
#: Factor that rounds upward the sum of at most some hundred nonnegative terms.
UPWARD = 1.0 + 1e-12
#: Upper bound of the underflow of one operation.
TINY = 1e-290


def exp(t: np.ndarray) -> np.ndarray:
    """Return e^t with a relative error of at most `EXP_ERROR`.

    The error of a result that underflows is at most `UNDERFLOW`. The result is nan for t > 709.
    """
    known = np.fmin(np.fmax(t, -2.0 * _LARGEST_EXP), _LARGEST_EXP)
    count = np.rint(known / _LOG_2[0])
    r = (known - count * _LOG_2[0]) - count * _LOG_2[1]
    value = np.ldexp(_series(_FACTORIALS, r), count.astype(np.int32))
    return np.asarray(np.where(t <= _LARGEST_EXP, value, np.nan))


def _series(coefficients: Sequence[float], r: np.ndarray) -> np.ndarray:
    """Return Σ c_k r^k for |r| <= 1, with the coefficients from the highest to the lowest."""
    value = np.full_like(r, coefficients[0])
    for coefficient in coefficients[1:]:
        value *= r
        value += coefficient
    return value


def tanh(t: np.ndarray) -> np.ndarray:
    """Return tanh t with an absolute error of at most `TANH_ERROR`."""
    power = exp(-2.0 * np.minimum(np.abs(t), _SATURATED))
    value = np.copysign((1.0 - power) / (1.0 + power), t)
    return np.asarray(np.where(np.isnan(t), np.nan, value))


def sin_cos(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sin t and cos t with absolute errors of at most `SIN_ERROR`.

    The results are nan for |t| > 65536.
    """
    known = np.where(np.abs(t) <= _LARGEST_ANGLE, t, np.nan)
    quarters = np.rint(known / _HALF_PI[0])
    r = (known - quarters * _HALF_PI[0]) - quarters * _HALF_PI[1]
    square = r * r
    sine = r * _series(_ODD, square)
    cosine = _series(_EVEN, square)
    quarter = np.mod(quarters, 4.0)
    is_odd = np.mod(quarter, 2.0) == 1.0
    of_sine = np.where(quarter >= 2.0, -1.0, 1.0)
    of_cosine = np.where((quarter == 1.0) | (quarter == 2.0), -1.0, 1.0)
    return of_sine * np.where(is_odd, cosine, sine), of_cosine * np.where(is_odd, sine, cosine)


def log(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an approximation y of log t and a bound of its error.

    Both are nan unless t > 0.

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
