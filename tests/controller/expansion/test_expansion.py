"""The expansion of a nonlinear game: closed forms, its identity, units, and refusals."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from known_models import game_at, model_at
from nominal import nominal_game
from own_models import GTM

import hfa
from controller.expansion.taylor import PowerSeries
from hfa import BadInputError, Model, NoSolutionError, Signal, expand
from trim import usual_condition

#: Bound of rounding errors in an expression that is 0 in theory, relative to the sizes of its terms.
ROUNDING = 1e-12


def linear_of(model):
    return hfa.linearize(model, hfa.trim(model))


def mixed(x, u, p, w):
    """Return a plant that is not affine in its inputs."""
    rates = {
        "a": -ca.sin(x.a) + x.b**2 + u.u + 0.3 * u.u * u.v + 0.2 * u.v**3,
        "b": x.a * ca.exp(0.4 * x.b) - x.a + x.b + u.v * ca.cos(x.a) + 0.1 * u.u**2 + 0.5 * x.a,
    }
    return rates, {}


MIXED = Model(
    "mixed",
    {"a": Signal(), "b": Signal()},
    {"u": Signal(), "v": Signal()},
    mixed,
    trim={"a": 0.0, "b": 0.0},
)


def hamiltonian(expansion, z, u):
    """Return the Hamiltonian at z and u, with the worst disturbance."""
    game = expansion.game
    V = expansion.V(z)
    d = expansion.disturbance(z)
    slope = ca.gradient(V, z)
    N = ca.DM(game.N)
    cost = ca.bilin(game.Q, z) + 2 * ca.dot(z, N @ u) + ca.bilin(game.R, u)
    reward = game.delta**2 * ca.dot(d, d) if np.isfinite(game.delta) else 0.0
    return ca.dot(slope, expansion.rates(z, u) + ca.DM(game.E) @ d) + cost - reward


def taylor(expression, z, degree):
    """Return the coefficients of t^0 ... t^degree of an expression on rays t z, z random."""
    t = ca.SX.sym("t")
    derivative = ca.substitute(expression, z, t * z)
    coefficients = []
    for order in range(degree + 1):
        coefficients.append(ca.substitute(derivative, t, 0) / math.factorial(order))
        derivative = ca.jacobian(derivative, t)
    points = np.random.default_rng(4).standard_normal((z.numel(), 30))
    return [np.array(ca.Function("c", [z], [ca.densify(c)])(points)) for c in coefficients]


def identity_error(expansion):
    """Return the largest coefficient that should be 0, relative to that of degree D + 1 in H.

    They are those of the Hamiltonian H(z, u(z), d(z)) up to degree D, and of ∂H/∂u up to D - 1.
    """
    z = ca.SX.sym("z", expansion.states)
    u = ca.SX.sym("u", expansion.rates.size1_in(1))
    H = hamiltonian(expansion, z, u)
    policy = expansion.policy(z)
    D = expansion.order
    *value, beyond = taylor(ca.substitute(H, u, policy), z, D + 1)
    slope = taylor(ca.substitute(ca.gradient(H, u), u, policy), z, D - 1)
    return max(np.abs(part).max() for part in [*value, *slope]) / np.abs(beyond).max()


@pytest.mark.parametrize("delta", [np.inf, 3.0])
def test_hamiltonian_and_its_slope_vanish_to_the_degree_of_the_value(delta):
    """With V of degree D, H(z, u(z), d(z)) is 0 to degree D, and ∂H/∂u to degree D - 1.

    The Hamiltonian H is differentiated here, with the functions V, u and d of the expansion, whose
    plant has products of inputs, and whose game has cross weights.
    """
    linear = linear_of(MIXED)
    N = [[0.2, -0.1], [0.05, 0.3]]
    expansion = expand(
        linear,
        hfa.solve(hfa.game(linear, Q=[1.0, 2.0], R=[0.5, 0.8], delta=delta, E=[[0.3], [1.0]], N=N)),
        5,
    )
    assert identity_error(expansion) <= ROUNDING


def test_every_coefficient_is_right_to_rounding_in_other_units():
    """The weights of the paper's aircraft are proved; computed in states and a cost of quite other sizes,
    they are the same in all digits of doubles.
    """
    linear = hfa.paper.level_model(hfa.aircraft("newton"), np.radians(5.0))
    game = hfa.paper.published_game(linear)
    found = expand(linear, hfa.solve(game), order=4)
    assert found.error < 1e-15
    cost = 2.0**40
    costly = replace(game, Q=cost * game.Q, R=cost * game.R, delta=2.0**20 * game.delta)
    scaled = expand(linear, hfa.solve(costly), order=4)
    assert scaled.weights == pytest.approx(cost * found.weights, rel=1e-14)
    assert scaled.policy_weights == pytest.approx(found.policy_weights, rel=1e-14)


# Refusals
# --------------------------------------------------------------------------------------------------


def scalar_expansion(f, degree=3):
    """Return the expansion of the plant x' = f(x) + u."""
    equations = lambda x, u, p, w: ({"x": f(x.x) + u.u}, {})  # noqa: E731
    model = Model("plant", {"x": Signal()}, {"u": Signal()}, equations, trim={"x": 0.0})
    linear = linear_of(model)
    return expand(linear, hfa.solve(hfa.Game(linear.A, linear.B, Q=[1.0], R=[1.0])), degree)


