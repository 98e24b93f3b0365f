"""Bounds of a function over many boxes at once, by Taylor models of degree 2.

In a box z = c + h s, |s_i| <= 1, each number of a network is

  x + Σ C_i s_i + Σ Q_ij s_i s_j, i <= j, within a radius r.

A function of an entry, f(c + d) with |d| <= X, is f + (f' + f''' X²/8) d + ½ f'' d², because d³ is
¾ X² d within X³/4, or its chord, which is better for wide boxes and the only one of relu. The radii
are weighted backward, with their signs, to the results. Curvatures of units cancel, too: order 2
requires 10 to 5000 times fewer boxes than order 1.

Rounding is part of the radii: each operation adds (k + 8) 2^-52 of its k terms, once for its values
and once for the weights, because a weight that is off by a share of |w| |M| is off by this share of
the terms. Sums of positive terms, as radii are, are off by less than 1e-9.

Sources: Makino and Berz, Int. J. of Pure and Applied Mathematics 6 (2003), 239-316; Singh et al.,
NeurIPS 2018 (DeepZ).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from controller.critic.network.operations import NotListedError, Operation

_ROUNDING = 2.0**-51
#: Rounding of sums of positive terms, outward.
OUTWARD = 1.0 + 1e-9


def _tanh(x: np.ndarray) -> Sequence[np.ndarray]:
    t = np.tanh(x)
    d = 1.0 - t * t
    return t, d, -2.0 * t * d, d * (6.0 * t * t - 2.0)


#: Kind -> x -> f and its first three derivatives; the highest argument -> a bound of the fourth;
#: s -> x at which f(x) - s x may be extreme.
_FUNCTIONS: dict[str, tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]] = {
    "": (lambda x: (x, 1.0 + 0 * x, 0 * x, 0 * x), lambda _: 0.0, lambda _: ()),
    "tanh": (
        _tanh,
        lambda _: 4.1,
        lambda s: (x := np.arctanh(np.sqrt(np.clip(1.0 - s, 0.0, 1.0 - 1e-15))), -x),
    ),
    "expm1": (
        lambda x: (np.expm1(x), *(np.exp(x),) * 3),
        np.exp,
        lambda s: (np.log(np.maximum(s, 1e-300)),),
    ),
    "square": (lambda x: (x * x, 2 * x, 2 + 0 * x, 0 * x), lambda _: 0.0, lambda s: (0.5 * s,)),
    # The fourth derivative of the kink is infinite: the chord alone bounds it.
    "relu": (
        lambda x: (np.maximum(x, 0.0), np.heaviside(x, 0.5), 0 * x, 0 * x),
        lambda _: np.inf,
        lambda s: (0 * s,),
    ),
}


class _Step(NamedTuple):
    """An operation over N boxes.

    x, Z, r: its results: x (k, N), Z = [C Q] (k, N, terms), Q absent if all are 0, r (k, N)
    slope: by which radii of its argument enter, (k, N)
    own: radius that it adds, (k, N)
    least, most: bounds of its argument, (k, N)
    shares: of the states in the width of the argument, (k, N, n)
    """

    x: np.ndarray
    Z: np.ndarray
    r: np.ndarray
    slope: np.ndarray
    own: np.ndarray
    least: np.ndarray
    most: np.ndarray
    shares: np.ndarray


class BoundedFunction:
    """A function of the state, given by its operations, with bounds over boxes.

    is_linear_in_pieces: whether all operations are linear, but for relu
    width: largest number of results of an operation
    """

    def __init__(self, operations: Sequence[Operation]) -> None:
        """Raise NotListedError for an operation that has no bounds."""
        self._operations = operations[1:]
        kinds = {operation.kind for operation in self._operations}
        for kind in kinds - {*_FUNCTIONS}:
            raise NotListedError(f"operation {kind} has no bounds")
        self.is_linear_in_pieces = kinds <= {"", "relu"}
        self.width = max(len(operation.matrix) for operation in self._operations)

    @np.errstate(all="ignore")
    def over(
        self, c: np.ndarray, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return x, Z and r over the boxes |z - c| <= h, (n, N) each, and how much each state
        widens r, (N, n).
        """
        steps = self._steps(c, h)
        m, N = steps[-1].x.shape
        radius, scores = np.zeros((m, N)), np.zeros((N, len(c)))
        weights = {len(steps) - 1: np.repeat(np.eye(m)[:, None], N, axis=1)}
        for place in range(len(steps) - 1, 0, -1):
            weight = weights.pop(place, None)  # of the radii, (m, N, k)
            if weight is None:
                continue
            operation, step = self._operations[place - 1], steps[place]
            added = np.abs(weight) * step.own.T
            radius = radius + added.sum(2)
            scores = scores + np.einsum("Nk,kNi->Ni", added.sum(0), step.shares)
            weight = (weight * step.slope.T).reshape(m * N, -1) @ operation.matrix
            sizes = [len(steps[i].x) for i in operation.sources]
            parts = np.split(weight.reshape(m, N, -1), np.cumsum(sizes)[:-1], axis=2)
            for source, part in zip(operation.sources, parts, strict=True):
                weights[source] = weights.get(source, 0.0) + part
        return *steps[-1][:2], radius * OUTWARD, scores

    def is_homogeneous(self, c: np.ndarray, h: np.ndarray) -> bool:
        """Return whether f(c + a y) - f(c) is a times f(c + y) - f(c) for |y| <= h and 0 <= a <= 1:
        f is linear in pieces, and has no kink there but at c.
        """
        near, at = (self._steps(c[:, None], widths[:, None]) for widths in (h, 0.0 * h))
        return self.is_linear_in_pieces and all(
            ((of_box.least > 0.0) | (of_box.most < 0.0) | (of_c.least + of_c.most == 0.0)).all()
            for (kind, *_), of_box, of_c in zip(self._operations, near[1:], at[1:], strict=True)
            if kind
        )

    @np.errstate(all="ignore")
    def slopes(self, c: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return middle and radius of the slope over one box |z - c| <= h, (m, n) each."""
        n = len(c)
        values = [(np.eye(n), np.zeros((n, n)))]
        steps = self._steps(c[:, None], h[:, None])
        for (kind, sources, matrix, _), step in zip(self._operations, steps[1:], strict=True):
            M, R = (np.concatenate([values[i][k] for i in sources]) for k in (0, 1))
            size = np.abs(matrix)
            R = size @ R + (len(M) + 8) * _ROUNDING * (size @ np.abs(M))
            M = matrix @ M
            derivatives = _FUNCTIONS[kind][0]
            # A slope is monotone on both sides of 0.
            at = (step.least, np.clip(0.0, step.least, step.most), step.most)
            slopes = np.array([derivatives(x)[1] for x in at])
            middle = 0.5 * (slopes.max(0) + slopes.min(0))
            radius = 0.5 * (slopes.max(0) - slopes.min(0))
            radius = radius + 8 * _ROUNDING * (1.0 + np.abs(middle))
            values.append((middle * M, np.abs(middle) * R + radius * (np.abs(M) + R)))
        return values[-1]

    @np.errstate(all="ignore")
    def _steps(self, c: np.ndarray, h: np.ndarray) -> list[_Step]:
        """Return the steps over boxes, that of the input first."""
        n, N = c.shape
        Z = np.zeros((n, N, n if self.is_linear_in_pieces else n + n * (n + 1) // 2))
        Z[np.arange(n), :, np.arange(n)] = h
        zero = np.zeros((n, N))
        steps = [_Step(c, Z, *(zero,) * 5, Z)]
        for kind, sources, matrix, constant in self._operations:
            x, Z, r = (np.concatenate([steps[i][k] for i in sources]) for k in range(3))
            size, shape = np.abs(matrix), (len(matrix), *Z.shape[1:])
            own = size @ (np.abs(x) + np.abs(Z).sum(2) + r) + np.abs(constant)[:, None]
            own = (sum(matrix.shape) + 8) * _ROUNDING * own  # of sums over both axes
            Z = (matrix @ Z.reshape(len(Z), -1)).reshape(shape)
            argument = matrix @ x + constant[:, None], Z, size @ r + own
            steps.append(_step(kind, *argument, own, n))
        return steps


def _step(kind: str, x: np.ndarray, Z: np.ndarray, r: np.ndarray, own: np.ndarray, n: int) -> _Step:
    """Return the step of a function of each entry of an argument, of whose radius r a part is its
    own, (k, N).
    """
    derivatives, fourth, points = _FUNCTIONS[kind]
    C = Z[:, :, :n]
    reach = np.abs(Z).sum(2) + r
    low, high = x - reach, x + reach
    f0, f1, f2, f3 = derivatives(x)
    of_low, of_high = derivatives(low)[0], derivatives(high)[0]

    # The chord, whose distance from f is largest at an end, or where the slopes are equal.
    slope = np.where(high > low, (of_high - of_low) / (high - low), f1)
    ends = [low, high, *(np.clip(point, low, high) for point in points(slope))]
    gaps = [derivatives(end)[0] - slope * end for end in ends]
    least, most = np.minimum.reduce(gaps), np.maximum.reduce(gaps)
    sizes = np.abs(of_low) + np.abs(of_high) + np.abs(slope) * (np.abs(low) + np.abs(high))
    radius = 0.5 * (most - least) + 8 * _ROUNDING * sizes
    value = slope * x + 0.5 * (least + most)

    # The parabola, whose ½ f'' acts on the square of the linear part alone.
    terms = [np.abs(f) * reach**k for k, f in enumerate((f0, f1, f2, f3, fourth(high)))]
    of_parabola = (
        (terms[3] + terms[4]) / 24.0
        + 0.5 * np.abs(f2) * (reach**2 - np.abs(C).sum(2) ** 2)
        + 8 * _ROUNDING * sum(terms[:4])
    )
    is_better = of_parabola < radius
    value = np.where(is_better, f0, value)
    slope = np.where(is_better, f1 + f3 * reach**2 / 8.0, slope)
    radius = np.where(is_better, of_parabola, radius)
    half = np.where(is_better, 0.5 * f2, 0.0)[:, :, None]
    i, j = (places[: Z.shape[2] - n] for places in np.triu_indices(n))
    Z = slope[:, :, None] * Z
    Z[:, :, n:] += half * np.where(i == j, 1.0, 2.0) * C[:, :, i] * C[:, :, j]
    shares = np.abs(C) / np.maximum(reach, 1e-300)[:, :, None]
    steep = np.abs(slope)
    return _Step(value, Z, steep * r + radius, slope, steep * own + radius, low, high, shares)
