"""The stored table of the update-law study is current and can be reproduced."""

from __future__ import annotations

import copy
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT

from studies.update_law.__main__ import main, table
from studies.update_law.study import ROWS, by_rounding, planned, references, summed_up

STORED = json.loads(
    (ROOT / "studies/update_law/results/published_study.json").read_text(encoding="utf-8")
)
COMMITTED: dict[str, dict[str, Any]] = {row["name"]: row for row in STORED["rows"]}
FROZEN = "learning alone, frozen, implicit"
#: Rows with an unstable flight. Their final values depend on rounding, but their overflow does not.
CHAOTIC = ("gains by hand, raw, W(0) = 100", "gains by hand, scaled, W(0) = 100")


def assert_same_outcome(found: dict[str, Any], stored: dict[str, Any]) -> None:
    for run, other in zip(found["runs"], stored["runs"], strict=True):
        assert bool(run["overflow"]) == bool(other["overflow"])
        for name in ("lambda_0", "alpha1", "alpha2", "explicit_step_limit"):
            # λ₀ of nearly dependent samples is of the order of rounding, and determines all four
            # numbers.
            if run["lambda_0"] > 1e-12:
                assert run[name] == pytest.approx(other[name], rel=1e-2)
        if by_rounding(run) or by_rounding(other):
            continue
        assert (run["stabilizing"], run["certified"]) == (other["stabilizing"], other["certified"])
        if found["name"] not in CHAOTIC and not run["overflow"] and other["P_error"] > 1e-9:
            assert run["P_error"] == pytest.approx(other["P_error"], rel=0.05)
            assert run["K_error"] == pytest.approx(other["K_error"], rel=0.05)


def test_the_stored_table_is_current_and_complete() -> None:
    """The stored rows have the current settings, and their summaries follow from their runs."""
    assert tuple(COMMITTED) == tuple(ROWS)
    of = references()
    for name, row in COMMITTED.items():
        assert summed_up(name, row["runs"]) == row
        for run, (reference, case, chosen) in zip(row["runs"], planned(name, of), strict=True):
            stack = (reference.dihedral_deg, case.seed, case.box)
            assert (run["dihedral_deg"], run["seed"], run["box"]) == stack
            stored = run["settings"]
            today = json.loads(json.dumps(asdict(chosen)))
            for weights in (
                "initial_weights",
                "recorded_weights",
            ):  # rounding differs between processors
                np.testing.assert_allclose(stored[weights], today[weights], rtol=1e-9)
            assert stored | {
                weights: 0.0 for weights in stored if "weights" in weights
            } == today | {weights: 0.0 for weights in today if "weights" in weights}


@pytest.mark.slow
def test_a_new_run_reproduces_every_row(tmp_path: Path) -> None:
    """A new run of the study reproduces every stored row."""
    assert main(["-o", str(tmp_path)]) == 0
    for row in json.loads((tmp_path / "published_study.json").read_text())["rows"]:
        assert_same_outcome(row, COMMITTED[row["name"]])


def test_another_outcome_is_detected() -> None:
    """The comparison of a stored with a new row detects a changed overflow, certificate, error
    or gain.
    """
    row = COMMITTED[FROZEN]
    assert_same_outcome(row, row)
    for change in (
        {"overflow": "lost"},
        {"certified": True},
        {"P_error": 0.2},
        {"K_error": 2.0},
        {"alpha2": 1.0},
    ):
        other = copy.deepcopy(row)
        other["runs"][0] |= change
        with pytest.raises(AssertionError):
            assert_same_outcome(other, row)


def test_runs_that_depend_on_rounding_are_counted() -> None:
    """Runs whose result depends on the ninth digit of the initial weights are counted.

    The stored range of errors includes the repeated runs.
    """
    row = COMMITTED["theorem gains, implicit"]
    assert {len(run["P_errors_nearby"]) for run in row["runs"]} == {2}
    hanging = [run for run in row["runs"] if by_rounding(run)]
    assert len(hanging) == row["decided_by_rounding"] == 2
    assert all(run["settings"]["stack_policies"] == "reevaluated" for run in hanging)
    errors = [error for run in row["runs"] for error in (run["P_error"], *run["P_errors_nearby"])]
    assert row["ranges"]["P_error"] == [min(errors), max(errors)]
    assert f"{min(errors):.1e}" == "1.7e-13"
    error = hanging[0]["P_error"]
    assert [
        by_rounding(hanging[0] | {"P_errors_nearby": [factor * error]}) for factor in (1.01, 1.1)
    ] == [False, True]


def test_the_document_shows_the_stored_numbers() -> None:
    """README.md of the study shows the table of the stored rows."""
    readme = ROOT / "studies" / "update_law" / "README.md"
    document = readme.read_text(encoding="utf-8").splitlines()
    shown = [line for line in document if line.startswith(tuple(f"| {name} |" for name in ROWS))]
    assert shown == table(STORED["rows"]).splitlines()[2:]


def test_stored_runs_agree_with_the_documents_causes() -> None:
    """The stored runs agree with the causes stated in README.md."""
    runs = [row["runs"] for row in COMMITTED.values()]
    assert sum(map(len, runs)) == 136
    explicit, implicit, raw, scaled, helped, frozen, rich, poor = runs
    assert all(run["explicit_step_limit"] < 1e-12 * run["settings"]["step"] for run in explicit)
    assert not any(run["overflow"] or run["stabilizing"] for run in implicit)
    reevaluated = [run for run in implicit if run["settings"]["stack_policies"] == "reevaluated"]
    assert (sum(run["settled"] is not None for run in reevaluated), len(reevaluated)) == (12, 16)
    assert all(run["overflow"] for run in (*raw, *scaled) if run["dihedral_deg"] == 5.0)
    for run in helped:
        assert run["settings"]["gains"] == [100.0, 100.0]
        assert run["settings"]["step"] < run["explicit_step_limit"]
    assert all(run["settled"] <= 0.9 * 10.0 / 2.0 for run in frozen)
    assert all(run["certified"] for run in rich)
    assert all(run["last_lambda_0"] < 0.01 * run["lambda_0"] for run in poor)
