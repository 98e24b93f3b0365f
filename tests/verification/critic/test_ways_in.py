"""A critic whose policy diverges fails, whichever way it is given."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import hfa as run
from game_files import stored
from known_models import game_at
from network_files import onnx_file, torch_file

import hfa
from controller import basis
from hfa import Critic, Game, Verdict, from_weights, solve, verify
from hfa.main import FAILED
from tests.support.steps_of import in_steps
from verification import Scope

pytestmark = pytest.mark.usefixtures("folder")
GAME = game_at(8.0)
AT_8 = ("--dihedral", "8")
#: Weights of the fourth powers of airspeed, angle of attack, dihedral and pitch rate. With them,
#: the policy diverges from corners of the box of typical deviations.
TAIL = np.array([0.0, -200.0, -50.0, -50.0])
CHANNELS = [0, 1, 3, 4]
FAST = Scope(flights=4)
DISCOUNT, DT = 0.999, 0.05


@cache
def exact_value() -> np.ndarray:
    return solve(GAME).P


@cache
def discounted() -> Game:
    return GAME.sampled(DT, DISCOUNT)


def weights(name: str, P: np.ndarray | None = None) -> np.ndarray:
    """Return the weights of the diverging critic in a basis with fourth powers.

    P: matrix of the quadratic part, by default that of the exact value in continuous time
    """
    psi = basis(name, 6)
    W = psi.weights(exact_value() if P is None else P)
    powers = psi.exponents[21:].argmax(axis=1).tolist()
    for channel, weight in zip(CHANNELS, TAIL, strict=True):
        W[21 + powers.index(channel)] = weight
    return W


Z = ca.SX.sym("z", 6)


def V() -> ca.SX:
    return ca.bilin(ca.DM(exact_value()), Z, Z) + ca.dot(ca.DM(TAIL), Z[CHANNELS] ** 4)


def policy() -> ca.SX:
    return -0.5 * ca.DM(GAME.R_inverse_B_transposed) @ ca.gradient(V(), Z)


def network(kind: str, *outputs: ca.SX) -> Critic:
    function = ca.Function("network", [Z], [ca.densify(ca.vertcat(*outputs))])
    return hfa.from_network(GAME, function, network=kind)


def quartic_onnx() -> str:
    """Write z'Pz + Σ w z⁴ as an ONNX graph and return its path."""
    w = np.zeros((6, 1))
    w[CHANNELS, 0] = TAIL
    nodes = [
        ("MatMul", "x P", "h"),
        ("Mul", "x h", "products"),
        ("MatMul", "products ones", "quadratic"),
        ("Mul", "x x", "squares"),
        ("Mul", "squares squares", "powers"),
        ("MatMul", "powers w", "quartic"),
        ("Add", "quadratic quartic", "y"),
    ]
    return onnx_file("v.onnx", nodes, {"P": exact_value(), "ones": np.ones((6, 1)), "w": w})


def one_layer(path: str) -> str:
    return torch_file(path, {"v.weight": weights("paper")[None], "v.bias": np.zeros(1)})


def steps_file(**more: Any) -> str:
    """Write the sampled plant as a plant in discrete time and return its path."""
    step = discounted()
    return stored(
        "plant.json",
        time="discrete",
        **{name: getattr(step, name) for name in "ABEQR"},
        delta=step.delta,
        discount=DISCOUNT,
        **more,
    )


def of_steps() -> np.ndarray:
    return weights("paper", solve(discounted()).P)


def npz(path: str = "w.npz", **more: Any) -> str:
    return stored(path, W=weights("paper"), **more)


#: Way in -> command line after `hfa verify`.
COMMANDS: dict[str, Callable[[], tuple[str, ...]]] = {
    "basis on the command line": lambda: (*AT_8, "--weights", npz(), "--basis", "paper"),
    "several files": lambda: (
        *(*AT_8, "--basis", "paper"),
        *("--weights", npz(), npz(path="other.npz")),
    ),
    "ONNX": lambda: (*AT_8, "--weights", quartic_onnx()),
    "one layer": lambda: (*AT_8, "--basis", "paper", "--weights", one_layer("l.pt")),
    "discounted": lambda: (
        *(*AT_8, "--discount", str(DISCOUNT), "--dt", str(DT)),
        *("--weights", stored("w.npz", W=of_steps(), basis="paper")),
    ),
    "discrete plant": lambda: (
        *("--model", steps_file()),
        *("--weights", stored("w.npz", W=of_steps(), basis="paper")),
    ),
}
#: Ways in that are tried in the fast tests.
FAST_COMMANDS = ("basis on the command line", "ONNX")


def judged(critic: Any) -> Verdict:
    return verify(GAME, critic, scope=FAST)


def of_a_game_in_steps() -> Verdict:
    problem = in_steps(discounted(), DISCOUNT)
    critic = from_weights(problem, of_steps(), "paper")
    return verify(problem, critic, scope=FAST)


#: Way in -> verdict in Python.
CALLS: dict[str, Callable[[], Verdict]] = {
    "CasADi functions": lambda: judged(from_weights(GAME, [1.0], ca.Function("psi", [Z], [V()]))),
    "V": lambda: judged(network("V", V())),
    "gradient": lambda: judged(network("gradient", ca.gradient(V(), Z))),
    "policy": lambda: judged(network("policy", policy())),
    "V and policy": lambda: judged(network("V+policy", V(), policy())),
    "discrete": of_a_game_in_steps,
}
#: Ways in that are tried in the fast tests.
FAST_CALLS = ("CasADi functions", "policy")


def ways(every: Mapping[str, object], fast: tuple[str, ...]) -> list[Any]:
    return [pytest.param(way, marks=() if way in fast else pytest.mark.slow) for way in every]


@pytest.mark.parametrize("way", ways(COMMANDS, FAST_COMMANDS))
def test_a_diverging_critic_fails_on_the_command_line(way: str) -> None:
    """Each form of the diverging critic fails, also if only the cost is limited."""
    result = run("verify", *COMMANDS[way](), "--limit-cost", "1", "--json")
    assert result.code == FAILED
    assert "CasADi" not in result.err
    data = json.loads(result.out)
    assert not data["ok"]
    for critic in data.get("critics", {"": data}).values():
        assert critic["grade"] == "fail"
        if "nonlinear" in critic:  # a polynomial, which is judged there
            excess = critic["nonlinear"]["flown"]["excess"]
            assert excess is None or excess > 0.05
        else:
            lost = critic["network"]["cost_lost_flown_percent"]
            assert lost is None or lost > 1.0


@pytest.mark.parametrize("way", ways(CALLS, FAST_CALLS))
def test_a_diverging_critic_fails_in_python(way: str) -> None:
    """Each form of the diverging critic fails, also if only the cost is limited."""
    verdict = CALLS[way]()
    assert verdict.grade == "fail"
    assert not verdict.holds(limit_cost=1.0)


def test_a_biased_critic_fails() -> None:
    """A linear term of V moves the equilibrium off the trim, so the cost is no reason to pass."""
    W = basis("quadratic+linear", 6).weights(exact_value())
    assert judged(from_weights(GAME, W, "quadratic+linear")).ok
    W[22] = 50.0
    verdict = judged(from_weights(GAME, W, "quadratic+linear"))
    assert verdict.grade == "fail"
    assert verdict.value_of("rest_point") > 0.0
    assert not verdict.holds(limit_cost=1.0)
