"""Predictive policy: gradient, cost, limits, delays, disturbances and refusals."""

from __future__ import annotations

import json
import pickle
from copy import copy, deepcopy
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are
from scipy.optimize import lsq_linear

import hfa
from hfa.main import main
from hfa_flight import Scenario, Waveform

EXAMPLES = Path(__file__).parents[4] / "examples"
PENDULUM_FILE = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
PENDULUM = hfa.load_model(PENDULUM_FILE)
UPRIGHT = hfa.trim(PENDULUM)
#: Cart of unit mass on a track, with a limited force and a limited speed.
CART = hfa.Model(
    "cart",
    {
        "position": hfa.Signal("m", min=-10.0, max=10.0),
        "speed": hfa.Signal("m/s", min=-1.0, max=1.0),
    },
    {"force": hfa.Signal("N", min=-2.0, max=2.0)},
    lambda x, u, p, w: ({"position": x.speed, "speed": u.force + w.push}, {}),
    disturbances={"push": hfa.Signal("N")},
    trim={"position": 0.0},
)
AT_REST = hfa.trim(CART)
WEIGHTS = np.eye(2), np.eye(1)


def moved(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return Ad, Bd and the exact cost Qd, Nd, Rd over a hold, by a sum over fine steps."""
    n, m = B.shape
    rates = np.block([[A, B], [np.zeros((m, n + m))]])
    weight = np.zeros((n + m, n + m))
    weight[:n, :n], weight[n:, n:] = Q, R
    nodes, shares = np.polynomial.legendre.leggauss(20)
    W = sum(
        0.5 * h * share * (over.T @ weight @ over)
        for node, share in zip(nodes, shares, strict=True)
        for over in [expm(rates * 0.5 * h * (1.0 + node))]
    )
    over = expm(rates * h)
    return over[:n, :n], over[:n, n:], W[:n, :n], W[:n, n:], W[n:, n:]


def gradient(policy: Any, point: Any, model: Any, size: float) -> np.ndarray:
    """Return -dU/dX of the first sample at the trim, by central differences."""
    columns = []
    for name in model.linear:
        X = np.array(point.states)
        step = size * model.states[name].nominal
        commands = []
        for sign in (1.0, -1.0):
            policy.reset()
            X[list(model.states).index(name)] = getattr(point.states, name) + sign * step
            commands.append(policy(0.0, X))
        columns.append(-(commands[0] - commands[1]) / (2.0 * step))
    return np.array(columns).T


def gain_of_holds(A: np.ndarray, B: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Return the optimal gain of the first hold, by backward Riccati from P of SciPy."""
    P = solve_continuous_are(A, B, *WEIGHTS)
    for h in holds[::-1]:
        over, forced, Qd, N, Rd = moved(A, B, *WEIGHTS, h)
        K = np.linalg.solve(Rd + forced.T @ P @ forced, forced.T @ P @ over + N.T)
        P = Qd + over.T @ P @ over - (over.T @ P @ forced + N) @ K
    return K


@pytest.mark.parametrize("model", [CART, PENDULUM], ids=["cart", "pendulum"])
def test_the_gradient_at_the_trim_is_the_exact_gain_of_the_holds(model: Any) -> None:
    """Near the trim the gain of equal holds for ever takes over, by `solve_discrete_are`."""
    point = hfa.trim(model)
    linear = hfa.linearize(model, point)
    policy = hfa.predictive(model, point, *WEIGHTS)
    plant = np.array(linear.A), np.array(linear.B)
    K = gain_of_holds(*plant, policy.holds)
    np.testing.assert_allclose(gradient(policy, point, model, 1e-5), K, rtol=1e-5)
    A, B, Qd, N, Rd = moved(*plant, *WEIGHTS, policy.dt)
    P = solve_discrete_are(A, B, Qd, Rd, s=N)
    forever = np.linalg.solve(Rd + B.T @ P @ B, B.T @ P @ A + N.T)
    np.testing.assert_allclose(policy.K, forever, rtol=1e-9)


def test_one_program_makes_the_last_plan_the_optimum_of_another_state() -> None:
    """At a second sample whose state is not the predicted one, the input of a linear model is that
    of the exact gain of the holds. The old plan would give -0.43 in place of -0.17.
    """
    policy = hfa.predictive(
        CART, AT_REST, *WEIGHTS, horizon=1.6, margin=0.0,
        limits={"position": (-1.0, 1.0)},
    )  # fmt: skip
    linear = hfa.linearize(CART, AT_REST)
    K = gain_of_holds(np.array(linear.A), np.array(linear.B), policy.holds)
    policy(0.0, [0.97, -0.1])
    elsewhere = np.array([0.95, -0.3])
    np.testing.assert_allclose(policy(policy.dt, elsewhere), -K @ elsewhere, rtol=1e-5)
    assert (policy.samples.planned, policy.samples.refused) == (2, 0)


def test_the_sample_time_resolves_the_fastest_pole() -> None:
    """A filter at 50 1/s beside the cart, without a weight worth a faster sample, sets it."""
    filtered = hfa.Model(
        "cart with a filter",
        {**CART.states, "filtered": hfa.Signal("m/s")},
        CART.inputs,
        lambda x, u, p, w: (
            {"position": x.speed, "speed": u.force, "filtered": 50.0 * (x.speed - x.filtered)},
            {},
        ),
        trim={"position": 0.0},
    )
    policy = hfa.predictive(filtered, hfa.trim(filtered), np.diag([1.0, 1.0, 1e-4]), np.eye(1))
    slow = hfa.predictive(CART, AT_REST, *WEIGHTS)
    assert 0.3 < 50.0 * policy.dt <= 0.7 < 50.0 * slow.dt


def test_near_the_trim_the_plan_costs_the_exact_value_and_the_exact_gain_flies() -> None:
    """A plan of half a second costs z'Pz with P of SciPy within 1 %, and the next input is -K z."""
    linear = hfa.linearize(CART, AT_REST)
    P = np.array(hfa.lqr(linear.A, linear.B, *WEIGHTS).P)
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS, horizon=0.5)
    z, later = np.array([0.02, -0.01]), np.array([0.015, -0.012])
    policy(0.0, z)
    assert policy.samples.first.cost == pytest.approx(z @ P @ z, rel=0.01)
    np.testing.assert_allclose(policy(policy.dt, later), -policy.K @ later, rtol=1e-9)
    assert policy.samples.linear == 1


