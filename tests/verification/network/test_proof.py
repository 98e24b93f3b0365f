"""Proofs that a policy is stabilizing and near the optimum, and policies that are not."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from controller.critic.network.operations import operations_of, row_function
from hfa import BadInputError, Game, from_network, solve, verify
from verification.network.bounds import BoundedFunction
from verification.network.proof import proof_of

Z = ca.MX.sym("z", 2)
A, B = np.array([[0.0, 1.0], [1.0, -0.3]]), np.array([[0.0], [1.0]])
FLOW = Game(A, B, Q=[1.0, 0.5], R=[1.0])
#: The theorem's cases.
GAMES = {
    "LQR": FLOW,
    "disturbance": replace(FLOW, E=B, delta=6.0),
    "cross weights": replace(FLOW, N=np.array([[0.3], [0.1]])),
}
BOX = np.ones(2)


def policy(u):
    return ca.Function("policy", [Z], [ca.densify(u)])


def nearly(game, gain=1.02, size=0.02):
    """Return -1.02 K z with a smooth error, 0 at the trim, that is odd and bounded."""
    K = ca.DM(solve(game).K)
    return policy(-gain * K @ Z + size * ca.tanh(3.0 * Z[0]) ** 3)


def judged(game, u, **how):
    return verify(game, from_network(game, policy(u), network="policy"), box=BOX, **how)


@pytest.mark.parametrize("name", GAMES)
def test_the_cost_of_each_flight_is_below_the_proved_bound(name):
    """A policy that is nearly optimal is proved in each case of the theorem, and its flights cost less.

    The flights are simulated here, without a disturbance and under the worst one of the exact game.
    """
    game = GAMES[name]
    exact, function = solve(game), nearly(game)
    proof = proof_of(exact, function, np.zeros(2), BOX, 0.01, 10.0)
    assert proof.excess < 0.05
    rows = row_function(function)
    reference = np.linalg.eigvalsh(exact.P)[-1]
    gains = (
        [0.0 * exact.disturbance_gain, exact.disturbance_gain]
        if math.isfinite(game.delta)
        else [0.0 * exact.disturbance_gain]
    )
    for L in gains:
        for start in ([1.0, 1.0], [1.0, -1.0], [0.5, 0.2]):
            z0 = np.array(start)

            def rate(z, L=L):
                u, d = rows(z[None])[0], L @ z
                paid = z @ game.Q @ z + 2.0 * z @ game.N @ u + u @ game.R @ u
                paid -= game.delta**2 * d @ d if d.any() else 0.0
                return np.append(game.A @ z + game.B @ u + game.E @ d, paid)

            how = {"rtol": 1e-9, "atol": 1e-11, "method": "DOP853"}
            end = solve_ivp(lambda _, y: rate(y[:2]), (0.0, 40.0), np.append(z0, 0.0), **how)
            *z, cost = end.y[:, -1]
            assert np.abs(z).max() < 1e-6
            above = (cost - z0 @ exact.P @ z0) / (reference * max(1.0, z0 @ z0))
            assert above <= proof.excess


ACTIVATIONS = {
    "tanh": ca.tanh,
    "relu": lambda x: ca.fmax(x, 0.0),
    "elu": lambda x: ca.fmax(x, 0.0) + ca.expm1(ca.fmin(x, 0.0)),
    "swish": lambda x: x * (0.5 + 0.5 * ca.tanh(0.5 * x)),
    "magnitude": ca.fabs,
    "clip": lambda x: ca.fmin(ca.fmax(x, -1.0), 0.5),
    "cube": lambda x: x**3 - x**2,
}


@pytest.mark.parametrize(
    ("name", "is_scalar"),
    [*((name, False) for name in ACTIVATIONS), ("clip", True), ("cube", True)],
)
def test_no_value_is_outside_of_its_bounds(name, is_scalar):
    """Values and slopes of networks at random states and corners of boxes are within their bounds."""
    rng = np.random.default_rng(len(name))
    for size in (1e-3, 0.1, 1.0):
        W, V = rng.normal(size=(9, 2)), rng.normal(size=(2, 9))
        x = ca.MX.sym("x", 2)
        h = ACTIVATIONS[name](ca.DM(W) @ x + ca.DM(rng.normal(size=9)))
        function = ca.Function("f", [x], [ca.densify(ca.DM(V) @ h)])
        function = function.expand() if is_scalar else function
        operations = operations_of(function)
        rows = row_function(function)
        c, width = rng.normal(size=(2, 30)), size * rng.random((2, 30))
        bounded = BoundedFunction(operations)
        middle, Z, radius, _ = bounded.over(c, width)
        slopes = [bounded.slopes(*box) for box in zip(c.T, width.T, strict=True)]
        M, R = (np.stack([each[k] for each in slopes], axis=1) for k in (0, 1))
        s = np.concatenate(
            [rng.uniform(-1.0, 1.0, (200, 2, 30)), np.sign(rng.normal(size=(50, 2, 30)))]
        )
        i, j = np.triu_indices(2)
        for part in s:
            values = rows((c + width * part).T).T
            terms = np.concatenate([part, part[i] * part[j]])[: Z.shape[2]]
            form = middle + np.einsum("kNn,nN->kN", Z, terms)
            assert (np.abs(values - form) <= radius).all()
            change = values - rows(c.T).T - np.einsum("kNn,nN->kN", M, width * part)
            within = np.einsum("kNn,nN->kN", R, width * np.abs(part)) + 1e-12 * (
                1.0 + np.abs(values)
            )
            assert (np.abs(change) <= within).all()


def test_relu_that_is_exact_with_all_kinks_at_the_trim_is_proved():
    """Pairs relu(z) - relu(-z) = z in two layers, without biases: u = -K z, with kinks at the trim."""
    pairs, join = np.vstack([np.eye(2), -np.eye(2)]), np.hstack([np.eye(2), -np.eye(2)])
    h = ca.fmax(ca.DM(pairs) @ Z, 0.0)
    h = ca.fmax(ca.DM(pairs @ join) @ h, 0.0)
    verdict = judged(FLOW, -ca.DM(solve(FLOW).K @ join) @ h)
    assert verdict.ok
    assert ": proved, at most 0.001" in verdict.headline
    assert verdict.to_dict()["proved"] is True
    assert verdict.flights == 0


def liars():
    """Yield the name of a lie and a policy that is exact but for it."""
    exact = -ca.DM(solve(FLOW).K) @ Z
    s = 0.6 * Z[0] + 0.8 * Z[1] - 0.3
    yield "hat", exact + 40.0 * ca.fmax(1.0 - ca.fabs(Z[0] - 0.5) / 1e-3, 0.0)
    yield "thin hat", exact + 3.0 * ca.fmax(1.0 - ca.fabs(Z[0] - 0.5) / 1e-5, 0.0)
    slab = ca.fmax(s / 1e-4, 0.0) - ca.fmax(s / 1e-4 - 1.0, 0.0)
    yield "slab", exact + 2.0 * (slab - ca.fmax(s / 1e-4 - 3.0, 0.0) + ca.fmax(s / 1e-4 - 4.0, 0.0))
    kinks = -ca.DM(solve(FLOW).K) @ (ca.fmax(Z, 0.0) - ca.fmax(-Z, 0.0))
    yield "slab beside kinks at the trim", kinks + 2.0 * slab
    yield "half-space", exact + 5.0 * ca.fmax(s - 0.4, 0.0)
    yield "ripple", exact + sum(ca.tanh((Z[0] - at) / 1e-3) * 0.3 for at in (-0.5, 0.2, 0.7))
    yield "saturated", ca.fmin(ca.fmax(exact, -0.5), 0.5)
    inside = ca.fmin(ca.fmax(Z / 1e-3, -10.0), 10.0) * 1e-3
    yield "normalizer with a tiny variance", -ca.DM(solve(FLOW).K) @ inside


@pytest.mark.parametrize(
    ("name", "u"),
    [
        pytest.param(*lie, marks=pytest.mark.slow if lie[0] in ("thin hat", "slab") else ())
        for lie in liars()
    ],
)
def test_a_policy_that_is_exact_but_for_a_lie_is_never_proved(name, u):
    """None of the lies is proved; those that make the loop unstable have a start that shows it."""
    verdict = judged(FLOW, u, limit_seconds=4.0)
    data = verdict.to_dict()
    assert data["proved"] is False
    assert ": proved" not in verdict.headline
    if name in ("hat", "half-space", "saturated", "normalizer with a tiny variance"):
        assert not verdict.holds(1.0)
        assert "counterexample" in data


@pytest.mark.parametrize(
    ("u", "why"),
    [
        (ca.if_else(Z[0] > 0.5, 1.0, 1.02), "operation lt has no bounds"),
        (1.0 + 0.02 * ca.log(2.0 + Z[0] ** 2), "operation log has no bounds"),
    ],
)
def test_an_operation_without_bounds_is_named_and_flights_are_made(u, why):
    verdict = judged(FLOW, -ca.DM(solve(FLOW).K) @ Z * u, flights=7)
    first = verdict.report(limit_cost=1.0).title
    assert first.startswith(
        "PASS on the linear game, given box, in 7 flights, not proved: at least"
    )
    assert f"not proved: {why}" in first
    assert (verdict.flights, verdict.holds(1.0)) == (7, True)


@pytest.mark.parametrize("discount", [1.0, 0.99])
def test_a_network_in_discrete_time_is_flown_and_not_proved(discount):
    game = FLOW.sampled(0.05, discount)
    K = ca.DM(solve(game).K)
    verdict = judged(game, -K @ Z + 0.01 * ca.tanh(Z[0]), flights=4)
    assert verdict.to_dict()["proved"] is False
    assert verdict.flights == 4
    assert "not proved: the theorem is one of continuous time" in " ".join(str(verdict).split())


def test_twenty_states_end_by_the_limit_of_seconds():
    A, B = np.random.default_rng(1).normal(size=(2, 20, 20))
    game = Game(A / 5.0, B[:, :4], Q=np.ones(20), R=np.ones(4))
    z = ca.MX.sym("z", 20)
    u = -ca.DM(solve(game).K) @ z + 0.3 * ca.tanh(z[:4]) ** 3
    critic = from_network(game, ca.Function("policy", [z], [u]), network="policy")
    verdict = verify(game, critic, limit_seconds=0.1, flights=4)
    assert verdict.to_dict()["proved"] is False
    assert "not proved: the limit of 0.1 s is over" in str(verdict)
    with pytest.raises(BadInputError, match="limit_seconds is -1"):
        judged(FLOW, Z[0], limit_seconds=-1.0)


def test_a_network_with_a_bias_is_proved_about_its_equilibrium():
    verdict = judged(FLOW, nearly(FLOW)(Z) + 0.05)
    assert verdict.to_dict()["proved"] is True
    assert "about its equilibrium" in " ".join(str(verdict).split())
