"""CasADi Functions as machine code: generated C, compiled once, cached by content.

With a C compiler a function runs several times faster than in CasADi's virtual machine, and gives
the same numbers to rounding. Without one, or when compiling fails, the virtual machine serves; one
line on standard error says so."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca

from hfa_support.files import temporary_folder
from hfa_support.progress import say_aside

_FLAGS = ("-O2", "-fPIC", "-shared", "-fno-math-errno")


def machine_code(function: ca.Function) -> ca.Function:
    """The same function compiled to machine code, or with one note the function itself where no
    compiler works.

    The library is kept in `cache_folder()` under two hashes: of the C text, the compiler and its
    flags, and of its own content, which is checked before it is loaded. Its symbol carries the
    first, because two libraries of one name cannot live in one process. A library that cannot be
    loaded is not kept."""
    compiler = c_compiler()
    if compiler is None:
        _say("no C compiler found; running without machine code")
        return function
    key = hashlib.sha256(
        "\n".join([_c_text(function, "placeholder"), compiler, *_FLAGS]).encode()
    ).hexdigest()[:24]
    symbol, library = f"hfa_{key}", None
    try:
        folder = _own_folder(cache_folder())
        kept = [each for each in folder.glob(f"{symbol}-*.so") if each.stem.endswith(_digest(each))]
        library = (
            kept[0]
            if kept
            else _compile([compiler, *_FLAGS], _c_text(function, symbol), folder, symbol)
        )
        return ca.external(symbol, str(library))
    except (OSError, RuntimeError, subprocess.CalledProcessError) as error:
        if library is not None:
            library.unlink(missing_ok=True)
        _say(
            f"cannot compile machine code with {compiler} ({str(error).splitlines()[0]}); running without"
        )
        return function


def cache_folder() -> Path:
    """Where compiled functions are kept: `$XDG_CACHE_HOME/hfa-toolchain`, by default under
    `~/.cache`.

    RuntimeError when there is no home folder.
    """
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "hfa-toolchain"


def _c_text(function: ca.Function, symbol: str) -> str:
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    arguments: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    generator.add(ca.Function(symbol, arguments, function.call(arguments)))
    return str(generator.dump())


def _own_folder(folder: Path) -> Path:
    """The folder, made if need be, which only its owner can write; RuntimeError when that is
    somebody else."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name == "posix" and folder.stat().st_uid != os.geteuid():
        raise RuntimeError(f"{folder} belongs to another user")
    folder.chmod(0o700)
    return folder


def _compile(compiler: list[str], text: str, folder: Path, symbol: str) -> Path:
    with temporary_folder(folder) as temporary:
        source, made = temporary / "generated.c", temporary / "generated.so"
        source.write_text(text, encoding="utf-8")
        words = [*compiler, str(source), "-o", str(made), "-lm"]
        subprocess.run(
            words, env={**os.environ, "TMPDIR": str(temporary)}, check=True, capture_output=True
        )
        made.chmod(0o700)
        return made.replace(folder / f"{symbol}-{_digest(made)}.so")


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:24]


@cache
def c_compiler() -> str | None:
    """The compiler that CC names, else cc, gcc or clang; None when there is none."""
    return shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")


@cache
def _say(message: str) -> None:
    """Once a process and message."""
    say_aside(f"hfa: {message}")
