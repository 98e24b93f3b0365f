"""Products with matrices of constants, in graphs of CasADi scalars."""

from __future__ import annotations

import casadi as ca
import numpy as np

#: Entries of a matrix up to which a product is a graph of scalars, two operations an entry.
_SCALARS = 4096


class Products:
    """Functions of x whose products with large matrices stay products.

    A graph of scalars of a layer of 1024 x 1024 has two million operations. So the result of such a
    product is new symbols, and `function` puts the graphs and the products together.
    """

    def __init__(self, x: ca.SX) -> None:
        self._symbols = [x]
        self._factors: list[tuple[ca.SX, np.ndarray]] = []

    def times(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a @ b."""
        a_is_constant = a.dtype != object
        b_is_constant = b.dtype != object
        if a_is_constant and not b_is_constant and a.ndim == 2 and b.ndim <= 2:
            return self.times(b.T, a.T).T
        if a_is_constant or not b_is_constant or b.ndim != 2 or b.size <= _SCALARS:
            return np.asarray(a @ b)
        rows, columns = b.shape
        shape = (*a.shape[:-1], columns)
        symbols = ca.SX.sym("h", a.size // rows * columns)
        self._symbols.append(symbols)
        self._factors.append((_entries(a), b))
        return np.fromiter(ca.vertsplit(symbols), object).reshape(shape)

    def function(self, outputs: np.ndarray) -> ca.Function:
        """x -> the entries of an array, row by row, (k,): of scalars (SX) where no product is
        large, else of matrices (MX)."""
        x = self._symbols[0]
        if not self._factors:
            return ca.Function("network", [x], [_entries(outputs)])
        values = [ca.MX.sym("x", x.numel())]
        for entries, matrix in self._factors:
            factor = ca.reshape(self._value(entries, values), len(matrix), -1)
            values.append(ca.vec((factor.T @ ca.DM(matrix)).T))
        return ca.Function("network", values[:1], [self._value(_entries(outputs), values)])

    def _value(self, entries: ca.SX, values: list[ca.MX]) -> ca.MX:
        """Entries that depend on the symbols, at values of these."""
        symbols = self._symbols[:1]
        arguments = values[:1]
        for symbol, value in zip(self._symbols[1 : len(values)], values[1:], strict=True):
            if ca.depends_on(entries, symbol):
                symbols.append(symbol)
                arguments.append(value)
        part = ca.Function("part", symbols, [ca.densify(entries)])
        return part(*arguments)


def _entries(array: np.ndarray) -> ca.SX:
    return ca.vertcat(*map(ca.SX, np.ravel(array).tolist()))
