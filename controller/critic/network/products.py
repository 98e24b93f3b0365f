"""Products of CasADi scalars with constant matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.row_network import RowNetwork, precision_of
from hfa_support.native.bound import RowFunction

#: Largest number of entries of a matrix whose product is expanded to scalars.
_SCALARS = 4096


class LargeProduct(NamedTuple):
    """Product of expressions with a large constant matrix.

    factor: the expressions (..., rows), flat in row-major order
    matrix: (rows, columns)
    """

    factor: ca.SX
    matrix: np.ndarray


class Part(NamedTuple):
    """Expressions between the large products, as a function.

    function: function of x and of those large products that occur in the expressions
    places: which they are: 0 for x, k for product k
    """

    function: ca.Function
    places: Sequence[int]

    def arguments(self, values: Sequence[Any]) -> list[Any]:
        """Return the arguments of the function, given the values of x and of all products."""
        return [values[place] for place in self.places]


class Products:
    """Graph of CasADi scalars in which products with large matrices are not expanded.

    The result of such a product is represented by new symbols.
    """

    def __init__(self, x: ca.SX) -> None:
        self._symbols = [x]  # x, and the symbols of each large product
        self._products: list[LargeProduct] = []

    def times(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the matrix product left @ right.

        If one factor contains symbols and the other is a large constant matrix, the result consists
        of new symbols (`_times_constant`).
        """
        if _has_symbols(left) and not _has_symbols(right) and right.ndim == 2:
            return self._times_constant(left, right)
        # (left right)' = right' left' holds for matrices and vectors, not for stacks of matrices.
        if _has_symbols(right) and not _has_symbols(left) and left.ndim == 2 and right.ndim <= 2:
            return self._times_constant(right.T, left.T).T
        return np.asarray(left @ right)

    def _times_constant(self, expressions: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return the product of expressions (..., rows) and a constant matrix (rows, columns)."""
        if matrix.size > _SCALARS:
            return self._as_new_symbols(expressions, matrix)
        if expressions.ndim == 1:  # CasADi's own product is faster
            return _array(ca.mtimes(ca.DM(matrix.T), _entries(expressions)))
        return np.asarray(expressions @ matrix)

    def _as_new_symbols(self, expressions: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return new symbols for the product of expressions (..., rows) and a large matrix."""
        rows, columns = matrix.shape
        symbols = ca.SX.sym("h", expressions.size // rows * columns)
        self._symbols.append(symbols)
        self._products.append(LargeProduct(_entries(expressions), matrix))
        return _array(symbols).reshape(*expressions.shape[:-1], columns)

    def function(self, outputs: np.ndarray) -> ca.Function:
        """Return the function x (n,) -> entries of `outputs` in row-major order (k,).

        The function is an SX function if no product is large, otherwise an MX function.
        """
        x = self._symbols[0]
        if not self._products:
            return ca.Function("network", [x], [_entries(outputs)])
        values = [ca.MX.sym("x", x.numel())]
        for factor, matrix in self._products:
            factor_columns = ca.reshape(self._value(factor, values), len(matrix), -1)
            values.append(ca.vec((factor_columns.T @ ca.DM(matrix)).T))
        return ca.Function("network", values[:1], [self._value(_entries(outputs), values)])

    def rows(self, outputs: np.ndarray) -> RowNetwork | None:
        """Return the function of many states x (N, n) -> `outputs` (N, k).

        The large products are computed by NumPy for all states together. The result is None if no
        product is large.

        outputs: array of CasADi scalars, k in total
        """
        if not self._products:
            return None
        matrices = [matrix.astype(precision_of(matrix)) for _, matrix in self._products]
        factors = [self._part(factor) for factor, _ in self._products]
        factor_rows = [RowFunction(part.function) for part in factors]
        last = self._part(_entries(outputs))
        last_rows = RowFunction(last.function)

        def on_rows(x: np.ndarray) -> np.ndarray:
            values = [x]
            for matrix, part, rows in zip(matrices, factors, factor_rows, strict=True):
                (factor,) = rows(*part.arguments(values))
                product = factor.reshape(-1, len(matrix)).astype(matrix.dtype) @ matrix
                values.append(product.reshape(len(x), -1).astype(float))
            return last_rows(*last.arguments(values))[0]

        return on_rows

    def _value(self, expressions: ca.SX, values: Sequence[ca.MX]) -> ca.MX:
        """Return the value of expressions, given the values of x and of the large products."""
        part = self._part(expressions)
        return part.function(*part.arguments(values))

    def _part(self, expressions: ca.SX) -> Part:
        """Return expressions as a function of x and of the large products that occur in them."""
        occurring = [
            place
            for place, symbols in enumerate(self._symbols)
            if place == 0 or ca.depends_on(expressions, symbols)
        ]
        arguments = [self._symbols[place] for place in occurring]
        return Part(ca.Function("part", arguments, [ca.densify(expressions)]), occurring)


def _has_symbols(array: np.ndarray) -> bool:
    return array.dtype == object


def _array(column: ca.SX) -> np.ndarray:
    """Return the entries of a column as an array of CasADi scalars."""
    return np.fromiter(ca.vertsplit(column), object)


def _entries(array: np.ndarray) -> ca.SX:
    return ca.vertcat(*map(ca.SX, np.ravel(array).tolist()))
