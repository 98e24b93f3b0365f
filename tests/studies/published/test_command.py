"""`python -m studies.published FILE`: class of an answer, exit code, and errors in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.published.__main__ import main
from studies.published.verdict import check_printed

RIGHT = (
    'time = "continuous"\n[plant]\nA = "0 1; 0 0"\nB = "0; 1"\nQ = "1 0; 0 2"\nR = "1"\n'
    '[printed]\nP = "2.0000 1.0000; 1.0000 2.0000"\nK = "1.0000 2.0000"\n'
)


def test_exit_code_and_first_line_are_those_of_the_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "printed.toml"
    file.write_text(RIGHT)
    assert main([str(file)]) == 0
    assert capsys.readouterr().out.startswith("as printed: ")
    file.write_text(RIGHT.replace('K = "1.0000 2.0000"', 'K = "1.0000 2.0010"'))
    assert main([str(file)]) == 1
    assert capsys.readouterr().out.startswith("one entry of the answer: K12 is printed 2.0010")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (RIGHT.replace("0 1; 0 0", "0 1; 0 x"), ": A, row 2: 'x' is not supported"),
        ("time = " + "[" * 5000 + "]" * 5000, " is not a TOML file"),
        ("time = " + "9" * 5000, " is not a TOML file"),
        (RIGHT.replace("0 1; 0 0", "9" * 5000), ": A, row 1: '9999"),
        (RIGHT.replace("0 1; 0 0", "(" * 5000), ": A, row 1: '(((("),
    ],
)
def test_bad_files_are_refused_in_one_line(
    tmp_path: Path, text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wrong entry, deep nesting and long numbers are named with the file and the row."""
    file = tmp_path / "printed.toml"
    file.write_text(text)
    assert main([str(file)]) == 2
    shown = capsys.readouterr()
    assert (shown.out, shown.err.count("\n")) == ("", 1)
    assert f"{file}{said}" in shown.err


def test_a_large_plant_is_compared_without_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plant with 50 states is checked without a search for a misprint, as the report states.

    The states decay at rates 1 to 50, each with an input and K_i = 1 / (rate + sqrt(rate^2 + 1)).
    With the printed gain of these rates, nothing needs to be searched for. With the gain of other
    rates of the first two states, the class cannot be told.
    """
    rates = np.arange(1.0, 51.0)
    gains = 1.0 / (rates + np.sqrt(rates**2 + 1.0))
    diagonal = " ".join(["1"] * 50)
    printed = "\n".join(" ".join(f"{entry:.4f}" for entry in row) for row in np.diag(gains))
    file = tmp_path / "large.toml"
    for first, name in ((rates[:2].copy(), "as printed"), (9.0, "cannot tell")):
        rates[:2] = first
        rows = "\n".join(" ".join(f"{entry:g}" for entry in row) for row in np.diag(-rates))
        file.write_text(
            f'time = "continuous"\n[plant]\nA = """\n{rows}\n"""\nB = "diag {diagonal}"\n'
            f'Q = "diag {diagonal}"\nR = "diag {diagonal}"\n'
            f'[printed]\nK = """\n{printed}\n"""\n'
        )
        is_right = name == "as printed"
        found = check_printed(file).classified
        assert (found.name, found.changed) == (name, ())
        assert (found.not_searched == "") == is_right
        assert main([str(file)]) == (0 if is_right else 1)
        assert found.not_searched in " ".join(capsys.readouterr().out.split())
