"""No ball about a wrong solution X of a Riccati equation is proved, whatever Y is given with it.

The proof requires a Y > 0 that nearly solves F'Y + Y F = -1 with the loop F of both players at X.

The games are uncoupled scalar games, whose roots are known, in other states.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from flint import arb, arb_mat
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from controller.riccati.balls import ball_matrix, precision
from controller.riccati.candidate import Candidate, corrections, first_units
from controller.riccati.equation import Equation
from controller.riccati.lyapunov import FailedError, Lyapunov, NotProvedError
from controller.riccati.refusal import stabilizing, why_not_the_value
from hfa import Game

BITS = 256
#: States z = T y of the uncoupled ones, with an inverse of integers.
T = np.array([[1.0, 2.0], [1.0, 3.0]])
T_INVERSE = np.array([[3.0, -2.0], [-1.0, 1.0]])


class Roots(NamedTuple):
    """Game of two states, and the roots of its uncoupled equations as fractions.

    right: of the stabilizing solution
    wrong: the other ones
    """

    game: Game
    right: tuple[tuple[int, int], tuple[int, int]]
    wrong: tuple[tuple[int, int], tuple[int, int]]


def in_other_states(a, b, e, q, **others):
    """Return the game of two scalar games with these a, b, e and q, in the states z = T y."""
    A, B, E = T @ np.diag(a) @ T_INVERSE, T @ np.diag(b), T @ np.diag(e)
    Q = T_INVERSE.T @ np.diag(q) @ T_INVERSE
    return Game(A, B, E=E, Q=Q, R=np.eye(2), **others)


ONES = [1.0, 1.0]
GAMES = {
    # P² - 2 a P - q = 0
    "continuous": Roots(
        in_other_states([1.0, -1.0], ONES, ONES, [3.0, 8.0]),
        ((3, 1), (2, 1)),
        ((-1, 1), (-4, 1)),
    ),
    # P² - 8/3 a P - 4/3 q = 0
    "disturbed": Roots(
        in_other_states([0.75, 1.5], ONES, ONES, [2.25, 9.0], delta=2.0),
        ((3, 1), (6, 1)),
        ((-1, 1), (-2, 1)),
    ),
    # (1 + P) (1 + other P) = a², and the product of the roots is -q.
    "discrete": Roots(
        in_other_states([2.0, 2.0], ONES, ONES, [0.0, 3.5], dt=True),
        ((3, 1), (7, 1)),
        ((0, 1), (-1, 2)),
    ),
    # The same for 15/16 P.
    "discrete, disturbed": Roots(
        in_other_states([2.0, 3.0], ONES, ONES, [0.0, 0.0], delta=4.0, dt=True),
        ((16, 5), (128, 15)),
        ((0, 1), (0, 1)),
    ),
}  # fmt: skip


def solution(roots):
    """Return T'⁻¹ diag(roots) T⁻¹."""
    first, second = (arb(above) / below for above, below in roots)
    back = ball_matrix(T_INVERSE)
    return back.transpose() * arb_mat([[first, 0], [0, second]]) * back


def lyapunov_solution(equation, X):
    """Return Y of F'Y + Y F = -1, in discrete time of F'Y F - Y = -1, for the loop F at X.

    It is solved in doubles: the proof requires no exact Y.
    """
    exact = X.mid()
    F = equation.loop(equation.gains_and_residual(exact)[0])
    F = np.array(F.mid().tolist(), dtype=float)
    one = np.eye(len(F))
    if equation.is_discrete:
        return ball_matrix(solve_discrete_lyapunov(F.T, one))
    return ball_matrix(solve_continuous_lyapunov(F.T, -one))


def proved_ball(equation, X, Y):
    """Return the ball about X that X and Y prove to contain the stabilizing solution."""
    return stabilizing(Candidate.at(equation, X, Y))


def contains(balls, exact):
    """Return whether all balls overlap the exact entries, which are balls of 256 bits themselves."""
    pairs = zip(balls.entries(), exact.entries(), strict=True)
    return all(ball.overlaps(entry) for ball, entry in pairs)


@pytest.mark.parametrize("name", GAMES)
def test_other_invariant_subspaces_are_refused(name):
    """Solutions X of the Riccati equation that do not stabilize are refused.

    Neither the Y of F'Y + Y F = -1 with the unstable loop F at X, which is indefinite, nor its
    negative, nor the Y of the stabilizing solution proves anything.
    """
    game, right, wrong = GAMES[name]
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        truth = solution(list(right))
        Y = lyapunov_solution(equation, truth)
        assert contains(proved_ball(equation, truth, Y).P, truth)
        for mixed in ([wrong[0], right[1]], [right[0], wrong[1]], list(wrong)):
            X = solution(mixed)
            own = lyapunov_solution(equation, X)
            for lie in (own, -own, Y):
                with pytest.raises(NotProvedError):
                    proved_ball(equation, X, lie)