def accelerated():
    """Expand about a flight of which the speed grows, where the deviations have no equilibrium."""
    usual = usual_condition(GTM)
    linear = hfa.linearize(GTM, hfa.trim(GTM, replace(usual, rates={**usual.rates, "speed": 0.5})))
    return expand(linear, hfa.solve(nominal_game(linear)), order=3)


def without_cost():
    """Expand a game whose second state costs nothing: P is singular."""
    linear = hfa.LinearModel.of([[1.0, 0.0], [0.0, -1.0]], [[1.0], [0.0]])
    return expand(linear, hfa.solve(hfa.game(linear, Q=[1.0, 0.0], R=[1.0])), order=3)


TABLE = ca.interpolant("table", "linear", [[-1.0, 0.5, 1.0]], [-1.0, 0.5, 2.0])
REFUSED = {
    "table": (lambda: scalar_expansion(TABLE), "table"),
    "nonsmooth": (lambda: scalar_expansion(lambda x: ca.fabs(x) * x), "x switches"),
    "root": (lambda: scalar_expansion(lambda x: x + x**1.5), "finite"),
    "power": (lambda: scalar_expansion(lambda x: x + (x**2) ** 1.25), "not finite"),
    "degree 1": (lambda: scalar_expansion(lambda x: x, degree=1), "2 to 5"),
    "degree 6": (lambda: scalar_expansion(lambda x: x, degree=6), "2 to 5"),
    "game": (lambda: expand(model_at(15.0), hfa.solve(game_at(10.0)), order=3), "A of the game"),
    "rates": (accelerated, "rate of speed"),
    "no cost": (without_cost, "P is singular"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_expansion_is_refused(case):
    """Equations with a table, with a switch or an infinite derivative at the trim, another degree
    than 2 to 5, a game at another trim, a trim with a changing speed and a singular P are refused.

    The message is one line that names the cause.
    """
    call, says = REFUSED[case]
    with pytest.raises((BadInputError, NoSolutionError), match=says) as refusal:
        call()
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "f",
    [
        lambda a, b: ca.atan2(0.3 + a, 0.5 - b) + ca.atan2(0.3 + a, b - 0.1) + ca.atan2(b - 0.4, a),
        lambda a, b: (
            (1.2 + a) ** (0.7 + b)
            + ca.constpow(a - 2.0, 3.0)
            + ca.constpow(a, 3.0)
            + (3.0 + b) ** -2.0
            + 2.0 ** (a * b)
        ),
        lambda a, b: ca.tanh(a - b) + ca.erf(a) * ca.cos(b) + ca.exp(a) / (2.0 + ca.sin(b)),
        lambda a, b: (
            ca.fmax(a, 0.5) * b + ca.fmin(b, a - 1.0) + ca.fabs(b - 0.3) + ca.sign(a - 1.0)
        ),
        lambda a, b: (
            ca.if_else(ca.logic_and(a < 0.5, b > -0.2), a * b, ca.sqrt(a)) + ca.log(1.5 + a)
        ),
    ],
)
def test_the_power_series_of_an_operation_is_near_it(f):
    """The series to degree 4 differ from the functions near 0 by terms of degree 5."""
    z = ca.SX.sym("z", 2)
    function = ca.Function("f", [z], [f(z[0], z[1])])
    ring = PowerSeries(2, 4)
    (series,) = ring.values(function, ring.variables())
    for at in ((0.01, -0.02), (-0.02, -0.01), (0.02, 0.02)):
        found = sum(series * np.prod(np.array(at) ** ring.exponents, axis=1))
        assert float(found) == pytest.approx(float(function(at)), abs=1e-6)
