"""A machine without a home folder has nowhere to keep machine code: everything runs without."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import pytest

from hfa_model.native import machine_code as generated


def test_without_a_home_folder_the_virtual_machine_serves_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    monkeypatch.setattr(generated, "_compiler", lambda: "cc")
    generated._say.cache_clear()
    x = ca.SX.sym("x")
    function = ca.Function("plain", [x], [ca.sin(x)])
    assert generated.machine_code(function) is function
    said = "hfa: cannot compile machine code (Could not determine home directory.); running without\n"
    assert capsys.readouterr().err == said
