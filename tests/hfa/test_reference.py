"""The option --reference of the commands."""

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15

from hfa.exit_codes import BAD_INPUT

COMMAND = ("--reference", "speed=7+0.01t+2sin(0.5t),alpha=5.73,dihedral=28.65")


@pytest.mark.slow
def test_a_command_is_typed_in_degrees():
    """The commanded angles reach the tracking in rad, and in SI units nothing but units changes."""
    data = answer("solve", *AT_15, *COMMAND)["tracking"]
    assert data["reachable"] is False
    alone = next(each for each in data["trims"] if list(each["command"]) == ["alpha"])
    assert alone["command"]["alpha"] == pytest.approx(np.radians(5.73))
    si = answer("solve", *AT_15, "--units", "si", "--reference", "dihedral=28.65")["tracking"]
    english = answer("solve", *AT_15, "--reference", "dihedral=28.65")["tracking"]
    assert si["trims"][0]["needed"]["elevator_center"] == pytest.approx(
        english["trims"][0]["needed"]["elevator_center"], rel=1e-6
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--reference", "speeds=7"), "did you mean speed"),
        (("--reference", "speed=exp(t)"), "write sums of terms"),
        (("--reference", "speed"), "is not NAME=VALUE"),
    ],
)
def test_a_wrong_reference_is_refused_in_one_line(words, said):
    """Unknown states and other texts are refused before anything is computed."""
    result = hfa("solve", *AT_15, *words)
    assert (result.code, result.out) == (BAD_INPUT, "")
    assert said in result.err
    assert result.err.count("\n") == 1