@pytest.mark.parametrize(
    ("start", "horizon", "Q", "R"),
    [([30.0, 3.0], 12.0, *WEIGHTS), ([1.0, -1.5], 1.0, np.diag([1.0, 0.01]), 0.01 * np.eye(1))],
    ids=["long", "short"],
)
def test_the_first_plan_of_a_linear_model_is_the_optimum_with_limited_inputs(
    start: list[float], horizon: float, Q: np.ndarray, R: np.ndarray
) -> None:
    """Its cost is that of SciPy's least squares with bounds, over the holds of the plan."""
    wide = {"speed": (-100.0, 100.0), "position": (-1000.0, 1000.0)}
    policy = hfa.predictive(CART, AT_REST, Q, R, limits=wide, horizon=horizon)
    linear = hfa.linearize(CART, AT_REST)
    plant = np.array(linear.A), np.array(linear.B), Q, R
    free, forced = np.array(start), np.zeros((2, len(policy.holds)))
    policy(0.0, free)
    rows, known = [], []
    for number, h in enumerate(policy.holds):
        A, B, Qd, N, Rd = moved(*plant, h)
        root = np.linalg.cholesky(np.block([[Qd, N], [N.T, Rd]])).T
        input_row = np.eye(len(policy.holds))[[number]]
        rows.append(root @ np.vstack([forced, input_row]))
        known.append(root @ np.append(free, 0.0))
        free, forced = A @ free, A @ forced + B @ input_row
    root = np.linalg.cholesky(np.array(hfa.lqr(*plant).P)).T
    found = lsq_linear(
        np.vstack([*rows, root @ forced]), -np.concatenate([*known, root @ free]), (-2.0, 2.0)
    )
    assert policy.samples.first.cost == pytest.approx(2.0 * found.cost, rel=2e-4)
    assert np.abs(found.x).max() > 1.99


