"""Precomputation of terms in a trim's equations that depend only on the constants of a point."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_support.native.bound import RowFunction
from trim.point.system import Equations, RowsOf, TrimSystem


class _Shared(NamedTuple):
    """Functions of rows in which terms without unknowns are computed beforehand."""

    constants: RowFunction  # constants -> constants and these terms
    residual: RowFunction  # `residual_rows` and `linear_rows` of these
    linear: RowFunction  # `residual_rows` and `linear_rows` of these


class SharedSystem(TrimSystem):
    """Equations of a trim in which terms that depend only on the constants c are precomputed.

    The precomputed terms follow the constants in c. The precomputed terms are omitted for the small
    systems that `quick_steps` solves (`is_quick`).
    """

    @cached_property
    def _shared(self) -> _Shared:
        return _shared_rows(self.equations)

    @property
    def residual_rows(self) -> RowsOf:
        """Function of rows (z, c) that returns the residuals r and their Jacobian J."""
        return super().residual_rows if self.is_quick else self._shared.residual

    @property
    def linear_rows(self) -> RowsOf:
        """Function of rows (z, c) that returns x, u, watched signals, A, B and the residuals."""
        return self.equations.linear_rows if self.is_quick else self._shared.linear

    def linear(
        self, z: np.ndarray, c: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the trims, linear models and residuals of N points.

        The result consists of x, u and the w watched signals (N, n + m + w), A (N, n, n), B (N, n,
        m) and the residuals r (N, e).

        z: (N, k), scaled unknowns
        c: (N, ..), constants
        """
        (flat,) = self.linear_rows(z, c)
        n = len(self.model.states)
        m = len(self.model.inputs)
        ends = np.cumsum([n + m + len(self.structure.watched), n * n, n * m])
        point, A, B, residual = np.split(flat, ends, axis=1)
        return point, A.reshape(len(z), n, n), B.reshape(len(z), n, m), residual

    def constants(
        self, count: int = 1, columns: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return the constants of N points with the precomputed terms after them, (N, ..).

        count, columns: as for `TrimSystem.constants`
        """
        c = super().constants(count, columns)
        if not self.is_quick:
            (c,) = self._shared.constants(c)
        return c


@lru_cache(maxsize=16)
def _shared_rows(equations: Equations) -> _Shared:
    functions = (equations.residual_rows.function, equations.linear_rows.function)
    return _Shared(*map(RowFunction, without_shared(*functions)))


def without_shared(*functions: ca.Function) -> list[ca.Function]:
    """Return functions equivalent to the given ones, in which terms without z are computed
    beforehand.

    The first function computes these terms g, c -> (c, g). The other functions are those given,
    with the arguments z and (c, g).

    functions: functions of (z, c)
    """
    z, c = functions[0].sx_in()
    outputs = [part for function in functions for part in function.call([z, c])]
    parts, names, terms = ca.extract_parametric(outputs, c)
    both = ca.vertcat(c, *names)
    made = [ca.Function("given", [c], [ca.vertcat(c, *terms)], {"cse": True})]
    for function in functions:
        own = [parts.pop(0) for _ in range(function.n_out())]
        made.append(ca.Function(function.name(), [z, both], own, {"cse": True}))
    return made
