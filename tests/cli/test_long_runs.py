"""What takes long is bounded, and announced once it can be judged."""

from __future__ import annotations

import pytest
from cli import assert_refused, hfa

from hfa_cli import progress
from hfa_cli.progress import ProgressLine


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("monte-carlo", "--dihedral", "15", "--members", "1e9"), "give a whole number from 1 to 1e+07"),
        (("schedule", "--dihedral", "15", "--to", "20", "--points", "1e5"), "give a whole number from 2 to 1000"),
    ],
)
def test_what_would_take_days_is_refused(words: tuple[str, ...], named: str) -> None:
    assert_refused(hfa(*words), 2, named)


def test_what_takes_more_than_a_minute_is_announced_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 2))
    monkeypatch.setattr(progress.time, "monotonic", lambda: float(next(clock)))
    long, short = ProgressLine("fly"), ProgressLine("fly")
    for done in range(1, 10):
        long(done, 183)
    assert capsys.readouterr().err == "hfa: note: fly: about 6 minutes more; Ctrl-C ends it\n"
    for done in range(1, 10):
        short(done, 20)
    assert capsys.readouterr().err == ""
