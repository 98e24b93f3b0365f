"""Sweeps into a store that are ended by Ctrl-C, SIGTERM, SIGHUP or SIGKILL, and resumed."""

import random
import signal

import pytest
from ended_runs import proc, result_of, run

from hfa.exit_codes import INTERRUPTED, TERMINATED

SWEEP = ("sweep", "--dihedral")
WORKERS = ("--workers", "2", "-o", "a.zarr")
THREE_CHUNKS = (*SWEEP, "0:14:0.04", "--hold", "speed=66:68:0.0125", *WORKERS)
LONG = (*SWEEP, "0:20:1", "--hold", "panel_mass=0.1:2:0.00002", *WORKERS)
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


def is_in_one_line(ended, said):
    """Return whether an ended run printed only the line `said`.

    The result is also True if Python ended the process before `hfa` started or if the run finished.
    """
    lines = [
        line for line in ended.err.splitlines(keepends=True) if not line.startswith("hfa: note: ")
    ]
    by_signal = ended.code in (1, -signal.SIGINT, -signal.SIGTERM)
    by_python = by_signal and "hfa/main.py" not in ended.err
    return lines == [said] or by_python or (ended.code == 0 and not lines)


def test_a_resumed_run_gives_identical_bits(tmp_path):
    """A run that is ended by each signal in turn at a random moment, and resumed each time, has the bits of
    a run that is not ended. So has a run in one process instead of two.
    """
    whole = run(tmp_path / "whole", *THREE_CHUNKS)
    assert whole.code == 0
    moments, resumed = random.Random(0), tmp_path / "resumed"
    again = ()
    for number, said in (
        (signal.SIGKILL, None),
        (signal.SIGTERM, "hfa: terminated\n"),
        (signal.SIGINT, "hfa: interrupted\n"),
    ):
        after = moments.uniform(0.0, whole.seconds)
        ended = run(resumed, *THREE_CHUNKS, *again, number=number, after=after)
        assert ended.workers_have_ended()
        assert said is None or is_in_one_line(ended, said), ended
        again = ("--resume",) if (resumed / "a.zarr").exists() else ()
    assert run(resumed, *THREE_CHUNKS, *again).code == 0
    one = ["1" if word == "2" else word for word in THREE_CHUNKS]
    assert run(tmp_path / "one", *one).code == 0
    for name in ("resumed", "one"):
        assert result_of(tmp_path / name) == result_of(tmp_path / "whole"), name
