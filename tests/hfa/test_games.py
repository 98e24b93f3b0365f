"""`hfa solve`, `hfa learn` and `hfa verify` on the aircraft and on plants from files."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa
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


@pytest.mark.parametrize(("speed", "options"), [(0.01, ()), (0.01 / 0.3048**2, ("--units", "si"))])
def test_sizes_are_typed_in_degrees_and_in_the_units_of_the_model(speed, options):
    """The K of --sizes is that of Q and R with 1/size², with angles in rad, and the speed 10 ft/s in
    the units of the model: 1/10² = 0.01 s²/ft². The report has the sizes as typed.
    """
    angle = math.radians(5.0) ** -2.0
    surfaces = ("aileron_center", "aileron_outer", "elevator_center", "elevator_outer")
    sizes = "speed=10ft/s,alpha=5,throttle=40," + ",".join(f"{name}=5" for name in surfaces)
    Q, R = f"speed={speed},alpha={angle!r}", f"{40.0**-2},{','.join([repr(angle)] * 4)}"
    weighted = answer("solve", *AT_15, *options, "--Q", Q, "--R", R, "--delta", "inf")
    sized = ("solve", *AT_15, *options, "--sizes", sizes, "--delta", "inf")
    assert np.allclose(answer(*sized)["K"], weighted["K"], rtol=1e-9)
    assert "alpha 5 deg, throttle 40" in " ".join(hfa(*sized).out.split())


def test_a_wrong_gain_that_is_learned_has_exit_code_1(monkeypatch):
    """If a law learns for twice R, the first line of `hfa learn` is a verdict FAIL with the cost."""
    learn = laws.learn

    def for_twice_R(game, *args, **options):
        return learn(replace(game, R=2.0 * game.R), *args, **options)

    monkeypatch.setattr(laws, "learn", for_twice_R)
    run = hfa("learn", "--model", small("plant.json"))
    assert run.code == FAILED
    assert run.out.startswith("FAIL on the linear game, balanced box: ")
