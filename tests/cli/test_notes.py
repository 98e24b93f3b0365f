"""Notes on standard error and on terminals: notes, colors, progress."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli import Terminal, hfa

from hfa_cli import output
from hfa_cli.output import ProgressLine

NOTE = "dihedral 16 deg lies beyond the paper's range, which ends at 15 deg"
SHORT = ("--law", "exact", "--duration", "0.1")
COMMANDS = {
    "solve": ("solve",),
    "learn": ("learn", "--set", "predefined_time=2"),
    "verify": ("verify", "--set", "predefined_time=2"),
    "fly": ("fly", *SHORT),
    "map": ("map", "--law", "exact", "--initial", "speed=1", "--initial", "dihedral=0", "--command", "dihedral=1"),
    "monte-carlo": ("monte-carlo", *SHORT, "--samples", "2"),
}


def sweep_note(farthest: str) -> str:
    return f"dihedral {farthest} deg lies beyond the paper's range, which ends at 15 deg"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in ("map", "learn", "verify"))) for name in COMMANDS]
)
def test_a_command_says_once_that_a_dihedral_lies_beyond_the_paper(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("verification.flights.recoverable_map._SCAN", 2)
    beyond = hfa(*COMMANDS[name], "--dihedral", "16", "--json")
    assert beyond.err == f"hfa: note: {NOTE}\n"
    assert json.loads(beyond.out)["warnings"] == [NOTE]
    if name != "map":  # test_map.py draws one within the range
        within = hfa(*COMMANDS[name], "--dihedral", "15", "--json")
        assert within.err == ""
        assert json.loads(within.out)["warnings"] == []


def test_quiet_says_no_note_and_no_progress_but_errors() -> None:
    words = ("sweep", "--dihedral", "14:20:2")
    for quiet in ("-q", "--quiet"):
        terminal = Terminal()
        assert hfa(*words, quiet, err=terminal) == hfa(*words)._replace(err="")
    refused = hfa("trim", "--quiet", "--dihedral", "15", "--hold", "speed=20")
    assert (refused.code, refused.out, refused.err[:13]) == (1, "", "hfa: no trim:")


@pytest.mark.parametrize(
    ("ranges", "farthest"),
    [
        (("--dihedral", "14:20:2"), "20"),
        (("--dihedral", "0:15:5"), ""),
    ],
    ids=["range", "within"],
)
def test_a_stored_sweep_has_them_in_its_store(tmp_path: Path, ranges: tuple[str, ...], farthest: str) -> None:
    import zarr

    path = tmp_path / "far.zarr"
    result = hfa("sweep", *ranges, "--json", "-o", str(path))
    expected = [sweep_note(farthest)] if farthest else []
    assert result.err == "".join(f"hfa: note: {note}\n" for note in expected)
    assert json.loads(result.out)["warnings"] == expected
    assert zarr.open_group(str(path), mode="r").attrs["warnings"] == expected


TRIM = ("trim", "--dihedral", "15")
COLOR = re.compile("\033\\[[0-9;]*m")


@pytest.mark.parametrize(("environment", "colored"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_a_terminal_gets_colors(environment: dict[str, str], colored: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    shown, plain = hfa(*TRIM, out=Terminal()).out, hfa(*TRIM).out
    assert bool(COLOR.search(shown)) == colored
    assert not COLOR.search(plain + hfa(*TRIM, "--json", out=Terminal()).out)
    assert COLOR.sub("", shown).split() == plain.split()


def test_what_takes_more_than_a_minute_is_announced_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 2))
    monkeypatch.setattr(output.time, "monotonic", lambda: float(next(clock)))
    long, short = ProgressLine("fly"), ProgressLine("fly")
    for done in range(1, 10):
        long(done, 183)
    assert capsys.readouterr().err == "hfa: note: fly: about 6 minutes more; Ctrl-C ends it\n"
    for done in range(1, 10):
        short(done, 20)
    assert capsys.readouterr().err == ""
