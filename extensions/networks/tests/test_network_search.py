"""Search for errors of a network over a box of states, and simulations from the box."""

from __future__ import annotations

import math

import numpy as np
import pytest
from game_samples import failed_names
from network_files import ONES, QUADRATIC, onnx_file, torch_file
from planted_critics import gain, value

from controller.hfa_game import ORDINARY_DEVIATIONS
from hfa import Game, from_network, solve, verify
from hfa_networks.judge.network_search import Comparison, search
from verification.critic.scope import Scope
from verification.hfa_box import ordinary_box

BOX = np.array(ORDINARY_DEVIATIONS)
pytestmark = pytest.mark.usefixtures("folder")


def test_a_network_right_only_at_the_origin_fails(game: Game) -> None:
    """A network that is right only at the origin fails.

    For u = -K z + 5 z_1³/7³, the error found equals the largest error in the box.
    """
    nodes = [
        ("MatMul", "x K", "u"),
        ("MatMul", "x first", "h"),
        ("Mul", "h h", "s"),
        ("Mul", "s h", "c"),
    ]
    constants = {
        "K": -gain(game).T,
        "first": 5.0 ** (1 / 3) / 7.0 * np.eye(6)[:, :1] @ np.eye(5)[:1],
    }
    critic = from_network(game, onnx_file("bent.onnx", [*nodes, ("Add", "u c", "y")], constants, 5))
    check = verify(game, critic, scope=Scope(box=ordinary_box()))
    assert check.K_rel_error < 1e-12
    assert [each.name for each in check.checks if not each.ok] == ["searched_policy_error"]
    (found,) = check.to_dict()["network"]["searched"]
    largest = np.sqrt(game.R.diagonal()) * (np.abs(solve(game).K) @ BOX)
    assert found["error"] == pytest.approx(5.0 * np.sqrt(game.R[0, 0]) / largest[0], rel=1e-6)
    assert check.to_dict()["graded"]["cost_lost_worst_percent"] <= 1e-6
    assert not check.holds(1e-6)


def test_a_value_with_nan_in_the_box_fails(game: Game) -> None:
    """The error of a value that is nan in part of the box is infinite."""
    nodes = [
        *QUADRATIC[:2],
        ("MatMul", "terms ones", "V"),
        ("Slice", "x a b c", "s"),
        ("Pow", "s half", "r"),
    ]
    constants = {
        "P": value(game),
        "ones": ONES,
        "a": np.array([0]),
        "b": np.array([1]),
        "c": np.array([1]),
    }
    constants |= {"half": np.array(2.5), "zero": np.array(1e-30)}
    path = onnx_file("nan.onnx", [*nodes, ("Mul", "r zero", "n"), ("Add", "V n", "y")], constants)
    critic = from_network(game, path)
    beside = Comparison(critic, solve(game), np.sqrt(np.diag(game.R)), BOX)
    found = {each.name: each.error for each in search(beside)[1]}
    assert found["value"] == math.inf


def test_no_simulated_cost_exceeds_the_linear_worst(
    game: Game,
) -> None:
    """For a linear network, no simulated excess cost exceeds the worst one of the linear loop.

    The largest of 40 simulated values exceeds 10 % of the mean of the linear loop.
    """
    critic = from_network(game, torch_file("policy.pt", {"weight": -1.2 * gain(game)}))
    check = verify(game, critic, scope=Scope(box=ordinary_box(), flights=40))
    data = check.to_dict()
    flown = data["network"]["cost_lost_flown_percent"]
    linear_loop = data["graded"]
    assert 0.1 * linear_loop["cost_lost_mean_percent"] < flown
    assert flown <= linear_loop["cost_lost_worst_percent"] * (1 + 1e-6)


def test_actor_with_constant_is_stable_off_trim(game: Game) -> None:
    """The exact gain plus a constant of 1 % of the largest input fails, and the constant is named.

    The equilibrium is reported, and the cost relative to the equilibrium is optimal.
    """
    offset = 0.01 * np.abs(gain(game)) @ BOX
    critic = from_network(game, torch_file("b.pt", {"weight": -gain(game), "bias": offset}))
    verdict = verify(game, critic, scope=Scope(box=ordinary_box(), flights=10))
    assert failed_names(verdict.checks) == {"origin_error", "searched_policy_error", "rest_point"}
    data = verdict.to_dict()["network"]
    rest = np.linalg.solve(game.B @ gain(game) - game.A, game.B @ offset)
    assert data["rest_point"] == pytest.approx(rest, rel=1e-9)
    assert data["cost_lost_flown_percent"] == pytest.approx(0.0, abs=1e-9)
    assert data["reach"] == 16.0
    headline = verdict.headline()
    assert verdict.grade == "fail"
    assert "optimal cost, equilibrium 0." in headline
    assert "without bound" not in headline
    assert verdict.reason == "it is right except for a constant in u"


def test_a_very_small_bias_is_near(game: Game) -> None:
    """A bias of 1e-6 of the largest input is graded NEAR, and the optimal cost is printed first."""
    offset = 1e-6 * np.abs(gain(game)) @ BOX
    critic = from_network(game, torch_file("b.pt", {"weight": -gain(game), "bias": offset}))
    verdict = verify(game, critic, scope=Scope(box=ordinary_box(), flights=4, seconds=0.0))
    assert "rest_point" in failed_names(verdict.checks)
    assert verdict.grade == "near"
    assert verdict.headline().startswith("NEAR on the linear game: optimal cost, not exact (")
