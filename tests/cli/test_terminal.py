"""What only a terminal gets: colors, unless NO_COLOR is set, bars and progress; a file or a pipe gets neither."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli import Terminal, hfa
from game_files import small

from hfa_cli.main import DONE, FAILED
from hfa_model import Aircraft
from hfa_support.reporting.text import Table
from trim import OperatingPoint, level_flight, trim_report

TRIM = ("trim", "--dihedral", "15")
COLOR = re.compile("\033\\[[0-9;]*m")
BAR = re.compile(r" *[ o]\[[-o]{10}\][ o]")


@pytest.mark.parametrize(
    ("environment", "colored"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_a_terminal_gets_bars_and_colors(
    environment: dict[str, str], colored: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    shown, plain = hfa(*TRIM, out=Terminal()).out, hfa(*TRIM).out
    assert bool(COLOR.search(shown)) == colored
    assert len(BAR.findall(shown)) == 11  # six states with limits and five inputs
    assert not COLOR.search(plain + hfa(*TRIM, "--json", out=Terminal()).out)
    assert hfa(*TRIM, "-o", "trim.md", out=Terminal()).code == DONE
    assert not BAR.search(plain + Path("trim.md").read_text(encoding="utf-8"))
    assert BAR.sub("", COLOR.sub("", shown)).split() == plain.split()


def test_equations_that_do_not_balance_come_first(published_aircraft: Aircraft, point: OperatingPoint) -> None:
    planted = OperatingPoint(
        point.states, point.inputs, point.residuals | {"pitch_rate": 0.1}, point.dynamics, point.status
    )
    for given, first, verdict in ((point, "rate of speed", "PASS"), (planted, "rate of pitch_rate", "FAIL")):
        parts = trim_report(published_aircraft, level_flight(point.states.dihedral), given).parts
        (table,) = (part for part in parts if isinstance(part, Table) and part.header[0] == "equation")
        assert (table.rows[0][0], table.rows[0][-1]) == (first, verdict)
        assert len(table.rows) == len(point.residuals)


def test_a_search_for_delta_min_says_how_far_it_is() -> None:
    """Of a plant of a hundred states it takes seconds, and what goes before and after it as many."""
    for words, code in ((("--delta", "200"), DONE), (("--delta", "100"), FAILED)):
        terminal = Terminal()
        result = hfa("solve", "--dihedral", "15", *words, err=terminal)
        assert result.code == code
        shown = re.findall(r"solve: +(\d+) %", terminal.getvalue())
        assert [int(each) for each in shown] == sorted({int(each) for each in shown})
        assert (shown[0], shown[-1], len(shown) > 15) == ("0", "100", True)
        assert terminal.getvalue().rpartition("%")[2].startswith("\r\033[K")
        assert "%" not in hfa("solve", "--dihedral", "15", *words).err


def test_a_refusal_on_a_terminal_stands_alone(tmp_path: Path) -> None:
    """Before there is a delta_min to search for: no counter is left beside it."""
    terminal = Terminal()
    unreached = small(tmp_path / "plant.json", A=[[1.0, 0.0], [0.0, -1.0]], B=[[0.0], [1.0]])
    assert hfa("solve", "--model", unreached, err=terminal).code == FAILED
    before, _, message = terminal.getvalue().rpartition("\r\033[K")
    assert "solve:   0 %" in before
    assert message.startswith("hfa: (A, B) is not stabilizable")


@pytest.mark.parametrize("words", ["sweep --speed 1:5:1", "learn --model plant.json --set tick=0.1"])
def test_progress_is_for_terminals_alone(words: str) -> None:
    small("plant.json")
    quiet, terminal = hfa(*words.split()), hfa(*words.split(), err=Terminal())
    assert (quiet.err, quiet.out) == ("", terminal.out)
    assert f"{words.split()[0]}: 100 %" in terminal.err
    assert terminal.err.endswith("\r\033[K")
    assert "\n" not in terminal.err
