"""The committed table of the paper's update law: it is today's, and what is run again comes out the same."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller import PublishedSettings
from controller.laws import certify
from controller.study.published_study import (
    StudyRow,
    StudyRun,
    planned_runs,
    published_study,
    references_of_models,
)
from controller.study.study_report import load_study, study_data
from controller.study.study_rows import STUDY
from hfa_support import BadInputError, NoSolutionError

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "docs" / "results" / "published_study.json"
QUICK = "theorem gains, explicit"
FINISHED = "learning alone, frozen, implicit"
#: An unstable flight learns along: what it ends at hangs on rounding, whether it overflows does not.
CHAOTIC = ("gains by hand, raw, W(0) = 100", "gains by hand, scaled, W(0) = 100")


@pytest.fixture(scope="module")
def committed() -> dict[str, StudyRow]:
    return {row.name: row for row in load_study(RESULTS)}


@pytest.fixture(scope="module")
def quick() -> StudyRow:
    (row,) = published_study((QUICK,))
    return row


def assert_same_outcome(found: StudyRow, stored: StudyRow) -> None:
    assert len(found.runs) == len(stored.runs)
    for run, other in zip(found.runs, stored.runs, strict=True):
        assert bool(run.overflow) == bool(other.overflow)
        for name in ("lambda_0", "alpha1", "alpha2", "explicit_step_limit"):
            # λ₀ of a poor stack is of the order of rounding, and all four follow from it.
            if run.lambda_0 > 1e-12:
                assert getattr(run, name) == pytest.approx(getattr(other, name), rel=1e-2)
        if run.decided_by_rounding or other.decided_by_rounding:
            continue
        assert (run.stabilizing, run.certified) == (other.stabilizing, other.certified)
        if found.name not in CHAOTIC and not run.overflow and other.P_error > 1e-9:
            assert run.P_error == pytest.approx(other.P_error, rel=0.05)
            assert run.K_error == pytest.approx(other.K_error, rel=0.05)


def markdown(rows: dict[str, StudyRow]) -> list[str]:
    """The table of docs/critics.md."""
    lines = []
    for row in rows.values():
        counts = [len(row.runs), len(row.runs) - len(row.finished)]
        counts += [sum(getattr(run, name) for run in row.runs) for name in ("stabilizing", "certified")]
        by_rounding = "-" if row.decided_by_rounding is None else row.decided_by_rounding
        ranges = [
            _range(*row.span(name)) for name in ("P_error", "K_error", "settled", "lambda_0", "explicit_step_limit")
        ]
        cells = [row.name, *map(str, counts), str(by_rounding), *ranges]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _range(low: float, high: float) -> str:
    if math.isnan(low):
        return "-"
    texts = ["never" if math.isinf(value) else f"{value:.2g}" for value in (low, high)]
    return " to ".join(dict.fromkeys(texts))


def same_settings(one: PublishedSettings, other: PublishedSettings) -> bool:
    """Weights, which another processor rounds in another way, to nine digits; the rest exactly."""
    weights = ("initial_weights", "recorded_weights")
    blank: dict[str, Any] = dict.fromkeys(weights, 0.0)
    pairs = [(np.array(getattr(one, name)), np.array(getattr(other, name))) for name in weights]
    return replace(one, **blank) == replace(other, **blank) and all(
        a.shape == b.shape and np.allclose(a, b, rtol=1e-9, atol=0.0) for a, b in pairs
    )


def test_the_committed_table_is_todays_and_whole(committed: dict[str, StudyRow]) -> None:
    assert tuple(committed) == tuple(STUDY)
    references = references_of_models()
    for name, row in committed.items():
        assert row.cause == STUDY[name].cause
        planned = planned_runs(name, references)
        for run, today in zip(row.runs, planned, strict=True):
            assert (run.dihedral_deg, {"seed": run.seed, "box": run.box}) == (today.dihedral_deg, today.stack)
            assert same_settings(run.settings, today.settings)
        assert not same_settings(row.runs[0].settings, replace(planned[0].settings, eta=0.7))


def test_the_file_comes_back_bit_by_bit(committed: dict[str, StudyRow]) -> None:
    stored = json.loads(RESULTS.read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert study_data(tuple(committed.values())) == stored


def test_a_quick_row_run_again_comes_out_the_same(committed: dict[str, StudyRow], quick: StudyRow) -> None:
    assert_same_outcome(quick, committed[QUICK])


@pytest.mark.slow
def test_every_row_run_again_comes_out_the_same(committed: dict[str, StudyRow]) -> None:
    for row in published_study():
        assert_same_outcome(row, committed[row.name])


def test_another_outcome_is_seen(committed: dict[str, StudyRow]) -> None:
    row = committed[FINISHED]
    assert_same_outcome(row, row)
    for change in ({"overflow": "lost"}, {"certified": True}, {"P_error": 0.2}, {"K_error": 2.0}, {"alpha2": 1.0}):
        with pytest.raises(AssertionError):
            assert_same_outcome(replace(row, runs=(replace(row.runs[0], **change), *row.runs[1:])), row)


def test_ends_that_hang_on_the_ninth_digit_of_the_start_are_said_to(committed: dict[str, StudyRow]) -> None:
    row = committed["theorem gains, implicit"]
    assert {(type(run.P_errors_nearby), len(run.P_errors_nearby)) for run in row.runs} == {(tuple, 2)}
    by_rounding = [run for run in row.runs if run.decided_by_rounding]
    assert by_rounding
    assert all(run.settings.stack_policies == "reevaluated" for run in by_rounding)
    low, high = row.span("P_error")
    assert all(low <= error <= high for run in row.runs for error in (run.P_error, *run.P_errors_nearby))
    steady = replace(by_rounding[0], P_errors_nearby=(1.01 * by_rounding[0].P_error,))
    assert not steady.decided_by_rounding
    assert replace(steady, P_errors_nearby=(1.1 * steady.P_error,)).decided_by_rounding


def test_the_document_shows_the_committed_numbers(committed: dict[str, StudyRow]) -> None:
    document = (ROOT / "docs" / "critics.md").read_text(encoding="utf-8").splitlines()
    table = [line for line in document if line.startswith(tuple(f"| {name} |" for name in STUDY))]
    assert table == markdown(committed)


def test_the_causes_that_the_document_gives_stand_in_the_runs(committed: dict[str, StudyRow]) -> None:
    rows = list(committed.values())
    assert sum(len(row.runs) for row in rows) == 136
    explicit, implicit, raw, scaled, helped, frozen, rich, poor = rows
    assert all(run.explicit_step_limit < 1e-12 * run.settings.step for run in explicit.runs)
    assert not any(run.overflow or run.stabilizing for run in implicit.runs)
    reevaluated = [run for run in implicit.runs if run.settings.stack_policies == "reevaluated"]
    assert (sum(math.isfinite(run.settled) for run in reevaluated), len(reevaluated)) == (12, 16)
    assert sum(run.decided_by_rounding for run in reevaluated) == 2
    assert f"{implicit.span('P_error')[0]:.1e}" == "1.7e-13"
    for row in (raw, scaled):
        assert all(run.overflow for run in row.runs if run.dihedral_deg == 5.0)
    assert all(
        run.settings.gains == (100.0, 100.0) and run.settings.step < run.explicit_step_limit for run in helped.runs
    )
    assert all(run.settled <= 0.9 * 10.0 / 2.0 for run in frozen.runs)
    assert all(run.certified for run in rich.runs)
    assert all(run.last_lambda_0 < 0.01 * run.lambda_0 for run in poor.runs)


@pytest.mark.slow  # hfa study runs the same two rows in tests/cli/test_study_command.py
def test_study_rows_that_take_seconds() -> None:
    seen: list[float] = []
    explicit, frozen = published_study(
        ("theorem gains, explicit", "learning alone, frozen, implicit"), progress=lambda f, _: seen.append(f)
    )
    assert len(explicit.runs) == 48
    assert explicit.finished == ()
    assert all(run.explicit_step_limit < 1e-10 * run.settings.step for run in explicit.runs)
    assert len(frozen.finished) == len(frozen.runs) == 4
    assert all(0.2 < run.P_error < 0.4 and not run.certified for run in frozen.runs)
    assert all(run.settled <= 0.9 * 10.0 / 2.0 for run in frozen.runs)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


@pytest.mark.slow
def test_study_rows_that_take_minutes() -> None:
    rows = {row.name: row for row in published_study(tuple(STUDY)[1:])}
    assert not any(run.certified for run in rows["theorem gains, implicit"].runs)
    assert not any(run.stabilizing for run in rows["theorem gains, implicit"].runs)
    for name in ("gains by hand, raw, W(0) = 100", "gains by hand, scaled, W(0) = 100"):
        assert len(rows[name].finished) < len(rows[name].runs)
        assert all(run.P_error > 0.5 for run in rows[name].finished)
    by_hand = rows["gains by hand, scaled, stabilizing W(0)"]
    assert len(by_hand.finished) == len(by_hand.runs)
    assert all(0.1 < run.P_error < 10.0 for run in by_hand.runs)
    rich, poor = (rows[f"learning alone, re-evaluated, implicit{end}"].runs for end in ("", ", poorer stack"))
    assert sum(run.certified for run in rich) >= 10
    assert not any(run.certified for run in poor)


def test_study_refuses_a_reference_without_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certify, "CORRECTION_LIMIT", 0.0)
    with pytest.raises(NoSolutionError, match="no certified reference for the study: failed: next Newton correction"):
        published_study(("learning alone, frozen, implicit",))


def test_study_rows_say_what_they_hold() -> None:
    with pytest.raises(BadInputError, match="unknown row 'nothing'; choose from theorem gains, explicit"):
        published_study(("nothing",))
    empty = StudyRow("x", "why", (StudyRun(15.0, PublishedSettings(), 1e-9, 1.0, 2.0, 1e-5, overflow="lost"),))
    assert np.isnan(empty.span("P_error")[0])
    assert empty.span("alpha2") == (2.0, 2.0)


def test_processes_share_the_runs(quick: StudyRow) -> None:
    assert repr(published_study((QUICK,), processes=2)) == repr((quick,))  # its numbers that are none are not equal
