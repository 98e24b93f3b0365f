"""Compiled C code that trims many points, one after the other, by Newton's method."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.native.machine_code import compiled
from trim.point.halving import LEAST_SHARE, LONGEST, MOST_TRIALS
from trim.point.system import NEARLY, RowsOf
from trim.sweeps.shared import SharedSystem, without_shared

#: Status of a point in the C code.
_UNSETTLED, _SETTLED, _SINGULAR = range(3)

_C_TEXT = """
{functions}
#define K {unknowns}
#define E {equations}
#define C {constants}
#define G {given}
#define FLAT {flat}

/* c -> g, c with what the steps of a point share. */
static void prepare(const double *c, double *g)
{{
    const double *arg[{given_arg}] = {{c}};
    double *res[{given_res}] = {{g}}, w[{given_w}];
    casadi_int iw[{given_iw}];
    given(arg, res, iw, w, 0);
}}

static void evaluate(const double *z, const double *g, double *r, double *J)
{{
    const double *arg[{residual_arg}] = {{z, g}};
    double *res[{residual_res}] = {{r, J}}, w[{residual_w}];
    casadi_int iw[{residual_iw}];
    residual(arg, res, iw, w, 0);
}}

static double norm(const double *v)
{{
    double sum = 0.0;
    for (int i = 0; i < K; i++)
        sum += v[i] * v[i];
    return sqrt(sum);
}}

/* J -> its factors L and U, row by row, with partial pivoting; 0 where it is singular. */
static int factor(double *J, int *pivots)
{{
    for (int j = 0; j < K; j++) {{
        int p = j;
        for (int i = j + 1; i < K; i++)
            if (fabs(J[i * K + j]) > fabs(J[p * K + j]))
                p = i;
        pivots[j] = p;
        if (!(fabs(J[p * K + j]) > 0.0))
            return 0;
        if (p != j)
            for (int i = 0; i < K; i++) {{
                double swapped = J[j * K + i];
                J[j * K + i] = J[p * K + i];
                J[p * K + i] = swapped;
            }}
        for (int i = j + 1; i < K; i++) {{
            if (J[i * K + j] == 0.0)
                continue;
            double share = J[i * K + j] / J[j * K + j];
            J[i * K + j] = share;
            for (int l = j + 1; l < K; l++)
                J[i * K + l] -= share * J[j * K + l];
        }}
    }}
    return 1;
}}

/* d = -J^-1 r of the factors of J. */
static void solve(const double *J, const int *pivots, const double *r, double *d)
{{
    for (int i = 0; i < K; i++)
        d[i] = -r[i];
    for (int j = 0; j < K; j++) {{
        double swapped = d[j];
        d[j] = d[pivots[j]];
        d[pivots[j]] = swapped;
    }}
    for (int i = 1; i < K; i++)
        for (int j = 0; j < i; j++)
            d[i] -= J[i * K + j] * d[j];
    for (int i = K - 1; i >= 0; i--) {{
        for (int j = i + 1; j < K; j++)
            d[i] -= J[i * K + j] * d[j];
        d[i] /= J[i * K + i];
    }}
}}

static int newton(const double *c, double *z)
{{
    double g[G], r[E], J[K * K], step[K], trial[K], trial_r[E], trial_J[K * K], next[K];
    int pivots[K];
    double share = 1.0, size;
    prepare(c, g);
    evaluate(z, g, r, J);
    size = norm(r);
    if (!factor(J, pivots))
        return {singular};
    solve(J, pivots, r, step);
    for (int trials = 0; trials < {most_trials}; trials++) {{
        for (int i = 0; i < K; i++)
            if (!(fabs(step[i]) < {longest}))
                return {singular};
        if (size <= {nearly}) {{
            for (int i = 0; i < K; i++)
                z[i] += step[i];
            return {settled};
        }}
        if (share < {least_share})
            return {unsettled};
        for (int i = 0; i < K; i++)
            trial[i] = z[i] + share * step[i];
        evaluate(trial, g, trial_r, trial_J);
        double trial_size = norm(trial_r);
        int better = trial_size < size;
        if (!better) {{
            solve(J, pivots, trial_r, next);
            better = norm(next) < (1.0 - share / 4.0) * norm(step);
        }}
        if (!better) {{
            share /= 2.0;
            continue;
        }}
        for (int i = 0; i < K; i++)
            z[i] = trial[i];
        for (int i = 0; i < K * K; i++)
            J[i] = trial_J[i];
        size = trial_size;
        share = 1.0;
        if (!factor(J, pivots))
            return {singular};
        solve(J, pivots, trial_r, step);
    }}
    return {unsettled};
}}

void {symbol}_newton(long long count, const double *c, double *z, signed char *status)
{{
    for (long long i = 0; i < count; i++)
        status[i] = (signed char)newton(c + i * C, z + i * K);
}}

void {symbol}_residual(long long count, const double *c, const double *z, double *r, double *J)
{{
    double g[G];
    for (long long i = 0; i < count; i++) {{
        prepare(c + i * C, g);
        evaluate(z + i * K, g, r + i * E, J + i * K * K);
    }}
}}

