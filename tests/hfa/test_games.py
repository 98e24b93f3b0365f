"""`hfa solve`, `hfa learn` and `hfa verify` on the aircraft and on plants from files."""

from dataclasses import replace
from pathlib import Path

import pytest
from cli import hfa
from game_files import AT_15, small

from controller.learning import laws
from hfa.main import FAILED


@pytest.mark.parametrize("delta", ["100", "113.5"])
def test_solve_below_the_smallest_delta_names_the_remedy(delta):
    """If delta is below delta_min (113.5486 at 15 deg), `hfa solve` fails, advises a larger delta and
    writes no file.
    """
    result = hfa("solve", *AT_15, "--delta", delta, "--json", "-o", "solution.json")
    assert (result.code, result.out) == (FAILED, "")
    assert result.err.count("\n") == 1
    assert f"for every input, the gain from the disturbance is at least {delta}" in result.err
    assert f"delta = {delta} is below delta_min = 113.5486; choose a larger delta" in result.err
    assert list(Path().iterdir()) == []


def test_a_wrong_gain_that_is_learned_has_exit_code_1(monkeypatch):
    """If a law learns for twice R, the first line of `hfa learn` is a verdict FAIL with the cost."""
    learn = laws.learn

    def for_twice_R(game, *args, **options):
        return learn(replace(game, R=2.0 * game.R), *args, **options)

    monkeypatch.setattr(laws, "learn", for_twice_R)
    run = hfa("learn", "--model", small("plant.json"))
    assert run.code == FAILED
    assert run.out.startswith("FAIL on the linear game, balanced box: ")
