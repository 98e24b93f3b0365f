"""Proved bounds on the errors of networks in a box."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import hfa

from hfa import Game, from_network, solve
from hfa_prove import error_bound
from verification import Box

#: Half-widths of the usual box of the paper's aircraft: ft/s, rad, rad/s.
BOX = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
TRAINED = Path(__file__).parents[3] / "tests" / "verification" / "network" / "trained"


def bound_on(game: Game, policy: Callable[[ca.SX], ca.SX], limit: float = 1e-6) -> Any:
    z = ca.SX.sym("z", 6)
    function = ca.Function("policy", [z], [policy(z)])
    return error_bound(
        game, from_network(game, function, network="policy"), box=Box(BOX, "usual"), limit=limit
    )


def linear(game: Game, z: ca.SX) -> ca.SX:
    return -ca.DM(solve(game).K) @ z


def test_a_linear_policy_of_relu_pairs_is_proved(game: Game) -> None:
    """A linear policy written with pairs max(t, 0) - max(-t, 0), t = W z, is proved exact in one
    box.

    """
    W = np.random.default_rng(3).normal(size=(6, 6))
    back = ca.DM(solve(game).K @ np.linalg.inv(W))

    def policy(z: ca.SX) -> ca.SX:
        t = ca.DM(W) @ z
        return -back @ ca.fmax(t, 0.0) + back @ ca.fmax(-t, 0.0)

    proof = bound_on(game, policy)
    assert (proof.fraction, proof.error, proof.boxes) == (1.0, 1e-6, 1)


def test_no_bound_is_proved_for_unsupported_operations(game: Game) -> None:
    """For operations without an enclosure, errors are searched for at random states and no bound is
    proved.
    """
    assert bound_on(game, lambda z: linear(game, z) + 1e-12 * ca.erf(z[1])) is None


def bump(y: ca.SX, at: np.ndarray, half_width: float) -> ca.SX:
    """Return a two-layer relu function with a single bump.

    The function is 1 at y = at, and 0 if |y_i - at_i| >= half_width for any i.
    """
    t = (y - ca.DM(at)) / half_width
    hats = ca.fmax(t + 1.0, 0.0) - 2.0 * ca.fmax(t, 0.0) + ca.fmax(t - 1.0, 0.0)
    return ca.fmax(ca.sum1(hats) - (y.numel() - 1.0), 0.0)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_narrow_bump_is_found_by_proof(game: Game, seed: int) -> None:
    """A narrow error of a policy that the search alone misses is found with a proof.

    The first input has an error of 300 % in a bump with 0.05 times the half-widths of the box.
    """
    rng = np.random.default_rng(seed)
    at = rng.uniform(-0.9, 0.9, 6)
    exact = solve(game)
    size = np.abs(exact.K[0]) @ BOX

    def policy(z: ca.SX) -> ca.SX:
        off = ca.vertcat(3.0 * size * bump(z / ca.DM(BOX), at, 0.05), *[0.0] * 4)
        return linear(game, z) + off

    proof = bound_on(game, policy)
    assert proof is not None
    assert proof.beyond is not None or proof.fraction <= np.abs(at).max() + 0.05


@pytest.mark.slow
def test_a_trained_network_is_proved_within_its_error(game: Game) -> None:
    """The error of the stored 6-32-32-5 policy is proved to be at most 0.051."""
    critic = from_network(game, TRAINED / "policy.npz", activation="tanh", scale=1.0 / BOX)
    proof = error_bound(game, critic, box=Box(BOX, "usual"), limit=0.051)
    assert proof is not None
    assert (proof.fraction, proof.beyond) == (1.0, None)


# Kinks and jumps: |t|, max, min and their slopes.


def with_hat(game: Game, of_abs: bool) -> Any:
    """Return the bound of a critic whose V is exact except for a narrow hat between the samples.

    The hat is three times as large as the largest V in the box and 1/250 of the box wide.

    of_abs: whether the hat is written with |t| instead of max(t, -t)
    """
    z = ca.SX.sym("z", 2)
    P = solve(game).P

    def slope(t: ca.SX) -> ca.SX:
        away = ca.fabs(t) if of_abs else ca.fmax(t, -t)
        return ca.fmax(1.0 - away / 0.004, 0.0)

    hat = 3.0 * float(np.abs(P).sum()) * slope(z[0] - 0.611) * slope(z[1] - 0.611)
    V = ca.Function("V", [z], [ca.bilin(ca.DM(P), z, z) + hat])
    return error_bound(game, from_network(game, V, network="V"), box=Box(np.ones(2), "planted"))


@pytest.mark.parametrize("of_abs", [True, False])
def test_a_narrow_hat_is_found_by_proof(of_abs: bool) -> None:
    """A narrow hat on V, written with relu units or with absolute values, is found."""
    game = Game([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)
    proof = with_hat(game, of_abs)
    assert proof is not None
    assert proof.beyond is not None


def test_verify_finds_a_stripe_of_wrong_inputs_by_proof_alone(tmp_path: Path) -> None:
    """A stripe that covers 1e-6 of the box passes the search of `hfa verify`, but not --prove."""
    A, B = np.array([[0.0, 1.0], [2.0, -0.3]]), np.array([[0.0], [1.0]])
    np.savez(tmp_path / "plant.npz", A=A, B=B, Q=np.eye(2), R=np.eye(1))
    K = solve(Game(A=A, B=B, Q=np.eye(2), R=np.eye(1))).K
    width = 1e-6
    hat = np.array([[0.0, 1.0]] * 3) / width
    for name, height in {"right": 0.0, "stripe": 1.0}.items():
        weights = {
            "0.weight": np.vstack([K, -K, hat]),
            "0.bias": np.array([0.0, 0.0, *(np.array([-1.0, 0.0, 1.0]) - 0.37123 / width)]),
            "2.weight": np.array([[-1.0, 1.0, height, -2.0 * height, height]]),
            "2.bias": np.zeros(1),
        }
        np.savez(tmp_path / f"{name}.npz", **weights)
    words = f"verify --model {tmp_path}/plant.npz --set activation=relu --weights {tmp_path}/"
    codes = {
        (name, proves): hfa(*f"{words}{name}.npz".split(), *["--prove"] * proves).code
        for name in ("right", "stripe")
        for proves in (False, True)
    }
    assert codes == {
        ("right", False): 0,
        ("right", True): 0,
        ("stripe", False): 0,
        ("stripe", True): 1,
    }
