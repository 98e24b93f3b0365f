"""Enclosures of functions of one variable over a range, by parabolas or lines.

For a range [low, high] that contains t0, f(t0 + d) = a + b d + c d² ± rest. `curve` is the Taylor
polynomial of degree 2, with the third derivative enclosed over the range. `line` has c = 0 and is
meant for wide ranges. Every remainder includes the rounding of its coefficients. The remainder is
inf or nan if the function is not defined on the range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from verification.enclosure.elementary import (
    EXP_ERROR,
    ROUNDING,
    SIN_ERROR,
    TANH_ERROR,
    atan,
    exp,
    log,
    sin_cos,
    tanh,
)

#: Arrays of one shape: center, lowest and highest argument.
Ranges = tuple[np.ndarray, np.ndarray, np.ndarray]


class Parabola(NamedTuple):
    """Enclosure f(t0 + d) = value + slope d + bend d² ± rest of a function over ranges of d.

    All arrays have the shape of t0.
    """

    value: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    rest: np.ndarray


class Slopes(NamedTuple):
    """Lowest and highest slope over a range, including generalized gradients (Clarke) at kinks."""

    low: np.ndarray
    high: np.ndarray


class Enclosed(NamedTuple):
    """Functions that enclose one kind of node over ranges of its argument.

    curve: (t0, low, high) -> enclosure by a parabola, or None if only lines are used
    line: (t0, low, high) -> enclosure by a line, or None if only parabolas are used
    slopes: (low, high) -> lowest and highest slope
    """

    curve: Callable[[Ranges], Parabola] | None
    line: Callable[[Ranges], Parabola] | None
    slopes: Callable[[np.ndarray, np.ndarray], Slopes]


def _reach(ranges: Ranges) -> np.ndarray:
    """Return the largest |t - t0| of each range, rounded upward."""
    centre, low, high = ranges
    return np.asarray(np.maximum(high - centre, centre - low) * (1.0 + 4.0 * ROUNDING))


def _parabola(
    value: np.ndarray,
    slope: np.ndarray,
    bend: np.ndarray,
    third: np.ndarray,
    errors: tuple[np.ndarray | float, np.ndarray | float, np.ndarray | float],
    reach: np.ndarray,
) -> Parabola:
    """Return the enclosure of a function by its Taylor polynomial of degree 2.

    value, slope, bend: coefficients of the polynomial
    third: upper bound of |f'''| / 6 over the range
    errors: error bounds of value, slope and bend
    reach: largest |d|
    """
    of_value, of_slope, of_bend = errors
    rest = of_value + reach * (of_slope + reach * (of_bend + reach * third))
    return Parabola(value, slope, bend, rest * (1.0 + 10.0 * ROUNDING))


def _by_slopes(
    value: np.ndarray, error: np.ndarray | float, slopes: Slopes, reach: np.ndarray
) -> Parabola:
    """Return the line f(t0 + d) = f(t0) + m d ± w |d|, by the mean value theorem.

    m and w are the center and half-width of the range of slopes.

    value: f(t0)
    error: error bound of `value`
    reach: largest |d|
    """
    middle = 0.5 * (slopes.low + slopes.high)
    width = np.maximum(slopes.high - middle, middle - slopes.low) * (1.0 + 4.0 * ROUNDING)
    return Parabola(value, middle, np.zeros_like(middle), error + width * reach)


# tanh


def _tanh_curve(ranges: Ranges) -> Parabola:
    centre, low, high = ranges
    T = tanh(centre)
    decline = 1.0 - T * T
    p = np.sort(np.stack([tanh(low) ** 2, tanh(high) ** 2]), axis=0)
    least = np.where((low <= 0.0) & (high >= 0.0), 0.0, p[0] - 4.0 * TANH_ERROR)
    most = p[1] + 4.0 * TANH_ERROR
    ends = np.maximum(_tanh_third(least), _tanh_third(most))
    third = np.where((least <= 2.0 / 3.0) & (most >= 2.0 / 3.0), np.maximum(ends, 1.0 / 9.0), ends)
    errors = (TANH_ERROR, 4.0 * TANH_ERROR, 8.0 * TANH_ERROR)
    third = third + 1e-11
    return _parabola(T, decline, -T * decline, third, errors, _reach(ranges))


def _tanh_third(p: np.ndarray) -> np.ndarray:
    """Return |tanh'''| / 6 = |(1 - p) (1 - 3 p)| / 3, with p = tanh²."""
    return np.asarray(np.abs((1.0 - p) * (1.0 - 3.0 * p)) / 3.0)


def _tanh_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    at_low = 1.0 - tanh(low) ** 2
    at_high = 1.0 - tanh(high) ** 2
    crosses = (low <= 0.0) & (high >= 0.0)
    most = np.where(crosses, 1.0, np.maximum(at_low, at_high) + 4.0 * TANH_ERROR)
    return Slopes(np.maximum(np.minimum(at_low, at_high) - 4.0 * TANH_ERROR, 0.0), most)


def _tanh_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of tanh by a line parallel to the chord."""
    centre, low, high = ranges
    at_low = tanh(low)
    at_high = tanh(high)
    slope = np.clip((at_high - at_low) / np.maximum(high - low, 1e-200), 0.0, 1.0)
    above = (at_low - slope * low, at_high - slope * high)
    top = _highest_above(slope, low, high, np.maximum(*above))
    bottom = -_highest_above(slope, -high, -low, -np.minimum(*above))
    constant = 0.5 * (top + bottom)
    size = np.maximum(np.abs(low), np.abs(high))
    rest = np.maximum(top - constant, constant - bottom)
    rest = rest + 4.0 * TANH_ERROR + 20.0 * ROUNDING * (1.0 + size)
    return Parabola(constant + slope * centre, slope, np.zeros_like(slope), rest)


