"""A CasADi Function at many points at once, on the vector unit of this machine."""

from __future__ import annotations

import ctypes
import hashlib
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.native.c_code import c_loop
from hfa_support.native.machine_code import loaded

#: Without trapping and errno every operation has a vector form; glibc declares its vector functions where
#: __FAST_MATH__ is defined, and GCC must not join sin and cos into one function, which has none. What -ffast-math
#: itself changes, the order of sums and nan, stays as it is written.
_FLAGS = (
    *("-O3", "-march=native", "-fPIC", "-shared", "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math"),
    *("-D__FAST_MATH__", "-fdisable-tree-sincos"),
)
#: Points a call: what it works on stays in the cache, and no power of two, whose columns would share lines of it.
_CHUNK = 250


def vector_code(function: ca.Function) -> Callable[..., np.ndarray] | None:
    """(N, size) of each argument -> (N, size) of the one result, a row a point; None where it cannot be compiled.

    function: a dense SX Function of columns with one result. May be called from several threads.
    """

    def load(symbol: str, library: Path) -> Any:
        return getattr(ctypes.CDLL(str(library)), symbol)

    run = loaded(lambda symbol: c_loop(function, symbol), _FLAGS, load, _machine())
    if run is None:
        return None
    sizes = [function.numel_in(index) for index in range(function.n_in())]
    result = function.numel_out(0)

    def evaluate(*tables: np.ndarray) -> np.ndarray:
        count = len(tables[0])
        flat = np.empty((count, result))
        for begin in range(0, count, _CHUNK):
            rows = slice(begin, min(begin + _CHUNK, count))
            columns = [np.ascontiguousarray(table[rows].T, dtype=float) for table in tables]
            if [len(each) for each in columns] != sizes:
                raise ValueError(f"{function.name()} takes tables with {sizes} columns")
            out = np.empty((result, rows.stop - begin))
            places = (ctypes.c_void_p * len(columns))(*(each.ctypes.data for each in columns))
            run(ctypes.c_long(rows.stop - begin), places, ctypes.c_void_p(out.ctypes.data))
            flat[rows] = out.T
        return flat

    return evaluate


def _machine() -> str:
    """What -march=native depends on: a library of another processor is not this one's."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        about = sorted({line for line in text.splitlines() if line.startswith(("model", "flags", "Features"))})
    except OSError:
        about = [platform.machine(), platform.processor()]
    return hashlib.sha256("\n".join(about).encode()).hexdigest()
