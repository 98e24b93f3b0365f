"""CasADi Functions as machine code that evaluates several rows at a time."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.native.bound import MAKING, RowFunction
from hfa_support.native.c_code import OPERATIONS, c_function
from hfa_support.progress import print_to_stderr

#: Products and sums are rounded separately, even on processors with fused multiply-add.
_FLAGS = ("-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off")

#: Head of the product of matrices in CasADi's C code, and the same for arrays that do not overlap;
#: its two inner loops, and the same exchanged, which a compiler evaluates for several rows at once.
#: Each sum has the same order, and thus the same bits.
_SLOW_HEAD = """void casadi_mtimes_dense(const casadi_real* x, casadi_int nrow_x, casadi_int ncol_x,
    const casadi_real* y, casadi_int ncol_y, casadi_real* z, casadi_int tr) {"""
_FAST_HEAD = """__attribute__((optimize("O3")))
void casadi_mtimes_dense(const casadi_real* restrict x, casadi_int nrow_x, casadi_int ncol_x,
    const casadi_real* restrict y, casadi_int ncol_y, casadi_real* restrict z, casadi_int tr) {"""
_ROW_LOOP_OUTSIDE = """      for (j=0; j<nrow_x; ++j) {
        for (k=0; k<ncol_x; ++k) {"""
_ROW_LOOP_INSIDE = """      for (k=0; k<ncol_x; ++k) {
        for (j=0; j<nrow_x; ++j) {"""

Loaded = TypeVar("Loaded")


def machine_code(function: ca.Function) -> ca.Function:
    """Return the function compiled to machine code.

    A function that CasADi cannot write in C (`_has_c`) is returned unchanged. Without a working
    compiler, every function is returned unchanged, and a note is printed once.
    """
    if not all(_has_c(called) for called in (function, *function.find_functions())):
        return function
    loaded = compiled(
        lambda symbol: _c_text(function, symbol),
        lambda symbol, library: ca.external(symbol, str(library)),
    )
    return function if loaded is None else loaded


def compiled(
    text: Callable[[str], str], load: Callable[[str, Path], Loaded], optimize: str = "-O2"
) -> Loaded | None:
    """Return a function loaded from a compiled C text, or None if that is not possible.

    None is returned if there is no compiler, or if compilation or loading fails. A note is then
    printed once.

    text: symbol -> C text that defines a function of this name
    load: (symbol, library) -> callable object
    optimize: optimization flag of the compiler

    The library is kept in `cache_folder()`. The symbol contains a hash of the C text, the compiler
    and its flags, because one process cannot load two libraries with equal symbols. A library that
    cannot be loaded is deleted.
    """
    compiler = c_compiler()
    if compiler is None:
        _print_once("no C compiler found; running without machine code")
        return None
    command = [compiler, optimize, *_FLAGS]
    content = "\n".join([text("placeholder"), *command])  # the symbol is not known yet
    symbol = f"hfa_{hashlib.sha256(content.encode()).hexdigest()[:24]}"
    library = None
    try:
        folder = _own_folder(cache_folder())
        library = folder / f"{symbol}.so"
        if not library.exists():
            _compile(command, text(symbol), library)
        return load(symbol, library)
    except (OSError, RuntimeError, AttributeError, subprocess.CalledProcessError) as error:
        if library is not None:
            library.unlink(missing_ok=True)
        why = str(error).partition("\n")[0] or type(error).__name__
        _print_once(f"cannot compile machine code with {compiler} ({why}); running without")
        return None


def cache_folder() -> Path:
    """Return the folder for compiled functions.

    The folder is `$XDG_CACHE_HOME/hfa-toolchain` or, without this variable,
    `~/.cache/hfa-toolchain`. Raises RuntimeError if the user has no home folder.
    """
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "hfa-toolchain"


def _c_text(function: ca.Function, symbol: str) -> str:
    """Return CasADi's C code of a function under the name `symbol`. The inner loops of its matrix
    products are exchanged, which is faster and gives the same bits.
    """
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    arguments: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    generator.add(ca.Function(symbol, arguments, function.call(arguments)))
    text = str(generator.dump())
    return text.replace(_SLOW_HEAD, _FAST_HEAD).replace(_ROW_LOOP_OUTSIDE, _ROW_LOOP_INSIDE)


def _has_c(function: ca.Function) -> bool:
    """Return whether CasADi writes C code for a function. It has none for a function in Python,
    such as one that calls an FMU, nor for the operation erfinv, which math.h lacks.
    """
    if function.class_name() != "SXFunction":
        return bool(function.class_name() != "CallbackInternal")
    operations = {function.instruction_id(place) for place in range(function.n_instructions())}
    return ca.OP_ERFINV not in operations


def _own_folder(folder: Path) -> Path:
    """Return the cache folder, accessible only to the user, and create it if it does not exist.

    Raises RuntimeError if the folder is a link or belongs to another user.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.is_symlink():
        raise RuntimeError(f"{folder} is a link; replace the link with a folder")
    if os.name == "posix" and folder.stat().st_uid != os.geteuid():
        raise RuntimeError(f"{folder} belongs to another user")
    folder.chmod(0o700)
    return folder


def _compile(compiler: list[str], text: str, library: Path) -> None:
    """Compile a C text to a library, which is moved to its place when it is complete.

    compiler: command line without files
    """
    with tempfile.TemporaryDirectory(dir=library.parent) as temporary:
        source = Path(temporary, "generated.c")
        made = Path(temporary, "generated.so")
        source.write_text(text, encoding="utf-8")
        command_line = [*compiler, str(source), "-o", str(made), "-lm"]
        # Files of the compiler go with the temporary folder, also after it fails.
        environment = {**os.environ, "TMPDIR": temporary}
        subprocess.run(command_line, env=environment, check=True, capture_output=True)
        made.chmod(0o700)  # nobody else may change or read it
        made.replace(library)


@cache
def c_compiler() -> str | None:
    """Return the path of the C compiler: the command in CC (default cc), else gcc, else clang; None
    if none of them exists.
    """
    return shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")


@cache
def _print_once(message: str) -> None:
    """Print a message on standard error, each message once per process."""
    print_to_stderr(f"hfa: {message}")


#: Number of rows per register, its lanes: two for any 64-bit processor, four with AVX2. The results
#: have identical bits.
_LANES = 2
_LANES_OF_AVX2 = 4
#: Functions of math.h of one and of two arguments, which are called lane by lane.
_UNARY = (
    *("sqrt", "fabs", "floor", "ceil", "exp", "log", "expm1", "log1p", "erf"),
    *("sin", "cos", "tan", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
_BINARY = ("pow", "atan2", "hypot", "fmod", "remainder", "copysign")
#: Operation -> C expression for operands with one number for each row. A condition is 1.0 or 0.0.
_ON_LANES = {
    ca.OP_CONST: "(real){{}} + {0}",
    ca.OP_FMIN: "lanes_fmin({0}, {1})",
    ca.OP_FMAX: "lanes_fmax({0}, {1})",
    ca.OP_LT: "truth({0} < {1})",
    ca.OP_LE: "truth({0} <= {1})",
    ca.OP_EQ: "truth({0} == {1})",
    ca.OP_NE: "truth({0} != {1})",
    ca.OP_NOT: "truth({0} == 0.0)",
    ca.OP_AND: "truth(({0} != 0.0) & ({1} != 0.0))",
    ca.OP_OR: "truth(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_SIGN: "chosen({0} == {0}, truth({0} > 0.0) - truth({0} < 0.0), {0})",
    ca.OP_IF_ELSE_ZERO: "(real)(({0} != 0.0) & (mask){1})",
}
#: Operation that calls a function of math.h -> C expression for operands with several lanes.
_FROM_MATH = {
    operation: f"lanes_{text}"
    for operation, text in OPERATIONS.items()
    if text.partition("(")[0] in (*_UNARY, *_BINARY)
}
_LANE_OPERATIONS = {**OPERATIONS, **_FROM_MATH, **_ON_LANES}

#: Operation -> C expression for one row, with scalar operands.
_ROW_OPERATIONS = {
    **OPERATIONS,
    ca.OP_FMIN: "lanes_fmin({0}, {1})",
    ca.OP_FMAX: "lanes_fmax({0}, {1})",
}

_HEAD = """
{target}
#include <math.h>
#define INLINE static inline __attribute__((always_inline, unused))
"""
_ROW_HEAD = """
#define LANES 1
#define LANE(number, i) number
typedef double real;

INLINE real lanes_fmax(real a, real b) { return (a > b) | (b != b) ? a : b; }
INLINE real lanes_fmin(real a, real b) { return (a < b) | (b != b) ? a : b; }
"""
_LANES_HEAD = """
#define LANES {lanes}
#define LANE(number, i) number[i]
typedef double real __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));
#define UNARY(name) INLINE real lanes_##name(real a) \\
    {{ for (int i = 0; i < LANES; i++) a[i] = name(a[i]); return a; }}
#define BINARY(name) INLINE real lanes_##name(real a, real b) \\
    {{ for (int i = 0; i < LANES; i++) a[i] = name(a[i], b[i]); return a; }}

INLINE real truth(mask holds) {{ return (real)(holds & (mask)((real){{}} + 1.0)); }}
INLINE real chosen(mask first, real a, real b)
{{
    return (real)((first & (mask)a) | (~first & (mask)b));
}}
INLINE real lanes_fmax(real a, real b) {{ return chosen((a > b) | (b != b), a, b); }}
INLINE real lanes_fmin(real a, real b) {{ return chosen((a < b) | (b != b), a, b); }}
"""

_LOOP = """
void {symbol}(long long count, const double *const *tables, double *const *results)
{{
    for (long long first = 0; first < count; first += LANES) {{
        int rows = count - first < LANES ? (int)(count - first) : LANES;
        {memory}
        {read}
        of_rows({names});
        {write}
    }}
}}
"""
_READ = """for (int j = 0; j < {size}; j++)
            for (int i = 0; i < LANES; i++)
                LANE({name}[j], i) = tables[{index}][(first + (i < rows ? i : 0)) * {size} + j];"""
_WRITE = """for (int j = 0; j < {size}; j++)
            for (int i = 0; i < rows; i++)
                results[{index}][(first + i) * {size} + j] = LANE({name}[j], i);"""


class RowCode(threading.local):
    """Compiled function that is evaluated for each row of its arguments.

    Several threads may call the function in parallel. Each thread has its own memory.
    """

    def __init__(self, function: ca.Function, symbol: str, library: Path) -> None:
        """Load the C function `symbol` of a library, which evaluates `function` for many rows."""
        self._call = getattr(ctypes.CDLL(str(library)), symbol)
        self._argument_sizes = [function.numel_in(index) for index in range(function.n_in())]
        self._result_sizes = [function.numel_out(index) for index in range(function.n_out())]
        self._bind(0)  # the first call binds the number of its rows

    def _bind(self, count: int) -> None:
        """Allocate memory for arguments and results of `count` rows, and bind the code to it."""
        self._tables = [np.empty((count, width)) for width in self._argument_sizes]
        self._results = [np.empty((count, size)) for size in self._result_sizes]
        self._evaluate = self.bound(self._tables, self._results)

    def __call__(self, *tables: Any) -> list[np.ndarray]:
        """Return the results (N, size of the result) for arguments (N, size of the argument).

        Raises ValueError for an argument of another shape.
        """
        count = len(tables[0])
        if count != len(self._tables[0]):
            self._bind(count)
        for memory, table in zip(self._tables, tables, strict=True):
            if np.shape(table) != memory.shape:
                raise ValueError(f"a table has the shape {np.shape(table)}, not {memory.shape}")
            memory[:] = table
        self._evaluate()
        return [result.copy() for result in self._results]

    def bound(
        self, tables: Sequence[np.ndarray], results: Sequence[np.ndarray]
    ) -> Callable[[], Any]:
        """Return a function without arguments that evaluates all rows of the tables into `results`.

        A result may be one of the tables. Raises ValueError unless all arrays are contiguous, of
        doubles and of matching shapes.
        """
        count = len(tables[0])
        widths = (*self._argument_sizes, *self._result_sizes)
        for array, width in zip((*tables, *results), widths, strict=True):
            if array.shape != (count, width) or array.dtype != float or not array.data.contiguous:
                raise ValueError(
                    "a bound table is not a contiguous array of doubles with all rows; copy the "
                    "table"
                )
        addresses = _addresses(tables), _addresses(results)
        return partial(self._call, ctypes.c_longlong(count), *addresses)


def row_code(function: ca.Function, one_row: bool = False) -> RowCode | RowFunction:
    """Return a CasADi Function compiled for many rows.

    Operations that cannot be written in C are compiled by CasADi if possible. If no compiler is
    available or compilation fails, CasADi evaluates the function.

    function: the Function, with dense arguments and results
    one_row: whether one row is evaluated at a time
    """
    with MAKING:  # one thread at a time builds expressions
        try:
            text = _text(function, one_row)
        except (BadInputError, RuntimeError):
            return RowFunction(machine_code(function))
    code = compiled(
        lambda symbol: text.replace("SYMBOL", symbol),
        lambda symbol, library: RowCode(function, symbol, library),
    )
    return RowFunction(function) if code is None else code


def _text(function: ca.Function, one_row: bool) -> str:
    """Return the C source of a function of many rows, whose name is SYMBOL.

    one_row: whether one row is evaluated at a time, and not one in each lane of a register

    Raises RuntimeError if CasADi cannot expand the function to scalars, and BadInputError if
    `c_function` does not support an operation.
    """
    scalars = function if function.is_a("SXFunction") else function.expand()
    arguments = tuple(f"x{index}" for index in range(function.n_in()))
    results = tuple(f"y{index}" for index in range(function.n_out()))
    # Lines of C that declare arrays of a block of rows, fill the arguments and store the results.
    memory, read, write = [], [], []
    for index, name in enumerate(arguments):
        size = function.numel_in(index)
        memory.append(f"real {name}[{max(1, size)}];")
        read.append(_READ.format(name=name, index=index, size=size))
    for index, name in enumerate(results):
        size = function.numel_out(index)
        memory.append(f"real {name}[{max(1, size)}];")
        write.append(_WRITE.format(name=name, index=index, size=size))
    loop = _LOOP.format(
        symbol="SYMBOL",
        memory="\n        ".join(memory),
        read="\n        ".join(read),
        names=", ".join([*arguments, *results]),
        write="\n        ".join(write),
    )

    target, lanes = _registers()
    head = _ROW_HEAD
    operations = _ROW_OPERATIONS
    if not one_row:
        from_math = [f"UNARY({name})" for name in _UNARY]
        from_math += [f"BINARY({name})" for name in _BINARY]
        head = _LANES_HEAD.format(lanes=lanes) + "\n".join(from_math)
        operations = _LANE_OPERATIONS
    body = c_function(scalars, "of_rows", arguments, results, "real", operations)
    return "\n".join([_HEAD.format(target=target), head, body, loop])


def _registers() -> tuple[str, int]:
    """Return the line of C that enables AVX2, and the number of doubles in a register. The line is
    "" for a processor without AVX2.
    """
    try:
        features = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    except OSError:  # not Linux
        features = []
    if "avx2" in features:
        return '#pragma GCC target("avx2")', _LANES_OF_AVX2
    return "", _LANES


def _addresses(arrays: Sequence[np.ndarray]) -> Any:
    """Return the addresses of the entries of arrays, as a C array."""
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
