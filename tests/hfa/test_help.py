"""The help of every command, which is short and ends with an example that runs."""

import shlex
from pathlib import Path

import pytest
from cli import hfa
from project import ROOT

from hfa.entry_points import commands

NAMES = list(commands())
#: The examples of all commands, in an order in which each finds the files of earlier ones: the
#: certificate to check is written first.
EXAMPLES = sorted(
    (entry.example for entry in commands().values()), key=lambda words: "hfa prove --check" in words
)


@pytest.mark.parametrize("name", NAMES)
def test_help_is_short_and_ends_with_an_example(name):
    """The help of a command has at most 60 lines and ends with the example of the command.

    The long help ends with the same line, and no line of it exceeds 80 columns.
    """
    pytest.importorskip("hfa_flight")
    text = hfa(*name.split(), "--help").out
    *_, last = text.splitlines()
    assert last.removeprefix("example: ") == commands()[name].example
    assert last.removeprefix("example: ").startswith(f"hfa {name} ")
    assert len(text.splitlines()) <= 60
    whole = hfa(*name.split(), "--help", "more").out.splitlines()
    assert whole[-1] == last
    assert [line for line in whole if len(line) > 80] == []


def ran(tmp_path, monkeypatch, examples, *more):
    """Run example commands one after the other in a folder, and return the exit code of each.

    more: words added to each example
    """
    monkeypatch.chdir(tmp_path)
    for folder in ("examples", "studies"):
        Path(folder).symlink_to(ROOT / folder)
    return {example: hfa(*shlex.split(example)[1:], *more).code for example in examples}


@pytest.mark.slow
def test_every_example_runs_with_json(tmp_path, monkeypatch):
    """The example of each command returns exit code 0 with --json. No two are the same."""
    codes = ran(tmp_path, monkeypatch, EXAMPLES, "--json")
    assert {name: code for name, code in codes.items() if code} == {}
    assert len(codes) == len(NAMES)
