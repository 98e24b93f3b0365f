"""A flight of a policy that is not linear ends when it has converged or diverged, or undecided."""

import math
from dataclasses import replace

import casadi as ca
import pytest
from scipy.integrate import solve_ivp

from hfa import Game, from_network, solve, verify

#: Unstable plants with one state and one input, in continuous time and in steps of 0.1 s.
FLOW = Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0])
STEP = Game([[1.1]], [[0.1]], Q=[0.1], R=[0.1], dt=0.1)
Z = ca.SX.sym("z")


def judged(game, u, unit=1.0):
    """Return the verdict on a policy, an expression of `Z`, in the box |z| <= 1, of z in other units."""
    game = replace(game, B=unit * game.B, Q=game.Q / unit**2)
    policy = ca.Function("policy", [Z], [ca.substitute(u, Z, Z / unit)])
    critic = from_network(game, policy, network="policy")
    return verify(game, critic, box=[unit], flights=10)


def cost_of_flow(limit, K):
    """Return the cost of u = -limit tanh(K z / limit) from z = 1, by DOP853."""

    def rates(_, x):
        u = -limit * math.tanh(K * x[0] / limit)
        return [x[0] + u, x[0] ** 2 + u**2]

    flown = solve_ivp(rates, (0.0, 60.0), [1.0, 0.0], method="DOP853", rtol=1e-10, atol=1e-12)
    return float(flown.y[1, -1])


def cost_of_steps(limit, K):
    """Return the cost of the same policy in discrete time, step by step."""
    z, cost = 1.0, 0.0
    for _ in range(10_000):
        u = -limit * math.tanh(K * z / limit)
        cost += 0.1 * z**2 + 0.1 * u**2
        z = 1.1 * z + 0.1 * u
    return cost


@pytest.mark.parametrize("limit", [1.05, 3.0])
@pytest.mark.parametrize(("game", "cost"), [(FLOW, cost_of_flow), (STEP, cost_of_steps)])
def test_a_policy_that_is_slow_at_its_limit_has_the_cost_of_its_flight(game, cost, limit):
    """The policy u = -limit tanh(K z / limit) has the cost of a simulation from the edge of the box,
    z = 1, from which its flight returns slowly: z' = z + u, and |u| is at most 1.05.
    """
    exact = solve(game)
    K = exact.K.item()
    verdict = judged(game, -limit * ca.tanh(K * Z / limit))
    above = 100.0 * (cost(limit, K) / exact.P.item() - 1.0)
    assert verdict.cost_above_optimum_percent == pytest.approx(above, rel=1e-3)
    shown = f"{above:.0f}" if limit == 1.05 else f"{above:.2g}"
    assert f": at least {shown} % above the optimum" in verdict.headline


@pytest.mark.parametrize("game", [FLOW, STEP])
def test_a_limit_below_what_the_box_needs_has_no_bounded_cost(game):
    """At z = 1, inputs within 0.9 do not stop the unstable plant z' = z + u, which needs |u| > 1."""
    K = solve(game).K.item()
    verdict = judged(game, -0.9 * ca.tanh(K * Z / 0.9))
    assert verdict.cost_above_optimum_percent == math.inf
    assert "not stabilizing from (x1 1): diverges" in verdict.headline.replace("x1 -1", "x1 1")


@pytest.mark.parametrize("game", [FLOW, STEP])
@pytest.mark.parametrize("unit", [1.0, 1e4])
def test_a_flight_to_another_equilibrium_is_a_counter_example(game, unit):
    """A policy of the plant z' = z + u, or z⁺ = 1.1 z + 0.1 u, is -K z near the trim, but beyond
    z = 0.5 it leads to another equilibrium, z = 0.8: a flight from there neither converges to 0 nor
    diverges. The verdict shows such a start.
    """
    K = solve(game).K.item()
    far = 1.0 / (1.0 + ca.exp(-200.0 * (Z - 0.5)))
    u = -K * Z * (1.0 - far) + far * (-0.8 - 2.0 * (Z - 0.8))
    verdict = judged(game, u, unit)
    assert verdict.cost_above_optimum_percent == math.inf
    assert (verdict.grade, verdict.holds(1e9)) == ("fail", False)
    data = verdict.to_dict()
    assert data["counterexample"][0] >= 0.5 * unit
    assert (data["proved"], "another equilibrium" in verdict.headline) == (False, True)
