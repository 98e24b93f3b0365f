"""What the page says: verdicts that can fail, and what the slider shows of an angle."""

from __future__ import annotations

import re
from dataclasses import replace

from controller import published_game
from hfa_model import published_models
from hfa_support import NoSolutionError
from hfa_support.reporting.text import four_decimals
from hfa_support.reporting.unit_system import shown_in
from verification import analyse_game
from verification.page import main_job
from verification.page.job_report import angle_report, point_report, verdicts
from verification.page.main_job import AngleResult, MainJob
from verification.page.page_html import slider


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
    angle = main_job.angle_result(job.aircraft, job.points[1].dihedral)
    text = angle_report(job, angle).text()
    assert "No game solution: no solution: planted" in text
    assert "short period" in text
    planted = replace(job, angles=(angle,))
    assert [row[1] for row in verdicts(planted).rows] == ["PASS", "PASS", "FAIL", "FAIL", "PASS"]


def test_a_solution_is_shown_in_full(job: MainJob) -> None:
    trimmed = job.points[2]
    solution = analyse_game(published_game(trimmed.model.A, trimmed.model.B))
    report = angle_report(job, AngleResult(trimmed, solution=solution))
    assert "Exact game solution for the model at dihedral 15 deg" in report.text()
    assert report.data["solution"]["P"] is not None


def test_the_print_stands_beside_a_model_in_its_own_units(job: MainJob) -> None:
    report = angle_report(job, AngleResult(job.points[2], printed=published_models()[1]))
    assert "printed" in report.text()
    with shown_in("si"):
        assert "printed" not in angle_report(job, AngleResult(job.points[2], printed=published_models()[1])).text()


def test_the_slider_shows_trim_modes_and_matrices(job: MainJob) -> None:
    point = job.points[2]
    text = point_report(job, point).text()
    assert text.startswith("At dihedral 15 deg\n\nTrim, published dynamics: trimmed")
    assert four_decimals(point.model.A[3, 1]) in text
    assert "phugoid" in text
    assert "No trim: " in point_report(job, job.points[-1]).text()


def test_the_slider_begins_at_the_first_angle_that_was_asked_for(job: MainJob) -> None:
    shown = [f"{point.dihedral_deg:g}" for point in job.points]
    for asked in (1, 2):
        text = slider(replace(job, angles=(AngleResult(job.points[asked]),)))
        assert re.findall(r'data-angle="([\d.]+) deg">', text) == [shown[asked]]
        assert f'value="{asked}" aria-valuetext="{shown[asked]} deg"' in text
    assert 'value="0"' in slider(job)
