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

from hfa_prove.enclosure.elementary import (
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
from hfa_prove.enclosure.splines import HIGHEST, Spline

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
    """

    value: Callable[[Any], Any]
    curve: Callable[[Ranges], Parabola] | None
    line: Callable[[Ranges], Parabola]
    slopes: Callable[[np.ndarray, np.ndarray], Slopes]

    def nearest(self, ranges: Ranges, of_square: np.ndarray) -> Parabola:
        """Return the parabola or the line on each range, whichever has the smaller remainder.

        of_square: upper bound of the part of d² that is omitted; the remainder of the parabola
            includes it
        """
        if self.curve is None:
            return self.line(ranges)
        curve = self.curve(ranges)
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


class _Expansion(NamedTuple):
    """Values of f, f' and f''/2 at points, and bounds of their errors."""

    value: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    errors: tuple[np.ndarray | float, np.ndarray | float, np.ndarray | float]


class _Curved(NamedTuple):
    """Function f with a derivative that rises or falls over all of its domain, or for t > 0 if odd.

    at: t -> expansion at t, nan outside the domain
    third: (low, high) -> upper bound of |f'''| / 6 over the range
    touch: m -> approximate t >= 0 with f'(t) = m
    sign: 1 if f is concave, -1 if it is convex; for t > 0 if f is odd
    is_odd: whether f(-t) = -f(t)
    """

    at: Callable[[np.ndarray], _Expansion]
    third: Callable[[np.ndarray, np.ndarray], np.ndarray]
    touch: Callable[[np.ndarray], np.ndarray]
    sign: float = 1.0
    is_odd: bool = False

    def curve(self, ranges: Ranges) -> Parabola:
        """Return the Taylor polynomial of degree 2."""
        centre, low, high = ranges
        third = self.third(low, high)
        value, slope, bend, errors = self.at(centre)
        return _parabola(value, slope, bend, third, errors, _reach(ranges))

    def slopes(self, low: np.ndarray, high: np.ndarray) -> Slopes:
        """Return the slopes at the ends, and for odd functions also at 0."""
        ends = [self.at(low), self.at(high)]
        if self.is_odd:
            ends.append(self.at(np.clip(0.0, low, high)))
        least = np.min([end.slope - end.errors[1] for end in ends], axis=0)
        most = np.max([end.slope + end.errors[1] for end in ends], axis=0)
        return Slopes(least, most)

    def line(self, ranges: Ranges) -> Parabola:
        """Return a line parallel to the chord over the range."""
        centre, low, high = ranges
        at_low, at_high = self.at(low), self.at(high)
        values = (self.sign * at_low.value, self.sign * at_high.value)
        slope = (values[1] - values[0]) / np.maximum(high - low, _NARROW)
        ends = (values[0] - slope * low, values[1] - slope * high)
        top = self._highest_above(slope, low, high, np.maximum(*ends))
        bottom = np.minimum(*ends)
        if self.is_odd:
            bottom = -self._highest_above(slope, -high, -low, -bottom)
        constant = 0.5 * (top + bottom)
        size = np.maximum(np.abs(values[0]), np.abs(values[1]))
        size = size + np.abs(slope) * np.maximum(np.abs(low), np.abs(high))
        rest = np.maximum(top - constant, constant - bottom) + at_low.errors[0] + at_high.errors[0]
        rest = (rest + 20.0 * ROUNDING * size) * _UP
        value = self.sign * (constant + slope * centre)
        return Parabola(value, self.sign * slope, np.zeros_like(slope), rest)

    def _highest_above(
        self, slope: np.ndarray, low: np.ndarray, high: np.ndarray, at_ends: np.ndarray
    ) -> np.ndarray:
        """Return an upper bound of g(t) = sign f(t) - slope t over [low, high].

        Rounding errors of the sums are not included.

        at_ends: the larger of g(low) and g(high)

        Where g is convex, it is highest at an end. Where g is concave, it is below its tangent at
        any p. The tangent is taken at the point p of the concave part that is closest to the
        computed zero of g'.
        """
        begin = np.maximum(low, 0.0) if self.is_odd else low
        end = np.maximum(high, begin)
        p = np.fmin(np.fmax(self.touch(self.sign * slope), begin), end)
        at_p = self.at(p)
        rise = self.sign * at_p.slope - slope
        error = at_p.errors[1]
        above = np.maximum(
            np.maximum(rise + error, 0.0) * (end - p), np.maximum(error - rise, 0.0) * (p - begin)
        )
        tangent = self.sign * at_p.value + at_p.errors[0] - slope * p + above
        highest = np.maximum(tangent, at_ends)
        return np.asarray(np.where(high <= 0.0, at_ends, highest) if self.is_odd else highest)


def _rounded(value: np.ndarray, slope: np.ndarray, bend: np.ndarray) -> _Expansion:
    """Return an expansion whose entries are computed with a few roundings."""
    sizes = np.abs(value), np.abs(slope), np.abs(bend)
    of_value, of_slope, of_bend = (8.0 * ROUNDING * size for size in sizes)
    return _Expansion(value, slope, bend, (of_value, of_slope, of_bend))


def _exp(t: np.ndarray) -> _Expansion:
    value = exp(t)
    error = 2.0 * EXP_ERROR * value + UNDERFLOW
    return _Expansion(value, value, 0.5 * value, (error, error, error))


def _third_of_exp(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    value = exp(high)
    return (value + (2.0 * EXP_ERROR * value + UNDERFLOW)) / 6.0


def _log(t: np.ndarray) -> _Expansion:
    value, error = log(t)
    slope = 1.0 / np.where(t > 0.0, t, np.nan)
    expansion = _rounded(value, slope, -0.5 * slope * slope)
    return expansion._replace(errors=(error, *expansion.errors[1:]))


def _sqrt(t: np.ndarray) -> _Expansion:
    value = np.sqrt(np.where(t > 0.0, t, np.nan))
    slope = 0.5 / value
    return _rounded(value, slope, -0.25 * slope / t)


def _inverse(t: np.ndarray) -> _Expansion:
    value = 1.0 / t
    return _rounded(value, -(value**2), value**3)


def _atan(t: np.ndarray) -> _Expansion:
    value, error = atan(t)
    slope = 1.0 / (1.0 + t * t)
    expansion = _rounded(value, slope, -t * slope * slope)
    return expansion._replace(errors=(error, *expansion.errors[1:]))


def _tanh(t: np.ndarray) -> _Expansion:
    value = tanh(t)
    slope = 1.0 - value * value
    errors = (TANH_ERROR, 4.0 * TANH_ERROR, 8.0 * TANH_ERROR)
    return _Expansion(value, slope, -value * slope, errors)


def _third_of_tanh(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the largest |tanh'''| / 6 = |(1 - p) (1 - 3 p)| / 3, with p = tanh².

    It falls with p to 0 at p = 1/3, rises to 1/9 at p = 2/3, and falls again.
    """
    at_ends = np.stack([tanh(low) ** 2, tanh(high) ** 2])
    least = at_ends.min(axis=0) - 4.0 * TANH_ERROR
    most = at_ends.max(axis=0) + 4.0 * TANH_ERROR
    least = np.where((low <= 0.0) & (high >= 0.0), 0.0, least)
    ends = [np.abs((1.0 - p) * (1.0 - 3.0 * p)) / 3.0 for p in (least, most)]
    between = np.where((least <= 2.0 / 3.0) & (most >= 2.0 / 3.0), 1.0 / 9.0, 0.0)
    return np.max([*ends, between], axis=0) + 1e-11


_CURVED = {
    "tanh": _Curved(
        _tanh,
        _third_of_tanh,
        lambda slope: np.arctanh(np.minimum(np.sqrt(1.0 - slope), 1.0 - ROUNDING)),
        is_odd=True,
    ),
    "atan": _Curved(
        _atan,
        lambda low, high: np.full_like(low, 1.0 / 3.0),
        lambda slope: np.sqrt(1.0 / slope - 1.0),
        is_odd=True,
    ),
    "exp": _Curved(_exp, _third_of_exp, np.log, sign=-1.0),
    "log": _Curved(
        _log,
        lambda low, high: 1.0 / (3.0 * np.where(low > 0.0, low, np.nan) ** 3),
        lambda slope: 1.0 / slope,
    ),
    "sqrt": _Curved(
        _sqrt,
        lambda low, high: 1.0 / (16.0 * low**2 * np.sqrt(low)),
        lambda slope: 0.25 / slope**2,
    ),
    "inverse": _Curved(
        _inverse, lambda low, high: low**-4.0, lambda slope: np.sqrt(-1.0 / slope), sign=-1.0
    ),
}


def _on_one_side(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sign of ranges that do not contain 0, and the ranges of |t|, else nan."""
    sign = np.where(low > 0.0, 1.0, -1.0)
    least = np.where(low > 0.0, low, np.where(high < 0.0, -high, np.nan))
    return sign, least, np.where(low > 0.0, high, -low)


def _reflected(function: _Curved, value: Callable[[Any], Any]) -> Enclosed:
    """Return the enclosures of an odd function that is not defined at 0, from those for t > 0."""

    def at(enclose: Callable[[Ranges], Parabola]) -> Callable[[Ranges], Parabola]:
        def reflected(ranges: Ranges) -> Parabola:
            sign, least, most = _on_one_side(*ranges[1:])
            found = enclose((sign * ranges[0], least, most))
            return Parabola(sign * found.value, found.slope, sign * found.bend, found.rest)

        return reflected

    def slopes(low: np.ndarray, high: np.ndarray) -> Slopes:
        _, least, most = _on_one_side(low, high)
        return function.slopes(least, most)

    return Enclosed(value, at(function.curve), at(function.line), slopes)


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


# sine and cosine


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


def _of_curved(name: str, value: Callable[[Any], Any]) -> Enclosed:
    function = _CURVED[name]
    return Enclosed(value, function.curve, function.line, function.slopes)


ENCLOSED: Mapping[str, Enclosed] = {
    "relu": Enclosed(lambda t: np.maximum(t, 0.0), None, _relu_line, _relu_slopes),
    "step": Enclosed(lambda t: np.where(t > 0.0, 1.0, 0.0), None, _step_line, _step_slopes),
    "inverse": _reflected(_CURVED["inverse"], np.reciprocal),
    "sin": _wave(np.sin, sin_cos),
    "cos": _wave(np.cos, _cos_sin),
    "tanh": _of_curved("tanh", np.tanh),
    "atan": _of_curved("atan", np.arctan),
    "exp": _of_curved("exp", np.exp),
    "log": _of_curved("log", np.log),
    "sqrt": _of_curved("sqrt", np.sqrt),
}
