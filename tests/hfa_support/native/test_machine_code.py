"""Machine code: the same results without a working compiler, and a note."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import casadi as ca
import pytest
from cli import hfa_process
from project import ROOT

from hfa_support.native.machine_code import machine_code

WORDS = (
    *("solve", "--aircraft", f"{ROOT}/examples/pendulum.py:PENDULUM"),
    *("--Q", "1,0.1", "--R", "1", "--delta", "inf", "--order", "3", "--json"),
)


def test_a_function_is_evaluated_without_a_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A compiler that fails is noted, and CasADi evaluates the function."""
    monkeypatch.setattr("hfa_support.native.machine_code.c_compiler", lambda: "false")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    function = machine_code(ca.Function("f", [x], [ca.sin(x)]))
    assert float(function(0.5)) == pytest.approx(math.sin(0.5), rel=1e-15)
    assert "cannot compile" in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("script", ["exit 1", 'echo garbage > "$o"'])
def test_a_broken_compiler_is_noted_and_replaced(tmp_path: Path, script: str) -> None:
    """Without a working compiler, one note is printed, and the results are the same.

    No file is left in the cache.
    """
    compiler = tmp_path / "broken"
    compiler.write_text(
        f'#!/bin/sh\nwhile [ $# -gt 0 ]; do [ "$1" = -o ] && o="$2"; shift; done\n{script}\n'
    )
    compiler.chmod(0o755)
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    compiled = hfa_process(*WORDS, folder=tmp_path, XDG_CACHE_HOME=str(right))
    assert [path.suffix for path in right.rglob("*") if path.is_file()].count(".so") == 1
    broken = hfa_process(*WORDS, folder=tmp_path, CC=str(compiler), XDG_CACHE_HOME=str(wrong))
    assert (compiled.code, broken.code) == (0, 0)
    notes = [line for line in broken.err.splitlines() if line not in compiled.err.splitlines()]
    assert len(notes) == 1
    assert "compile" in notes[0]
    radii = [
        [radius["c"] for radius in json.loads(result.out)["radii"]] for result in (compiled, broken)
    ]
    assert radii[0] == pytest.approx(radii[1], rel=1e-9)
    assert not [path for path in wrong.rglob("*") if path.is_file()]
