"""Simulation of discrete-time plants with `hfa fly --model`."""

from dataclasses import replace

import numpy as np
import pytest
from cli import answer, hfa
from game_files import stored

from controller.discrete.solution import solve_discrete
from controller.game.discrete_game import DiscreteGame
from hfa import Game, NoSolutionError
from hfa.main import FAILED
from hfa_flight.step_flight import fly_steps

STEP = Game([[1.05, 0.1], [0.0, 0.9]], [[0.0], [0.1]], np.eye(2), np.eye(2), [[0.1]], np.inf)
PROBLEM = DiscreteGame(replace(STEP, N=[[0.05], [0.0]]), 0.97)


def test_the_cost_of_a_flight_equals_its_value():
    """The cost of a discrete-time flight with the optimal gain is x'Px, another gain costs more,
    and divergence is reported.
    """
    solution = solve_discrete(PROBLEM)
    start = np.array([1.0, -0.5])
    flight = fly_steps(PROBLEM, solution.K, "exact", start, 600)
    assert flight.costs.sum() == pytest.approx(start @ solution.P @ start, rel=1e-10)
    assert flight.decays
    rows = flight.report().parts[1].rows
    assert [rows[0][0], rows[1][0], rows[-1][0]] == ["0", "60", "600"]
    assert rows[0][1:] == ("1", "-0.5", f"{-(solution.K @ start)[0]:.5g}")
    assert rows[-1][-1] == ""
    worse = fly_steps(PROBLEM, 1.1 * solution.K, "other", start, 600)
    assert worse.costs.sum() > flight.costs.sum()
    with pytest.raises(NoSolutionError, match="the state exceeds 1e50"):
        fly_steps(PROBLEM, np.zeros((1, 2)), "none", start, 100_000)


@pytest.mark.usefixtures("folder")
def test_policies_and_critics_in_files_cost_equally():
    """The exact policy, and the critics made from P, K or H of the exact solution, have the same
    cost.

    A wrong gain fails. Wrong options are refused.
    """
    parts = {name: getattr(STEP, name) for name in ("A", "B", "Q", "R")}
    continuous = stored("continuous.json", **parts)
    plant = stored("plant.json", **parts, time="discrete", discount=0.97, N=PROBLEM.step.N)
    solution = solve_discrete(PROBLEM)
    words = ("fly", "--model", plant, "--initial", "x1=1", "--duration", "30")
    flown = answer(*words)
    assert np.shape(flown["x"]) == (31, 2)
    assert flown["x"][1] == pytest.approx((STEP.A - STEP.B @ solution.K)[:, 0])
    for name, matrix in (("P", solution.P), ("K", solution.K), ("H", solution.H)):
        critic = stored("critic.npz", **{name: matrix})
        assert answer(*words, "--weights", critic)["cost"] == pytest.approx(flown["cost"])
    wrong = stored("wrong.npz", K=-solution.K)
    assert answer(*words, "--weights", wrong, code=FAILED)["decays"] is False
    assert hfa(*words).out.startswith("PASS: the state decays, cost ")
    assert hfa(*words, "--weights", wrong).out.startswith("FAIL: the state does not decay, cost ")
    for refused, message in (
        (("fly", "--model", continuous, "--initial", "x1=1"), 'requires time = "discrete"'),
        (("fly", "--model", plant), "add --initial NAME=VALUE"),
        ((*words, "--gust", "400:5"), "--gust applies only to an aircraft"),
        (("fly", "--model", plant, "--initial", "y=1"), "y is unknown; choose from x1, x2"),
        ((*words[:-1], "2.5"), "give a whole number of steps"),
    ):
        result = hfa(*refused)
        assert result.code == 2
        assert message in result.err
