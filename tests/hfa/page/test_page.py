"""The page of `hfa report`: verdicts, stored results of studies, and plots.

The verdicts fail on planted errors. The plots contain the numbers of the models.
"""

from __future__ import annotations

import copy
import json
import re
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plotly.graph_objects import Figure
from project import ROOT

pytest.importorskip("hfa_flight")

import hfa_model
from hfa import BadInputError, NoSolutionError, sweep
from hfa.page.claims import Claims, claims_section, load_claims
from hfa.page.flights import flights_section, load_flights
from hfa.page.job_report import angle_report, any_angle, verdict_sentence, verdicts
from hfa.page.main_job import MainJob, main_job, with_game
from hfa.page.plots import front_view, in_script, locus_plot
from hfa_aircraft.model import Model
from hfa_model.parameters import ParameterSet
from hfa_support.reporting.report import Report


@pytest.fixture(scope="module")
def job(parameter_set: ParameterSet) -> MainJob:
    """Return the results for a page without games.

    The results contain both printed pairs and five angles. One angle has no trim.
    """
    return main_job(
        parameter_set, "published", asked=(), swept=np.radians([5.0, 10.0, 15.0, 20.0, 59.0])
    )


STORED = ROOT / "studies" / "section5" / "results"


def test_a_pair_that_is_not_regenerated_fails(job: MainJob) -> None:
    """A printed pair that is not regenerated (planted) makes the report fail."""
    assert [row[1] for row in verdicts(job).rows] == ["PASS"] * 3
    pair = job.regeneration.pairs[0]
    wrong = replace(
        pair, checks=(replace(pair.checks[0], ok=False, reason="planted"), *pair.checks[1:])
    )
    planted = replace(
        job, regeneration=replace(job.regeneration, pairs=(wrong, *job.regeneration.pairs[1:]))
    )
    assert {row[0]: row[1] for row in verdicts(planted).rows} == {
        "printed pair at 5 deg regenerated": "PASS",
        "printed pair at 15 deg regenerated": "FAIL",
        "4 of 5 angles of the sweep trimmed": "PASS",
    }
    assert not planted.ok