def _highest_above(
    slope: np.ndarray, low: np.ndarray, high: np.ndarray, at_ends: np.ndarray
) -> np.ndarray:
    """Return an upper bound of g(t) = tanh t - slope t over [low, high].

    Rounding errors in g are not included.

    at_ends: the larger of g(low) and g(high)

    For t < 0, g is convex and therefore highest at an end. For t > 0, g is concave and therefore
    below its tangent at any p. The tangent is taken at the point p >= 0 of the range that is
    closest to the computed zero of g'.
    """
    begin = np.maximum(low, 0.0)
    end = np.maximum(high, begin)
    equal = np.arctanh(np.minimum(np.sqrt(1.0 - slope), 1.0 - ROUNDING))
    p = np.clip(equal, begin, end)
    at_p = tanh(p)
    rise = 1.0 - at_p * at_p - slope
    error = 4.0 * TANH_ERROR
    above = np.maximum(
        np.maximum(rise + error, 0.0) * (end - p), np.maximum(error - rise, 0.0) * (p - begin)
    )
    highest = np.maximum(at_p - slope * p + above, at_ends)
    return np.asarray(np.where(high <= 0.0, at_ends, highest))


# relu and step


def _relu_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of max(t, 0) by a line parallel to the chord.

    The difference max(t, 0) - slope t is highest at an end of the range, and lowest, 0, at t = 0.
    """
    centre, low, high = ranges
    crosses = (low < 0.0) & (high > 0.0)
    slope = np.where(crosses, high / np.maximum(high - low, 1e-200), low >= 0.0)
    slope = np.clip(slope, 0.0, 1.0)
    top = np.where(crosses, np.maximum(-slope * low, (1.0 - slope) * high), 0.0)
    half = 0.5 * top
    rest = half * (1.0 + 4.0 * ROUNDING) + 2.0 * ROUNDING * np.where(crosses, np.abs(centre), 0.0)
    return Parabola(half + slope * centre, slope, np.zeros_like(slope), rest)


def _relu_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    return Slopes(np.where(low > 0.0, 1.0, 0.0), np.where(high < 0.0, 0.0, 1.0))


def _step_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of the unit step by a constant.

    The step is 1 for t > 0 and 0 for t < 0. If the range contains 0, the enclosure is [0, 1].
    """
    _, low, high = ranges
    is_open = (low <= 0.0) & (high >= 0.0)
    value = np.where(is_open, 0.5, low > 0.0)
    zero = np.zeros_like(value)
    return Parabola(value, zero, zero, np.where(np.isnan(low + high), np.nan, 0.5 * is_open))


def _step_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    is_open = (low <= 0.0) & (high >= 0.0)
    return Slopes(np.where(is_open, -np.inf, 0.0), np.where(is_open, np.inf, 0.0))


# polynomials, powers and transcendental functions


def _inverse_curve(ranges: Ranges) -> Parabola:
    centre, low, high = ranges
    nearest = np.where(low > 0.0, low, np.where(high < 0.0, -high, np.nan))
    value = 1.0 / np.where(np.isnan(nearest), np.nan, centre)
    size = np.abs(value)
    errors = (
        2.0 * ROUNDING * size,
        4.0 * ROUNDING * size**2,
        6.0 * ROUNDING * size**3,
    )
    return _parabola(value, -(value**2), value**3, nearest**-4.0, errors, _reach(ranges))


def _inverse_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    defined = (low > 0.0) | (high < 0.0)
    ends = np.stack([-1.0 / low**2, -1.0 / high**2])
    least = np.where(defined, ends.min(axis=0), -np.inf)
    most = np.where(defined, ends.max(axis=0), np.inf)
    return Slopes(least * (1.0 + 4.0 * ROUNDING), most * (1.0 - 4.0 * ROUNDING))


def _sqrt_curve(ranges: Ranges) -> Parabola:
    centre, low, _ = ranges
    root = np.sqrt(np.where(low > 0.0, centre, np.nan))
    slope = 0.5 / root
    bend = -0.25 * slope / centre
    third = 1.0 / (16.0 * low**2 * np.sqrt(low))
    errors = (2.0 * ROUNDING * root, 4.0 * ROUNDING * slope, 6.0 * ROUNDING * np.abs(bend))
    return _parabola(root, slope, bend, third, errors, _reach(ranges))


