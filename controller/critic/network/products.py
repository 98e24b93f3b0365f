"""Products of CasADi scalars with constant matrices."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.critic.network.row_network import RowNetwork, precision_of
from hfa_support.native.bound import RowFunction

#: Largest number of entries of a matrix whose product is expanded to scalars.
_SCALARS = 4096


class Products:
    """Graph of CasADi scalars in which products with large matrices are not expanded.

    The result of such a product is represented by new symbols.
    """

    def __init__(self, x: ca.SX) -> None:
        self._symbols = [x]
        self._factors: list[tuple[ca.SX, np.ndarray]] = []

    def times(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the matrix product a @ b.

        If one factor contains symbols and the other is a large constant matrix, the result consists
        of new symbols.
        """
        if _has_symbols(a) == _has_symbols(b):
            return np.asarray(a @ b)
        if _has_symbols(b):
            if a.ndim == 2 and b.ndim <= 2:
                return self.times(b.T, a.T).T
            return np.asarray(a @ b)
        if b.ndim == 2 and b.size > _SCALARS:
            return self._by_new_symbols(a, b)
        if a.ndim == 1 and b.ndim == 2:
            return np.fromiter(ca.vertsplit(ca.mtimes(ca.DM(b.T), _entries(a))), object)
        return np.asarray(a @ b)

    def _by_new_symbols(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return new symbols for the product of expressions (..., rows) and a constant matrix."""
        rows, columns = b.shape
        shape = (*a.shape[:-1], columns)
        symbols = ca.SX.sym("h", a.size // rows * columns)
        self._symbols.append(symbols)
        self._factors.append((_entries(a), b))
        return np.fromiter(ca.vertsplit(symbols), object).reshape(shape)

    def function(self, outputs: np.ndarray) -> ca.Function:
        """Return the function x (n,) -> entries of `outputs` in row-major order (k,).

        The function is an SX function if no product is large, otherwise an MX function.
        """
        x = self._symbols[0]
        if not self._factors:
            return ca.Function("network", [x], [_entries(outputs)])
        values = [ca.MX.sym("x", x.numel())]
        for entries, matrix in self._factors:
            factor = ca.reshape(self._value(entries, values), len(matrix), -1)
            values.append(ca.vec((factor.T @ ca.DM(matrix)).T))
        return ca.Function("network", values[:1], [self._value(_entries(outputs), values)])

    def rows(self, outputs: np.ndarray) -> RowNetwork | None:
        """Return the function of many states x (N, n) -> `outputs` (N, k).

        The large products are computed by NumPy for all states together. The result is None if no
        product is large.

        outputs: array of CasADi scalars, k in total
        """
        if not self._factors:
            return None
        steps = []
        for number, (entries, matrix) in enumerate(self._factors):
            part, places = self._part(entries, number + 1)
            steps.append((RowFunction(part), places, matrix.astype(precision_of(matrix))))
        last, places_of_last = self._part(_entries(outputs), len(self._symbols))
        last_rows = RowFunction(last)

        def on_rows(x: np.ndarray) -> np.ndarray:
            values = [x]
            for part, places, matrix in steps:
                factor = part(*(values[place] for place in places))[0]
                product = factor.reshape(-1, len(matrix)).astype(matrix.dtype) @ matrix
                values.append(product.reshape(len(x), -1).astype(float))
            return last_rows(*(values[place] for place in places_of_last))[0]

        return on_rows

    def _value(self, entries: ca.SX, values: list[ca.MX]) -> ca.MX:
        """Return an expression in terms of x and the large products, evaluated at given values."""
        part, places = self._part(entries, len(values))
        return part(*(values[place] for place in places))

    def _part(self, entries: ca.SX, count: int) -> tuple[ca.Function, list[int]]:
        """Return a CasADi Function that computes an expression from x and the large products."""
        places = [0]
        for place in range(1, count):
            if ca.depends_on(entries, self._symbols[place]):
                places.append(place)
        symbols = [self._symbols[place] for place in places]
        return ca.Function("part", symbols, [ca.densify(entries)]), places


def _has_symbols(array: np.ndarray) -> bool:
    return array.dtype == object


def _entries(array: np.ndarray) -> ca.SX:
    return ca.vertcat(*map(ca.SX, np.ravel(array).tolist()))
