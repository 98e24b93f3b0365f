"""Bounds of a function over many boxes at once, by Taylor models of degree 2.

In a box z = c + h s, |s_i| <= 1, each number of a network is

  x + Σ C_i s_i + Σ Q_ij s_i s_j, i <= j, within a radius r.

A function of an entry, f(c + d) with |d| <= X, is f + (f' + f''' X²/8) d + ½ f'' d², because d³ is
¾ X² d within X³/4, or its chord, which is better for wide boxes and the only one of relu. The radii
are weighted backward, with their signs, to the results. Curvatures of units cancel, too: order 2
requires 10 to 5000 times fewer boxes than order 1.

Rounding is part of the radii: each operation adds a bound of its own, relative to its terms.

Sources: Makino and Berz, Int. J. of Pure and Applied Mathematics 6 (2003), 239-316; Singh et al.,
NeurIPS 2018 (DeepZ).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from controller.critic.network.operations import NotListedError, Operation

#: Rounding of an operation with k terms, relative to their sizes, is below (k + 8) times this.
_ROUNDING = 2.0**-52
#: Radii are rounded up by this share, far more than their own rounding.
_OUTWARD = 1.0 + 1e-9


class _Smooth(NamedTuple):
    """A smooth function f of each entry.

    derivatives: x -> f and its first three derivatives
    fourth: the highest argument -> bound of the fourth derivative
    points: s -> all x with f'(x) = s
    """

    derivatives: Callable[[np.ndarray], tuple[np.ndarray, ...]]
    fourth: Callable[[np.ndarray], np.ndarray | float]
    points: Callable[[np.ndarray], Sequence[np.ndarray]]


def _tanh(x: np.ndarray) -> tuple[np.ndarray, ...]:
    t = np.tanh(x)
    d = 1.0 - t * t
    return t, d, -2.0 * t * d, d * (6.0 * t * t - 2.0)


def _tanh_points(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.arctanh(np.sqrt(np.clip(1.0 - slope, 0.0, 1.0 - 1e-15)))
    return x, -x


def _expm1(x: np.ndarray) -> tuple[np.ndarray, ...]:
    d = np.exp(x)
    return np.expm1(x), d, d, d


_SMOOTH = {
    "tanh": _Smooth(_tanh, lambda _: 4.1, _tanh_points),
    "expm1": _Smooth(_expm1, np.exp, lambda s: (np.log(np.maximum(s, 1e-300)),)),
}
_POLYNOMIAL = ("input", "constant", "product", "add", "times")


#: Lowest and highest values, (k, N) each, of the sources of each operation.
Ranges = list[list[tuple[np.ndarray, np.ndarray]]]


class Form(NamedTuple):
    """Numbers over N boxes: x (k, N), C (k, N, n), Q (k, N, pairs) or None for 0, and r (k, N)."""

    x: np.ndarray
    C: np.ndarray
    Q: np.ndarray | None
    r: np.ndarray

    @property
    def linear(self) -> np.ndarray:
        """Largest |Σ C_i s_i|, (k, N)."""
        return np.abs(self.C).sum(2)

    @property
    def curved(self) -> np.ndarray | float:
        """Bound of |Σ Q_ij s_i s_j|, (k, N)."""
        return 0.0 if self.Q is None else np.abs(self.Q).sum(2)

    @property
    def reach(self) -> np.ndarray:
        """Largest distance from x, (k, N)."""
        return np.asarray(self.linear + self.curved + self.r)


class _Step(NamedTuple):
    """What a form becomes, the radius that the operation adds, and its slopes by its sources."""

    form: Form
    own: np.ndarray
    slopes: tuple[np.ndarray, ...] = ()  # (k, N) each, of functions of the entries


class Bounds(NamedTuple):
    """Bounds of a function over N boxes.

    form: its numbers
    scores: how much each state widens the radius, (N, n)
    ranges: of each operation that is not linear, the lowest and highest values of its sources
    """

    form: Form
    scores: np.ndarray
    ranges: Ranges


class BoundedFunction:
    """A function of the state, given by its operations, with bounds over boxes."""

    def __init__(self, operations: Sequence[Operation]) -> None:
        """Raise NotListedError for an operation that has no bounds."""
        for operation in operations:
            if operation.kind not in (*_SMOOTH, "relu", *_POLYNOMIAL):
                raise NotListedError(operation.kind)
        self.operations = operations

    @property
    def is_piecewise_linear(self) -> bool:
        """Whether all operations are linear, but for relu."""
        return not any(o.kind in _SMOOTH or o.kind == "times" for o in self.operations)

    @property
    def width(self) -> int:
        """Largest number of entries of a product."""
        return max((max(o.data.shape) for o in self.operations if o.kind == "product"), default=1)

    def over(self, c: np.ndarray, h: np.ndarray) -> Bounds:
        """Return the bounds over the boxes |z - c| <= h, (n, N) each."""
        with np.errstate(all="ignore"):
            return self._over(c, h)

    def _over(self, c: np.ndarray, h: np.ndarray) -> Bounds:
        n, N = c.shape
        C = np.zeros((n, N, n))
        C[np.arange(n), :, np.arange(n)] = h
        steps: list[_Step] = []
        ranges: Ranges = []
        for operation in self.operations:
            sources = [steps[i].form for i in operation.sources]
            is_nonlinear = operation.kind in _SMOOTH or operation.kind in ("relu", "times")
            between = [(a.x - a.reach, a.x + a.reach) for a in sources if is_nonlinear]
            ranges.append(between)
            if operation.kind == "input":
                step = _Step(Form(c, C, None, np.zeros((n, N))), np.zeros((n, N)))
            elif operation.kind in _SMOOTH or operation.kind == "relu":
                step = _of_entries(operation.kind, sources[0])
            else:
                step = _polynomial(operation, sources, N, n)
            form = step.form
            steps.append(step._replace(form=form._replace(r=form.r + step.own)))
        form = steps[-1].form
        radius, scores = self._backward(steps, len(form.x))
        return Bounds(form._replace(r=radius * _OUTWARD), scores * h.T, ranges)

    def _backward(self, steps: list[_Step], m: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the radius of the results, (m, N), and the scores of the states, (N, n)."""
        N = steps[-1].own.shape[1]
        weights: list[np.ndarray | None] = [None] * len(steps)  # of the radii, (m, N, k)
        scores: list[np.ndarray | float] = [0.0] * len(steps)  # (N, k)
        weights[-1] = np.repeat(np.eye(m)[:, None], N, axis=1)
        radius = np.zeros((m, N))

        def send(to: int, weight: np.ndarray, score: np.ndarray) -> None:
            known = weights[to]
            weights[to] = weight if known is None else known + weight
            scores[to] = scores[to] + score

        for place in range(len(steps) - 1, 0, -1):
            (kind, sources, data), step = self.operations[place], steps[place]
            weight = weights[place]
            weights[place] = None
            if weight is None or kind == "constant":
                continue
            share = np.abs(weight) * step.own.T
            radius = radius + share.sum(2)
            score = scores[place] + share.sum(0)
            if kind == "product":
                back = weight.reshape(m * N, -1) @ data
                send(sources[0], back.reshape(m, N, -1), score @ np.abs(data))
            else:
                factors: Sequence[Any] = step.slopes or (1.0,) * len(sources)
                for source, factor in zip(sources, factors, strict=True):
                    send(source, weight * np.asarray(factor).T, score)
        of_states = scores[0]
        if not isinstance(of_states, np.ndarray):
            of_states = np.zeros((N, len(steps[0].own)))
        return radius, of_states

    def slopes(self, bounds: Bounds, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return middle and radius of the slope by the state over some boxes, (m, N', n) each.

        bounds: of `over`
        chosen: numbers of the boxes, (N',)
        """
        eye = np.repeat(np.eye(bounds.scores.shape[1])[:, None], len(chosen), axis=1)
        values = [(eye, np.zeros(eye.shape))]  # of the input
        for place, operation in enumerate(self.operations[1:], start=1):
            parts = [values[i] for i in operation.sources]
            between = [(low[:, chosen], high[:, chosen]) for low, high in bounds.ranges[place]]
            with np.errstate(all="ignore"):
                values.append(_slope(operation, parts, between, len(chosen)))
        return values[-1]


def _slope(
    operation: Operation,
    parts: list[tuple[np.ndarray, np.ndarray]],
    between: list[tuple[np.ndarray, np.ndarray]],
    N: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and radius of the slope of an operation, (k, N, n) each.

    parts: those of its sources
    between: lowest and highest values of its sources, (k, N) each
    """
    kind, _, data = operation
    if kind == "constant":
        return np.zeros((len(data), N, 1)), np.zeros((len(data), N, 1))
    M, R = parts[0]
    if kind == "product":
        flat, wide = M.reshape(len(M), -1), R.reshape(len(M), -1)
        rounded = (data.shape[1] + 8) * _ROUNDING * (np.abs(data) @ np.abs(flat))
        shape = (len(data), N, -1)
        return (data @ flat).reshape(shape), (np.abs(data) @ wide + rounded).reshape(shape)
    if kind == "add":
        sum_of_both = M + parts[1][0]
        sizes = np.abs(M) + np.abs(parts[1][0])
        return sum_of_both, R + parts[1][1] + 8 * _ROUNDING * sizes
    if kind == "times":
        (a_low, a_high), (b_low, b_high) = between
        first = _by_interval(M, R, b_low, b_high)
        second = _by_interval(*parts[1], a_low, a_high)
        return first[0] + second[0], first[1] + second[1]
    low, high = _slopes_between(kind, *between[0])
    return _by_interval(M, R, low, high)


def _by_interval(
    M: np.ndarray, R: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and radius of the product of M ± R, (k, N, n), and an interval, (k, N)."""
    middle, radius = 0.5 * (low + high)[:, :, None], 0.5 * (high - low)[:, :, None]
    # 1 - tanh² is rounded relative to 1.
    radius = radius + 8 * _ROUNDING * (1.0 + np.abs(middle) + radius)
    return middle * M, np.abs(middle) * R + radius * (np.abs(M) + R)


def _slopes_between(kind: str, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest slope of a function in low <= x <= high."""
    if kind == "relu":
        return np.where(low > 0.0, 1.0, 0.0), np.where(high < 0.0, 0.0, 1.0)
    smooth = _SMOOTH[kind]
    of_low, of_high = smooth.derivatives(low)[1], smooth.derivatives(high)[1]
    least, largest = np.minimum(of_low, of_high), np.maximum(of_low, of_high)
    if kind == "tanh":  # whose slope is largest, 1, at 0
        largest = np.where((low < 0.0) & (high > 0.0), 1.0, largest)
    return least, largest


def _polynomial(operation: Operation, sources: list[Form], N: int, n: int) -> _Step:
    """Return the step of an operation that is a polynomial of degree 1 or 2."""
    kind, _, data = operation
    if kind == "constant":
        x = np.repeat(np.asarray(data, float)[:, None], N, axis=1)
        zero = np.zeros(x.shape)
        return _Step(Form(x, np.zeros((*x.shape, n)), None, zero), zero)
    a = sources[0]
    if kind == "product":
        size = np.abs(data)
        k, K = data.shape

        def times(array: np.ndarray) -> np.ndarray:
            return (data @ array.reshape(K, -1)).reshape(k, N, -1)

        own = (K + 8) * _ROUNDING * (size @ (np.abs(a.x) + a.linear + a.curved))
        Q = None if a.Q is None else times(a.Q)
        return _Step(Form(data @ a.x, times(a.C), Q, size @ a.r), own)
    b = sources[1]
    if kind == "add":
        Q = a.Q if b.Q is None else b.Q if a.Q is None else a.Q + b.Q
        form = Form(a.x + b.x, a.C + b.C, Q, a.r + b.r)
        sizes = np.abs(a.x) + np.abs(b.x) + a.linear + b.linear + a.curved + b.curved
        return _Step(form, 8 * _ROUNDING * sizes)
    return _times(a, b)


def _times(a: Form, b: Form) -> _Step:
    """Return the step of the product of two forms, entry by entry."""
    x, y = a.x[:, :, None], b.x[:, :, None]
    Q = _square(a.C, b.C)
    Q = Q if a.Q is None else Q + a.Q * y
    Q = Q if b.Q is None else Q + x * b.Q
    radius = np.abs(a.x) * b.r + np.abs(b.x) * a.r  # weighted backward by the slopes
    own = (
        a.linear * b.curved
        + a.curved * b.linear
        + a.curved * b.curved
        + a.r * (b.linear + b.curved)
        + b.r * (a.linear + a.curved)
        + a.r * b.r
    )
    sizes = (np.abs(a.x) + a.reach) * (np.abs(b.x) + b.reach)
    form = Form(a.x * b.x, a.C * y + x * b.C, Q, radius)
    return _Step(form, own + 16 * _ROUNDING * sizes, (b.x, a.x))


def _square(C: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return the products (Σ C_i s_i)(Σ D_j s_j) as coefficients of s_i s_j, i <= j."""
    n, first = C.shape[2], 0
    Q = np.empty((*C.shape[:2], n * (n + 1) // 2))
    for i in range(n):
        part = Q[:, :, first : first + n - i]
        np.multiply(C[:, :, i, None], D[:, :, i:], out=part)
        part[:, :, 1:] += part[:, :, 1:] if C is D else C[:, :, i + 1 :] * D[:, :, i, None]
        first += n - i
    return Q


def _of_entries(kind: str, a: Form) -> _Step:
    """Return the step of a function of each entry."""
    reach, linear = a.reach, a.linear
    slope, middle, radius = _chord(kind, a.x - reach, a.x + reach)
    value = slope * a.x + middle
    curved = None
    if kind != "relu":
        smooth = _SMOOTH[kind]
        f0, f1, f2, f3 = smooth.derivatives(a.x)
        fourth = smooth.fourth(a.x + reach)
        # ½ f'' acts on the square of the linear part alone.
        of_cubic = (
            (np.abs(f3) * reach**3 + fourth * reach**4) / 24.0
            + 0.5 * np.abs(f2) * (reach**2 - linear**2)
            + 16
            * _ROUNDING
            * (np.abs(f0) + np.abs(f1) * reach + np.abs(f2) * reach**2 + np.abs(f3) * reach**3)
        )
        is_better = of_cubic < radius
        value = np.where(is_better, f0, value)
        slope = np.where(is_better, f1 + f3 * reach**2 / 8.0, slope)
        radius = np.where(is_better, of_cubic, radius)
        curved = _square(a.C, a.C) * np.where(is_better, 0.5 * f2, 0.0)[:, :, None]
    C, r = slope[:, :, None] * a.C, np.abs(slope) * a.r
    if a.Q is not None:
        of_Q = slope[:, :, None] * a.Q
        curved = of_Q if curved is None else curved + of_Q
    return _Step(Form(value, C, curved, r), radius, (slope,))


def _chord(
    kind: str, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slope, middle and radius with |f(x) - slope x - middle| <= radius from low to high."""
    is_wide = high - low > (0.0 if kind == "relu" else 1e-9)
    width = np.where(is_wide, high - low, 1.0)
    if kind == "relu":
        of_low, of_high = np.maximum(low, 0.0), np.maximum(high, 0.0)
        slope = np.where(is_wide, (of_high - of_low) / width, high > 0.0)
        kink = np.where((low < 0.0) & (high > 0.0), 0.0, of_low - slope * low)
        gaps = [of_low - slope * low, of_high - slope * high, kink]
    else:
        smooth = _SMOOTH[kind]
        of_low, of_high = smooth.derivatives(low)[0], smooth.derivatives(high)[0]
        in_middle = smooth.derivatives((low + high) / 2.0)[1]
        slope = np.where(is_wide, (of_high - of_low) / width, in_middle)
        gaps = [of_low - slope * low, of_high - slope * high]
        for point in smooth.points(slope):  # where f(x) - slope x is extreme
            inside = np.clip(point, low, high)
            gaps.append(smooth.derivatives(inside)[0] - slope * inside)
    least, largest = np.minimum.reduce(gaps), np.maximum.reduce(gaps)
    sizes = np.abs(of_low) + np.abs(of_high) + np.abs(slope) * (np.abs(low) + np.abs(high))
    return slope, 0.5 * (least + largest), 0.5 * (largest - least) + 16 * _ROUNDING * sizes
