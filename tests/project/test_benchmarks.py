"""Tests of the benchmarks: equal results of a peer, and a run of every job."""

import pytest

from benchmarks import __main__ as bench, jobs, report


def test_values_of_a_peer_must_be_the_same(monkeypatch):
    """The job that is timed against SciPy's Schur form fails if the value P of a game that this peer
    finds differs by a factor of 1.00001.
    """
    schur_value = jobs.schur_value
    monkeypatch.setattr(jobs, "schur_value", lambda game: 1.00001 * schur_value(game))
    with pytest.raises(AssertionError):
        jobs.games(quick=True)


@pytest.mark.slow
def test_every_job_runs(capsys, monkeypatch):
    """Every job runs at a toy size, and no result is stored."""
    monkeypatch.setattr(report, "store", lambda *_: pytest.fail("stored"))
    assert bench.main(["--quick"]) == 0
    assert capsys.readouterr().out.count("| job |") == len(jobs.JOBS)
