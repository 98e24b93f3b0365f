"""Machine code: equal results, one compilation, and behavior without a working compiler."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support.native import machine_code as generated

needs_compiler = pytest.mark.skipif(
    generated.c_compiler() is None, reason="no C compiler on this machine"
)


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    generated._print_once.cache_clear()
    return generated.cache_folder()


def cube() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("cube", [x], [x**3])


def without_home(patched: pytest.MonkeyPatch) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    patched.delenv("XDG_CACHE_HOME")
    # The user who runs the tests has a home folder.
    patched.setattr(Path, "home", nowhere)


#: Fault -> (script of the compiler that succeeds, or function that plants another fault, text of
#: the note).
_BROKEN = {
    "exit code": ("exit 1", "returned non-zero exit status 1"),
    "garbage": ('echo garbage > "$o"', "running without"),
    "no home": (without_home, "Could not determine home directory."),
}


@needs_compiler
@pytest.mark.parametrize("broken", [*_BROKEN, "no compiler"])
def test_a_broken_compiler_is_noted_and_replaced(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    cache: Path,
    broken: str,
) -> None:
    """Without a working compiler, one note is printed and the function itself is returned.

    No file is left in the cache.
    """
    does, warning = _BROKEN.get(broken, ("", "no C compiler found; running without machine code"))
    compiler = tmp_path / "cc"
    script = does if isinstance(does, str) else 'exec cc "$@"'
    if callable(does):
        does(monkeypatch)
    compiler.write_text(
        f'#!/bin/sh\nwhile [ $# -gt 0 ]; do [ "$1" = -o ] && o="$2"; shift; done\n{script}\n'
    )
    compiler.chmod(0o755)
    # The compiler is searched for once per process.
    monkeypatch.setattr(
        generated, "c_compiler", lambda: None if broken == "no compiler" else str(compiler)
    )
    function = cube()
    assert generated.machine_code(function) is function
    err = capsys.readouterr().err
    assert err.startswith("hfa: ")
    assert err.count("\n") == 1
    assert warning in err
    assert [path for path in cache.rglob("*") if path.is_file()] == []


@needs_compiler
def test_machine_code_gives_the_same_numbers(cache: Path) -> None:
    """A function is compiled once, and its results are equal within rounding."""
    x = ca.SX.sym("x", 3)
    function = ca.Function("step", [x], [ca.sin(x) * x])  # `step` is also a symbol of the C library
    compiled = generated.machine_code(function)
    (library,) = cache.rglob("*.so")
    stamp = library.stat().st_mtime_ns
    generated.machine_code(function)
    assert library.stat().st_mtime_ns == stamp
    point = np.array([0.3, -1.0, 2.0])
    assert np.array(compiled(point)) == pytest.approx(np.array(function(point)), rel=1e-15)


@needs_compiler
@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_a_damaged_library_is_compiled_again(cache: Path, damage: str) -> None:
    """A damaged library in the cache is compiled again.

    The load of a damaged library could end the process with a bus error.
    """
    function = cube()
    generated.machine_code(function)
    (library,) = cache.rglob("*.so")
    content = library.read_bytes()
    library.unlink()  # the library is loaded in this process
    flipped = content[:5000] + bytes([content[5000] ^ 1]) + content[5001:]
    library.write_bytes({"cut": content[:1000], "flipped": flipped}[damage])
    assert float(generated.machine_code(function)(2.0)) == 8.0
    (again,) = cache.rglob("*.so")
    assert again.read_bytes() == content


@needs_compiler
def test_a_linked_cache_is_left_unchanged(cache: Path, tmp_path: Path) -> None:
    """If the cache folder is a link, its target is not changed."""
    target = tmp_path / "target"
    target.mkdir(mode=0o755)
    cache.parent.mkdir(parents=True)
    cache.symlink_to(target)
    assert float(generated.machine_code(cube())(2.0)) == 8.0
    assert target.stat().st_mode & 0o777 == 0o755
    assert not list(target.iterdir())