@pytest.mark.parametrize("name", GAMES)
def test_each_proved_ball_contains_the_solution_and_its_gains(name):
    """A ball that is proved about any X contains the solution. It is proved for small changes of X.

    Y solves F'Y + Y F = -1 with the loop F at X or at the solution, or is up to 30 % off.
    """
    game, right, _ = GAMES[name]
    rng = np.random.default_rng(1)
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        truth = solution(list(right))
        gains = equation.gains_and_residual(truth)[0]
        # the change of X whose residual is -1, to the first order
        worst = lyapunov_solution(equation, truth)
        for size, is_worst in product(
            (0.0, 1e-40, 1e-12, 1e-6, 1e-3, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0), (False, True)
        ):
            change = T_INVERSE.T @ rng.standard_normal((2, 2)) @ T_INVERSE
            X = truth + (worst * arb(size) if is_worst else ball_matrix(size * (change + change.T)))
            ys = lyapunov_solution(equation, X), lyapunov_solution(equation, truth)
            for Y, factor in product(ys, (0.7, 0.97, 1.0, 1.03, 1.3)):
                try:
                    found = proved_ball(equation, X, Y * arb(factor))
                except NotProvedError:
                    assert size > 1e-6 or factor != 1.0
                    continue
                assert contains(found.P, truth)
                assert contains(found.gains, gains)


@pytest.mark.parametrize("name", GAMES)
def test_each_ball_proved_in_doubles_contains_the_solution_and_its_gains(name, monkeypatch):
    """A ball that is proved in doubles contains the solution, whatever correction and Y a wrong solver
    of Lyapunov equations returns.
    """
    game, right, _ = GAMES[name]
    rng, solved, proofs = np.random.default_rng(2), Lyapunov.solve, 0

    def wrong(self, C):
        noise = 10.0 ** rng.uniform(-9.0, 0.0) * rng.standard_normal(C.shape)
        return solved(self, C) * (1.0 + noise + noise.T)

    monkeypatch.setattr(Lyapunov, "solve", wrong)
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        truth = solution(list(right))
        gains = equation.gains_and_residual(truth)[0]
        for size in [0.0, 1e-12, 1e-6, 1e-3] * 8:
            change = size * rng.standard_normal((2, 2))
            with suppress(FailedError):
                for candidate in corrections(equation, truth + ball_matrix(change)):
                    at_X = equation.gains_and_residual(candidate.X.mid())[0]
                    assert contains(ball_matrix(candidate.loop), equation.loop(at_X))
                    with suppress(NotProvedError):
                        found, proofs = stabilizing(candidate), proofs + 1
                        assert contains(found.P, truth)
                        assert contains(found.gains, gains)
    assert proofs > 10


@pytest.mark.parametrize("change", [1e-9, 1e-3, 0.05])
def test_the_ball_about_a_candidate_has_room_for_the_quadratic_term(change):
    """P of x' = u is 1. At X = 1 + s, the residual is -2 s - s², and Y = 1 / (2 + 2 s): the distance
    from P is more than the residual times Y.
    """
    game = Game([[0.0]], [[1.0]], Q=[[1.0]], R=[[1.0]])
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        X = ball_matrix(np.array([[1.0 + change]]))
        assert proved_ball(equation, X, lyapunov_solution(equation, X)).P[0, 0].contains(1)


@pytest.mark.parametrize(
    ("rate", "q", "root", "dt"), [(-1.0, 1.0, 1.0, None), (0.5, 0.25, 0.5, True)]
)
def test_no_ball_is_proved_just_below_the_smallest_delta(rate, q, root, dt):
    """P² - 2 P + q = 0 has the double root 1 at q = 1, and P² - (0.75 + q) P + q = 0 has 0.5 at
    q = 0.25. For q just above, they have none: no X near the root is proved.

    rate: a of x' = a x + d, or x⁺ = a x + d, at δ = 1
    """
    game = Game([[rate]], [[0.0]], E=[[1.0]], Q=[[q + 5e-4]], R=[[1.0]], delta=1.0, dt=dt)
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        for X in root * np.linspace(0.6, 0.98, 20):
            candidate = ball_matrix(np.array([[X]]))
            with pytest.raises(NotProvedError):
                proved_ball(equation, candidate, lyapunov_solution(equation, candidate))


@pytest.mark.parametrize(
    ("game", "roots", "reason"),
    [
        # In the first state, the pole without disturbance is 1: unstable.
        (
            in_other_states([1.0, -1.0], [0.0, 1.0], [1.0, 0.0], [0.75, 8.0], delta=1.0),
            [(-3, 2), (2, 1)],
            "for every input, the gain from the disturbance",
        ),
        # It is 0: that of both players is -1.
        (
            in_other_states([0.0, -1.0], [0.0, 1.0], [1.0, 0.0], [-1.0, 8.0], delta=1.0),
            [(-1, 1), (2, 1)],
            "",
        ),
        # In the first state, delta² - E'XE = 1 - 2 < 0: the disturbance pays.
        (
            in_other_states([0.5, 2.0], [0.0, 1.0], [1.0, 0.0], [2.5, 3.5], delta=1.0, dt=True),
            [(2, 1), (7, 1)],
            "in one step, the disturbance gains",
        ),
    ],
)
def test_a_stabilizing_solution_of_two_states_may_be_no_value(game, roots, reason):
    """X is proved to stabilize the loop of both players, and not to be the value; nothing is proved
    where the pole without disturbance is exactly 0.
    """
    with precision(BITS):
        equation = Equation(game, first_units(game, game.delta), game.delta)
        X = solution(roots)
        found = proved_ball(equation, X, lyapunov_solution(equation, X))
        if reason:
            assert why_not_the_value(found).startswith(reason)
        else:
            with pytest.raises(NotProvedError):
                why_not_the_value(found)
