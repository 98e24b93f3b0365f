"""`hfa identify`: one run, held against the committed parameters, the documents and its own files."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cli import Result, hfa
from project import ROOT

from hfa_model import default_parameters, load_parameters
from trim import identification
from trim.identification import ALTERNATIVES, Identification, run_identification

COMMITTED = ROOT / "hfa_model"
FILE = "parameters.toml"


class Run(NamedTuple):
    """The output of one run, its folder and its findings."""

    result: Result
    folder: Path
    found: Identification


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("identify")
    found = []

    def kept(*arguments: Any) -> Identification:
        found.append(run_identification(*arguments))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identification, "run_identification", kept)
        with contextlib.chdir(folder):
            result = hfa("identify", "-o", "evidence.json")
            found[0].fit.save(Path(FILE))
    return Run(result, folder, found[0])


def test_it_writes_the_committed_parameters(identified: Run) -> None:
    # Not the same bits: another processor rounds the linear algebra in another order.
    found, committed = (load_parameters(folder / FILE) for folder in (identified.folder, COMMITTED))
    assert found.sources == committed.sources
    assert found.notes == committed.notes
    assert found.values._asdict() == pytest.approx(committed.values._asdict(), rel=1e-8)
    assert found.standard_errors == pytest.approx(committed.standard_errors, rel=1e-4)


def test_the_output_may_be_the_parameters(identified: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identification, "run_identification", lambda *_: identified.found)
    path = tmp_path / "mine.TOML"
    assert hfa("identify", "-o", str(path)).code == 0
    written, committed = load_parameters(path), load_parameters(identified.folder / FILE)
    assert written.values == committed.values


def test_the_json_file_holds_the_same_parameters(identified: Run) -> None:
    data = json.loads((identified.folder / "evidence.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    shipped = default_parameters()
    values = {name: row["value"] for name, row in data["parameters"].items()}
    assert values == pytest.approx(shipped.values._asdict(), rel=1e-8)
    errors = {name: row["standard_error"] for name, row in data["parameters"].items() if row["standard_error"]}
    assert errors == pytest.approx(shipped.standard_errors, rel=1e-4)
    assert len(data["entries"]) == 132
    assert np.sum([entry["half_units"] ** 2 for entry in data["entries"]]) == pytest.approx(data["sum_of_squares"])
    assert [row["description"] for row in data["structures"]] == ["published", *(name for name, _ in ALTERNATIVES)]
