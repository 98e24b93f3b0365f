"""Figures of a verdict beside the errors: L2 gain and disk margins."""

import math
from dataclasses import replace

import numpy as np
import pytest
from known_models import model_at

import hfa
from hfa import solve, verify
from verification import nonlinear_plant


def test_a_gain_above_delta_fails_and_margins_are_of_both_policies(elevator_game):
    """The LQR gain stabilizes, but its L2 gain is above a delta of 1.01 delta_min: the grade is
    "fail", whatever the cost. The stored disk margins are those of this gain and of the exact one.
    """
    game = elevator_game.with_delta(1.01 * solve(elevator_game).delta_min)
    K = solve(game.with_delta(math.inf)).K
    exact = solve(game)
    verdict = verify(game, hfa.from_gain(game, K))
    (gain,) = [check for check in verdict.checks if check.name == "l2_gain"]
    assert gain.value == pytest.approx(exact.closed_loops.l2_gain(K).high, rel=1e-9)
    assert gain.value > gain.limit == game.delta
    assert (gain.ok, verdict.stabilizing, verdict.grade) == (False, True, "fail")
    assert replace(verdict, cost_above_optimum_percent=0.1).grade == "fail"
    data, closed_loops = verdict.to_dict(), exact.closed_loops
    assert data["disk_margin"] == pytest.approx(closed_loops.disk_margin(K).disk)
    assert data["disk_margin_exact"] == pytest.approx(closed_loops.disk_margin(exact.K).disk)
    assert data["disk_margin"] != pytest.approx(data["disk_margin_exact"], rel=1e-5)


#: Game whose P is positive definite.
DEFINITE = hfa.Game(np.diag([-1.0, -2.0]), np.eye(2), Q=np.eye(2), R=np.eye(2))
#: Game whose P is only semidefinite: the second state costs nothing.
SEMIDEFINITE = hfa.Game(DEFINITE.A, [[1.0], [0.0]], Q=[1.0, 0.0], R=[1.0])


@pytest.mark.parametrize(
    ("game", "factor", "less", "limit", "ok"),
    [
        (DEFINITE, 0.5, 0.0, 1e-6, True),  # smaller than the exact P, but definite
        (DEFINITE, -0.5, 0.0, 1e-6, False),
        (SEMIDEFINITE, 1.0, 1e-4, 1e-2, True),  # negative within the limit
        (SEMIDEFINITE, 1.0, 1e-4, 1e-6, False),
    ],
)
def test_an_indefinite_value_fails_beyond_the_permitted_error(game, factor, less, limit, ok):
    """P may have a negative eigenvalue only as far as the limit of its error permits: of a game with a
    definite exact P not at all, and with a semidefinite one within the limit.

    factor, less: P is the factor times the exact one, minus a share of its largest entry at (2, 2)
    """
    P = factor * solve(game).P - np.diag([0.0, less * solve(game).P.max()])
    checks = verify(game, hfa.from_value(game, P), limit=limit).checks
    (least,) = [check for check in checks if check.name == "P_smallest_eigenvalue"]
    assert least.ok is ok


def test_inputs_of_the_nonlinear_plant_end_at_their_limits():
    """The limits of the plant's inputs, which are deviations from the trim, are those of the aircraft,
    and a larger input has the rates of the limit.
    """
    linear = model_at(15.0)
    plant = nonlinear_plant(linear)
    signals = [linear.model.inputs[name] for name in linear.inputs]
    lowest, highest = ([getattr(each, end) for each in signals] for end in ("min", "max"))
    np.testing.assert_allclose(plant.lowest + linear.point.u, lowest, atol=1e-12)
    np.testing.assert_allclose(plant.highest + linear.point.u, highest, atol=1e-12)
    for u, limit in ((1000.0, plant.highest), (-1000.0, plant.lowest)):
        held = np.array(plant.rates(np.zeros(6), limit))
        assert np.array(plant.closed(np.zeros(6), np.full(5, u))) == pytest.approx(held, rel=1e-12)
