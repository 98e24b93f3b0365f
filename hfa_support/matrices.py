"""Arrays of users: matrices, labels of their rows, tables between points."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, numbers_in, shortened
from hfa_support.reporting.results import ByValue

#: Larger numbers (or numbers below its inverse) overflow in products and are meaningless in a
#: model.
LARGEST = 1e100
#: Relative error of a computed sum, compared with its largest term: ten roundings, of the user's
#: arithmetic or of the derivatives of a model. That of an eigenvalue algorithm is p(n) eps |A| with
#: p of this size (LAPACK Users' Guide, 4.8).
ROUNDING = 10.0 * float(np.finfo(float).eps)


def checked_matrix(name: str, value: Any, largest: float, ndim: int | None = 2) -> np.ndarray:
    """Return a matrix, given by the user, as a read-only array of floats.

    name: name of the matrix in messages
    value: the given value
    largest: largest permitted magnitude of an entry
    ndim: required number of dimensions, or None for any

    Raises BadInputError if the value does not consist of real numbers, if an entry is not finite or
    too large, or if the number of dimensions is not `ndim`.
    """
    array = numbers_in(name, value)
    if ndim not in (None, array.ndim):
        raise BadInputError(f"the number of dimensions of {name} is {array.ndim}; give {ndim}")
    for index in np.argwhere(~(np.abs(array) <= largest))[:1]:  # also nan
        entry = array[tuple(index)]
        rule = "give finite entries"
        if np.isfinite(entry):
            rule = f"give entries of at most {largest:g} in magnitude"
        where = "".join(f"[{i}]" for i in index)
        raise BadInputError(f"{name}{where} is {entry:g}; {rule}")
    array.setflags(write=False)
    return array


def shape_text(shape: tuple[int, ...]) -> str:
    """Return a shape as text, (5, 6) as "5 x 6", () as "a number"."""
    return " x ".join(map(str, shape)) or "a number"


def spectral_radius(matrix: np.ndarray) -> float:
    """Return the largest magnitude of the eigenvalues of a square matrix."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def spectral_abscissa(matrix: np.ndarray) -> float:
    """Return the largest real part of the eigenvalues of a square matrix."""
    return float(np.linalg.eigvals(matrix).real.max())