def unstable(square: float, cube: float) -> hfa.Model:
    """Return x' = x + square x² + cube x³ + u, whose linear optimum costs (1 + √2) x²."""
    return hfa.Model(
        "unstable",
        {"x": hfa.Signal("1")},
        {"u": hfa.Signal("1", min=-10.0, max=10.0)},
        lambda x, u, p, w: ({"x": x.x + square * x.x**2 + cube * x.x**3 + u.u}, {}),
    )


@pytest.mark.parametrize("kick", [0.3, 0.9])
def test_a_plan_that_is_lost_begins_anew(kick: float) -> None:
    """The inputs of the last plan lead to infinity after a kick, in which case feedback returns."""
    model = unstable(0.0, 1.0)
    policy = hfa.predictive(model, hfa.trim(model), [[1.0]], [[1.0]])
    x = np.array([1.0])
    for number in range(80):
        x = x + kick * (number == 5)
        u = policy(number * policy.dt, x)
        x = solve_ivp(lambda _, x, u=u: x + x**3 + u, (0.0, policy.dt), x, rtol=1e-8).y[:, -1]
    assert abs(x[0]) < 1e-3


def test_the_exact_gain_waits_until_its_own_flight_costs_the_value() -> None:
    """At x = 1 the plan costs the linear value, although the gain's own flight costs 16 % more."""
    model = unstable(-3.0, 3.91)
    point = hfa.trim(model)
    policy = hfa.predictive(model, point, [[1.0]], [[1.0]])
    flight = hfa.fly(
        model, point, policy, scenario=Scenario(duration=8.0), initial=[1.0], predict=False,
        weights=(np.eye(1), np.eye(1)),
    )  # fmt: skip
    plan = policy.samples.first
    assert plan is not None
    assert flight.cost is not None
    assert plan.cost == pytest.approx(1.0 + np.sqrt(2.0), rel=0.01)
    assert flight.cost < 1.01 * plan.cost


@pytest.mark.parametrize("garbage", [np.nan, 1e3, -1e3])
def test_garbage_of_the_quadratic_program_leaves_the_old_plan(
    garbage: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If every program returns garbage, the first guess is flown, and the pendulum converges."""

    true = ca.conic

    def conic(*arguments: Any) -> ca.Function:
        solve = true(*arguments)
        names = solve.name_in(), solve.name_out()
        given = [ca.MX.sym(name, solve.sparsity_in(name)) for name in names[0]]
        results = [ca.MX(solve.sparsity_out(name)) for name in names[1]]
        results[:2] = [ca.MX(ca.DM.ones(*solve.size_out("x")) * garbage), ca.MX(-1e9)]
        return ca.Function("garbage", given, results, *names)

    monkeypatch.setattr(ca, "conic", conic)
    policy = hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS)
    _, states, _ = flown(policy, PENDULUM, UPRIGHT, {"angle": 0.8, "rate": -0.5}, 6.0)
    assert np.abs(states[-1]).max() < 1e-2
    assert policy.samples.refused == policy.samples.planned - 1 > 0


def flown(
    policy: Any, model: Any, point: Any, start: dict[str, float], seconds: float, **happens: Any
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return cost with z'Pz at the end, states and inputs of a flight with Q = 1 and R = 1."""
    scenario = Scenario(duration=seconds, **happens)
    initial = [start.get(name, 0.0) for name in model.states]
    flight = hfa.fly(
        model, point, policy, scenario=scenario, initial=initial, predict=False, weights=WEIGHTS
    )
    linear = hfa.linearize(model, point)
    P = np.array(hfa.lqr(linear.A, linear.B, *WEIGHTS).P)
    z = np.array(flight.states[-1]) - np.array(point.states)
    return float(flight.cost) + float(z @ P @ z), np.array(flight.states), np.array(flight.inputs)


@pytest.mark.parametrize(
    ("model", "start", "seconds", "ratio"),
    [
        (CART, {"position": 4.0}, 12.0, 1.02),
        (PENDULUM, {"angle": 0.8, "rate": -0.5}, 6.0, 1.01),
    ],
    ids=["cart", "pendulum"],
)
def test_a_flight_costs_little_more_than_the_best_flight(
    model: Any, start: dict[str, float], seconds: float, ratio: float
) -> None:
    """The flight converges within all limits, and its cost is near that of the best flight found.

    The cart reaches its speed limit and the pendulum its torque limit.
    """
    point = hfa.trim(model)
    best = hfa.optimize(model, point, start, *WEIGHTS)
    policy = hfa.predictive(model, point, *WEIGHTS, margin=1e-3)
    cost, states, inputs = flown(policy, model, point, start, seconds)
    assert best.reason is None
    assert 0.99 * best.cost < cost < ratio * best.cost
    for column, signal in zip(states.T, model.states.values(), strict=True):
        assert signal.min - 1e-3 <= column.min()
        assert column.max() <= signal.max + 1e-3
    for column, signal in zip(inputs.T, model.inputs.values(), strict=True):
        assert signal.min <= column.min()
        assert column.max() <= signal.max
    assert policy.samples.linear > 0
    assert policy.samples.rise < 0.02


def test_the_margin_narrows_the_limits() -> None:
    """With a margin of 0.2, plans keep the cart's speed within 0.8 of its limit, and come near it.

    The linear policy at the end keeps 0.9 of the limit.
    """
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS, margin=0.2)
    _, states, _ = flown(policy, CART, AT_REST, {"position": 4.0}, 4.0)
    assert 0.75 < np.abs(states[:, 1]).max() < 0.85


