"""Rows of a study in a file and back."""

from __future__ import annotations

import json
from pathlib import Path

from controller import PublishedSettings
from controller.study.published_study import StudyRow, StudyRun
from controller.study.study_report import load_study, study_data


def test_a_row_comes_back_as_it_was(tmp_path: Path) -> None:
    settings = PublishedSettings(gains=(1.0, 2.0))
    run = StudyRun(15.0, settings, 1e-9, 1.0, 2.0, 1e-5, P_error=0.5, last_lambda_0=2.0, P_errors_nearby=(0.5, 0.7))
    lost = StudyRun(5.0, settings, 1e-9, 1.0, 2.0, 1e-5, overflow="lost", last_lambda_0=3.0)
    path = tmp_path / "row.json"
    path.write_text(json.dumps(study_data((StudyRow("x", "why", (run, lost)),))), encoding="utf-8")
    (row,) = load_study(path)
    assert row.runs == (run, lost)
    assert row.runs[0].decided_by_rounding
