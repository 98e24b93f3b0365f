"""Verdicts on networks as critics and policies."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, stored
from network_files import (
    onnx_file,
    torch_file,
)
from planted_critics import gain, value, weights_of

from controller import critic_in
from hfa import (
    Game,
    from_network,
    read_critic,
    solve,
    verify,
)
from hfa.main import BAD_INPUT, DONE, FAILED

GOPS = json.loads(Path(__file__).with_name("gops.json").read_text(encoding="utf-8"))
pytestmark = pytest.mark.usefixtures("folder")


# Right networks.


@pytest.mark.slow
def test_published_weights_of_gops_are_checked():
    """The published weights of GOPS, V = W'psi plus a constant, are checked.

    The exact weights pass. The learned weights have errors of 1.6 % in P and 0.43 % in K, and a
    cost between 0.0001 % and 0.001 % above the optimum. V at the origin is the constant.
    """
    plant = stored("plant.json", **GOPS["plant"])
    exact_P = solve(Game(**GOPS["plant"])).P
    row, column = np.triu_indices(3)
    learned_P = np.zeros((3, 3))
    learned_P[row, column] = learned_P[column, row] = GOPS["learned"] / (1.0 + (row != column))
    B = np.array(GOPS["plant"]["B"])
    errors = [
        np.linalg.norm(F @ (learned_P - exact_P)) / np.linalg.norm(F @ exact_P)
        for F in (np.eye(3), B.T)
    ]
    assert [f"{error:.2g}" for error in errors] == ["0.016", "0.0043"]
    words = ("verify", "--model", plant, "--network", "V=value", "--weights")
    for name, weights, bias in (
        ("exact", GOPS["exact"], 0.0),
        ("learned", GOPS["learned"], GOPS["learned_bias"]),
    ):
        one = {"v.weight": np.array([weights], "float32"), "v.bias": np.array([bias], "float32")}
        both = {
            f"{part}.{key}": each for part in ("value", "value_target") for key, each in one.items()
        }
        torch_file(f"{name}.pkl", both)
    exact = answer(*words, "exact.pkl")
    assert exact["ok"]
    learned = answer(*words, "learned.pkl", code=FAILED)
    assert [learned["P_rel_error"], learned["K_rel_error"]] == pytest.approx(errors, rel=1e-4)
    assert learned["network"]["value_at_origin"] == pytest.approx(GOPS["learned_bias"], rel=1e-6)
    assert hfa(*words, "learned.pkl", "--limit-cost", "0.001").code == DONE
    assert hfa(*words, "learned.pkl", "--limit-cost", "0.0001").code == FAILED


# Several outputs, scales, bases in words.


def test_the_scale_of_inputs_is_applied(game):
    """A policy with scaled inputs passes with its scale. A scale of wrong length is refused."""
    scale = np.array([1 / 7.0, *[10.0] * 5])
    path = torch_file("scaled.pt", {"weight": -gain(game) / scale})
    assert verify(game, from_network(game, path, scale=scale), flights=1).ok
    assert (
        "does not consist of 6 finite numbers"
        in hfa("verify", *AT_15, "--weights", path, "--set", "scale=1,2").err
    )


def test_v_and_a_policy_are_checked_together(game):
    """V and u as outputs of one graph are checked together: a policy of the wrong sign fails.

    If the argument `network` is omitted, six outputs are read as the gradient of V.
    """
    nodes = [
        ("MatMul", "x P", "h"),
        ("Mul", "x h", "t"),
        ("ReduceSum", "t axes", "V"),
        ("MatMul", "x K", "u"),
        ("Concat", "V u", "y", {"axis": 1}),
    ]
    constants = {"P": value(game), "axes": np.array([1]), "K": gain(game).T}
    path = onnx_file("both.onnx", nodes, constants, outputs=6)  # V and five inputs
    check = verify(game, from_network(game, path, network="V+policy="), flights=1)
    assert not check.ok
    assert check.P_rel_error < 1e-6
    assert "the gain has the wrong sign" in check.reason
    assert set(from_network(game, path).network) == {"gradient"}


def test_scale_applies_to_the_inputs_of_a_basis(game):
    """A layer on a basis is evaluated at the scaled states."""
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
    assert critic.value is not None
    assert float(critic.value(np.ones(6))) == pytest.approx(2.0 + weights[:6] @ scale**2)


def test_kind_of_an_npy_file_follows_from_shape(game):
    """The shape of the array in an .npy file determines whether the array is W, P or K.

    An array of another shape is refused.
    """
    for entry, right in {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}.items():
        np.save("mine.npy", right)
        found = critic_in("mine.npy", game)
        stored_part = {"W": found.weights, "P": found.P, "K": found.K}[entry]
        assert np.array_equal(stored_part, right)
    np.save("odd.npy", np.ones((4, 3)))
    assert (
        "odd.npy: the array of shape (4, 3) does not fit W, P or K"
        in hfa("verify", *AT_15, "--weights", "odd.npy").err
    )


def test_networks_with_unsuitable_output_numbers_are_refused(game):
    """A network is refused if its number of outputs fits no quantity, or fits several.

    The command that the error proposes is accepted. A single output on a plant with one input is
    read as the policy.
    """
    said = hfa(
        "verify", *AT_15, "--weights", torch_file("policy.pt", {"weight": np.zeros((3, 6))})
    ).err
    assert (
        "the network has 3 outputs, but for this plant V has 1, gradient has 6, policy has 5"
        in said
    )
    plant = stored("plant.json", **GOPS["plant"])
    path = torch_file("policy.pt", {"weight": -np.ones((1, 3))})
    named = hfa("verify", "--model", plant, "--weights", path, "--network", "policy=")
    assert named.code == FAILED
    alone = hfa("verify", "--model", plant, "--weights", path).out  # one input
    assert alone.splitlines()[0] == named.out.splitlines()[0]
    A = [[0.0, 1.0], [-1.0, -1.0]]
    eye = np.eye(2).tolist()
    square = stored("square.json", A=A, B=eye, Q=eye, R=eye)
    policy = torch_file("two.pt", {"weight": -np.eye(2)})
    said = hfa("verify", "--model", square, "--weights", policy)
    assert said.code == BAD_INPUT
    typed = said.err.rpartition("; type ")[2].split()
    assert typed[:2] == ["hfa", "verify"]
    assert hfa(*typed[1:]).code == FAILED


def test_a_state_dict_needs_its_activation():
    """`hfa verify` accepts a state dict with its activation.

    Without the activation, the command is refused, and the error ends with the complete command.
    """
    plant = Game(
        [[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], E=np.eye(2), Q=[1, 1], R=[1], delta=np.inf
    )
    K = solve(plant).K
    np.savez("plant.npz", A=plant.A, B=plant.B, Q=plant.Q, R=plant.R)
    torch_file("policy.pt", {"0.weight": 1e-4 * np.eye(2), "2.weight": -1e4 * K})
    line = "hfa verify --model plant.npz --weights policy.pt --set activation=tanh"
    assert hfa(*line.split()[1:]).code == DONE
    asked = hfa(*line.partition(" --set")[0].split()[1:])
    assert asked.code == BAD_INPUT
    assert asked.err.rstrip().endswith(f"; type {line}")


def test_one_layer_on_one_state_is_a_policy_unless_v_is_asked_for():
    """The layer is that of u = -K x; with V=, it is W of V = W x²."""
    plant = Game([[-1.0]], [[1.0]], Q=[1.0], R=[1.0])
    exact = solve(plant)
    policy, value = (
        torch_file(f"{name}.pt", {"weight": matrix})
        for name, matrix in (("policy", -exact.K), ("value", exact.P))
    )
    for path, network in ((policy, ""), (policy, "policy="), (value, "V=")):
        assert verify(plant, from_network(plant, path, network=network), flights=2).ok
    assert not verify(plant, from_network(plant, policy, network="V=")).ok


def test_the_policy_of_a_value_contains_the_cross_weights():
    """Networks of V and ∂V/∂z imply u = -R⁻¹(½ B'∂V/∂z + N'z)."""
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
            assert verify(game, critic).ok == (bend == 0.0)


@pytest.mark.parametrize("sides", [(3.0, 3.0), (3.0, 1.0)])
def test_the_gain_at_a_kink_is_the_mean_of_both_sides(sides):
    """u = -a z for z > 0, -b z for z < 0, of a ReLU network: K is the mean, and a nonsmooth point is named."""
    a, b = sides
    game = Game([[1.0]], [[1.0]], E=[[1.0]], Q=[1.0], R=[1.0], delta=np.inf)
    layers = {"0.weight": [[1.0], [-1.0]], "2.weight": [[-a, b]]}
    np.savez("relu.npz", **{name: np.array(layer) for name, layer in layers.items()})
    critic = read_critic("relu.npz", game, activation="relu")
    assert critic.K.item() == pytest.approx((a + b) / 2.0, abs=1e-12)
    assert ("nonsmooth point" in critic.origin) == (a != b)


@pytest.mark.parametrize("cost_unit", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize(("bias", "is_nonsmooth"), [(0.0, True), (-1e-7, False), (1e-7, False)])
def test_a_kink_at_the_trim_does_not_depend_on_the_unit_of_the_cost(cost_unit, bias, is_nonsmooth):
    """u = relu(z + bias) of a plant without a box of states has its nonsmooth point at z = -bias."""
    game = Game([[1.0]], [[1.0]], Q=[cost_unit], R=[cost_unit])
    z = ca.SX.sym("z")
    policy = ca.Function("policy", [z], [ca.fmax(z + bias, 0.0)])
    critic = from_network(game, policy)
    assert critic.is_nonsmooth == is_nonsmooth
    assert critic.K.item() == pytest.approx(-0.5 if is_nonsmooth else -float(bias > 0.0))
