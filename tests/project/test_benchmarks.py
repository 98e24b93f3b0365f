"""Tests of the benchmarks: equal results of peers, and a run of every job."""

import pytest

from benchmarks import __main__ as bench, jobs, report
from hfa.paper import level_flight


@pytest.mark.filterwarnings("ignore:number of constraints")
def test_trims_of_a_peer_must_be_the_same():
    """python-control, the peer that the job is timed against, finds the trim and A of the project.
    States, inputs or A that differ by 0.1 %, 0.1 % and 10 % are refused.
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
