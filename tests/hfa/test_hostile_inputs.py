"""Hostile inputs to commands. They give a result, or one line and no file.

`make fuzz` runs many more of them.
"""

from __future__ import annotations

from pathlib import Path

import hostile
import pytest
from cli import Result, hfa
from extension import needs
from hostile import WAYS, attempt, hostile_case, output_fault, seeds
from hypothesis import given, strategies as st

#: The command handles warnings as it does for users.
pytestmark = pytest.mark.filterwarnings("default")
#: The corrupted files include files of extensions.
IN_FILES = needs(
    "hfa_jsbsim",
    "hfa_prove",
    "hfa_design",
)


def marks_of(way: str) -> list[pytest.MarkDecorator]:
    """Return the marks of a kind of inputs. Those in files are slow: the files are made first."""
    return [IN_FILES, pytest.mark.slow] * bool(WAYS[way])


@pytest.mark.parametrize("way", [pytest.param(way, marks=marks_of(way)) for way in WAYS])
@given(data=st.data())
def test_a_hostile_input_gives_a_result_or_error(way: str, data: st.DataObject) -> None:
    """Every hostile variant of one kind of input gives a result, or an error of one line."""
    pytest.importorskip("hfa_flight")
    words, files = data.draw(hostile_case(way))
    assert attempt(words, files) is None


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=marks_of(way)) for way in WAYS if WAYS[way]]
)
def test_the_unchanged_file_is_accepted(way: str) -> None:
    """Each input file is accepted before it is corrupted."""
    for name, content in seeds().items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content)
    result = hfa(*(way if word == "{}" else word for word in WAYS[way]))
    assert result.code in (0, 1), result.err  # 1: the controller is unstable at some angle
    assert result.out


def _raise() -> Result:
    raise KeyError("x")


def _write(path: str, text: str = "{}") -> Result:
    Path(path).write_text(text)
    return Result(0, "done\n", "")


def _hang() -> Result:
    while True:
        pass


@pytest.mark.parametrize(
    ("run", "said"),
    [
        (_raise, "KeyError: 'x'"),
        (lambda: _write("a.json", "{"), "not whole: a.json"),
        (lambda: _write("../b.json"), "left outside: ['b.json']"),
        (lambda: _write("c.json"), "left, and nobody asked: c.json"),
        (lambda: Result(1, "", ""), "exit code 1, and not a word"),
        (lambda: Result(3, "", ""), "exit code 3"),
        (_hang, "no end after 0.05 s"),
    ],
)
def test_planted_faults_are_detected(monkeypatch: pytest.MonkeyPatch, run, said: str) -> None:
    """The test harness detects a command that crashes, hangs, leaves a wrong file or is silent."""
    # Planted faults of a command.
    monkeypatch.setattr(hostile, "unchecked_hfa", lambda *words, err: run())
    monkeypatch.setattr(hostile, "LONGEST", 0.05 if run is _hang else 10.0)
    assert said in (attempt(["trim", "--dihedral", "5", "-o", "a.json"], {}) or "")


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
def test_wrong_messages_are_detected(result: Result, said: str) -> None:
    """The test harness detects a message that is too long, unprintable or on several lines."""
    assert said in (output_fault(result) or "")
    assert output_fault(Result(2, "", "hfa: a\n")) is None
