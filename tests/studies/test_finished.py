"""A finished part is known by the version and by everything that decided its numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies import finished as module
from studies.finished import finished, stamped

DECIDES = {"seed": 1, "angles": [5.0, 15.0]}


def test_part_is_read_where_nothing_decides_it_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part is read where nothing that decides it differs."""
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
    # Another version of the product.
    monkeypatch.setattr(module, "VERSION", "0.0.1")
    assert finished(path, DECIDES) is None
    assert finished(path.with_name("none.json"), DECIDES) is None