def of_step(A: np.ndarray, Q: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return e^(A dt) and ∫ e^(A t) Q e^(A' t) dt over a step, as of white noise of intensity Q.

    Van Loan's exponential contains e^(-A dt), which overflows: it is taken of a part of dt, and
    doubled. Source: C. Van Loan, IEEE Transactions on Automatic Control 23 (1978) 395.
    """
    from scipy.linalg import expm

    n = len(A)
    doublings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(A, 1)) * dt, 1.0))))
    part = expm(np.block([[-A, Q], [np.zeros((n, n)), A.T]]) * (dt / 2**doublings))
    Phi = part[n:, n:].T
    integral = Phi @ part[:n, n:]
    for _ in range(doublings):
        integral = integral + Phi @ integral @ Phi.T
        Phi = Phi @ Phi
    return Phi, integral


def quadratic_forms(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return z'M z of each row z, (N,).

    rows: (N, n)
    matrix: M, (n, n)
    """
    return np.asarray(np.einsum("ki,ij,kj->k", rows, matrix, rows))


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the balanced form D⁻¹ M D of a matrix M, (n, n), and the diagonal of D, (n,).

    Row and column i of the balanced form have lengths within a factor of two, unless one is 0. The
    diagonal consists of powers of two, so that no digit changes. The algorithm is that of LAPACK's
    dgebal (James, Langou, Lowery 2014), with its limit: a unit that shortens row and column by less
    than 5 % is not changed.

    Raises ValueError if an entry is not finite.
    """
    scaled = np.array(np.asarray_chkfinite(matrix), dtype=float)
    units = np.ones(len(scaled))
    changed = True
    while changed:
        changed = False
        for i in range(len(scaled)):
            column, row = math.hypot(*scaled[:, i].tolist()), math.hypot(*scaled[i].tolist())
            if not column or not row:
                continue
            # The power of two nearest sqrt(row / column), which makes both equally long.
            unit = 2.0 ** math.ceil((math.log2(row) - math.log2(column) - 1.0) / 2.0)
            if column * unit + row / unit < 0.95 * (column + row):
                scaled[:, i] *= unit
                scaled[i] /= unit
                units[i] *= unit
                changed = True
    return scaled, units


def power_of_two(sizes: np.ndarray) -> np.ndarray:
    """Return the power of two nearest to each size, and 1 for a size of 0."""
    positive = np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(np.exp2(np.round(np.log2(positive))))


def labels_of(value: Any) -> list[tuple[str, ...]]:
    """Return the labels along each axis of an array of pandas, polars or xarray, () for an axis
    that is numbered, and [] for another value.
    """
    if hasattr(value, "coords") and hasattr(value, "dims"):  # xarray
        axes = [value.coords.get(axis, ()) for axis in value.dims]
        axes = [axis.to_numpy().tolist() if len(axis) else axis for axis in axes]
    elif hasattr(value, "to_dicts"):  # polars
        axes = [(), value.columns]
    else:  # pandas
        axes = value.axes if hasattr(type(value), "loc") else []
    return [tuple(axis) if _are_names(axis) else () for axis in axes]


def _are_names(labels: Sequence[Any]) -> bool:
    """Return whether labels of an axis are names, not numbers or the "column_1" of polars."""
    has_texts = any(isinstance(label, str) for label in labels)
    return has_texts and not all(re.fullmatch(r"(column_)?\d+", str(label)) for label in labels)


def in_order(what: str, value: Any, *orders: Sequence[str]) -> Any:
    """Return a labelled array as numbers in the given order, and another value unchanged.

    what: name of the array, for messages
    orders: names along each axis, () for an axis that keeps its order; an array with fewer axes has
        the last ones

    Raises BadInputError unless the labels of each axis are the names of its order, in any order.
    """
    labels = labels_of(value)
    if not labels:
        return value
    numbers = value.to_numpy()
    for axis, (given, order) in enumerate(zip(labels, orders[-len(labels) :], strict=False)):
        if not given or not order:  # a numbered axis, or one in any order
            continue
        if sorted(map(str, given)) != sorted(order):
            raise BadInputError(
                f"{what} has the labels {shortened(', '.join(map(str, given)), 200)}; label each "
                f"of {', '.join(order)} once, or give {what}.to_numpy() in this order"
            )
        numbers = numbers.take([given.index(name) for name in order], axis=axis)
    return numbers


@dataclass(frozen=True, eq=False)
class LinearTable(ByValue):
    """Array of any shape that is piecewise linear in one variable and constant beyond both ends.

    breakpoints: (N,), strictly increasing
    values: (N, ...), the array at each breakpoint

    Raises BadInputError if the breakpoints do not increase, or if the numbers of breakpoints and
    values differ.
    """

    breakpoints: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        """Convert both fields to arrays of floats.

        Raises BadInputError, as described for the class.
        """
        breakpoints = np.asarray(self.breakpoints, dtype=float)
        values = np.asarray(self.values, dtype=float)
        increasing = (
            breakpoints.ndim == 1 and breakpoints.size > 0 and (np.diff(breakpoints) > 0).all()
        )
        if not increasing or len(values) != len(breakpoints):
            raise BadInputError(
                "a table is invalid; give increasing breakpoints, and one value for each"
            )
        vars(self).update(breakpoints=breakpoints, values=values)

    def at(self, where: float | np.ndarray) -> np.ndarray:
        """Return the array at x, interpolated linearly and constant beyond both ends.

            v_i + (v_i+1 - v_i) (x - x_i)/(x_i+1 - x_i)

        where: x, a number or an array of any shape

        The shape of the result is the shape of x, followed by the shape of the tabulated array.
        """
        last = len(self.breakpoints) - 1
        place = np.interp(where, self.breakpoints, np.arange(last + 1.0))
        left = np.floor(place).astype(int)
        share = (place - left).reshape(np.shape(place) + (1,) * (self.values.ndim - 1))
        change = self.values[np.minimum(left + 1, last)] - self.values[left]
        return np.asarray(self.values[left] + share * change)
