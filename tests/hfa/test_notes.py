"""Notes and progress on standard error, and text on terminals."""

import re

import pytest
from cli import Terminal, hfa


def test_quiet_suppresses_all_but_errors():
    """--quiet suppresses notes and progress, but not errors."""
    words = ("sweep", "--dihedral", "14:16:2")  # noted: 16 deg is beyond the paper's range
    told = hfa(*words)
    assert "note: " in told.err
    assert hfa(*words, "-q", err=Terminal()) == told._replace(err="")
    refused = hfa("trim", "--quiet", "--dihedral", "95")
    assert (refused.code, refused.out, refused.err[:5]) == (2, "", "hfa: ")


TRIM = ("trim", "--dihedral", "15")
COLOR = re.compile("\033\\[[0-9;]*m")


@pytest.mark.parametrize(("environment", "colored"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_a_terminal_gets_colors(environment, colored, monkeypatch):
    """Text is colored on a terminal unless colors are turned off. Pipes and JSON have no color.

    The words are the same in all cases.
    """
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "400")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    shown = hfa(*TRIM, out=Terminal()).out
    plain = hfa(*TRIM).out
    assert bool(COLOR.search(shown)) == colored
    assert not COLOR.search(plain + hfa(*TRIM, "--json", out=Terminal()).out)
    assert COLOR.sub("", shown).split() == plain.split()
