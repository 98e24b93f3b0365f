"""Functions of one variable: their values, and enclosures over a range by parabolas or lines.

For a range [low, high] that contains t0, f(t0 + d) = a + b d + c d² ± rest. `curve` is the Taylor
polynomial of degree 2, with the third derivative enclosed over the range. `line` has c = 0 and is
meant for wide ranges. Every remainder includes the rounding of its coefficients. The remainder is
inf or nan if the function is not defined on the range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from verification.enclosure.elementary import (
    EXP_ERROR,
    ROUNDING,
    SIN_ERROR,
    TANH_ERROR,
    UNDERFLOW,
    atan,
    exp,
    log,
    sin_cos,
    tanh,
)
from verification.enclosure.splines import HIGHEST, Spline

#: Arrays of one shape: center, lowest and highest argument.
Ranges = tuple[np.ndarray, np.ndarray, np.ndarray]
#: Upward rounding of a few sums and products of nonnegative numbers.
_UP = 1.0 + 4.0 * ROUNDING
#: Smallest width of a range by which a difference is divided.
_NARROW = 1e-200


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
    """A function of one variable, and functions that enclose it over ranges of its argument.

    value: t -> f(t) in double precision, on which no proof depends
    curve: (t0, low, high) -> enclosure by a parabola, or None if the function has kinks
    line: (t0, low, high) -> enclosure by a line
    slopes: (low, high) -> lowest and highest slope
    is_exact: whether `curve` has no other remainder than rounding
    """

    value: Callable[[Any], Any]
    curve: Callable[[Ranges], Parabola] | None
    line: Callable[[Ranges], Parabola]
    slopes: Callable[[np.ndarray, np.ndarray], Slopes]
    is_exact: bool = False

    def nearest(self, ranges: Ranges, of_square: np.ndarray) -> Parabola:
        """Return the parabola or the line on each range, whichever has the smaller remainder.

        of_square: upper bound of the part of d² that is omitted; the remainder of the parabola
            includes it
        """
        if self.curve is None:
            return self.line(ranges)
        curve = self.curve(ranges)
        if self.is_exact:
            return curve
        line = self.line(ranges)
        is_curve = curve.rest + np.abs(curve.bend) * of_square <= line.rest
        return Parabola(*(np.where(is_curve, a, b) for a, b in zip(curve, line, strict=True)))


def _reach(ranges: Ranges) -> np.ndarray:
    """Return the largest |t - t0| of each range, rounded upward."""
    centre, low, high = ranges
    return np.asarray(np.maximum(high - centre, centre - low) * _UP)


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
    width = np.maximum(slopes.high - middle, middle - slopes.low) * _UP
    return Parabola(value, middle, np.zeros_like(middle), error + width * reach)


class _Concave(NamedTuple):
    """Function that is concave for t > 0 within its domain.

    at: t -> f(t) and a bound of its error
    slope: (t, f(t)) -> f'(t) and a bound of its error
    touch: m -> approximate t >= 0 with f'(t) = m
    """

    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray | float]]
    slope: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray | float]]
    touch: Callable[[np.ndarray], np.ndarray]


def _chord_line(f: _Concave, ranges: Ranges, is_odd: bool) -> Parabola:
    """Return an enclosure of f by a line parallel to its chord over the range.

    is_odd: whether f is odd, and therefore convex for t < 0; otherwise f is concave everywhere
    """
    centre, low, high = ranges
    at_low, error_low = f.at(low)
    at_high, error_high = f.at(high)
    slope = (at_high - at_low) / np.maximum(high - low, _NARROW)
    ends = (at_low - slope * low, at_high - slope * high)
    top = _highest_above(f, slope, low, high, np.maximum(*ends), is_odd)
    bottom = np.minimum(*ends)
    if is_odd:
        bottom = -_highest_above(f, slope, -high, -low, -bottom, is_odd)
    constant = 0.5 * (top + bottom)
    size = np.maximum(np.abs(at_low), np.abs(at_high))
    size = size + np.abs(slope) * np.maximum(np.abs(low), np.abs(high))
    rest = np.maximum(top - constant, constant - bottom) + error_low + error_high
    rest = (rest + 20.0 * ROUNDING * size) * _UP
    return Parabola(constant + slope * centre, slope, np.zeros_like(slope), rest)


def _highest_above(
    f: _Concave,
    slope: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    at_ends: np.ndarray,
    is_odd: bool,
) -> np.ndarray:
    """Return an upper bound of g(t) = f(t) - slope t over [low, high].

    Rounding errors of the sums are not included.

    at_ends: the larger of g(low) and g(high)

    Where g is convex, it is highest at an end. Where g is concave, it is below its tangent at any
    p. The tangent is taken at the point p of the concave part that is closest to the computed zero
    of g'.
    """
    begin = np.maximum(low, 0.0) if is_odd else low
    end = np.maximum(high, begin)
    p = np.clip(np.nan_to_num(f.touch(slope), nan=1.0), begin, end)
    at_p, error = f.at(p)
    steepness, of_slope = f.slope(p, at_p)
    rise = steepness - slope
    above = np.maximum(
        np.maximum(rise + of_slope, 0.0) * (end - p), np.maximum(of_slope - rise, 0.0) * (p - begin)
    )
    highest = np.maximum(at_p + error - slope * p + above, at_ends)
    return np.asarray(np.where(high <= 0.0, at_ends, highest) if is_odd else highest)


def _negative(line: Parabola) -> Parabola:
    """Return the enclosure of -f for that of f."""
    return Parabola(-line.value, -line.slope, -line.bend, line.rest)


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


def _tanh_touch(slope: np.ndarray) -> np.ndarray:
    return np.asarray(np.arctanh(np.minimum(np.sqrt(1.0 - slope), 1.0 - ROUNDING)))


_TANH = _Concave(
    lambda t: (tanh(t), TANH_ERROR),
    lambda _, value: (1.0 - value * value, 4.0 * TANH_ERROR),
    _tanh_touch,
)


# relu and step


def _relu_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of max(t, 0) by a line parallel to the chord.

    The difference max(t, 0) - slope t is highest at an end of the range, and lowest, 0, at t = 0.
    """
    centre, low, high = ranges
    crosses = (low < 0.0) & (high > 0.0)
    slope = np.where(crosses, high / np.maximum(high - low, _NARROW), low >= 0.0)
    slope = np.clip(slope, 0.0, 1.0)
    top = np.where(crosses, np.maximum(-slope * low, (1.0 - slope) * high), 0.0)
    half = 0.5 * top
    rest = half * _UP + 2.0 * ROUNDING * np.where(crosses, np.abs(centre), 0.0)
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


