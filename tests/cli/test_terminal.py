"""What only a terminal gets: colors, unless NO_COLOR is set, bars and progress; a file or a pipe gets neither."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli import Terminal, hfa
from game_files import small

from hfa_cli.main import DONE

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


@pytest.mark.parametrize("words", ["solve --model plant.json", "learn --model plant.json --set tick=0.1"])
def test_progress_is_for_terminals_alone(words: str) -> None:
    small("plant.json")
    quiet, terminal = hfa(*words.split()), hfa(*words.split(), err=Terminal())
    assert (quiet.err, quiet.out) == ("", terminal.out)
    assert f"{words.split()[0]}: 100 %" in terminal.err
    assert terminal.err.endswith("\r\033[K")
    assert "\n" not in terminal.err
