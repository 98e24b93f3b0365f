"""Games that were once solved wrongly, or wrongly refused, through the public face."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from controller import minimum_delta
from hfa import Game, NoSolutionError, solve

#: COMPleib's AC4 (F. Leibfritz, COMPleib: COnstraint Matrix-optimization Problem library, 2004).
AC4 = json.loads((Path(__file__).parent / "compleib_ac4.json").read_text(encoding="utf-8"))


def ac4(delta=math.inf):
    return Game(**{name: np.array(AC4[name]) for name in "ABEQRN"}, delta=delta)


def test_the_smallest_delta_of_compleib_ac4():
    """The game is solved just above 0.019678875, and refused just below.

    The plant has rates of 0.009 to 30 1/s.
    """
    smallest = minimum_delta(ac4())
    assert smallest.refused < 0.019678875 < smallest.value
    assert smallest.value <= smallest.refused * 1.000001
    for delta in (0.0198, 0.019678877):
        assert solve(ac4(delta=delta)).poles().real.max() < 0.0
    with pytest.raises(NoSolutionError, match="delta_min"):
        solve(ac4(delta=0.019678873))


@pytest.mark.parametrize("delta", [10.0, 1e10, 1e44])
@pytest.mark.parametrize("discount", [1.0, 0.9])
def test_a_small_gain_of_the_disturbance_keeps_its_digits(delta, discount):
    """(δ² - α E'P E) L = α E'P (A - B K), also if δ² is 1e88 times P.

    The certificate states an enclosure of L narrower than 1e-16.
    """
    matrices = {"A": [[0.5]], "B": [[1.0]], "E": [[1.0]], "Q": [[1.0]], "R": [[1.0]]}
    game = Game(**matrices, delta=delta, dt=True, discount=discount)
    solution = solve(game)
    P, loop = solution.P[0, 0], 0.5 - solution.K[0, 0]
    expected = discount * P * loop / (delta**2 - discount * P)
    assert solution.disturbance_gain[0, 0] == pytest.approx(expected, rel=1e-14)
    last = next(line for line in solution.certificate.proved if line.startswith("L is enclosed"))
    assert float(last.split()[-1]) < 1e-16