def test_a_delay_is_bridged_by_the_commands_under_way() -> None:
    """With a delay, the flight costs its drift until the first command acts, and the cost from
    there, as long as the equations are linear.
    """
    dt = 0.1
    start, delay = np.array([1.0, 0.3]), 0.2
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS, dt=dt)
    late, _, _ = flown(
        policy, CART, AT_REST, dict(zip(CART.states, start.tolist(), strict=True)), 15.0,
        tick=0.01, step=0.01, delay=delay,
    )  # fmt: skip
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    over, _, drift, _, _ = moved(A, B, *WEIGHTS, delay)
    after = dict(zip(CART.states, (over @ start).tolist(), strict=True))
    prompt, _, _ = flown(policy, CART, AT_REST, after, 15.0, tick=0.01, step=0.01)
    assert late == pytest.approx(start @ drift @ start + prompt, rel=5e-4)


def ends_in_a_push(policy: Any, model: Any, point: Any, push: float) -> float:
    """Return the first state after 15 s in a constant push that the plans know."""
    knows = policy.in_air(("push",))
    air = {"push": Waveform(np.array([push]), np.zeros(1))}
    scenario = Scenario(duration=15.0, tick=policy.dt, step=policy.dt / 10.0, air=air)
    flight = hfa.fly(
        model, point, lambda t, X: knows(t, [*X], {"push": push}), scenario=scenario, predict=False
    )
    return float(flight.states[-1][0])


@pytest.mark.slow
def test_plans_end_at_the_cheapest_equilibrium_in_a_known_wind() -> None:
    """A torque-controlled pendulum ends at min z'Qz + v'Rv with all moments balanced."""
    push = 0.2
    angles = np.linspace(-0.6, 0.6, 200_001)
    torques = -push - 0.15 * 9.81 * 0.5 * np.sin(angles)
    cheapest = angles[np.argmin(angles**2 + torques**2)]
    policy = hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS)
    assert ends_in_a_push(policy, PENDULUM, UPRIGHT, push) == pytest.approx(cheapest, abs=2e-3)