def _sqrt_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    least = np.where(low > 0.0, 0.5 / np.sqrt(high), -np.inf)
    most = np.where(low > 0.0, 0.5 / np.sqrt(low), np.inf)
    return Slopes(least * (1.0 - 4.0 * ROUNDING), most * (1.0 + 4.0 * ROUNDING))


def _exp_curve(ranges: Ranges) -> Parabola:
    centre, _, high = ranges
    value = exp(centre)
    error = 2.0 * EXP_ERROR * value
    third = exp(high) * (1.0 + 2.0 * EXP_ERROR) / 6.0
    return _parabola(value, value, 0.5 * value, third, (error, error, error), _reach(ranges))


def _exp_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    return Slopes(exp(low) * (1.0 - 2.0 * EXP_ERROR), exp(high) * (1.0 + 2.0 * EXP_ERROR))


def _exp_line(ranges: Ranges) -> Parabola:
    centre, low, high = ranges
    value = exp(centre)
    slopes = _exp_slopes(low, high)
    return _by_slopes(value, 2.0 * EXP_ERROR * value, slopes, _reach(ranges))


def _log_curve(ranges: Ranges) -> Parabola:
    centre, low, _ = ranges
    value, error = log(np.where(low > 0.0, centre, np.nan))
    slope = 1.0 / centre
    bend = -0.5 * slope * slope
    errors = (error, 2.0 * ROUNDING * slope, 4.0 * ROUNDING * np.abs(bend))
    return _parabola(value, slope, bend, 1.0 / (3.0 * low**3), errors, _reach(ranges))


def _log_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    least = np.where(low > 0.0, 1.0 / high, -np.inf)
    most = np.where(low > 0.0, 1.0 / low, np.inf)
    return Slopes(least * (1.0 - 4.0 * ROUNDING), most * (1.0 + 4.0 * ROUNDING))


def _wave(pair: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Enclosed:
    """Return the enclosures of a function f with f'' = -f and |f'| <= 1, such as sine and cosine.

    pair: t -> f(t) and f'(t), with errors of at most `SIN_ERROR`
    """

    def curve(ranges: Ranges) -> Parabola:
        value, slope = pair(ranges[0])
        errors = (SIN_ERROR, SIN_ERROR, SIN_ERROR)
        third = np.full_like(value, 1.0 / 6.0)
        return _parabola(value, slope, -0.5 * value, third, errors, _reach(ranges))

    def line(ranges: Ranges) -> Parabola:
        value, _ = pair(ranges[0])
        return _by_slopes(value, SIN_ERROR, slopes(*ranges[1:]), _reach(ranges))

    def slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
        """Return the range of f' over [low, high], f'(m) ± |t - m| with the center m."""
        middle = 0.5 * (low + high)
        _, slope = pair(middle)
        width = np.maximum(high - middle, middle - low) * (1.0 + 4.0 * ROUNDING) + 2.0 * SIN_ERROR
        return Slopes(np.maximum(slope - width, -1.0), np.minimum(slope + width, 1.0))

    return Enclosed(curve, line, slopes)


def _cos_sin(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cos t and its derivative -sin t."""
    sine, cosine = sin_cos(t)
    return cosine, -sine


def _atan_curve(ranges: Ranges) -> Parabola:
    centre = ranges[0]
    value, error = atan(centre)
    slope = 1.0 / (1.0 + centre * centre)
    bend = -centre * slope * slope
    errors = (error, 4.0 * ROUNDING * slope, 8.0 * ROUNDING * np.abs(bend))
    third = np.full_like(value, 1.0 / 3.0)
    return _parabola(value, slope, bend, third, errors, _reach(ranges))


def _atan_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    ends = np.stack([1.0 / (1.0 + low * low), 1.0 / (1.0 + high * high)])
    crosses = (low <= 0.0) & (high >= 0.0)
    most = np.where(crosses, 1.0, ends.max(axis=0) * (1.0 + 8.0 * ROUNDING))
    return Slopes(ends.min(axis=0) * (1.0 - 8.0 * ROUNDING), most)


ENCLOSED: Mapping[str, Enclosed] = {
    "tanh": Enclosed(_tanh_curve, _tanh_line, _tanh_slopes),
    "relu": Enclosed(None, _relu_line, _relu_slopes),
    "step": Enclosed(None, _step_line, _step_slopes),
    "inverse": Enclosed(_inverse_curve, None, _inverse_slopes),
    "sqrt": Enclosed(_sqrt_curve, None, _sqrt_slopes),
    "exp": Enclosed(_exp_curve, _exp_line, _exp_slopes),
    "log": Enclosed(_log_curve, None, _log_slopes),
    "sin": _wave(sin_cos),
    "cos": _wave(_cos_sin),
    "atan": Enclosed(_atan_curve, None, _atan_slopes),
}
