"""Checks of networks and of other nonquadratic values in discrete time."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from game_samples import failed_names

from hfa import Critic, Game, Solution, from_gain, from_network, solve, verify
from tests.support.steps_of import in_steps
from verification import Box, Scope

pytestmark = pytest.mark.usefixtures("folder")
A = np.array([[1.02, 0.1], [0.1, 1.0]])
B = np.array([[0.0], [0.1]])
BOX = np.array([0.5, 0.2])
SCOPE = Scope(Box(BOX, "planted"), flights=20)
Z = ca.SX.sym("z", 2)


def problem_of(delta: float = 20.0, discount: float = 1.0, N: float = 0.0) -> Game:
    step = Game(A, B, 0.1 * np.eye(2), np.eye(2), np.eye(1), delta)
    return in_steps(replace(step, N=np.full((2, 1), N)), discount)


def exact_of(problem: Game) -> Solution:
    return solve(problem)


def critic_of(problem: Game, **outputs: ca.SX) -> Critic:
    function = ca.Function("planted", [Z], [ca.densify(ca.vertcat(*outputs.values()))])
    return from_network(problem, function, network="+".join(outputs))


def exact_value(problem: Game) -> ca.SX:
    return ca.bilin(ca.DM(exact_of(problem).P), Z, Z)


def exact_policy(problem: Game) -> ca.SX:
    return -ca.DM(exact_of(problem).K) @ Z


PROBLEMS = {
    "game": problem_of(),
    "LQR": problem_of(delta=np.inf),
    "discounted": problem_of(discount=0.98),
    "cross weights": problem_of(N=0.3),
}

NAMES = [
    pytest.param(name, marks=[] if name == "cross weights" else [pytest.mark.slow])
    for name in PROBLEMS
]


@pytest.mark.parametrize("name", NAMES)
def test_networks_of_exact_values_and_policies_pass(name: str) -> None:
    """Networks of the exact V, its gradient or the exact u pass."""
    problem = PROBLEMS[name]
    V = exact_value(problem)
    for outputs in (
        {"V": V + 3.0},
        {"gradient": ca.gradient(V, Z)},
        {"policy": exact_policy(problem)},
        {"V": V, "policy": exact_policy(problem)},
    ):
        verdict = verify(problem, critic_of(problem, **outputs), scope=replace(SCOPE, flights=4))
        assert verdict.ok, failed_names(verdict.checks)
        assert "searched_policy_error" in [check.name for check in verdict.checks]


def test_a_policy_exact_only_at_the_origin_fails() -> None:
    """A policy that is exact only at the origin fails.

    With u = -1e-3 tanh(1e3 K x), the loop does not converge from any tested multiple of the box.
    """
    problem = problem_of()
    u = -1e-3 * ca.tanh(1e3 * ca.DM(exact_of(problem).K) @ Z)
    verdict = verify(problem, critic_of(problem, policy=u), scope=SCOPE)
    assert verdict.K_rel_error < 1e-12
    assert failed_names(verdict.checks) == {"searched_policy_error", "cost_lost_flown_percent"}
    assert verdict.to_dict()["network"]["reach"] == 0.0


def test_a_policy_exact_in_the_box_that_loses_flights_fails() -> None:
    """A policy that is exact in the box fails if its loop leaves the box and does not converge."""
    slow = Game(
        [[0.99369, 0.01564], [0.01473, 1.0595]],
        [[0.14128], [-0.09389]],
        Q=np.eye(2),
        R=np.eye(1),
        dt=0.1,
    )
    u = ca.if_else(ca.norm_inf(Z) < 1.05, exact_policy(slow), 0.0)
    verdict = verify(slow, critic_of(slow, policy=u), scope=replace(SCOPE, box=Box([1.0, 1.0], "")))
    assert failed_names(verdict.checks) == {"cost_lost_flown_percent"}
    assert not verdict.ok
    assert "not all flights from the box converge" in verdict.headline


@pytest.mark.slow  # test_no_network_error_exceeds_the_reported_one, in continuous time
@pytest.mark.parametrize("name", ["LQR", "discounted"])
def test_a_value_wrong_away_from_the_origin_fails(name: str) -> None:
    """A value that is exact to second order at the origin and wrong away from it fails."""
    problem = PROBLEMS[name]
    V = exact_value(problem)
    size = float(BOX @ np.abs(exact_of(problem).P) @ BOX)
    verdict = verify(
        problem, critic_of(problem, V=V + 0.5 * V**2 / size), scope=replace(SCOPE, flights=1)
    )
    assert verdict.P_rel_error < 1e-12
    assert {"searched_value_error", "searched_gradient_error", "searched_policy_error"} == (
        failed_names(verdict.checks)
    )


def test_the_implied_policy_is_a_saddle_point() -> None:
    """The policy implied by a nonquadratic value is a saddle point of Q(u, w).

    The policy has a lower cost than u ± 0.001, each with the worst w for this input. The policy
    differs from the linearized policy.
    """
    problem = problem_of(delta=20.0, discount=0.95, N=0.2)
    step = problem
    P = exact_of(problem).P
    value = ca.bilin(ca.DM(P), Z, Z) + 2e4 * Z[0] ** 4
    V = ca.Function("V", [Z], [value])
    critic = critic_of(problem, V=value)
    u = ca.SX.sym("u")
    w = ca.SX.sym("w", 2)
    x = np.array([0.4, -0.3])
    after = ca.DM(A) @ x + ca.DM(B) @ u + ca.DM(step.E) @ w
    paid = float(x @ step.Q @ x) + 2.0 * float(x @ problem.N[:, 0]) * u + u**2
    Q = paid - step.delta**2 * ca.sumsqr(w) + 0.95 * V(after)
    slopes = ca.Function("slopes", [ca.vertcat(u, w)], [ca.gradient(Q, ca.vertcat(u, w))])
    worst = ca.rootfinder("worst", "newton", {"x": w, "p": u, "g": ca.gradient(Q, w)})
    cost = ca.Function("cost", [u, w], [Q])
    best = float(critic.policy(x))
    costs = [float(cost(best + d, worst(x0=[0, 0], p=best + d)["x"])) for d in (-1e-3, 0.0, 1e-3)]
    assert costs[1] < min(costs[0], costs[2])
    at_saddle = np.append(best, np.array(worst(x0=[0, 0], p=best)["x"]))
    assert np.abs(np.array(slopes(at_saddle))).max() < 1e-8
    assert abs(best + (critic.K @ x).item()) > 0.05  # far from the linearized policy


@pytest.mark.parametrize(("factor", "delta"), [(0.7, 40.0), (1.2, 40.0), (0.7, np.inf)])
@pytest.mark.parametrize("is_discrete", [False, True])
def test_simulated_cost_of_a_linear_network_equals_that_of_its_loop(
    is_discrete: bool, factor: float, delta: float
) -> None:
    """The largest simulated cost of u = -K z is that of the linear loop, also if it is slow."""
    problem = problem_of(discount=0.97, delta=delta)
    game = problem if is_discrete else replace(problem, dt=None, discount=1.0)
    K = factor * solve(game).K
    network = verify(game, critic_of(game, policy=-ca.DM(K) @ Z), scope=SCOPE)
    assert network.cost_lost == pytest.approx(verify(game, from_gain(game, K)).cost_lost, rel=1e-6)
    assert network.to_dict()["network"]["cost_lost_flown_percent"] == pytest.approx(
        network.cost_lost, rel=1e-6
    )


def test_the_equilibrium_of_a_shifted_network_is_found() -> None:
    """The equilibrium of x⁺ = A x + B (b - K x) is (I - A + B K)⁻¹ B b."""
    problem, bias = problem_of(), np.array([0.2])
    K = exact_of(problem).K
    critic = critic_of(problem, policy=ca.DM(bias) - ca.DM(K) @ Z)
    rest = verify(problem, critic, scope=SCOPE).to_dict()["network"]["rest_point"]
    np.testing.assert_allclose(rest, np.linalg.solve(np.eye(2) - A + B @ K, B @ bias), rtol=1e-6)


@pytest.mark.slow  # test_networks_of_exact_values_and_policies_pass
def test_rounding_of_an_accurate_value_at_the_trim_is_no_error() -> None:
    """V = Σ log cosh(ε y) / ε² is y'y up to ε², with rounding errors of its slope of 1e-16/ε."""
    rng = np.random.default_rng(0)
    for _ in range(2):
        A = rng.standard_normal((3, 3))
        A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
        game = Game(A, rng.standard_normal((3, 1)), Q=np.eye(3), R=np.eye(1), dt=0.1)
        z = ca.SX.sym("z", 3)
        y = 1e-3 * (ca.DM(np.linalg.cholesky(solve(game).P).T) @ z)
        V = 2e6 * ca.sum1(ca.log((ca.exp(y) + ca.exp(-y)) / 2.0))
        critic = from_network(game, ca.Function("V", [z], [V]))
        verdict = verify(game, critic, scope=Scope(flights=5), limit=1e-3)
        assert verdict.ok, verdict.headline
        assert verdict.cost_lost < 1e-3
