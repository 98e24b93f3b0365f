"""Policies of functions Q(x, u)."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from network_files import read

from hfa import BadInputError, from_network

HERE = Path(__file__).parent
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
