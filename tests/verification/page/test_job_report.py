"""What the page says: verdicts that can fail, what the slider shows of an angle, and the claims that were stored."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import pytest
from project import ROOT

from controller import published_game
from hfa_support import BadInputError, NoSolutionError
from verification import analyse_game
from verification.page import main_job
from verification.page.claims import Claims, claims_section, load_claims
from verification.page.job_report import angle_report, verdicts
from verification.page.main_job import MainJob

STORED = ROOT / "studies" / "section5" / "results"


def test_a_pair_that_is_not_regenerated_fails(job: MainJob) -> None:
    assert [row[1] for row in verdicts(job).rows] == ["PASS"] * 3
    pair = job.regeneration.pairs[0]
    wrong = replace(pair, checks=(pair.checks[0]._replace(ok=False, reason="planted"), *pair.checks[1:]))
    planted = replace(job, regeneration=replace(job.regeneration, pairs=(wrong, *job.regeneration.pairs[1:])))
    assert [row[1] for row in verdicts(planted).rows] == ["FAIL", "PASS", "PASS"]
    assert not planted.ok


def test_a_game_without_a_solution_is_said_and_fails(job: MainJob, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    def unsolved(game: object) -> None:
        raise NoSolutionError("no solution: planted")

    monkeypatch.setattr(main_job, "analyse_game", unsolved)
    angle = main_job.with_game(job.points[1])
    text = angle_report(job, angle).text()
    assert "No game solution: no solution: planted" in text
    assert "short period" in text
    planted = replace(job, angles=(angle,))
    assert [row[1] for row in verdicts(planted).rows] == ["PASS", "PASS", "FAIL", "FAIL", "PASS"]


def test_a_solution_is_shown_in_full(job: MainJob) -> None:
    trimmed = job.points[2]
    solution = analyse_game(published_game(trimmed.model.A, trimmed.model.B))
    report = angle_report(job, replace(trimmed, solution=solution))
    assert "Exact game solution for the model at dihedral 15 deg" in report.text()
    assert report.data["solution"]["P"] is not None


@pytest.fixture(scope="module")
def claims() -> Claims:
    return load_claims(STORED)


def test_a_row_each_with_the_verdict_that_is_stored(job: MainJob, claims: Claims) -> None:
    said, table = claims_section(claims, job.regeneration).parts
    stored = claims.data["claims"]
    assert [(row[0], row[-1]) for row in table.rows] == [(claim["number"], claim["verdict"]) for claim in stored]
    assert {row[-1].tone for row in table.rows if row[-1] == "not confirmed"} == {"bad"}
    assert "the same matrices as" in said
    assert "28 not confirmed" in str(verdicts(replace(job, claims=claims)).rows[-1][0])


def test_another_aircraft_is_noticed(job: MainJob, claims: Claims) -> None:
    angle, A, B = claims.models[1]
    for changed in (B * (1 + 1e-6), B[:, 1:]):
        other = claims._replace(models=[claims.models[0], (angle, A, changed)])
        assert "OTHER matrices than" in str(claims_section(other, job.regeneration).parts[0])


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (["schema"], "hfa.report/1"),
        (["verdicts"], []),
        (["setting", "models", 0, "A", 0], [1.0]),
        (["claims", 0, "subject"], "nobody"),
        (["claims", 0, "verdict"], {}),
        (["claims", 0, "findings", "published, modified", "value"], "1"),
    ],
)
def test_a_damaged_table_is_refused(place: list[Any], value: Any, claims: Claims, tmp_path: Path) -> None:
    data = copy.deepcopy(claims.data)
    *path, last = place
    reduce(getitem, path, data)[last] = value
    (tmp_path / "claims.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(BadInputError, match="is damaged"):
        load_claims(tmp_path)
