"""Hostile inputs by every way in, made by hypothesis; `make fuzz` makes many more of the same kind."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from attempts import Taken, attempt, ending_at, fault_of, said_wrongly
from cli import Result, hfa
from hypothesis import HealthCheck, given, settings, strategies as st
from ways_in import WAYS, Case, seeds

from hfa_cli.commands import solve, trim

#: Warnings are what the command makes of them, as they are for its users.
pytestmark = pytest.mark.filterwarnings("default")


@settings(max_examples=15, derandomize=True, database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(way=st.sampled_from(sorted(WAYS)), content=st.binary(max_size=40))
def test_a_hostile_input_is_a_result_or_one_line(way: str, content: bytes) -> None:
    assert attempt(way, content) is None


@pytest.mark.parametrize("way", WAYS)
def test_what_is_made_hostile_is_accepted_as_it_was(way: str) -> None:
    if not WAYS[way].file:
        pytest.skip("a command line is no file")
    result = hfa(*unchanged(way))
    assert result.code in (0, 1), result.err
    assert result.out


@pytest.mark.parametrize("way", [name for name, each in WAYS.items() if each.file and each.work])
def test_one_that_is_not_followed_to_the_end_ends_where_the_work_begins(way: str) -> None:
    words = unchanged(way)
    with pytest.raises(Taken), ending_at(WAYS[way].work):
        hfa(*words)
    assert attempt(way, b"", whole=False) is None


@pytest.mark.parametrize("words", [["servo", "all", "-o", "folder"]])
def test_a_command_line_that_takes_minutes_is_not_followed_to_the_end(words: list[str]) -> None:
    with pytest.raises(Taken), ending_at(WAYS["command line"].work):
        hfa(*words)


def unchanged(way: str) -> list[str]:
    """The command line of a way in, its files beside it as they are."""
    for name, content in seeds().items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content)
    return [WAYS[way].file if word == "{}" else word for word in WAYS[way].words]


def _raise(_: object) -> int:
    raise KeyError("x")


def _write_half(_: object) -> int:
    Path("a.json").write_text("{")
    print("done")
    return 0


def _write_outside(_: object) -> int:
    Path("../b.json").write_text(json.dumps({}))
    print("done")
    return 0


def _print_and_go(_: object) -> int:
    Path("c.json").write_text(json.dumps({}))
    print("done")
    return 0


@pytest.mark.parametrize(
    ("run", "said"),
    [
        (_raise, "KeyError: 'x'"),
        (_write_half, "not whole: a.json"),
        (_write_outside, "left outside: ['b.json']"),
        (_print_and_go, "left, and nobody asked: c.json"),
        (lambda _: 1, "exit code 1, and not a word"),
        (lambda _: 3, "exit code 3"),
    ],
)
def test_planted_faults_are_seen(monkeypatch: pytest.MonkeyPatch, run, said: str) -> None:
    monkeypatch.setattr(trim, "run", run)
    assert said in (fault_of(Case(["trim", "--dihedral", "5", "-o", "a.json"], {})) or "")


def test_a_planted_hang_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(_: object) -> int:
        while True:
            pass

    monkeypatch.setattr("attempts.LONGEST", 0.05)
    monkeypatch.setattr(solve, "run", run)
    assert fault_of(Case(["solve", "--dihedral", "5"], {})) == "no end after 0.05 s"


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (Result(2, "", "hfa: a\nhfa: b\n"), "more than one line"),
        (Result(2, "out", "hfa: a\n"), "not one line alone"),
        (Result(0, "out", "RuntimeWarning: overflow\n"), "more than one line"),
        (Result(2, "", "hfa: \x1b[31m\n"), "not printable"),
        (Result(2, "", f"hfa: {'x' * 2000}\n"), "too long"),
    ],
)
def test_wrong_words_are_seen(result: Result, said: str) -> None:
    assert said in (said_wrongly(result) or "")
    assert said_wrongly(Result(2, "", "hfa: a\n")) is None
