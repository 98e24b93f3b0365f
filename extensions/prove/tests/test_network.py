"""Proved bounds on the errors of networks in a box."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import hfa

from controller.hfa_game import ORDINARY_DEVIATIONS
from hfa import Game, from_network, solve
from hfa_prove.enclosure.relaxation import Relaxation
from hfa_prove.network import Proof, _halves, error_bound, prove
from verification.box import Box, ordinary_box

BOX = np.array(ORDINARY_DEVIATIONS)
TRAINED = Path(__file__).parents[3] / "tests" / "verification" / "network" / "trained"
ACTIVATIONS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "tanh": ca.tanh,
    "relu": lambda t: ca.fmax(t, 0.0),
    "cube": lambda t: t**3,
    "clip": lambda t: ca.fmin(ca.fmax(t, -0.7), 0.4),
}


def random_network(activation: str, seed: int, of_gradient: bool = False) -> ca.Function:
    """Return a random function of four inputs: a network plus a linear and a quadratic part.

    The network has two hidden layers of 8 units.

    of_gradient: whether the network is replaced by the gradient of its first output
    """
    rng = np.random.default_rng(seed)
    y = ca.SX.sym("y", 4)
    h = y
    for _ in range(2):
        weights = rng.normal(size=(8, h.numel())) * rng.uniform(0.2, 1.5)
        h = ACTIVATIONS[activation](ca.DM(weights) @ h + ca.DM(rng.normal(size=8)))
    outputs = ca.DM(rng.normal(size=(2, 8))) @ h
    if of_gradient:
        outputs = ca.gradient(outputs[0], y)
    quadratic = ca.bilin(ca.DM(rng.normal(size=(4, 4))), y, y)
    linear = ca.DM(rng.normal(size=(outputs.numel(), 4))) @ y
    return ca.Function("network", [y], [ca.densify(outputs + linear + quadratic)])


@pytest.mark.parametrize(
    ("activation", "of_gradient"),
    [("tanh", True), ("relu", False), ("clip", False), ("cube", True)],
)
def test_no_sample_in_the_box_exceeds_the_bound(activation: str, of_gradient: bool) -> None:
    """No sample of a network in a box exceeds the upper bound over the box.

    The lower bound of the largest value is at most the upper bound. For small boxes, both bounds
    agree to 1 %.
    """
    if of_gradient and activation in ("relu", "clip"):
        return  # its gradient has steps
    rng = np.random.default_rng(7)
    for seed in range(3):
        function = random_network(activation, seed, of_gradient)
        half_widths = 10.0 ** rng.uniform(-4.0, 0.0, (8, 1)) * rng.uniform(0.1, 1.0, (8, 4))
        centres = rng.uniform(-1.0, 1.0, (8, 4)) * (1.0 - half_widths)
        bounds = Relaxation(function, "f").over(centres, half_widths)
        assert np.all(bounds.highest < np.inf)
        for index, (centre, half_width) in enumerate(zip(centres, half_widths, strict=True)):
            y = rng.uniform(-1.0, 1.0, (500, 4))
            y[::2] = np.sign(y[::2])
            largest = np.abs(np.array(function((centre + half_width * y).T))).max()
            assert largest <= bounds.highest[index] * (1.0 + 1e-14)
            assert bounds.lowest[index] <= bounds.highest[index]
        assert bounds.highest[half_widths.max(axis=1) < 1e-3] == pytest.approx(
            bounds.lowest[half_widths.max(axis=1) < 1e-3], rel=1e-2, abs=1e-2
        )


def test_the_bound_includes_rounding() -> None:
    """The bound of a function includes rounding errors.

    At single points, the bound is at least the value of Σ max(w'y, 0) - Σ w'y in rational
    arithmetic, for weights w of size 1e8.
    """
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(16, 3)) * 1e8
    y = ca.SX.sym("y", 3)
    units = ca.fmax(ca.DM(weights) @ y, 0.0)
    function = ca.Function("f", [y], [ca.sum1(units) - ca.DM(weights.sum(axis=0)).T @ y])
    centres = np.abs(rng.normal(size=(40, 3))) / 3.0
    bounds = Relaxation(function, "f").over(centres, np.zeros((40, 3)))
    for centre, highest in zip(centres, bounds.highest, strict=True):
        state = list(map(Fraction, centre))
        exact = -sum(map(lambda w, x: Fraction(w) * x, weights.sum(axis=0), state))
        for row in weights:
            exact += max(sum(map(lambda w, x: Fraction(w) * x, row, state)), Fraction(0))
        assert abs(exact) <= Fraction(highest)


# Right policies.


def bound_on(game: Game, policy: Callable[[ca.SX], ca.SX], limit: float = 1e-6) -> Proof | None:
    z = ca.SX.sym("z", 6)
    function = ca.Function("policy", [z], [policy(z)])
    return error_bound(
        game, from_network(game, function, network="policy"), box=ordinary_box(), limit=limit
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

    assert bound_on(game, policy) == Proof("error", 1e-6, 1.0, 1)


def test_no_bound_is_proved_for_unsupported_operations(game: Game) -> None:
    """For operations without an enclosure, errors are searched for at random states and no bound is
    proved.
    """
    assert bound_on(game, lambda z: linear(game, z) + 1e-12 * ca.erf(z[1])) is None


# Planted errors.


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


def test_a_fraction_ends_before_the_first_error() -> None:
    """The fraction of the box with a proved bound excludes the nearest state with a larger error.

    The printed fraction is rounded down. A bound that is true in the whole box is proved there.
    """
    y = ca.SX.sym("y", 2)
    function = ca.Function("f", [y], [ca.fmax(5.0 * ca.tanh(y[0]) - 3.0, 0.0) + 0.2 * y[1] ** 2])
    largest = float(function([0.6, 0.6]))
    proof = prove("error", function, np.ones(2), largest, 2.0)
    assert proof is not None
    assert proof.beyond is not None
    assert proof.fraction <= 0.6
    assert float(function(proof.beyond)) > largest
    assert Proof("error", 0.1, 0.96875, 1).where == "on 0.96 times the box"
    proof = prove("error", function, np.ones(2), 2.0, 2.0)
    assert proof == Proof("error", 2.0, 1.0, proof.boxes if proof else 0)


def test_no_fraction_is_proved_without_a_bound() -> None:
    """No fraction of the box is proved if the error equals the bound at 0.

    A bound on an error that overflows double precision is not proved in the whole box.
    """
    y = ca.SX.sym("y", 2)
    squares = ca.tanh(y[0]) ** 2 + ca.tanh(y[1]) ** 2
    proof = prove("error", ca.Function("f", [y], [1.0 - 0.1 * squares]), np.ones(2), 1.0, 0.1)
    assert proof is not None
    assert proof.beyond is None
    assert proof.fraction == 0.0
    huge = ca.Function("f", [y], [(1e200 * ca.tanh(y[0])) ** 2 * 1e-200])
    told: list[tuple[float, float, str]] = []
    proof = prove("error", huge, np.ones(2), 1e299, 0.1, lambda *each: told.append(each))
    assert all(0.0 <= done <= total == 0.1 for done, total, _ in told)
    assert told[-1][:2] == (0.1, 0.1)
    assert proof is not None
    assert proof.fraction < 1.0


@pytest.mark.slow
def test_a_trained_network_is_proved_within_its_error(game: Game) -> None:
    """The error of the stored 6-32-32-5 policy is proved to be at most 0.051."""
    critic = from_network(game, TRAINED / "policy.npz", activation="tanh", scale=1.0 / BOX)
    proof = error_bound(game, critic, box=ordinary_box(), limit=0.051)
    assert proof is not None
    assert (proof.fraction, proof.beyond) == (1.0, None)


# Kinks and jumps: |t|, max, min and their slopes.


def with_hat(game: Game, of_abs: bool) -> Proof | None:
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


@pytest.mark.parametrize("kind", ["fabs", "sign", "fmax", "fmin", "slope of fmax", "comparison"])
def test_bounds_of_kinks_are_true_and_narrow(kind: str) -> None:
    """Bounds of functions with kinks are true and narrow, compared with values at random states.

    Some boxes are centered on a kink.
    """
    y = ca.SX.sym("y", 2)
    t = y[0] - 0.3 * y[1]
    expression = {
        "fabs": ca.fabs(t) * y[1],
        "sign": ca.sign(t) + y[0],
        "fmax": ca.fmax(t, y[1]) - y[0],
        "fmin": ca.fmin(t, 0.2) * y[0],
        "slope of fmax": ca.gradient(ca.fmax(t, 0.0) * y[1], y)[0],
        "comparison": ca.if_else(t > 0.1, y[0], y[1]),
    }[kind]
    function = ca.Function("f", [y], [ca.densify(expression)])
    relaxation = Relaxation(function, "f")
    rng = np.random.default_rng(0)
    centres = rng.uniform(-1.0, 1.0, (40, 2))
    centres[:5, 0] = 0.3 * centres[:5, 1]
    halves = 10.0 ** rng.uniform(-3.0, 0.0, (40, 1)) * np.ones((1, 2))
    bounds = relaxation.over(centres, halves)
    states = centres[:, None] + halves[:, None] * rng.uniform(-1.0, 1.0, (40, 200, 2))
    found = np.abs(np.array(function(states.reshape(-1, 2).T))).reshape(40, 200).max(axis=1)
    found = np.maximum(found, np.abs(np.array(function(centres.T))).ravel())
    assert np.all(found <= bounds.highest)
    assert np.all(bounds.highest <= found + 8.0 * halves[:, 0] + 2.1 * (halves[:, 0] > 1e-9))


def test_no_bound_is_proved_if_numbers_underflow() -> None:
    """No bound is proved for 1e300 (1e-320 y_1 - 1e-320 y_2).

    The double closest to 1e-320 has a relative error of 1e-3.
    """
    y = ca.SX.sym("y", 2)
    function = ca.Function("f", [y], [1e300 * (1e-320 * y[0] - 1e-320 * y[1])])
    proof = prove("error", function, np.full(2, 1e300), 1e-6, 0.2)
    assert proof is None or proof.fraction == 0.0


def test_boxes_are_halved_across_the_largest_gap() -> None:
    """Without a known gap, the widest side is halved; both halves cover the box."""
    centres = np.array([[0.0, 1.0], [0.5, 0.5], [0.0, 0.0]])
    widths = np.array([[1.0, 0.5], [0.25, 0.5], [1.0, 0.125]])
    gaps = np.array([[0.1, 0.9], [np.inf, 1.0], [0.0, 0.0]])
    found, halved = _halves(centres, widths, gaps)
    for k, side in enumerate((1, 1, 0)):
        expected = widths[k].copy()
        expected[side] /= 2.0
        for half, sign in ((k, -1.0), (k + 3, 1.0)):
            np.testing.assert_array_equal(halved[half], expected)
            moved = found[half] - centres[k]
            assert moved[side] == sign * expected[side]
            assert moved[1 - side] == 0.0


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