@pytest.mark.slow
def test_the_policy_rests_at_the_cheapest_equilibrium_of_a_cheap_state() -> None:
    """The weight of the speed is 1e-6 of that of the roll, which the force does not move. The rest
    speed s minimizes s² + v² with v = s - push: weights that only make it unique must not move it.
    """
    push = 0.4
    boat = hfa.Model(
        "boat",
        {"speed": hfa.Signal("m/s"), "roll": hfa.Signal("rad")},
        {"force": hfa.Signal("N", min=-2.0, max=2.0)},
        lambda x, u, p, w: ({"speed": u.force - x.speed + w.push, "roll": -x.roll}, {}),
        disturbances={"push": hfa.Signal("N")},
    )
    point = hfa.trim(boat)
    policy = hfa.predictive(boat, point, np.diag([1.0, 1e6]), np.eye(1))
    assert ends_in_a_push(policy, boat, point, push) == pytest.approx(0.5 * push, rel=2e-3)


def test_the_game_of_a_finite_delta_is_at_the_end() -> None:
    """Near the trim, K is that of the game with held inputs, by value iteration; it acts harder
    than the LQR.
    """
    linear = hfa.linearize(PENDULUM, UPRIGHT)
    delta = 1.5 * hfa.solve(hfa.game(linear, *WEIGHTS, delta=1e3)).delta_min
    calm = hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS)
    tense = hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS, delta=delta)
    dt = tense.dt
    A, B, Q, N, R = moved(np.array(linear.A), np.array(linear.B), *WEIGHTS, dt)
    E = moved(np.array(linear.A), np.eye(2), np.eye(2), np.eye(2), dt)[1]
    both = np.hstack([B, E])
    weight = np.diag([R[0, 0], -dt * delta**2, -dt * delta**2])
    cross = np.hstack([N, np.zeros((2, 2))])
    P = np.zeros((2, 2))
    for _ in range(2000):
        K = np.linalg.solve(weight + both.T @ P @ both, both.T @ P @ A + cross.T)
        P = Q + A.T @ P @ A - (A.T @ P @ both + cross) @ K
    np.testing.assert_allclose(tense.K, K[:1], rtol=1e-6)
    assert (tense.K > 1.01 * calm.K).all()


LAWS = {"predictive": hfa.predictive, "state-dependent": hfa.state_dependent}


def asked(X: Any, winds: Any = None, law: str = "predictive") -> Any:
    """Return a function that asks a law of the cart for the inputs of a sample."""

    def ask() -> None:
        policy = LAWS[law](CART, AT_REST, *WEIGHTS)
        policy(0.0, X) if winds is None else policy.in_air(("push",))(0.0, X, winds)

    return ask


def made(**wrong: Any) -> Any:
    """Return a function that makes the policy of the pendulum with wrong settings."""
    return lambda: hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS, **wrong)


ROWS = [[0.0, 0.0], [0.1, 0.0]]
REFUSED = {
    "margin is 1.0": made(margin=1.0),
    "dt is -0.1 s": made(dt=-0.1),
    "dt is 100.0 s; give at most": made(dt=100.0),
    "budget is 0.0": made(budget=0.0),
    "give at least 0.05 s": made(dt=0.05, horizon=0.01),
    "below delta_min": made(delta=1e-3),
    "X has shape (2, 2); give the 2 states of one sample": asked(ROWS),
    "X has shape (1,); give the 2 states of one sample": asked([0.0], law="state-dependent"),
    "give finite numbers": asked([0.0, 0.0], {"push": np.nan}),
    "the plans do not know the wind": asked([0.0, 0.0], {"gust": 0.5}),
}


@pytest.mark.parametrize("says", REFUSED)
def test_what_is_refused(says: str) -> None:
    """Wrong settings and samples are refused in one line that says what to give."""
    with pytest.raises((hfa.BadInputError, hfa.NoSolutionError)) as refused:
        REFUSED[says]()
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_long_horizon_is_cut_and_said() -> None:
    """A horizon of a minute is cut to 10 time constants of the pendulum's growing pole."""
    policy = hfa.predictive(PENDULUM, UPRIGHT, *WEIGHTS, horizon=60.0)
    growing = np.linalg.eigvals(np.array(hfa.linearize(PENDULUM, UPRIGHT).A)).real.max()
    assert 0.0 <= 10.0 / growing - policy.holds.sum() < policy.dt
    assert any("60 s was cut to 3" in note for note in policy.notes())


