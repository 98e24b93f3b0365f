"""The second derivation: exact where there is a value, refused where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from reference_riccati import reference_solution, relative_error

from controller import Game
from controller.riccati.certificate import iterated_solution
from hfa_support import NoSolutionError
from verification import minimum_delta

I2 = np.eye(2)


def test_second_derivation_is_exact_to_1e12(game: Game) -> None:
    assert relative_error(iterated_solution(game), reference_solution(game).P) < 1e-12


def test_iteration_refuses_where_there_is_no_value(game: Game) -> None:
    for delta in (1.0, 50.0, 100.0, minimum_delta(game).value * 0.999):
        with pytest.raises(NoSolutionError, match="Lanzon-Feng-Anderson"):
            iterated_solution(game.with_delta(delta))


def test_iteration_refuses_what_no_input_can_stabilize() -> None:
    with pytest.raises(NoSolutionError, match="step 1 of the Lanzon-Feng-Anderson"):
        iterated_solution(Game(np.diag([0.5, -1.0]), [[0.0], [1.0]], I2, I2, [[1.0]], 10.0))
