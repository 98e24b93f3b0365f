"""Policies of functions Q(x, u)."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from network_files import read, torch_file

from hfa import BadInputError, from_network

HERE = Path(__file__).parent
RNG = np.random.default_rng(9)
pytestmark = pytest.mark.usefixtures("folder")


def test_default_torch_exports_are_read(game):
    """The default ONNX export of a Q function in PyTorch is read with the actions of PyTorch."""
    pytest.importorskip("onnx", reason="the package onnx is not installed")
    expected = json.loads((HERE / "torch_2_13.json").read_text(encoding="utf-8"))["q"]
    path = HERE / "torch_2_13_q.onnx"
    critic = from_network(game, path)
    for row, x in enumerate(expected["x"]):
        policy = np.array(critic.policy(x)).ravel()
        assert policy == pytest.approx(expected["mu"][row], rel=1e-11)


@pytest.mark.parametrize(
    ("power", "says"),
    [
        (lambda u: u**3, "is not quadratic in u"),
        (lambda u: u**2 + 1e-12 * ca.tanh(u), "is not quadratic in u"),
        (lambda u: u, "has neither a minimum nor a maximum over u"),
    ],
)
def test_a_q_not_quadratic_in_u_is_refused(power, says):
    """A Q that is not quadratic in u, or has neither a minimum nor a maximum over u, is refused."""
    xu = ca.SX.sym("xu", 2)
    Q = ca.Function("Q", [xu], [xu[0] ** 4 + power(xu[1])])
    with pytest.raises(BadInputError, match=says):
        read(Q, states=1, inputs=1)


def test_the_actor_beside_two_q_functions_is_read(game):
    """Of a file with an actor and two Q functions, the actor is read, with network="policy=actor" and
    without. With network="q1", the file is refused: this Q function is not quadratic in u.

    At x = 0, where the slope of tanh is 1, that of the actor is the product of its weights.
    """
    tensors = {"actor.0.weight": RNG.normal(size=(8, 6)), "actor.2.weight": RNG.normal(size=(5, 8))}
    for name in ("q1", "q2"):
        tensors |= {
            f"{name}.0.weight": RNG.normal(size=(8, 11)),
            f"{name}.2.weight": RNG.normal(size=(1, 8)),
        }
    path = torch_file("sac.pt", tensors)
    with pytest.raises(BadInputError, match=r"Q\(x, u\) is not quadratic in u; export the policy"):
        from_network(game, path, network="q1", activation="relu")
    actor = tensors["actor.2.weight"] @ tensors["actor.0.weight"]
    for network in ("policy=actor", ""):
        critic = from_network(game, path, network=network, activation="tanh")
        assert pytest.approx(-actor, rel=1e-12) == critic.K
        assert critic.declared.notes == ("not used: q1, q2",)
