"""Tests of the benchmarks: equal results of peers, stored figures, and the table of the page."""

import numpy as np
import pytest

import hfa
from benchmarks import __main__ as bench, jobs, report
from hfa.paper import level_flight


@pytest.mark.filterwarnings("ignore:number of constraints")
def test_a_job_refuses_a_peer_with_another_result():
    """python-control finds the trim and A of the HFA, so that the job accepts the peer; it refuses
    one whose states, inputs or A are another's.
    """
    condition = level_flight(0.1)
    ours = jobs.TrimmedPlant.of(condition)
    peers = jobs.control_points(condition)("dihedral", [0.1])
    jobs.same_points(condition, [ours], peers)
    for wrong in (
        ours._replace(states=ours.states * 1.001),
        ours._replace(inputs=ours.inputs * 1.001),
        ours._replace(A=ours.A * 1.1),
    ):
        with pytest.raises(AssertionError):
            jobs.same_points(condition, [wrong], peers)


def test_the_job_of_games_refuses_another_value(monkeypatch):
    """The job that compares games with a peer refuses one whose value differs by 1e-5."""
    right = jobs.schur_value
    monkeypatch.setattr(jobs, "schur_value", lambda game: 1.00001 * right(game))
    with pytest.raises(AssertionError):
        jobs.games(quick=True)


def test_the_job_of_a_flight_refuses_another_loop(monkeypatch):
    """The job that compares flights with a peer refuses a flight of a gain whose columns are
    shifted by one state.
    """
    right = hfa.fly

    def fly(model, point, solution, **given):
        return right(model, point, np.roll(solution.K, 1, axis=1), **given)

    monkeypatch.setattr(hfa, "fly", fly)
    with pytest.raises(AssertionError):
        jobs.flight(quick=True)


@pytest.mark.slow
def test_every_job_runs(capsys, monkeypatch):
    """Every job runs at a toy size, and no result is stored."""
    monkeypatch.setattr(report, "store", lambda *_: pytest.fail("stored"))
    assert bench.main(["--quick"]) == 0
    assert capsys.readouterr().out.count("| job |") == len(jobs.JOBS)


def test_the_page_shows_the_stored_figures():
    """The table of the page of benchmarks is that of the stored results."""
    assert report.figures(report.stored()) in report.PAGE.read_text("utf-8")