def cart_flight(policy: Any, wrong: dict[int, Any]) -> np.ndarray:
    """Return the states of an exact flight of the cart, (N, 2), in which some samples are wrong."""
    policy.reset()
    dt = policy.dt
    states = [np.array([1.0, 0.2])]
    for number in range(50):
        x = states[-1]
        (force,) = policy(number * dt, wrong.get(number, x))
        states.append(np.array([x[0] + dt * x[1] + 0.5 * dt**2 * force, x[1] + dt * force]))
    return np.array(states)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("wrong", [[np.nan, 0.2], [1.0, np.inf], [1.0, 1.4], [-2.0, 0.2]])
def test_a_wrong_sample_changes_no_flight(law: str, wrong: list[float]) -> None:
    """The prediction of an exact model takes the place of a sample that is not finite or
    impossible, at the first one too, and the report counts it.
    """
    policy = LAWS[law](CART, AT_REST, *WEIGHTS, dt=0.1)
    expected = cart_flight(policy, {})
    np.testing.assert_allclose(cart_flight(policy, {4: wrong, 15: wrong}), expected, atol=1e-6)
    assert any("2 samples were not finite or impossible" in note for note in policy.notes())
    assert np.isfinite(cart_flight(policy, {0: [np.nan] * 2, 1: [np.nan] * 2})).all()


