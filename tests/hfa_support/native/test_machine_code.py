"""Machine code gives the same numbers, is compiled once, and is done without where it cannot be had."""

from __future__ import annotations

import os
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support.native import machine_code as generated


def test_without_a_home_folder_the_virtual_machine_serves_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    monkeypatch.setattr(generated, "c_compiler", lambda: "cc")
    generated._say.cache_clear()
    x = ca.SX.sym("x")
    function = ca.Function("plain", [x], [ca.sin(x)])
    assert generated.machine_code(function) is function
    said = "hfa: cannot compile machine code (Could not determine home directory.); running without\n"
    assert capsys.readouterr().err == said


def test_without_a_compiler_the_virtual_machine_serves_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    x = ca.SX.sym("x")
    function = ca.Function("plain", [x], [ca.sin(x)])
    generated._say.cache_clear()
    monkeypatch.setattr(generated, "c_compiler", lambda: None)
    assert generated.machine_code(function) is function
    assert capsys.readouterr().err == "hfa: no C compiler found; running without machine code\n"

    generated._say.cache_clear()
    monkeypatch.setattr(generated, "c_compiler", lambda: "/bin/false")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert generated.machine_code(function) is function
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.rglob("*.so"))


#: Compilers that end well and make nothing, no library, or a library of something else.
_BROKEN = {
    "nothing": ("", "cannot compile machine code ([Errno 2]"),
    "garbage": ('echo garbage > "$o"', "cannot be loaded); running without"),
    "another library": (
        'echo "int x;" > "$o.c"; cc -shared -fPIC "$o.c" -o "$o"',
        "cannot be loaded); running without",
    ),
}


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("broken", _BROKEN)
def test_with_a_broken_compiler_the_virtual_machine_serves_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, broken: str
) -> None:
    makes, said = _BROKEN[broken]
    compiler = tmp_path / "cc"
    compiler.write_text(f'#!/bin/sh\nwhile [ $# -gt 0 ]; do [ "$1" = -o ] && o="$2"; shift; done\n{makes}\n')
    compiler.chmod(0o755)
    monkeypatch.setattr(generated, "c_compiler", lambda: str(compiler))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    generated._say.cache_clear()
    x = ca.SX.sym("x")
    function = ca.Function("plain", [x], [ca.sin(x)])
    assert generated.machine_code(function) is function
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert said in err
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
def test_machine_code_is_compiled_once_and_gives_the_same_numbers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x", 3)
    function = ca.Function("step", [x], [ca.sin(x) * x])  # `step` is also a symbol of the C library
    compiled = generated.machine_code(function)
    libraries = list(tmp_path.rglob("*.so"))
    assert len(libraries) == 1
    stamp = libraries[0].stat().st_mtime_ns
    generated.machine_code(function)
    assert libraries[0].stat().st_mtime_ns == stamp
    point = np.array([0.3, -1.0, 2.0])
    assert np.array(compiled(point)) == pytest.approx(np.array(function(point)), rel=1e-15)


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_a_library_that_is_not_what_was_compiled_is_compiled_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, damage: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    x = ca.SX.sym("x")
    function = ca.Function("cube", [x], [x**3])
    generated.machine_code(function)
    (library,) = tmp_path.rglob("*.so")
    content = library.read_bytes()
    library.unlink()  # it is loaded
    flipped = content[:5000] + bytes([content[5000] ^ 1]) + content[5001:]
    library.write_bytes({"cut": content[:1000], "flipped": flipped}[damage])
    assert float(generated.machine_code(function)(2.0)) == 8.0
    (again,) = (tmp_path / "cache").rglob("*.so")
    assert again.read_bytes() == content


def test_the_cache_of_another_user_is_not_used(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(generated, "c_compiler", lambda: "cc")
    monkeypatch.setattr(generated.os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    generated._say.cache_clear()
    x = ca.SX.sym("x")
    function = ca.Function("plain", [x], [ca.sin(x)])
    assert generated.machine_code(function) is function
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "hfa-toolchain belongs to another user" in said


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
def test_the_cache_is_closed_to_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    generated.cache_folder().mkdir(mode=0o777)
    x = ca.SX.sym("x")
    before = os.umask(0)  # the compiler would let everybody write
    try:
        generated.machine_code(ca.Function("plain", [x], [ca.sin(x)]))
    finally:
        os.umask(before)
    (library,) = generated.cache_folder().glob("*.so")
    assert [path.stat().st_mode & 0o777 for path in (generated.cache_folder(), library)] == [0o700, 0o700]
