"""The checker of exact solutions: stored answers, Lyapunov equations and the number of bits."""

import numpy as np
import pytest

from controller.riccati.balls import (
    Balls,
    DoubleBalls,
    ball_matrix,
    precision,
)
from controller.riccati.equation import equation_of, users_units
from controller.riccati.lyapunov import (
    Lyapunov,
    change_along,
    lyapunov_in_bits,
    proves_stable,
)
from hfa import Game

BITS = 256


@pytest.mark.parametrize("seed", range(4))
def test_the_residual_of_a_step_contains_the_exact_one(seed):
    """The residual contains that of 500 bits, and its radius is below 1e-12 of it.

    R + B'XB, here R, has condition number 2^30: the gains lose half of their digits.
    """
    least, random = 2.0**-30, np.random.default_rng(seed)
    modes = np.linalg.qr(random.standard_normal((4, 4)))[0]
    R = modes @ np.diag([least, 1.0, 1.0, 1.0]) @ modes.T
    N = 0.1 * least * random.standard_normal((1, 4))
    game = Game([[0.0]], np.ones((1, 4)), Q=[[least]], R=(R + R.T) / 2.0, N=N, dt=True)

    def residual(bits):
        with precision(bits):
            equation = equation_of(game, users_units(game), Balls)
            _, residual = equation.gains_and_residual(Balls.of(np.zeros((1, 1))))
            return residual.matrix[0, 0]

    found, exact = residual(53), residual(500)
    assert found.contains(exact)
    assert found.rad() < 1e-12 * exact


def test_an_indefinite_Y_proves_no_stability():
    """The Y of an unstable loop solves its Lyapunov equation exactly, but is not positive.

    A positive Y proves no stability of it either, but that of the stable loop -|F|.
    """
    F, Y = np.diag([-1.0, 2.0]), np.diag([0.5, -0.25])
    for balls in (Balls, DoubleBalls):
        assert not proves_stable(balls.of(F), balls.of(Y), is_discrete=False)
        assert not proves_stable(balls.of(F), balls.of(np.abs(Y)), is_discrete=False)
        assert proves_stable(balls.of(-np.abs(F)), balls.of(np.abs(Y)), is_discrete=False)


@pytest.mark.parametrize("is_discrete", [False, True])
def test_a_lyapunov_equation_is_solved_in_bits(is_discrete):
    """The residual is in the last bits, corrected in doubles and solved in bits."""
    with precision(BITS):
        F, C = (
            ball_matrix(np.array(each))
            for each in ([[-0.5, 1.0], [0.0, -0.25]], [[1.0, 2.0], [2.0, -3.0]])
        )
        in_bits = Lyapunov(Balls(F), is_discrete=is_discrete)
        for D in (Balls(lyapunov_in_bits(F, C, is_discrete=is_discrete)), in_bits.solve(-Balls(C))):
            residual = change_along(Balls(F), D, is_discrete=is_discrete) + Balls(C)
            assert residual.norm() < 1e-70


def test_the_number_of_bits_is_restored():
    """`precision` restores the number of bits, also after an exception."""
    from flint import ctx

    before = ctx.prec
    with precision(77):
        assert ctx.prec == 77
    with pytest.raises(ZeroDivisionError), precision(78):
        ball_matrix(np.zeros((1, 1))).inv()
    assert ctx.prec == before