@pytest.mark.parametrize("law", LAWS)
def test_a_moved_aircraft_is_believed_at_the_second_sample(law: str) -> None:
    """A jump that stays is no wrong sample: the policy returns from there."""
    policy = LAWS[law](CART, AT_REST, *WEIGHTS, dt=0.1)
    policy(0.0, [0.0, 0.0])
    x = np.array([2.0, 0.0])
    forces = [policy(number * policy.dt, x)[0] for number in (1, 2)]
    assert abs(forces[0]) < 1e-9
    assert forces[1] < -0.5


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("copied", [copy, deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
def test_a_copy_in_flight_flies_on_as_the_policy_does(law: str, copied: Any) -> None:
    """A policy is a value with a state: the copy flies on, and does not change the original."""
    model = hfa.load_model(PENDULUM_FILE)
    policy = LAWS[law](model, hfa.trim(model), *WEIGHTS)
    for number, angle in enumerate((0.5, 0.48)):
        policy(number * policy.dt, [angle, -0.4])
    other = copied(policy)
    later = [[0.46, -0.45], [0.43, -0.5]]
    flown = [[each(0.0, X).item() for X in later] for each in (other, policy)]
    assert flown[0] == pytest.approx(flown[1], rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_a_long_flight_keeps_no_more_than_a_short_one(law: str) -> None:
    """Of a sample remain at most its processor time and what a pickle says of a number."""
    model = hfa.load_model(PENDULUM_FILE)
    policy = LAWS[law](model, hfa.trim(model), *WEIGHTS)
    sizes = []
    for number in range(200):
        policy(number * policy.dt, policy.point.x)
        if number in (99, 199):
            sizes.append(len(pickle.dumps(policy)))
    assert sizes[1] - sizes[0] < 20 * 100


def test_the_first_plan_knows_the_wind() -> None:
    """With the true push given, the first plan already ends at rest against it."""
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS).in_air(("push",))
    assert policy(0.0, [0.0, 0.0], {"push": 0.5}) == pytest.approx([-0.5], abs=1e-3)


def test_a_first_plan_before_the_flight_is_that_of_its_first_sample() -> None:
    """A plan from the expected states is flown; from other states it is made anew."""
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS)
    expected = policy(0.0, [3.0, 0.1]).item()
    for begun in ([3.0, 0.1], [3.02, 0.1], [-3.0, 0.5]):
        policy.begin(begun)
        assert policy(0.0, [3.0, 0.1]).item() == pytest.approx(expected, abs=1e-3)


def test_a_spent_budget_flies_the_last_plan_on() -> None:
    """Without time for a program, the second input is that of the first plan."""
    policy = hfa.predictive(CART, AT_REST, *WEIGHTS, budget=1e-9)
    policy.begin([3.0, 0.1])
    plan = policy.controller.samples.first
    policy(0.0, [3.0, 0.1])
    (force,) = policy(policy.dt, [2.95, 0.0])
    assert force == pytest.approx(float(plan.v[1, 0]) * policy.problem.sizes[1][0], abs=1e-9)
    assert policy.samples.late == 1


def test_a_flight_from_the_trim_has_no_ratio_to_its_first_plan(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The first plan of a flight that begins at the trim costs nothing but rounding."""
    words = ["--aircraft", PENDULUM_FILE, "--law", "predictive", "--duration", "1", "--json"]
    assert main(["fly", *words, "--disturbance", "push=0.1"]) == 0
    samples = json.loads(capsys.readouterr().out)["policy"]["samples"]
    assert samples["first_plan"] is None
    assert 0.0 <= samples["rise"] < 0.1


@pytest.mark.parametrize("law", ["predictive", "state-dependent"])
def test_laws_fly_and_are_compared_on_the_command_line(
    law: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """`fly --law` and `optimize --law` fly the same flight, near the best; the report of `fly` says
    what the samples needed.
    """
    words = ["--aircraft", PENDULUM_FILE, "--law", law, "--json"]
    assert main(["fly", *words, "--initial", "angle=40", "--duration", "6"]) == 0
    flown = json.loads(capsys.readouterr().out)
    assert main(["optimize", *words, "--start", "angle=40"]) == 0
    compared = json.loads(capsys.readouterr().out)["policies"]
    (ratio,) = [each["over_best"] for each in compared if each["policy"] == law]
    assert 0.999 < ratio < 1.02
    assert flown["policy"]["law"] == law
    if law == "predictive":
        counts = flown["policy"]["samples"]
        assert counts["planned"] + counts["linear"] == round(6.0 / flown["policy"]["dt"])
        assert counts["planned"] > counts["refused"] >= 0
        assert counts["first_plan"] == pytest.approx(flown["cost"], rel=0.05)
    assert abs(flown["final"]["angle"]) < 1e-3


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (
            ["--law", "predictive", "--command", "angle=1:2"],
            "--command cannot be combined with --law predictive",
        ),
        (["--law", "state-dependent", "--horizon", "1"], "--horizon applies only to"),
        (["--law", "exact", "--margin", "0.1"], "--margin applies only to"),
        (["--law", "predictive", "--samples", "2", "--workers", "2"], "a law that plans"),
        (["--keep-inside"], "move no limited state"),
    ],
)
def test_what_the_command_refuses(
    words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Options that contradict each other, and a filter without effect, are refused with the reason."""
    assert main(["fly", "--aircraft", PENDULUM_FILE, *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert named in line


@pytest.mark.slow
def test_the_flexible_aircraft_converges_inside_its_envelope_from_the_papers_start() -> None:
    """From x(0) at 10 deg, where the exact policy leaves the envelope, the flight stays inside at
    1.02 times the best flight, which costs 4560.
    """
    model = hfa.aircraft()
    point = hfa.trim(model, dihedral=np.radians(10.0))
    game = hfa.paper.published_game(hfa.linearize(model, point))
    start = {"speed": 5.0, "alpha": 0.05}
    flights = {
        name: hfa.fly(
            model, point, policy, 3.0, initial=start, predict=False, weights=(game.Q, game.R)
        )
        for name, policy in [
            ("predictive", hfa.predictive(model, point, game.Q, game.R)),
            ("exact", hfa.solve(game)),
        ]
    }
    assert flights["predictive"].ok
    assert flights["predictive"].cost < 1.02 * 4560.0
    away = np.array(flights["predictive"].states[-1]) - np.array(point.states)
    places = [list(model.states).index(name) for name in model.linear]
    assert np.abs(away[places]).max() < 0.05
    assert flights["exact"].departure is not None
