"""Critics of the discounted problem in discrete time."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, stored
from planted_critics import gain, value

from controller import Game
from hfa_cli.main import BAD_INPUT, FAILED
from verification import from_gain, from_value, solve_discounted
from verification.critic.critic_check import check_discounted

DISCOUNT, DT = 0.99, 0.01
WORDS = ("--discount", str(DISCOUNT), "--dt", str(DT))
pytestmark = pytest.mark.usefixtures("folder")


def test_the_exact_critic_passes_and_planted_mistakes_are_named(game: Game) -> None:
    exact = solve_discounted(game, DISCOUNT, DT)
    assert check_discounted(game, from_value(game, exact.P), DISCOUNT, DT).ok
    assert check_discounted(game, from_gain(game, exact.K), DISCOUNT, DT).ok
    for wrong, said in (
        (from_value(game, exact.P / DT), "every entry of P is 100 times the exact one"),
        (from_value(game, -exact.P), "the value has the wrong sign"),
        (from_gain(game, -exact.K), "the gain has the wrong sign"),
        (from_value(game, value(game)), "this is the solution in continuous time, without discount"),
        (from_gain(game, gain(game)), "this is the gain in continuous time, without discount"),
    ):
        check = check_discounted(game, wrong, DISCOUNT, DT)
        assert not check.ok
        assert check.diagnosis.startswith(said)


def test_the_cost_lost_is_that_of_the_steps_summed_up(game: Game) -> None:
    """Under w = L x, from the worst start among many: the sum of 3000 steps."""
    exact = solve_discounted(game, DISCOUNT, DT)
    step, K, rng = exact.game, 1.1 * exact.K, np.random.default_rng(0)
    check = check_discounted(game, from_gain(game, K), DISCOUNT, DT)
    x = np.linalg.solve(np.linalg.cholesky(exact.P).T, rng.normal(size=(6, 1000)))
    V, J, factor = np.sum(x * (exact.P @ x), axis=0), np.zeros(1000), 1.0
    for _ in range(3000):
        u, w = -K @ x, exact.disturbance_gain @ x
        paid = np.sum(x * (step.Q @ x), axis=0) + np.sum(u * (step.R @ u), axis=0)
        J += factor * (paid - step.delta**2 * np.sum(w * w, axis=0))
        x, factor = step.A @ x + step.B @ u + step.E @ w, factor * DISCOUNT
    lost = 100.0 * (J / V - 1.0)
    assert 0.7 * check.lost < lost.max() <= check.lost * (1 + 1e-6)


def test_the_command_compares_with_the_problem_that_is_said_and_never_guesses(game: Game) -> None:
    file = stored("P.npz", P=solve_discounted(game, DISCOUNT, DT).P)
    found = answer("verify", *AT_15, "--weights", file, *WORDS)
    assert (found["ok"], found["schema"], found["dt"]) == (True, "hfa.discounted-check/1", DT)
    said = hfa("verify", *AT_15, "--weights", file, *WORDS).out
    assert said.startswith("PASS by the error limit 1e-06: exact within 1e-06, stabilizing, no cost lost")
    assert answer("verify", *AT_15, "--weights", file, code=FAILED)["ok"] is False
    one = hfa("verify", *AT_15, "--weights", file, "--discount", "0.99")
    assert (one.code, "--discount and --dt belong together; neither has a default" in one.err) == (BAD_INPUT, True)