def test_a_game_without_solution_fails(job: MainJob, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """A game without a solution (planted) is reported at its angle and makes the report fail."""

    def unsolved(game: object) -> None:
        raise NoSolutionError("no solution: planted")

    # The paper's game has a solution at every angle with a trim.
    monkeypatch.setattr("hfa.page.main_job.solve", unsolved)
    angle = with_game(job.points[1])
    text = angle_report(job, angle).text()
    assert "No game solution: no solution: planted" in text
    assert "short period" in text
    planted = replace(job, angles=(angle,))
    assert [row[1] for row in verdicts(planted).rows] == ["PASS", "PASS", "FAIL", "FAIL", "PASS"]


@pytest.fixture(scope="module")
def claims() -> Claims:
    return load_claims(STORED)


def test_each_claim_has_a_row_with_its_verdict(job: MainJob, claims: Claims) -> None:
    """The page has one row with the stored verdict for each claim, and counts the unconfirmed
    claims.
    """
    said, table = claims_section(claims, job.regeneration).parts
    stored = claims.data["claims"]
    assert [row[:2] for row in table.rows] == [
        (claim["number"], claim["verdict"]) for claim in stored
    ]
    assert {row[1].tone for row in table.rows if row[1] == "not confirmed"} == {"bad"}
    assert "the same matrices as" in said
    with_claims = replace(job, claims=claims)
    assert verdicts(with_claims).rows[-1][1] == "28 of 55 claims not confirmed"
    assert "28 of 55 claims not confirmed" in verdict_sentence(with_claims)


FLIGHTS = ROOT / "studies" / "best_flights" / "results"


def test_the_page_shows_the_stored_flights(job: MainJob) -> None:
    """The page shows the costs and limits of the stored flights.

    The page also states whether these flights used the aircraft of the page.
    """
    flights = load_flights(FLIGHTS)
    drawn = any_angle(replace(job, flights=flights), Report("Any dihedral angle", ()))
    best = flights.data["flights"][-1]["best"]["cost"]
    assert f"{best:,.0f}" in drawn
    assert "does not converge" in drawn
    assert "pitch_rate -39.39 to 39.39 deg/s" in drawn
    assert "for this page's aircraft" in flights_section(flights, model_pairs(job)).text(width=None)
    for changed in ({}, {angle: (A, 1.01 * B) for angle, (A, B) in model_pairs(job).items()}):
        assert "ANOTHER aircraft" in flights_section(flights, changed).text(width=None)


def model_pairs(job: MainJob) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    return {
        point.dihedral_deg: (point.model.A, point.model.B)
        for point in job.points
        if point.model is not None
    }


def test_damaged_flights_are_refused(tmp_path: Path) -> None:
    """A file of best flights with a missing entry is refused."""
    data = json.loads((FLIGHTS / "best_flights.json").read_text(encoding="utf-8"))
    del data["flights"][0]["best"]["cost"]
    (tmp_path / "best_flights.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(BadInputError, match="is damaged"):
        load_flights(tmp_path)


def checks_in(data: Any) -> set[str]:
    """Return the names of all checks in the data of a report."""
    if isinstance(data, dict):
        own = {data["name"]} if {"name", "value", "limit"} <= set(data) else set()
        return own.union(*map(checks_in, data.values()))
    return set().union(*map(checks_in, data)) if isinstance(data, list) else set()


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (["schema"], "hfa.report/1"),
        (["setting", "models", 0, "A", 0], [1.0]),
        (["claims", 0, "subject"], "nobody"),
        (["claims", 0, "findings", "published, modified", "value"], "1"),
    ],
)
def test_a_damaged_table_is_refused(
    place: list[Any], value: Any, claims: Claims, tmp_path: Path
) -> None:
    """A file of claims with a damaged entry is refused."""
    data = copy.deepcopy(claims.data)
    *path, last = place
    reduce(getitem, path, data)[last] = value
    (tmp_path / "claims.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(BadInputError, match="is damaged"):
        load_claims(tmp_path)


def test_plotly_accepts_the_front_view(job: MainJob) -> None:
    """Plotly accepts the front view. Arrows are to scale, and panels are at the dihedral angle."""
    plot = front_view(job.aircraft, job.points)
    assert plot is not None
    (spec,) = plot.figures
    figure = Figure(spec)
    found = re.search(r"arrows: ([\d.e+-]+) lbf per foot", plot.text)
    assert found is not None
    assert len(figure.frames) == len(job.points)
    for frame, point in zip(spec["frames"], job.points, strict=True):
        panels, lift, weight, _, sizes = frame["data"]
        if point.model is None:
            assert len(panels["x"]) == len(sizes["x"]) == 0
            continue
        loads = hfa_model.loads(job.aircraft, point.model.point.states, point.model.point.inputs)
        p = hfa_model.parameters_of(job.aircraft)
        lengths = [
            np.hypot(np.diff(each["x"])[::3], np.diff(each["y"])[::3]) for each in (lift, weight)
        ]
        forces = (
            np.array([loads.outer.lift, loads.center.lift, loads.outer.lift]),
            p.panel_mass * p.gravity,
        )
        for length, force in zip(lengths, forces, strict=True):
            assert length * float(found[1]) == pytest.approx(force, rel=2e-3)
        assert sizes["text"][1] == f"{loads.center.lift:.1f} lbf"
        # The tip of the left panel is one span from its hinge, at the dihedral angle.
        x, y = panels["x"][7], panels["y"][7]
        assert np.arctan2(y, x - p.panel_span / 2) == pytest.approx(point.dihedral, abs=1e-4)


def test_data_in_a_script_contain_no_tag() -> None:
    """Data in a script contain no tag, and nan becomes null."""
    value = {"name": "</script><script>alert(1)", "x": np.array([0.5, np.nan])}
    text = in_script(value)
    assert "<" not in text
    assert json.loads(text) == {"name": "</script><script>alert(1)", "x": [0.5, None]}


def test_front_view_and_locus_require_a_trim(job: MainJob, published_aircraft: Model) -> None:
    """Without a trimmed point, the front view and the root locus are omitted."""
    assert front_view(job.aircraft, job.points[-1:]) is None
    assert locus_plot(sweep(published_aircraft, {"dihedral": np.radians([59.0])})) is None
