"""Tests of the benchmarks: equal results of peers, stored figures, and the table of the page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from project import ROOT

import hfa
from benchmarks import __main__ as bench, jobs, report
from hfa.paper import level_flight

F16 = hfa.load_model(f"{ROOT}/examples/f16.py:F16")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:number of constraints")
@pytest.mark.parametrize(
    ("condition", "name", "values"),
    [
        (level_flight(0.1), "dihedral", [0.1, 0.2]),
        (hfa.TrimCondition(F16, F16.trim), "turn_rate", [0.0, 0.1]),
    ],
)
def test_python_control_trims_and_linearizes_the_same_aircraft(
    condition: hfa.TrimCondition, name: str, values: list[float]
) -> None:
    """python-control finds the same trims, and its finite differences give A within 2e-3."""
    theirs = jobs.control_points(condition)(name, values)
    for value, (point, model) in zip(values, theirs, strict=True):
        imposed = {**condition.imposed, name: value}
        ours = hfa.trim(condition.model, replace(condition, imposed=imposed))
        np.testing.assert_allclose(point.states, ours.states, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(point.inputs, ours.inputs, rtol=1e-6, atol=1e-6)
        A = condition.model.at(list(ours.states), list(ours.inputs)).A
        np.testing.assert_allclose(model.A, A, atol=2e-3)


@pytest.mark.slow
def test_every_job_runs(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every job runs at a toy size, and no result is stored."""
    monkeypatch.setattr(report, "store", lambda *_: pytest.fail("stored"))
    assert bench.main(["--quick"]) == 0
    assert capsys.readouterr().out.count("| job |") == len(jobs.JOBS)


def test_the_page_shows_the_stored_figures() -> None:
    """The page shows the stored results; nothing else compares the two."""
    assert report.shown(report.stored()) in report.PAGE.read_text("utf-8")
