"""Compilation of CasADi Functions to machine code, cached by content.

A compiled function runs several times faster than in CasADi's virtual machine, and the results are
equal within rounding. If there is no C compiler or the compilation fails, one line on standard
error reports it and the virtual machine is used.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import casadi as ca

from hfa_support.progress import print_to_stderr

#: Products and sums are rounded separately, even on processors with fused multiply-add.
_FLAGS = ("-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off")

#: Product of matrices in CasADi's C code, and the same with the sums of all rows side by side. Each
#: sum has the same order, and thus the same bits.
_PRODUCT = """void casadi_mtimes_dense(const casadi_real* x, casadi_int nrow_x, casadi_int ncol_x,
    const casadi_real* y, casadi_int ncol_y, casadi_real* z, casadi_int tr) {"""
_FAST_PRODUCT = """__attribute__((optimize("O3")))
void casadi_mtimes_dense(const casadi_real* restrict x, casadi_int nrow_x, casadi_int ncol_x,
    const casadi_real* restrict y, casadi_int ncol_y, casadi_real* restrict z, casadi_int tr) {"""
_BY_ROWS = """      for (j=0; j<nrow_x; ++j) {
        for (k=0; k<ncol_x; ++k) {"""
_SIDE_BY_SIDE = """      for (k=0; k<ncol_x; ++k) {
        for (j=0; j<nrow_x; ++j) {"""

Loaded = TypeVar("Loaded")


def machine_code(function: ca.Function) -> ca.Function:
    """Return the function compiled to machine code.

    Without a working compiler, a note is printed once and the function is returned unchanged. A
    function that calls an FMU, which is compiled already, or erfinv, which C does not have, is
    returned unchanged.
    """
    if any(not _has_c(each) for each in (function, *function.find_functions())):
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
    and its flags. One process cannot load two libraries with equal symbols. The owner and the hash
    of a kept library are checked before it is loaded. A library that cannot be loaded is deleted.
    """
    compiler = c_compiler()
    if compiler is None:
        _print_once("no C compiler found; running without machine code")
        return None
    command = [compiler, optimize, *_FLAGS]
    content = "\n".join([text("placeholder"), *command])
    symbol = f"hfa_{hashlib.sha256(content.encode()).hexdigest()[:24]}"
    library = None
    try:
        folder = _own_folder(cache_folder())
        kept = [path for path in folder.glob(f"{symbol}-*.so") if _is_own(path, symbol)]
        library = kept[0] if kept else _compile(command, text(symbol), folder, symbol)
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
    """Return CasADi's C code of a function under the name `symbol`, with `_FAST_PRODUCT`."""
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    arguments: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    generator.add(ca.Function(symbol, arguments, function.call(arguments)))
    text = str(generator.dump())
    return text.replace(_PRODUCT, _FAST_PRODUCT).replace(_BY_ROWS, _SIDE_BY_SIDE)


def _has_c(function: ca.Function) -> bool:
    """Return whether CasADi has C code of a function: of no callback of Python and of no erfinv."""
    if function.class_name() != "SXFunction":
        return bool(function.class_name() != "CallbackInternal")
    operations = {function.instruction_id(place) for place in range(function.n_instructions())}
    return ca.OP_ERFINV not in operations


def _own_folder(folder: Path) -> Path:
    """Return the cache folder, accessible only to the user, and create it if it does not exist."""
    # Raises RuntimeError if the folder is a link or belongs to another user.
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.is_symlink():
        raise RuntimeError(f"{folder} is a link; replace the link with a folder")
    if os.name == "posix" and folder.stat().st_uid != os.geteuid():
        raise RuntimeError(f"{folder} belongs to another user")
    folder.chmod(0o700)
    return folder


def _compile(compiler: list[str], text: str, folder: Path, symbol: str) -> Path:
    """Return the library of a C text, `symbol-digest.so` in a folder.

    It is complete when it is moved to its name. The digest is checked before a library is loaded.
    """
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        source = Path(temporary, "generated.c")
        library = Path(temporary, "generated.so")
        source.write_text(text, encoding="utf-8")
        command_line = [*compiler, str(source), "-o", str(library), "-lm"]
        # Files of the compiler go with the temporary folder, also after it fails.
        environment = {**os.environ, "TMPDIR": temporary}
        subprocess.run(command_line, env=environment, check=True, capture_output=True)
        library.chmod(0o700)  # nobody else may change or read it
        return library.replace(folder / f"{symbol}-{_digest(library, symbol)}.so")


def _is_own(file: Path, symbol: str) -> bool:
    """Return whether a library is this user's and has the hash in its name."""
    status = file.lstat()
    if not stat.S_ISREG(status.st_mode):
        return False
    if os.name == "posix" and status.st_uid != os.geteuid():
        return False
    return file.stem.endswith(_digest(file, symbol))


def _digest(file: Path, symbol: str) -> str:
    return hashlib.sha256(symbol.encode() + file.read_bytes()).hexdigest()[:24]


@cache
def c_compiler() -> str | None:
    """Return the path of a C compiler, or None if there is none.

    The command in CC (default cc) is preferred, then gcc, then clang.
    """
    return shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")


@cache
def _print_once(message: str) -> None:
    """Print a message on standard error. The same message is printed only once per process."""
    print_to_stderr(f"hfa: {message}")
