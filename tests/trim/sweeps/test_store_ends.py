"""Sweeps into a store that are ended by Ctrl-C, SIGTERM, SIGHUP or SIGKILL."""

import signal

import pytest
from ended_runs import proc, run

from hfa.exit_codes import INTERRUPTED, TERMINATED

LONG = (
    *("sweep", "--dihedral", "0:20:1", "--hold", "panel_mass=0.1:2:0.00002"),
    *("--workers", "2", "-o", "a.zarr"),
)
pytestmark = [proc, pytest.mark.slow]


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        (signal.SIGTERM, TERMINATED, "hfa: terminated\n"),
        (signal.SIGINT, INTERRUPTED, "hfa: interrupted\n"),
        (signal.SIGHUP, TERMINATED, "hfa: terminated\n"),
        (signal.SIGKILL, -signal.SIGKILL, None),
    ],
)
def test_an_ended_run_leaves_no_workers_or_folders(tmp_path, number, code, said):
    """A run that a signal ends while two workers compute leaves no worker process and, except after
    SIGKILL, no temporary folder.
    """
    ended = run(tmp_path, *LONG, number=number, after=0.3, working=2)
    assert len(ended.workers) == 2
    assert ended.workers_have_ended()
    assert (ended.code, ended.out) == (code, "")
    if said:
        assert ended.err == said
        assert list((tmp_path / "temporary").iterdir()) == []
