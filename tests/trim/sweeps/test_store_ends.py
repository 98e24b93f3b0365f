"""Sweeps into a store that are ended by Ctrl-C, SIGTERM, SIGHUP or SIGKILL, and resumed."""

import signal

import pytest
from ended_runs import assert_resumed_bits_equal, leaves_nothing, proc, result_of, run

from hfa.exit_codes import INTERRUPTED, TERMINATED

SWEEP = ("sweep", "--dihedral")
WORKERS = ("--workers", "2", "-o", "a.zarr")
THREE_CHUNKS = (*SWEEP, "0:14:0.04", "--hold", "speed=66:68:0.0125", *WORKERS)
LONG = (*SWEEP, "0:20:1", "--hold", "panel_mass=0.1:2:0.00002", *WORKERS)
SLOW = pytest.mark.slow


@pytest.mark.slow
@proc
@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        pytest.param(signal.SIGTERM, TERMINATED, "hfa: terminated\n", marks=SLOW),
        pytest.param(signal.SIGINT, INTERRUPTED, "hfa: interrupted\n", marks=SLOW),
        pytest.param(signal.SIGHUP, TERMINATED, "hfa: terminated\n", marks=SLOW),
        (signal.SIGKILL, -signal.SIGKILL, None),
    ],
)
def test_an_ended_run_leaves_no_workers_or_folders(tmp_path, number, code, said):
    """A run that a signal ends leaves no worker process and no temporary folder."""
    ended = leaves_nothing(tmp_path, LONG, number)
    assert ended.code == code
    assert said is None or ended.err == said


@proc
@pytest.mark.slow
def test_a_resumed_run_gives_identical_bits(tmp_path):
    """A run that is ended at random moments and resumed gives identical bits; so does one process."""
    assert_resumed_bits_equal(tmp_path, THREE_CHUNKS)
    one = ["1" if word == "2" else word for word in THREE_CHUNKS]
    assert run(tmp_path / "one", *one).code == 0
    assert result_of(tmp_path / "one") == result_of(tmp_path / "whole")
