"""The neighborhood in which a value agrees with simulated flights of both players."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hfa
from hfa import Model, Signal, expand


def pendulum(x, u, p, w):
    """Return a pendulum with a quadratic spring, which makes the terms of odd degree nonzero."""
    return {"a": x.b, "b": x.a + 0.8 * x.a**2 - x.a**3 / 6.0 - 0.1 * x.b + u.u}, {}


PENDULUM = Model(
    "pendulum", {"a": Signal(), "b": Signal()}, {"u": Signal()}, pendulum,
    trim={"a": 0.0, "b": 0.0},
)  # fmt: skip


def states_at(expansion, size, count, seed):
    """Return random states with z'Pz = size², (n, count)."""
    y = np.random.default_rng(seed).standard_normal((expansion.states, count))
    return np.linalg.solve(expansion.root.T, size * y / np.linalg.norm(y, axis=0))


def costs(expansion, z):
    """Return the costs of flights with u and d of the expansion from z (n, count), (count,)."""
    game = expansion.game
    loop = np.linalg.eigvals(game.worst_case_loop(expansion.solution.P))
    w = ca.SX.sym("w", expansion.states + 1)
    state = w[:-1]
    u, d = expansion.policy(state), expansion.disturbance(state)
    paid = game.delta**2 * ca.sumsqr(d)
    rates = ca.vertcat(
        expansion.rates(state, u) + ca.DM(game.E) @ d,
        ca.bilin(game.Q, state) + ca.bilin(game.R, u) - paid,
    )
    f = ca.Function("f", [w], [rates])
    begin = np.vstack([z, np.zeros(z.shape[1])])
    flown = solve_ivp(
        lambda t, y: np.array(f(y.reshape(begin.shape))).ravel(),
        (0.0, 12.0 / np.abs(loop.real).min()),
        begin.ravel(),
        rtol=1e-7,
        atol=1e-9,
    )
    return flown.y[:, -1].reshape(begin.shape)[-1]


def test_flights_inside_the_radius_agree_and_some_outside_do_not():
    """For a pendulum, V of degree 4 and its quadratic part each state a set z'Pz <= c. Inside, they
    differ from the costs of 50 flights by at most their stated share of the cost.

    Of 200 flights from states at 1.3 times the distance √c, at least one differs by more.
    """
    linear = hfa.linearize(PENDULUM, hfa.trim(PENDULUM))
    solution = hfa.solve(hfa.game(linear, Q=[1.0, 0.5], R=[2.0], delta=4.0, E=[[0.0], [1.0]]))
    expansion = expand(linear, solution, 4)
    of_one = np.sqrt(np.diag(np.linalg.inv(solution.P)))  # largest |z_i| where z'Pz = 1
    for radius in expansion.radii:
        np.testing.assert_allclose(radius.extents, math.sqrt(radius.c) * of_one)
        random = np.random.default_rng(99).uniform(size=50) ** 0.5  # of the distance
        inside = random * states_at(expansion, math.sqrt(radius.c), count=50, seed=99)
        outside = states_at(expansion, 1.3 * math.sqrt(radius.c), count=200, seed=99)
        errors = []
        for z0 in (inside, outside):
            value = np.array(expand(linear, solution, radius.degree).V(z0))[0]
            errors.append(np.abs(value / costs(expansion, z0) - 1.0).max())
        assert errors[0] <= radius.share < errors[1]


def test_linear_plant_agrees_everywhere():
    """For a linear plant, whose V is quadratic, V of degree 3 and its quadratic part agree with flights
    from any state: c is infinite.
    """
    linear = hfa.LinearModel.of([[0.0, 1.0], [-1.0, 0.3]], [[0.0], [1.0]])
    solution = hfa.solve(hfa.game(linear, Q=[1.0, 1.0], R=[2.0], delta=5.0))
    assert [radius.c for radius in expand(linear, solution, order=3).radii] == [math.inf, math.inf]


def dip(x, u, p, w):
    """Return a lift with a smooth loss between .25 and .55, in which there is a second equilibrium."""
    lost = ca.exp(-(((x.a - 0.4) / 0.08) ** 2))
    return {
        "a": -2.0 * x.a + x.q + 1.9 * x.a * lost,
        "q": -4.0 * x.a + 7.0 * x.a * lost - x.q + 3.0 * u.u,
    }, {}


@pytest.mark.parametrize(("unit", "nominal"), [(1.0, 0.1), (1000.0, 0.1), (1.0, 100.0)])
def test_a_set_ends_where_flights_stay_at_another_equilibrium(unit, nominal):
    """Flights from far beyond a loss of lift come back to it and stay there, at .42 in place of 0: no
    set that is said to agree reaches it, also in other units or from nominal values far beyond.
    """
    a = Signal(nominal=nominal * unit)

    def equations(x, u, p, w):
        rates, _ = dip(x._replace(a=x.a / unit, q=x.q / unit), u, p, w)
        return {name: unit * rate for name, rate in rates.items()}, {}

    model = Model("dip", {"a": a, "q": a}, {"u": Signal()}, equations, trim={"a": 0.0, "q": 0.0})
    linear = hfa.linearize(model, hfa.trim(model))
    game = hfa.game(linear, Q=np.eye(2) / unit**2, R=[1.0], delta=np.inf)
    for degree in (2, 3):
        for radius in expand(linear, hfa.solve(game), degree).radii:
            assert 0.05 < radius.extents[0] / unit < 0.42
