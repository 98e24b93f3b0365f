"""A finished part is known by the version and by everything that decided its numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies import finished as module
from studies.finished import finished, stamped

DECIDES = {"seed": 1, "angles": [5.0, 15.0]}


@pytest.fixture
def part(tmp_path: Path) -> Path:
    path = tmp_path / "part.json"
    path.write_text(json.dumps(stamped({"result": 3.5, "lost": np.inf}, DECIDES)), encoding="utf-8")
    return path


def test_a_part_of_today_is_read(part: Path) -> None:
    found = finished(part, DECIDES)
    assert found == stamped({"result": 3.5, "lost": None}, DECIDES)
    assert found.keys() == {"result", "lost", "toolchain", "identity", "digest"}
    assert finished(part, dict(reversed(DECIDES.items()))) is not None


@pytest.mark.parametrize("decides", [{**DECIDES, "seed": 2}, {**DECIDES, "step": 0.1}, {"seed": 1}])
def test_what_others_decided_is_not(part: Path, decides: dict[str, object]) -> None:
    assert finished(part, decides) is None


def test_another_version_is_not(part: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "toolchain_version", lambda: "0.0.1")
    assert finished(part, DECIDES) is None


@pytest.mark.parametrize(("written", "damaged"), [("3.5", "3.6"), ("result", "resuld"), (', "lost": null', "")])
def test_a_damaged_one_is_not(part: Path, written: str, damaged: str) -> None:
    text = part.read_text(encoding="utf-8")
    assert text.count(written) == 1
    part.write_text(text.replace(written, damaged), encoding="utf-8")
    assert finished(part, DECIDES) is None


@pytest.mark.parametrize("text", ["", "[1]", '"text"', "{}", '{"toolchain": 1}', "{"])
def test_what_is_no_part_is_not(part: Path, text: str) -> None:
    part.write_text(text, encoding="utf-8")
    assert finished(part, DECIDES) is None
    assert finished(part.with_name("none.json"), DECIDES) is None
