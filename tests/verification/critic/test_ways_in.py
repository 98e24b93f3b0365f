"""A critic whose policy diverges from corners of the box fails, whichever way it is given."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from cli import hfa as run
from game_files import stored
from known_models import game_at

import hfa
from controller import basis
from hfa import Game, from_weights, solve, verify
from hfa.main import FAILED
from verification import Scope

pytestmark = pytest.mark.usefixtures("folder")
GAME = game_at(8.0)
#: Weights of the fourth powers of airspeed, angle of attack, dihedral and pitch rate.
TAIL = np.array([0.0, -200.0, -50.0, -50.0])
CHANNELS = [0, 1, 3, 4]
FAST = Scope(flights=4)


@cache
def P_of(game: Game) -> np.ndarray:
    return solve(game).P


def weights(game: Game) -> np.ndarray:
    """Return the weights of the diverging critic of a game in the paper's basis."""
    psi = basis("paper", 6)
    W = psi.weights(P_of(game))
    powers = psi.exponents[21:].argmax(axis=1).tolist()
    for channel, weight in zip(CHANNELS, TAIL, strict=True):
        W[21 + powers.index(channel)] = weight
    return W


@pytest.mark.slow  # test_a_diverging_critic_fails_in_python, and the quartic tail in discrete time
def test_a_diverging_critic_fails_on_the_command_line() -> None:
    """It fails alone, among right ones, and in discrete time, also if only the cost is limited."""
    sampled = GAME.sampled(0.05, 0.999)
    right = stored("right.npz", P=P_of(GAME))
    diverging = stored("wrong.npz", W=weights(GAME), basis="paper")
    discounted = stored("discounted.npz", W=weights(sampled), basis="paper")
    for words in (
        (diverging,),
        (right, diverging),
        (discounted, "--discount", "0.999", "--dt", "0.05"),
    ):
        words = ("verify", "--dihedral", "8", "--weights", *words, "--limit-cost", "1")
        assert run(*words).code == FAILED


Z = ca.SX.sym("z", 6)
V = ca.bilin(ca.DM(P_of(GAME)), Z, Z) + ca.dot(ca.DM(TAIL), Z[CHANNELS] ** 4)
POLICY = -0.5 * ca.DM(GAME.R_inverse_B_transposed) @ ca.gradient(V, Z)
OUTPUTS = {
    "V": V,
    "gradient": ca.gradient(V, Z),
    "policy": POLICY,
    "V+policy": ca.vertcat(V, POLICY),
}


@pytest.mark.parametrize("way", ["functions", *OUTPUTS])
def test_a_diverging_critic_fails_in_python(way: str) -> None:
    if way == "functions":
        critic = from_weights(GAME, [1.0], ca.Function("psi", [Z], [V]))
    else:
        function = ca.Function("network", [Z], [ca.densify(OUTPUTS[way])])
        critic = hfa.from_network(GAME, function, network=way)
    verdict = verify(GAME, critic, scope=FAST)
    assert verdict.grade == "fail"
    assert not verdict.holds(limit_cost=1.0)


def test_a_biased_critic_fails() -> None:
    """A linear term of V moves the equilibrium off the trim, so the cost is no reason to pass."""
    W = basis("quadratic+linear", 6).weights(P_of(GAME))
    assert verify(GAME, from_weights(GAME, W, "quadratic+linear"), scope=FAST).ok
    W[22] = 50.0
    verdict = verify(GAME, from_weights(GAME, W, "quadratic+linear"), scope=FAST)
    assert verdict.grade == "fail"
    assert verdict.value_of("rest_point") > 0.0
    assert not verdict.holds(limit_cost=1.0)