def _square_curve(ranges: Ranges) -> Parabola:
    centre = ranges[0]
    value = centre * centre
    one = np.ones_like(value)
    return _parabola(value, 2.0 * centre, one, 0.0 * one, (ROUNDING * value, 0, 0), _reach(ranges))


def _square_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of t² by a line parallel to its chord.

    t² = m² + 2 m (t - m) + (t - m)², with m the middle of the range.
    """
    centre, low, high = ranges
    middle = 0.5 * (low + high)
    half = 0.5 * np.maximum(high - middle, middle - low) ** 2
    value = middle * (2.0 * centre - middle) + half
    size = half + np.abs(middle) * (2.0 * np.abs(centre) + np.abs(middle))
    return Parabola(value, 2.0 * middle, np.zeros_like(value), half * _UP + 4.0 * ROUNDING * size)


def _square_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    return Slopes(2.0 * low, 2.0 * high)


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


def _inverse_line(ranges: Ranges) -> Parabola:
    """Return an enclosure of 1/t by a line. 1/t is odd, and -1/t concave for t > 0."""
    centre, low, high = ranges
    sign = np.where(low > 0.0, 1.0, -1.0)
    least = np.where(low > 0.0, low, np.where(high < 0.0, -high, np.nan))
    most = np.where(low > 0.0, high, -low)
    line = _chord_line(_MINUS_INVERSE, (sign * centre, least, most), is_odd=False)
    return Parabola(-sign * line.value, -line.slope, line.bend, line.rest)


_MINUS_INVERSE = _Concave(
    lambda t: (-1.0 / t, 2.0 * ROUNDING / t),
    lambda t, _: (1.0 / t**2, 4.0 * ROUNDING / t**2),
    lambda slope: 1.0 / np.sqrt(slope),
)


def _inverse_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    defined = (low > 0.0) | (high < 0.0)
    ends = np.stack([-1.0 / low**2, -1.0 / high**2])
    least = np.where(defined, ends.min(axis=0), -np.inf)
    most = np.where(defined, ends.max(axis=0), np.inf)
    return Slopes(least * _UP, most * (1.0 - 4.0 * ROUNDING))


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
    return Slopes(least * (1.0 - 4.0 * ROUNDING), most * _UP)


_SQRT = _Concave(
    lambda t: (np.sqrt(t), ROUNDING * np.sqrt(t)),
    lambda _, value: (0.5 / value, 2.0 * ROUNDING / value),
    lambda slope: 0.25 / slope**2,
)


def _error_of_exp(value: np.ndarray) -> np.ndarray:
    return 2.0 * EXP_ERROR * value + UNDERFLOW


def _exp_curve(ranges: Ranges) -> Parabola:
    centre, _, high = ranges
    value = exp(centre)
    error = _error_of_exp(value)
    third = exp(high)
    third = (third + _error_of_exp(third)) / 6.0
    return _parabola(value, value, 0.5 * value, third, (error, error, error), _reach(ranges))


def _exp_slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
    least = exp(low)
    most = exp(high)
    return Slopes(np.maximum(least - _error_of_exp(least), 0.0), most + _error_of_exp(most))


def _minus_exp(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    value = exp(t)
    return -value, _error_of_exp(value)


_MINUS_EXP = _Concave(
    _minus_exp, lambda _, value: (value, _error_of_exp(-value)), lambda slope: np.log(-slope)
)


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
    return Slopes(least * (1.0 - 4.0 * ROUNDING), most * _UP)


_LOG = _Concave(log, lambda t, _: (1.0 / t, 2.0 * ROUNDING / t), lambda slope: 1.0 / slope)


def _wave(
    value: Callable[[Any], Any], pair: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
) -> Enclosed:
    """Return the enclosures of a function f with f'' = -f and |f'| <= 1, such as sine and cosine.

    value: t -> f(t), without an error bound
    pair: t -> f(t) and f'(t), with errors of at most `SIN_ERROR`
    """

    def curve(ranges: Ranges) -> Parabola:
        height, slope = pair(ranges[0])
        errors = (SIN_ERROR, SIN_ERROR, SIN_ERROR)
        third = np.full_like(height, 1.0 / 6.0)
        return _parabola(height, slope, -0.5 * height, third, errors, _reach(ranges))

    def line(ranges: Ranges) -> Parabola:
        height, _ = pair(ranges[0])
        return _by_slopes(height, SIN_ERROR, slopes(*ranges[1:]), _reach(ranges))

    def slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
        """Return the range of f' over [low, high], f'(m) ± |t - m| with the center m."""
        middle = 0.5 * (low + high)
        _, slope = pair(middle)
        width = np.maximum(high - middle, middle - low) * _UP + 2.0 * SIN_ERROR
        return Slopes(np.maximum(slope - width, -1.0), np.minimum(slope + width, 1.0))

    return Enclosed(value, curve, line, slopes)


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


def _atan_touch(slope: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(1.0 / slope - 1.0))


_ATAN = _Concave(
    atan, lambda t, _: (1.0 / (1.0 + t * t), 4.0 * ROUNDING / (1.0 + t * t)), _atan_touch
)


# piecewise polynomials


@lru_cache(maxsize=64)
def _of_spline(spline: Spline) -> Enclosed:
    """Return the enclosures of a piecewise polynomial."""
    bounds = _Pieces(spline)
    return Enclosed(spline.at, bounds.curve, bounds.line, bounds.slopes)


class _Touched(NamedTuple):
    """Bounds over all pieces that meet a range.

    smoothness: least number of continuous derivatives at the knots in the range
    values, slopes: lowest and highest f and f'
    bent: upper bound of |f''|
    third: upper bound of |f'''| / 6
    """

    smoothness: np.ndarray
    values: Slopes
    slopes: Slopes
    bent: np.ndarray
    third: np.ndarray


class _Pieces:
    """Enclosures of a piecewise polynomial from bounds of its pieces.

    spline: the piecewise polynomial
    """

    def __init__(self, spline: Spline) -> None:
        self._spline = spline
        self._knots = np.array(spline.knots)
        c = spline.coefficients.T
        lengths = np.array([np.inf, *np.diff(self._knots), np.inf]) * _UP
        self._values = _hull(c, lengths)
        self._slopes = _hull(np.array([c[1], 2.0 * c[2], 3.0 * c[3]]), lengths)
        bent = _hull(np.array([2.0 * c[2], 6.0 * c[3]]), lengths)
        self._bent = np.maximum(np.abs(bent.low), np.abs(bent.high))
        self._third = np.abs(c[3]) * _UP

    def _touched(self, low: np.ndarray, high: np.ndarray) -> _Touched:
        first = np.searchsorted(self._knots, low, side="left")
        last = np.searchsorted(self._knots, high, side="right")

        def most(each: np.ndarray) -> np.ndarray:
            """Return the largest of the values of consecutive pieces or knots."""
            result = np.full(np.shape(low), -np.inf)
            for k, value in enumerate(each):
                is_met = (first <= k) & (k <= last - (len(each) == len(self._knots)))
                result = np.where(is_met, np.maximum(result, value), result)
            return np.where(np.isfinite(low + high), result, np.nan)

        values = Slopes(-most(-self._values.low), most(self._values.high))
        slopes = Slopes(-most(-self._slopes.low), most(self._slopes.high))
        smoothness = np.fmin(-most(-self._spline.smoothness.astype(float)), HIGHEST)
        return _Touched(smoothness, values, slopes, most(self._bent), most(self._third))

    def _at(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return f, f' and f'' / 2 at t, and bounds of their errors."""
        piece = np.searchsorted(self._knots, t, side="right")
        d = t - self._spline.origins[piece]
        c = np.moveaxis(self._spline.coefficients[piece], -1, 0)
        results = []
        errors = []
        for factors in (c, [c[1], 2.0 * c[2], 3.0 * c[3]], [c[2], 3.0 * c[3]]):
            total = np.zeros_like(d)
            size = np.zeros_like(d)
            for factor in reversed(factors):
                total = factor + d * total
                size = np.abs(factor) + np.abs(d) * size
            results.append(total)
            errors.append(2.0 * ROUNDING * size)
        return (*results, *errors)

    def curve(self, ranges: Ranges) -> Parabola:
        """Return the Taylor polynomial, without a bound if the range contains a kink or a jump."""
        centre, low, high = ranges
        value, slope, bend, *errors = self._at(centre)
        touched = self._touched(low, high)
        reach = _reach(ranges)
        second = np.where(touched.smoothness >= 2, 0.0, 0.5 * touched.bent + np.abs(bend))
        second = np.where(touched.smoothness >= 1, second, np.inf)
        third = np.where(touched.smoothness >= 2, touched.third, 0.0)
        of_value, of_slope, of_bend = errors
        return _parabola(value, slope, bend, third, (of_value, of_slope, of_bend + second), reach)

    def line(self, ranges: Ranges) -> Parabola:
        """Return a line by the range of slopes, or a constant if the range contains a jump."""
        centre, low, high = ranges
        value, _, _, error, *_ = self._at(centre)
        touched = self._touched(low, high)
        by_slopes = _by_slopes(value, error, self.slopes(low, high), _reach(ranges))
        middle = 0.5 * (touched.values.low + touched.values.high)
        half = np.maximum(touched.values.high - middle, middle - touched.values.low) * _UP
        zero = np.zeros_like(middle)
        is_jump = touched.smoothness < 0
        constant = Parabola(middle, zero, zero, half + 2.0 * ROUNDING * np.abs(middle))
        return Parabola(
            *(np.where(is_jump, a, b) for a, b in zip(constant, by_slopes, strict=True))
        )

    def slopes(self, low: np.ndarray, high: np.ndarray) -> Slopes:
        """Return the range of f' over [low, high], unbounded if the range contains a jump."""
        touched = self._touched(low, high)
        middle = 0.5 * (low + high)
        _, slope, _, _, error, _ = self._at(middle)
        width = np.maximum(high - middle, middle - low) * touched.bent * _UP + error
        is_smooth = touched.smoothness >= 1
        least = np.where(is_smooth, slope - width, -np.inf)
        most = np.where(is_smooth, slope + width, np.inf)
        is_jump = touched.smoothness < 0
        return Slopes(
            np.where(is_jump, -np.inf, np.maximum(least, touched.slopes.low)),
            np.where(is_jump, np.inf, np.minimum(most, touched.slopes.high)),
        )


def _hull(coefficients: np.ndarray, lengths: np.ndarray) -> Slopes:
    """Return bounds of the polynomials Σ c_k s^k for 0 <= s <= length, rounded outward.

    A polynomial that is not constant is unbounded if its length is infinite.

    coefficients: (degrees + 1, pieces)
    lengths: (pieces,)
    """
    low = high = coefficients[0]
    size = np.abs(low)
    for k, factor in enumerate(coefficients[1:], start=1):
        term = np.where(factor == 0.0, 0.0, factor * np.where(factor == 0.0, 1.0, lengths) ** k)
        is_endless = np.isinf(term)
        low = low + np.where(is_endless, -np.inf, np.minimum(term, 0.0))
        high = high + np.where(is_endless, np.inf, np.maximum(term, 0.0))
        size = size + np.where(is_endless, 0.0, np.abs(term))
    return Slopes(low - 4.0 * ROUNDING * size, high + 4.0 * ROUNDING * size)


def enclosed(kind: str | Spline) -> Enclosed:
    """Return the enclosures of a kind of node: a name in `ENCLOSED`, or a piecewise polynomial."""
    return ENCLOSED[kind] if isinstance(kind, str) else _of_spline(kind)


ENCLOSED: Mapping[str, Enclosed] = {
    "tanh": Enclosed(np.tanh, _tanh_curve, lambda r: _chord_line(_TANH, r, True), _tanh_slopes),
    "relu": Enclosed(lambda t: np.maximum(t, 0.0), None, _relu_line, _relu_slopes),
    "step": Enclosed(lambda t: np.where(t > 0.0, 1.0, 0.0), None, _step_line, _step_slopes),
    "square": Enclosed(np.square, _square_curve, _square_line, _square_slopes, is_exact=True),
    "inverse": Enclosed(np.reciprocal, _inverse_curve, _inverse_line, _inverse_slopes),
    "sqrt": Enclosed(np.sqrt, _sqrt_curve, lambda r: _chord_line(_SQRT, r, False), _sqrt_slopes),
    "exp": Enclosed(
        np.exp, _exp_curve, lambda r: _negative(_chord_line(_MINUS_EXP, r, False)), _exp_slopes
    ),
    "log": Enclosed(np.log, _log_curve, lambda r: _chord_line(_LOG, r, False), _log_slopes),
    "sin": _wave(np.sin, sin_cos),
    "cos": _wave(np.cos, _cos_sin),
    "atan": Enclosed(np.arctan, _atan_curve, lambda r: _chord_line(_ATAN, r, True), _atan_slopes),
}
