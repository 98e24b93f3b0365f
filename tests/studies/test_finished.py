"""Stored parts of a study are reused only for the same version and settings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies import finished as module
from studies.finished import finished, row_by_row, stamped

DECIDES = {"seed": 1, "angles": [5.0, 15.0]}


def test_an_outdated_or_damaged_part_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stored part is rejected if the settings or the version differ or the file is damaged."""
    path = tmp_path / "part.json"
    path.write_text(json.dumps(stamped({"result": 3.5, "lost": np.inf}, DECIDES)), encoding="utf-8")
    assert finished(path, dict(reversed(DECIDES.items()))) == stamped(
        {"result": 3.5, "lost": None}, DECIDES
    )
    for other in ({**DECIDES, "seed": 2}, {**DECIDES, "step": 0.1}, {"seed": 1}):
        assert finished(path, other) is None
    whole = path.read_text(encoding="utf-8")
    damaged = [
        whole.replace(*each)
        for each in (("3.5", "3.6"), ("result", "resuld"), (', "lost": null', ""))
    ]
    for text in (*damaged, "", "[1]", '"text"', "{}", '{"toolchain": 1}', "{"):
        path.write_text(text, encoding="utf-8")
        assert finished(path, DECIDES) is None
    path.write_text(whole, encoding="utf-8")
    # Another version of the program.
    monkeypatch.setattr(module, "VERSION", "0.0.1")
    assert finished(path, DECIDES) is None
    assert finished(path.with_name("none.json"), DECIDES) is None


def test_rows_of_other_settings_are_discarded(tmp_path: Path) -> None:
    """Rows are computed once for the same settings. For other settings they are computed again."""
    computed = []

    def row_of(name: str) -> dict[str, Any]:
        computed.append(name)
        return {"aircraft": name, "row": len(computed)}

    path = tmp_path / "rows.json"
    for decides in ({"starts": 30}, {"starts": 30}, {"starts": 2}):
        rows = row_by_row(path, ["A", "B"], None, decides, row_of)
    assert computed == ["A", "B", "A", "B"]
    assert [row["row"] for row in rows] == [3, 4]
    assert json.loads(path.read_text(encoding="utf-8"))["starts"] == 2
    again = row_by_row(path, ["A", "B"], ["A"], {"starts": 2}, row_of)
    assert [row["row"] for row in again] == [5, 4]