void {symbol}_linear(long long count, const double *c, const double *z, double *flat)
{{
    for (long long i = 0; i < count; i++) {{
        const double *arg[{linear_arg}] = {{z + i * K, c + i * C}};
        double *res[{linear_res}] = {{flat + i * FLAT}}, w[{linear_w}];
        casadi_int iw[{linear_iw}];
        linear(arg, res, iw, w, 0);
    }}
}}
"""


class CompiledTrim:
    """Loops over many points in compiled C code: Newton's method, residuals and linear models.

    rows: number of equations, and number of entries in a row of `Equations.linear_rows`
    """

    def __init__(self, symbol: str, library: Path, rows: tuple[int, int]) -> None:
        functions = ctypes.CDLL(str(library))
        self._newton = getattr(functions, f"{symbol}_newton")
        self._residual = getattr(functions, f"{symbol}_residual")
        self._linear = getattr(functions, f"{symbol}_linear")
        self._rows = rows

    def newton(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the unknowns (N, k) after Newton's method, and two masks (N,).

        The first mask marks the points that converged, the second mask the points with a singular
        Jacobian.

        z: (N, k), initial scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        ends = np.array(z, order="C")
        status = np.empty(len(z), dtype=np.int8)
        _run(self._newton, c, ends, status)
        return ends, status == _SETTLED, status == _SINGULAR

    def residuals(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals r (N, e) and their Jacobian J (N, k, k).

        z: (N, k), scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        count, k = z.shape
        residual = np.empty((count, self._rows[0]))
        jacobian = np.empty((count, k, k))
        _run(self._residual, c, z, residual, jacobian)
        return residual, jacobian

    def linear(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray]:
        """Return the rows of `Equations.linear_rows` at N points, as a tuple with one array (N,
        ..).

        z: (N, k), scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        flat = np.empty((len(z), self._rows[1]))
        _run(self._linear, c, z, flat)
        return (flat,)


class CompiledSystem(SharedSystem):
    """Equations of a trim at many points, in machine code if a compiler works.

    machine: the compiled loops, or None without a compiler or if the equations are not square
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.machine = None
        equations = self.equations
        if equations.square:
            functions = (equations.residual_rows.function, equations.linear_rows.function)
            self.machine = compiled_trim(*functions)
            self.is_quick = self.is_quick or self.machine is not None

    def quick_steps(
        self, z: np.ndarray, c: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the unknowns (N, k) after Newton's method, and two masks (N,).

        The first mask marks the points that converged, the second mask the points that need another
        method.

        z: (N, k), initial scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        if self.machine is None:
            return super().quick_steps(z, c)
        return self.machine.newton(z, c)

    @property
    def residual_rows(self) -> RowsOf:
        """Function of rows (z, c) that returns the residuals r and their Jacobian J.

        The function is machine code if the system is compiled.
        """
        return super().residual_rows if self.machine is None else self.machine.residuals

    @property
    def linear_rows(self) -> RowsOf:
        """Function of rows (z, c) that returns x, u, watched signals, A, B and the residuals.

        The function is machine code if the system is compiled.
        """
        return super().linear_rows if self.machine is None else self.machine.linear


@lru_cache(maxsize=16)
def compiled_trim(residual: ca.Function, linear: ca.Function) -> CompiledTrim | None:
    """Return the compiled loops for the equations of a trim, or None if no compiler works.

    If the result is None, a note is printed.

    residual: function (z, c) -> residuals r and Jacobian J, which must be square
    linear: function (z, c) -> a row of `Equations.linear_rows`
    """
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    sizes: dict[str, int] = {}
    whole = ca.Function("linear", linear.sx_in(), linear.call(linear.sx_in()))
    parts = (*without_shared(residual), whole)
    for function in parts:
        name = function.name()
        generator.add(function)
        for kind in ("arg", "res", "iw", "w"):
            sizes[f"{name}_{kind}"] = max(2, getattr(function, f"sz_{kind}")())
    numbers = {
        "unknowns": residual.numel_in(0),
        "constants": residual.numel_in(1),
        "equations": residual.numel_out(0),
        "given": parts[0].numel_out(0),
        "flat": linear.numel_out(0),
        "most_trials": MOST_TRIALS,
        "longest": LONGEST,
        "nearly": NEARLY,
        "least_share": LEAST_SHARE,
        "unsettled": _UNSETTLED,
        "settled": _SETTLED,
        "singular": _SINGULAR,
    }
    functions = str(generator.dump())
    rows = (residual.numel_out(0), linear.numel_out(0))
    return compiled(
        lambda symbol: _C_TEXT.format(functions=functions, symbol=symbol, **numbers, **sizes),
        lambda symbol, library: CompiledTrim(symbol, library, rows),
        "-O3",
    )


def _run(loop: Any, *arrays: np.ndarray) -> None:
    """Run a compiled loop over the rows of arrays."""
    rows = [np.ascontiguousarray(array) for array in arrays]
    loop(ctypes.c_longlong(len(rows[0])), *(ctypes.c_void_p(row.ctypes.data) for row in rows))
