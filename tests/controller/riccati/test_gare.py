"""The exact solution and the smallest delta: accuracy, certification, and reasons for refusals."""

import numpy as np
import pytest

from controller import minimum_delta
from controller.riccati import smallest_delta
from hfa import Game, NoSolutionError, solve, verify

I2 = np.eye(2)


TURN, SECOND = [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]]


@pytest.mark.parametrize(
    ("A", "B", "options", "message"),
    [
        (np.diag([0.5, -1.0]), SECOND, {}, "input reaches the mode with eigenvalue 0.5;"),
        (np.diag([0.0, -1.0]), SECOND, {}, "input reaches the mode with eigenvalue 0;"),
        ([[0.5, 1.0], [-1.0, 0.5]], 0.0 * I2, {}, "stabilizable: .* eigenvalue 0.5 ± 1i;"),
        (TURN, 0.0 * I2, {"dt": True}, "stabilizable: .* eigenvalue 0 ± 1i of sqrt"),
        (1.2 * I2, SECOND, {"dt": True, "discount": 0.81}, "stabilizable: .* 1.08 of sqrt"),
        (TURN, SECOND, {"Q": 0.0 * I2}, "detectable: .* eigenvalue 0 ± 1i has no cost"),
        # u = -x1 costs nothing, and turns the state at √2 rad/s.
        (TURN, SECOND, {"Q": [1.0, 0.0], "N": [[1.0], [0.0]]}, "detectable: .* 0 ± 1.414i has"),
    ],
)
def test_a_missing_lqr_solution_names_the_mode(A, B, options, message):
    """If no LQR solution exists, a one-line message names the responsible mode."""
    weights = {"Q": I2, "R": np.eye(np.shape(B)[1])} | options
    game = Game(A, B, E=I2, delta=10.0, **weights)
    for solver in (solve, minimum_delta):
        with pytest.raises(NoSolutionError, match=message) as refusal:
            solver(game)
        assert "\n" not in str(refusal.value)


def test_a_solution_beyond_the_range_of_doubles_is_refused():
    """P is 2.4e600 where the input moves the state by 1e-300."""
    with pytest.raises(NoSolutionError, match="beyond the range of doubles"):
        solve(Game([[1.2]], [[1e-300]], Q=[1.0], R=[1.0]))


@pytest.mark.parametrize(("slow", "is_refined"), [(1e-3, True), (-1e-3, False)])
def test_the_printed_gain_stabilizes(slow, is_refined):
    """If four decimals of K do not stabilize a plant with a fast and a slow mode, more are printed.

    slow: slow eigenvalue of A, 1/s
    is_refined: whether four decimals are not enough
    """
    modes = np.array([[0.8, 0.6], [-0.6, 0.8]])
    A = modes @ np.diag([1e3, slow]) @ modes.T
    B = 100.0 * modes @ [[1.0], [1.0]]
    solution = solve(Game(A, B, Q=4e-12 * np.eye(2), R=np.eye(1)))
    (table,) = (part for part in solution.report().parts if "K" in getattr(part, "header", ()))
    printed = np.array([row[1:] for row in table.rows], dtype=float)
    assert np.linalg.eigvals(A - B @ printed).real.max() < 0.0
    assert (np.linalg.eigvals(A - B @ solution.K.round(4)).real.max() > 0.0) == is_refined
    assert np.array_equal(printed, solution.K.round(4)) != is_refined


def test_a_gain_that_doubles_do_not_hold_is_said_not_to_stabilize():
    """The exact K moves the pole 2^-60 to -2^-60; K rounded to doubles does not."""
    A = np.diag([0.5, 0.875, -2.0, 2.0**-60])
    A[0, 2:] = 2.5, 0.5
    game = Game(A, [[3.0], [0.125], [1.0], [-1.0]], Q=np.zeros((4, 4)), R=[1.0])
    solution = solve(game)
    assert solution.poles().max() == -(2.0**-60)
    assert not solution.is_stable
    assert not verify(game, solution).ok
    assert "K, rounded to doubles, does not stabilize the plant" in str(solution.report())


def test_delta_min_of_48_states_is_proved_without_many_bits():
    """The bounds of an unstable game, beyond which P is not finite, are proved in a second or two."""
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((48, 48)) / np.sqrt(48), rng.standard_normal((48, 12))
    value, refused = minimum_delta(Game(A, B, Q=np.eye(48), R=np.eye(12)))
    assert refused < value <= refused * (1.0 + 1e-6)


def test_an_estimate_beside_which_nothing_is_proved_is_no_refusal(monkeypatch):
    """Where the first tried delta is exactly delta_min, 1 here, bounds are proved beside it."""
    exact = smallest_delta.Estimate(smallest_delta.FIRST_WIDTH, None)
    monkeypatch.setattr(smallest_delta, "estimate", lambda _: exact)
    bounds = minimum_delta(Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]]))
    assert bounds.refused < 1.0 < bounds.value <= bounds.refused * (1.0 + 1e-6)
