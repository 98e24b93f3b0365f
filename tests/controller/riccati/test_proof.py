"""The checker of exact solutions proves right proposals and refuses wrong ones."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, arb_mat
from stored_games import KINDS, errors, stored

from controller.riccati.balls import (
    Balls,
    DoubleBalls,
    ball_matrix,
    identity,
    midpoints,
    precision,
)
from controller.riccati.enclosure import enclosed, lyapunov_enclosure
from controller.riccati.equation import equation_of, users_units
from controller.riccati.proof import (
    NotProvedError,
    lyapunov_ball,
    prove_value,
    proves_stable,
    stabilizing,
)
from hfa import Game

BITS = 256
#: Games of both times with one state, whose solutions are known in closed form.
SCALAR = {
    "continuous": Game(
        [[1.0]], [[1.0]], E=[[1.0]], Q=[[3.0]], R=[[1.0]]
    ),  # P² - 2P - 3 = 0: 3 and -1
    "discrete": Game([[2.0]], [[1.0]], E=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=True),  # P = 3 and 0
}
ROOTS = {"continuous": (3.0, -1.0), "discrete": (3.0, 0.0)}
#: Loops of both players at the first root, and Y.
LOOPS = {"continuous": (-2.0, 0.25), "discrete": (0.5, 4.0 / 3.0)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_few_balls_contain_the_stored_answers(kind: str) -> None:
    game = stored(kind, 0)
    found = enclosed(game.game)
    assert max(errors(game, midpoints(found.P), midpoints(found.K))) < 1e-13


@pytest.mark.parametrize("time", SCALAR)
@pytest.mark.parametrize("arithmetic", [Balls, DoubleBalls])
def test_a_wrong_root_is_no_stabilizing_solution(
    time: str, arithmetic: type[Balls | DoubleBalls]
) -> None:
    """The other root solves the equation exactly, with the exact, negative Y of its loop."""
    game = SCALAR[time]
    with precision(BITS):
        equation = equation_of(game, users_units(game), Balls)
        right, wrong = (ball_matrix(np.array([[root]])) for root in ROOTS[time])
        Y = ball_matrix(np.array([[LOOPS[time][1]]]))
        stabilizing(equation, right, Y, arithmetic)
        gains, _ = equation.gains_and_residual(wrong)
        F = equation.loop(Balls(wrong), Balls(gains)).matrix[0, 0]
        exact = 1 / (1 - F**2) if game.is_discrete else -1 / (2 * F)
        for Y_of_lie in (Y, arb_mat([[exact]]), arb_mat([[-exact]])):
            with pytest.raises(NotProvedError):
                stabilizing(equation, wrong, Y_of_lie, arithmetic)


@pytest.mark.parametrize("time", SCALAR)
@pytest.mark.parametrize("arithmetic", [Balls, DoubleBalls])
@pytest.mark.parametrize("error", [1e-12, 1e-6, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("factor", [0.7, 0.9, 1.0, 1.1, 1.3])
def test_an_accepted_proposal_contains_the_solution(
    time: str, arithmetic: type[Balls | DoubleBalls], error: float, sign: float, factor: float
) -> None:
    """However wrong X and Y are: what is accepted contains the right root and gain."""
    game = SCALAR[time]
    root = ROOTS[time][0]
    with precision(BITS):
        equation = equation_of(game, users_units(game), Balls)
        X, Y = (
            ball_matrix(np.array([[each]]))
            for each in (root + sign * error, factor * LOOPS[time][1])
        )
        try:
            found = stabilizing(equation, X, Y, arithmetic)
        except NotProvedError:
            assert error > 1e-3 or abs(factor - 1.0) > 0.2
            return
        assert Balls.around(found.X, found.spread).matrix[0, 0].contains(arb(root))
        gain = root if time == "continuous" else 2.0 * root / (1.0 + root)
        assert found.gains[0, 0].contains(arb(gain))


@pytest.mark.parametrize("arithmetic", [Balls, DoubleBalls])
@pytest.mark.parametrize(
    ("game", "P", "Y", "Y_of_control"),
    [
        # A = 1 is unstable without input, and P = -3/2 has the stable loop 1 + P of both.
        (Game([[1.0]], [[0.0]], E=[[1.0]], Q=[[0.75]], R=[[1.0]], delta=1.0), -1.5, 1.0, -0.5),
        # The loop of both is A / (1 - P), and the disturbance gains P - 1 in each step.
        (
            Game([[0.5]], [[0.0]], E=[[1.0]], Q=[[2.5]], R=[[1.0]], delta=1.0, dt=True),
            2.0,
            4 / 3,
            4 / 3,
        ),
    ],
)
def test_a_stabilizing_solution_may_be_no_value(
    game: Game, P: float, Y: float, Y_of_control: float, arithmetic: type[Balls | DoubleBalls]
) -> None:
    with precision(BITS):
        equation = equation_of(game, users_units(game), Balls)
        X, shape, of_control = (ball_matrix(np.array([[each]])) for each in (P, Y, Y_of_control))
        found = stabilizing(equation, X, shape, arithmetic)
        for lie in (None, of_control, shape):
            with pytest.raises(NotProvedError):
                prove_value(found, lie)


def test_an_indefinite_Y_proves_no_stability() -> None:
    """The Y of an unstable loop solves its Lyapunov equation exactly, but is not positive."""
    F, Y = np.diag([-1.0, 2.0]), np.diag([0.5, -0.25])
    for balls in (Balls, DoubleBalls):
        assert not proves_stable(balls.of(F), balls.of(Y), is_discrete=False)
        assert not proves_stable(balls.of(F), balls.of(np.abs(Y)), is_discrete=False)
        assert proves_stable(balls.of(-np.abs(F)), balls.of(np.abs(Y)), is_discrete=False)


@pytest.mark.parametrize("is_discrete", [False, True])
def test_a_lyapunov_ball_contains_the_solution(is_discrete: bool) -> None:
    """Whatever D is proposed, and D of an unstable loop is refused."""
    F, C = np.array([[-0.5, 1.0], [0.0, -0.25]]), np.array([[1.0, 2.0], [2.0, -3.0]])
    with precision(BITS):
        exact = lyapunov_enclosure(ball_matrix(F), ball_matrix(C), is_discrete=is_discrete)
        assert exact is not None
        change = Balls(ball_matrix(F)).T @ Balls(exact)
        left = change + change.T
        if is_discrete:
            left = change @ Balls(ball_matrix(F)) - Balls(exact)
        assert (left + Balls(ball_matrix(C))).norm() < 1e-30
        Y = lyapunov_enclosure(ball_matrix(F), identity(2), is_discrete=is_discrete)
        for wrong in (1e-6, 0.1, 10.0):
            D = exact + ball_matrix(wrong * np.array([[1.0, -1.0], [-1.0, 2.0]]))
            found = lyapunov_ball(ball_matrix(F), ball_matrix(C), D, Y, is_discrete=is_discrete)
            assert all(map(arb.contains, found.entries(), exact.mid().entries()))
        unstable = ball_matrix(np.array([[2.0]])), identity(1)
        assert lyapunov_enclosure(*unstable, is_discrete=is_discrete) is None


def test_the_number_of_bits_is_restored() -> None:
    from flint import ctx

    before = ctx.prec
    with precision(77):
        assert ctx.prec == 77
    with pytest.raises(ZeroDivisionError), precision(78):
        ball_matrix(np.zeros((1, 1))).inv()
    assert ctx.prec == before
