"""Verdicts on networks as critics and policies."""

import casadi as ca
import numpy as np
import pytest
from cli import hfa
from game_files import AT_15, stored
from network_files import torch_file
from planted_critics import gain, value

from hfa import BadInputError, Game, from_network, solve, verify

pytestmark = pytest.mark.usefixtures("folder")


# Several outputs, scales, bases in words.


def test_a_scale_without_a_number_for_each_state_is_refused():
    """A scale of 2 numbers is refused for 6 states."""
    path = torch_file("scaled.pt", {"weight": np.ones((5, 6))})
    said = hfa("verify", *AT_15, "--weights", path, "--set", "scale=1,2").err
    assert "does not consist of 6 finite numbers" in said


def test_three_outputs_on_a_plant_with_two_inputs_are_a_gradient():
    """Without a name, 3 outputs for 3 states and 2 inputs are read as ∂V/∂z, not as V and u.

    With network="V+policy", V = z'Pz passes, and u = +K z has the wrong sign.
    """
    A = [[1.0, 0.4, 0.0], [0.1, -1.0, 1.0], [0.3, 0.0, -2.0]]
    game = Game(A, np.eye(3)[:, :2], E=np.eye(3), Q=np.eye(3), R=np.eye(2), delta=9.0)
    z = ca.SX.sym("z", 3)
    V = ca.bilin(ca.DM(value(game)), z, z)
    both = ca.Function("f", [z], [ca.vertcat(V, ca.DM(gain(game)) @ z)])
    check = verify(game, from_network(game, both, network="V+policy"), flights=1, limit_seconds=0.0)
    assert check.P_rel_error < 1e-6
    assert "the gain has the wrong sign" in check.reason
    assert set(from_network(game, both).network) == {"gradient"}


def test_scale_applies_to_the_inputs_of_a_basis(game):
    """A layer w on a basis is V = w'ψ(scale z): P is scaled on both sides.

    The basis is the quadratic one, or the squares of the states, for which V(1, ..., 1) is
    Σ w_i scale_i² + 2.
    """
    weights = np.arange(1.0, 22.0)
    scale = np.array([0.5, 6.0, 1.0, 4.0, 3.0, 0.25])
    path = stored("layer.npz", weight=weights[None], bias=np.zeros(1))
    own = from_network(game, path, basis="quadratic")
    scaled = from_network(game, path, basis="quadratic", scale=scale)
    np.testing.assert_allclose(scaled.P, own.P * np.outer(scale, scale), rtol=1e-12)
    assert scaled.P[0, 1] != own.P[0, 1]
    z = ca.SX.sym("z", 6)
    squares = ca.Function("squares", [z], [z**2])
    path = stored("squares.npz", weight=weights[None, :6], bias=np.full(1, 2.0))
    critic = from_network(game, path, basis=squares, scale=scale)
    assert float(critic.value(np.ones(6))) == pytest.approx(2.0 + weights[:6] @ scale**2)


def test_networks_with_unsuitable_output_numbers_are_refused(game):
    """Three outputs are neither V, ∂V/∂z nor u of the paper's game with 6 states and 5 inputs.

    A single output, which may be V or u of a plant with one input, is read as the policy.
    """
    path = torch_file("policy.pt", {"weight": np.zeros((3, 6))})
    with pytest.raises(
        BadInputError,
        match="has 3 outputs, but for this plant V has 1, gradient has 6, policy has 5",
    ):
        from_network(game, path)
    one = Game(-np.eye(3), np.ones((3, 1)), Q=np.ones(3), R=[1.0])
    path = torch_file("policy.pt", {"weight": -np.ones((1, 3))})
    assert np.array_equal(from_network(one, path).K, from_network(one, path, network="policy=").K)


def test_the_policy_of_a_value_contains_the_cross_weights():
    """Networks of V and ∂V/∂z imply u = -R⁻¹(½ B'∂V/∂z + N'z).

    V is the exact z'Pz, and this with 0.1 |z|⁴ added.
    """
    A = np.array([[0.0, 1.0], [2.0, -0.3]])
    B = np.array([[0.0], [1.0]])
    N = np.array([[0.4], [-0.3]])
    game = Game(A=A, B=B, Q=np.eye(2), R=[2.0], N=N)
    exact = solve(game)
    z = ca.SX.sym("z", 2)
    state = np.array([0.7, -0.2])
    for bend in (0.0, 0.1):
        V = ca.bilin(ca.DM(exact.P), z, z) + bend * ca.sumsqr(z) ** 2
        slope = ca.Function("slope", [z], [ca.gradient(V, z)])
        u = -np.linalg.solve(game.R, 0.5 * B.T @ np.array(slope(state)).ravel() + N.T @ state)
        for function, kind in ((ca.Function("V", [z], [V]), "V"), (slope, "gradient")):
            critic = from_network(game, function, network=kind)
            assert np.allclose(np.array(critic.policy(state)).ravel(), u)
