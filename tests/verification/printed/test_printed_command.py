"""`hfa printed`: class of an answer, exit code, and errors in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import Terminal, answer, assert_refused, hfa

from hfa.main import BAD_INPUT, DONE, FAILED


def test_printed_answers_have_class_and_exit_code(tmp_path: Path) -> None:
    """A correct answer has exit code 0. A wrong entry is named, with exit code 1."""
    file = tmp_path / "printed.toml"
    right = (
        'time = "continuous"\n[plant]\nA = "0 1; 0 0"\nB = "0; 1"\nQ = "1 0; 0 2"\nR = "1"\n'
        '[printed]\nP = "2.0000 1.0000; 1.0000 2.0000"\nK = "1.0000 2.0000"\n'
    )
    file.write_text(right)
    assert hfa("printed", str(file)).code == DONE
    file.write_text(right.replace('K = "1.0000 2.0000"', 'K = "1.0000 2.0010"'))
    result = hfa("printed", str(file))
    assert result.code == FAILED
    assert result.out.startswith("one entry of the answer: K12 is printed 2.0010, exact 2\n")
    data = answer("printed", str(file), code=FAILED)
    assert data["verdict"] == "one entry of the answer"
    assert data["entries"][-1]["half_unit"] == 5e-5


def test_the_search_shows_its_progress(tmp_path: Path) -> None:
    """The search shows its progress on a terminal. An error replaces the line of progress."""
    file = tmp_path / "printed.toml"
    other = (
        'time = "continuous"\n[plant]\nA = "0 1; 0 0"\nB = "0; 1"\nQ = "1 0; 0 2"\nR = "1"\n'
        '[printed]\nK = "2.4142 2.6131"\n'
    )
    file.write_text(other)
    said = hfa("printed", str(file), err=Terminal()).err.split("\r\033[K")
    assert said[:2] == ["", "compare:   0 %"]
    shares = [int(line.removeprefix("compare:").removesuffix("%")) for line in said[1:-1]]
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert said[-2:] == ["compare: 100 %", ""]
    file.write_text(other.replace("2.4142", "x"))
    assert hfa("printed", str(file), err=Terminal()).err.split("\r\033[K")[-1].startswith("hfa: ")


def test_bad_input_is_refused_in_one_line(tmp_path: Path) -> None:
    """Wrong numbers and unknown options are refused in one line."""
    file = tmp_path / "printed.toml"
    file.write_text('time = "continuous"\n[plant]\nA = "0 1; 0 x"\n[printed]\nK = "1 2"\n')
    assert_refused(hfa("printed", str(file)), BAD_INPUT, "A, row 2: 'x' is not supported")
    assert_refused(
        hfa("printed", str(file), "--dihedral", "5"),
        BAD_INPUT,
        "unknown option --dihedral",
    )


@pytest.mark.parametrize(
    "text",
    [
        "time = " + "[" * 5000 + "]" * 5000,
        "time = " + "9" * 5000,
        'time = "continuous"\n[plant]\nA = "' + "9" * 5000 + '"\nB = "1"\n[printed]\nK = "1"\n',
        'time = "continuous"\n[plant]\nA = "' + "(" * 5000 + '"\nB = "1"\n[printed]\nK = "1"\n',
    ],
)
def test_deep_nesting_and_long_numbers_are_refused(tmp_path: Path, text: str) -> None:
    """Deep nesting and very long numbers in a file are refused in one line."""
    file = tmp_path / "printed.toml"
    file.write_text(text)
    assert_refused(hfa("printed", str(file)), BAD_INPUT, str(file))


def test_a_large_plant_is_compared_without_search(tmp_path: Path) -> None:
    """A plant with 50 states is checked without a search for a misprint, as the report states.

    The states decay at rates 1 to 50, each with an input and K_i = 1 / (rate + sqrt(rate^2 + 1)).
    The printed gain belongs to other rates of the first two states.
    """
    rates = np.arange(1.0, 51.0)
    gains = 1.0 / (rates + np.sqrt(rates**2 + 1.0))
    rates[:2] = 9.0
    rows = "\n".join(" ".join(f"{entry:g}" for entry in row) for row in np.diag(-rates))
    diagonal = " ".join(["1"] * 50)
    printed = "\n".join(" ".join(f"{entry:.4f}" for entry in row) for row in np.diag(gains))
    file = tmp_path / "large.toml"
    file.write_text(
        f'time = "continuous"\n[plant]\nA = """\n{rows}\n"""\nB = "diag {diagonal}"\n'
        f'Q = "diag {diagonal}"\nR = "diag {diagonal}"\n[printed]\nK = """\n{printed}\n"""\n'
    )
    judged = hfa("printed", str(file), "-o", str(tmp_path / "large.json"))
    assert judged.code == FAILED
    data = json.loads((tmp_path / "large.json").read_text("utf-8"))
    assert data["not_searched"].startswith("changed entries of the plant and interchanged states")
    assert "50 states exceed the limit, 80000" in data["not_searched"]
    assert data["not_searched"] in " ".join(judged.out.split())
    assert "Q diag of 50 entries from 1 to 1 (printed)" in judged.out
