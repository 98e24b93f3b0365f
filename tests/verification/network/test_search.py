"""Search for errors of a network over a box of states, and simulations from the box."""

import math

import casadi as ca
import numpy as np
import pytest
from game_samples import failed_names
from planted_critics import gain, value

from hfa import Game, from_network, solve, verify

#: Typical deviations of the flexible aircraft: ft/s, rad and rad/s.
BOX = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
pytestmark = pytest.mark.usefixtures("folder")


def test_a_network_right_only_at_the_origin_fails(game):
    """The policy u = -K z + 5 z_1³/7³ e_1 has the exact K, and fails by the search alone: the error
    found is the largest in the box, 5 at its edge z_1 = 7, relative to the largest exact input, with
    inputs in units of 1/√R.
    """
    z = ca.SX.sym("z", 6)
    u = -ca.DM(gain(game)) @ z + 5.0 * (z[0] / 7.0) ** 3 * ca.DM(np.eye(5)[0])
    critic = from_network(game, ca.Function("policy", [z], [u]), network="policy")
    check = verify(game, critic, flights=4)
    assert check.K_rel_error < 1e-12
    assert failed_names(check.checks) == {"searched_policy_error"}
    largest = np.sqrt(game.R.diagonal()) * (np.abs(solve(game).K) @ BOX)
    found = check.value_of("searched_policy_error")
    assert found == pytest.approx(5.0 * np.sqrt(game.R[0, 0]) / largest[0], rel=1e-6)
    assert not check.holds(1e-6)


def test_a_value_with_nan_in_the_box_fails(game):
    """The error of a value that is nan where z_1 < -1, a part of the box, is infinite."""
    z = ca.SX.sym("z", 6)
    V = ca.bilin(ca.DM(value(game)), z, z) + 1e-30 * ca.sqrt(z[0] + 1.0)
    critic = from_network(game, ca.Function("V", [z], [V]), network="V")
    verdict = verify(game, critic, flights=1)
    assert verdict.value_of("searched_value_error") == math.inf


def biased(game, share):
    """Return the policy u = -100 K tanh(z / 100) plus a constant, a share of the largest inputs."""
    z = ca.SX.sym("z", 6)
    u = -100.0 * ca.DM(gain(game)) @ ca.tanh(z / 100.0)
    offset = share * np.abs(gain(game)) @ BOX
    policy = ca.Function("policy", [z], [ca.densify(u + ca.DM(offset))])
    return from_network(game, policy, network="policy")


@pytest.mark.parametrize(
    ("share", "grade"), [(1e-8, "near"), pytest.param(0.3, "fail", marks=pytest.mark.slow)]
)
def test_a_bias_is_graded_by_the_cost_of_its_equilibrium(game, share, grade):
    """A policy with a constant of a `share` of the largest inputs in the box has an equilibrium z off
    the trim. The check "rest_point" has V*(z) in percent of the mean of V* over the corners of the
    box; verdict.holds(limit) is true if the limit exceeds this number and the cost above the optimum.

    The stated cost of the equilibrium per second is z'Qz + u'Ru.
    """
    critic = biased(game, share)
    verdict = verify(game, critic, limit=1e-9, flights=4, limit_seconds=1.0)
    assert "rest_point" in failed_names(verdict.checks)
    assert verdict.grade == grade
    found = verdict.to_dict()["network"]
    z = np.array(found["rest_point"])
    u = critic.u(z)
    assert np.linalg.norm(game.A @ z + game.B @ u) <= 1e-12 * np.linalg.norm(game.B @ u)
    assert found["equilibrium_cost"] == pytest.approx(
        z @ game.Q @ z + u @ game.R @ u, rel=1e-9, abs=0.0
    )
    assert f"costs {found['equilibrium_cost']:.2g} per second" in str(verdict)
    P = value(game)
    percent = 100.0 * z @ P @ z / (BOX @ np.diag(np.diag(P)) @ BOX)
    assert verdict.value_of("rest_point") == pytest.approx(percent, rel=1e-6)
    least = max(percent, verdict.cost_above_optimum_percent)
    assert (verdict.holds(0.99 * least), verdict.holds(1.01 * least)) == (False, True)


def test_errors_are_relative_to_the_largest_exact_numbers_in_the_box():
    """For V 10 % too large (plus a constant, which counts nothing) and u = -0.8 K z, the errors found
    are relative to b'|P|b of V, and to the largest slope and input in the box |z_i| <= b_i.
    """
    A = np.array([[-0.5, 1.0], [-1.0, 0.2]])
    B = np.array([[0.0, 1.0], [1.0, 0.0]])
    game = Game(A, B, E=np.eye(2), Q=np.eye(2), R=np.eye(2), delta=50.0)
    P, K = solve(game).P, solve(game).K
    b = np.array([2.0, 0.3])
    z = ca.SX.sym("z", 2)
    V = 1.1 * ca.bilin(ca.DM(P), z, z) + 7.0
    both = ca.Function("both", [z], [ca.vertcat(V, -0.8 * ca.DM(K) @ z)])
    found = verify(game, from_network(game, both, network="V+policy"), box=b, flights=1)
    errors = {each["name"]: each["error"] for each in found.to_dict()["network"]["searched"]}
    largest = max(corner @ P @ corner for corner in (b, b * [1.0, -1.0]))
    expected = {
        "value": 0.1 * largest / (b @ np.abs(P) @ b),
        "gradient": 0.1,
        "policy": 0.2,
    }
    assert errors == pytest.approx(expected, rel=1e-6)
