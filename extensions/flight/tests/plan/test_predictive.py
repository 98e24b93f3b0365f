"""Predictive policy: gradient, cost, limits, delays, disturbances and refusals."""

import json
import math
from functools import partial

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa as hfa_command
from held_inputs import over_hold
from known_models import game_at, model_at
from project import ROOT
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_are, solve_discrete_are

import hfa
from hfa_flight import Scenario
from hfa_flight.policies.policy import NextSample

PENDULUM_FILE = f"{ROOT}/examples/pendulum.py:PENDULUM"
PENDULUM = hfa.load_model(PENDULUM_FILE)
UPRIGHT = hfa.trim(PENDULUM)  # unstable, with a torque of at most 0.7 N m
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
WEIGHTS = np.eye(2), np.eye(1)  # Q of both states, R of the one input
#: Without a budget of time, plans do not depend on how busy the machine is.
predictive = partial(hfa.predictive, budget=math.inf)
LAWS = {"predictive": predictive, "state-dependent": hfa.state_dependent}


def cart_policy(law="predictive", **settings):
    """Return a policy of the cart with the weights `WEIGHTS`."""
    return LAWS[law](CART, AT_REST, *WEIGHTS, **settings)


def gradient(policy):
    """Return -dU/dX of the first sample at the pendulum's trim, by central differences."""
    columns = []
    for step in 1e-5 * np.eye(2):
        commands = []
        for X in (UPRIGHT.x + step, UPRIGHT.x - step):
            policy.reset()
            commands.append(policy(0.0, X))
        columns.append((commands[1] - commands[0]) / 2e-5)
    return np.array(columns).T


def gain_of_holds(A, B, holds):
    """Return the optimal gain of the first hold, by backward Riccati from P of SciPy."""
    P = solve_continuous_are(A, B, *WEIGHTS)
    for h in holds[::-1]:
        Ah, Bh, Q, N, R = over_hold(A, B, *WEIGHTS, h)
        K = np.linalg.solve(R + Bh.T @ P @ Bh, Bh.T @ P @ Ah + N.T)
        P = Q + Ah.T @ P @ Ah - (Ah.T @ P @ Bh + N) @ K
    return K


def test_one_quadratic_program_finds_the_optimal_input_off_the_plan():
    """At the second sample, the state differs from the plan of the first. One quadratic program then
    finds the optimal input -K z of the linear cart (`gain_of_holds`), not that of the first plan.
    """
    # With this limit, at 1 m, a plan and not the linear policy acts at the second sample.
    policy = predictive(
        CART, AT_REST, *WEIGHTS, horizon=1.6, margin=0.0,
        limits={"position": (-1.0, 1.0)},
    )  # fmt: skip
    linear = hfa.linearize(CART, AT_REST)
    K = gain_of_holds(np.array(linear.A), np.array(linear.B), policy.holds)
    policy(0.0, [0.97, -0.1])
    # The force of the second sample in the first plan, N: v is in nominal values.
    planned = float(policy.samples.first.v[1, 0]) * policy.problem.nominal.inputs[0]
    elsewhere = np.array([0.95, -0.3])
    assert abs(planned + (K @ elsewhere).item()) > 0.05  # the exact force differs by this, N
    np.testing.assert_allclose(policy(policy.dt, elsewhere), -K @ elsewhere, rtol=1e-5)
    assert (policy.samples.planned, policy.samples.refused) == (2, 0)


def unstable(square, cube):
    """Return x' = x + square x² + cube x³ + u, whose linear optimum costs (1 + √2) x²."""
    return hfa.Model(
        "unstable",
        {"x": hfa.Signal("1")},
        {"u": hfa.Signal("1", min=-10.0, max=10.0)},
        lambda x, u, p, w: ({"x": x.x + square * x.x**2 + cube * x.x**3 + u.u}, {}),
    )


def test_a_new_plan_replaces_one_that_diverges_after_a_jump():
    """x' = x + x³ + u: after a jump of x by 0.9, x would diverge with the inputs of the last plan,
    |u| <= 10. The flight converges.
    """
    model = unstable(0.0, 1.0)
    policy = predictive(model, hfa.trim(model), [[1.0]], [[1.0]])
    x = np.array([1.0])
    for number in range(80):
        if number == 5:
            x = x + 0.9
        u = policy(number * policy.dt, x)
        x = solve_ivp(lambda _, x, u=u: x + x**3 + u, (0.0, policy.dt), x, rtol=1e-8).y[:, -1]
    assert abs(x[0]) < 1e-3


def test_the_linear_policy_takes_over_only_where_its_own_flight_costs_the_linear_value():
    """The plan from x = 1 costs the linear value x'Px, but the flight of u = -K x would cost 16 % more:
    the linear policy does not take over there, and the flight costs at most 1 % more than the plan.
    """
    # x' = x - 3 x² + 3.91 x³ + u: 3.91 makes the plan from x = 1 cost x'Px = (1 + √2) x².
    model = unstable(-3.0, 3.91)
    point = hfa.trim(model)
    policy = predictive(model, point, [[1.0]], [[1.0]])
    flight = hfa.fly(
        model, point, policy, scenario=Scenario(duration=8.0), initial=[1.0], predict=False,
        weights=(np.eye(1), np.eye(1)),
    )  # fmt: skip
    plan = policy.samples.first
    assert plan.cost == pytest.approx(1.0 + np.sqrt(2.0), rel=0.01)
    assert flight.cost < 1.01 * plan.cost


def test_wrong_solutions_of_the_quadratic_program_leave_the_old_plan(monkeypatch):
    """If every program returns a wrong step that promises a lower cost (planted), all steps are
    refused. The first guess is flown, and the pendulum converges.
    """
    unplanted = ca.conic

    def conic(*arguments):
        """Return a solver whose every step is 1000 in all unknowns, for a cost of -1e9."""
        solve = unplanted(*arguments)
        names = solve.name_in(), solve.name_out()
        given = [ca.MX.sym(name, solve.sparsity_in(name)) for name in names[0]]
        results = [ca.MX(solve.sparsity_out(name)) for name in names[1]]
        results[:2] = [ca.MX(ca.DM.ones(*solve.size_out("x")) * 1e3), ca.MX(-1e9)]  # x, cost
        return ca.Function("wrong", given, results, *names)

    monkeypatch.setattr(ca, "conic", conic)
    policy = predictive(PENDULUM, UPRIGHT, *WEIGHTS)
    _, states, _ = flown(policy, PENDULUM, UPRIGHT, {"angle": 0.8, "rate": -0.5}, 6.0)
    assert np.abs(states[-1]).max() < 1e-2
    # Refused steps of the first plan, which is the best one of several guesses, are not counted.
    assert policy.samples.refused == policy.samples.planned - 1 > 0


def flown(policy, model, point, start, seconds, **happens):
    """Return cost with z'Pz at the end, states and inputs of a flight with Q = 1 and R = 1.

    happens: further arguments of the scenario
    """
    scenario = Scenario(duration=seconds, **happens)
    initial = [start.get(name, 0.0) for name in model.states]
    flight = hfa.fly(
        model, point, policy, scenario=scenario, initial=initial, predict=False, weights=WEIGHTS
    )
    linear = hfa.linearize(model, point)
    P = np.array(hfa.lqr(linear.A, linear.B, *WEIGHTS).P)
    z = np.array(flight.states[-1]) - np.array(point.states)
    return float(flight.cost) + float(z @ P @ z), np.array(flight.states), np.array(flight.inputs)


def test_a_plan_begins_at_the_state_that_is_reached_after_the_delay():
    """With a delay of two samples, the cart drifts without a force until the first command acts. The
    flight costs this drift, by quadrature, and what a flight without delay costs from the state at
    the end of the drift.
    """
    dt = 0.1
    start, delay = np.array([1.0, 0.3]), 0.2
    policy = cart_policy(dt=dt)
    late, _, _ = flown(
        policy, CART, AT_REST, dict(zip(CART.states, start.tolist(), strict=True)), 15.0,
        tick=0.01, step=0.01, delay=delay,
    )  # fmt: skip
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    transition, _, cost_of_drift, _, _ = over_hold(A, B, *WEIGHTS, delay)
    after = dict(zip(CART.states, (transition @ start).tolist(), strict=True))
    prompt, _, _ = flown(policy, CART, AT_REST, after, 15.0, tick=0.01, step=0.01)
    assert late == pytest.approx(start @ cost_of_drift @ start + prompt, rel=5e-4)


def test_near_the_trim_the_gain_of_a_finite_delta_is_that_of_the_sampled_game():
    """Near the trim, K is that of the game with held inputs and a disturbance of each state (E = I),
    by SciPy's Riccati equation with the weight -dt δ² of a disturbance. Each entry exceeds the LQR's.
    """
    linear = hfa.linearize(PENDULUM, UPRIGHT)
    delta = 1.5 * hfa.solve(hfa.game(linear, Q=WEIGHTS[0], R=WEIGHTS[1], delta=1e3)).delta_min
    lqr = predictive(PENDULUM, UPRIGHT, *WEIGHTS)
    of_game = predictive(PENDULUM, UPRIGHT, *WEIGHTS, delta=delta)
    dt, plant = of_game.dt, np.array(linear.A)
    A, B, Q, N, R = over_hold(plant, np.array(linear.B), *WEIGHTS, dt)
    _, E, _, _, _ = over_hold(plant, np.eye(2), np.eye(2), np.eye(2), dt)
    # The input u minimizes, and the disturbances maximize.
    both = np.hstack([B, E])
    weight = np.diag([R[0, 0], -dt * delta**2, -dt * delta**2])
    cross = np.hstack([N, np.zeros((2, 2))])
    P = solve_discrete_are(A, both, Q, weight, s=cross)
    K = np.linalg.solve(weight + both.T @ P @ both, both.T @ P @ A + cross.T)
    np.testing.assert_allclose(of_game.K, K[:1], rtol=1e-6)  # the row of u
    assert (of_game.K > 1.01 * lqr.K).all()


@pytest.mark.parametrize(
    ("shift", "deviation", "fastest"),
    [(0.0, 10.0, 0.5), (0.2, 0.0, 0.79), (-0.2, 0.1, 0.79)],
)
def test_limits_are_moved_and_narrowed_by_the_next_sample_that_a_filter_predicts(
    shift, deviation, fastest
):
    """The limit of the speed, 1 m/s, is moved by what the air adds to the speed, and narrowed by 4
    standard deviations, at most to its half. The margin narrows it by 1 %.

    fastest: 0.99 m/s - shift - 4 deviation, at least 0.5 m/s
    """
    following = NextSample(np.array([0.0, shift]), np.array([0.0, deviation]))
    policy, x, speeds = cart_policy(), np.array([-8.0, 0.0]), []
    dt = policy.dt
    for number in range(round(4.0 / dt)):
        (u,) = policy.of_estimate(number * dt, x, following)
        x = np.array([x[0] + dt * x[1] + 0.5 * dt**2 * u, x[1] + dt * u])
        speeds.append(x[1])
    assert max(speeds) == pytest.approx(fastest, abs=1e-4)


@pytest.mark.parametrize(
    ("says", "refused"),
    [
        ("margin is 1.0", lambda: cart_policy(margin=1.0)),
        ("dt is -0.1 s", lambda: cart_policy(dt=-0.1)),
        ("dt is 1000.0 s; give at most", lambda: cart_policy(dt=1000.0)),
        ("limit_weight is -1.0", lambda: cart_policy("state-dependent", limit_weight=-1.0)),
        ("budget is 0.0", lambda: cart_policy(budget=0.0)),
        ("give at least 0.05 s", lambda: cart_policy(dt=0.05, horizon=0.01)),
        ("below delta_min", lambda: cart_policy(delta=1e-3)),
        ("X has shape (2, 2)", lambda: cart_policy()(0.0, np.zeros((2, 2)))),
    ],
)
def test_wrong_settings_of_a_law_are_refused(says, refused):
    """Wrong settings of a law, and states of another shape, are refused in one line."""
    with pytest.raises((hfa.BadInputError, hfa.NoSolutionError)) as caught:
        refused()
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def cart_flight(policy, wrong):
    """Return the states of an exact flight of the cart, (N, 2).

    wrong: number of a sample -> states that the policy sees in place of the true ones
    """
    policy.reset()
    dt = policy.dt
    states = [np.array([1.0, 0.2])]
    for number in range(50):
        x = states[-1]
        (force,) = policy(number * dt, wrong.get(number, x))
        states.append(np.array([x[0] + dt * x[1] + 0.5 * dt**2 * force, x[1] + dt * force]))
    return np.array(states)


@pytest.mark.parametrize("law", LAWS)
def test_a_faulty_sample_does_not_change_the_flight(law):
    """A sample that is not finite, or too far from the prediction to be possible, is replaced by the
    prediction of the model, which is exact here. The report counts the 3 replaced ones.

    Samples that are not finite at the beginning, without a prediction, leave the flight finite.
    """
    policy = cart_policy(law, dt=0.1)
    expected = cart_flight(policy, {})
    wrong = {4: [np.nan, 0.2], 15: [1.0, 1.4], 25: [-2.0, 0.2]}
    np.testing.assert_allclose(cart_flight(policy, wrong), expected, atol=1e-6)
    assert any(note.startswith("3 samples") for note in policy.notes())
    assert np.isfinite(cart_flight(policy, {0: [np.nan] * 2, 1: [np.inf] * 2})).all()


def test_without_time_for_a_new_plan_the_last_one_is_flown():
    """Without time for a program, the second input is that of the first plan."""
    policy = cart_policy(budget=1e-9)
    policy.begin([3.0, 0.1])
    plan = policy.controller.samples.first
    policy(0.0, [3.0, 0.1])
    (force,) = policy(policy.dt, [2.95, 0.0])
    # v has the inputs of the plan, a row for each sample, divided by their nominal values.
    assert force == pytest.approx(float(plan.v[1, 0]) * policy.problem.nominal.inputs[0], abs=1e-9)
    assert policy.samples.late == 1


def test_a_flight_of_the_command_does_not_depend_on_the_machine(monkeypatch):
    """On a machine that needs a second between two instructions, the flight is the same."""
    words = ["fly", "--aircraft", PENDULUM_FILE, "--policy", "predictive", "--duration", "0.4"]
    words += ["--initial", "angle=40", "--disturbance", "push=2", "--json"]
    finals = []
    for slow in (False, True):
        if slow:  # each reading of the clock is a second after the one before
            monkeypatch.setattr("time.thread_time", map(float, range(10**9)).__next__)
        finals.append(json.loads(hfa_command(*words).out)["final"])
    assert finals[0] == finals[1]


@pytest.mark.parametrize(
    "law", ["predictive", pytest.param("state-dependent", marks=pytest.mark.slow)]
)
def test_laws_fly_and_are_compared_on_the_command_line(law):
    """A flight costs the same by `fly --policy` and `optimize --policy`, and at most 2 % more than the
    best flight.
    """
    words = ["--aircraft", PENDULUM_FILE, "--policy", law, "--initial", "angle=70"]
    flown = json.loads(hfa_command("fly", *words, "--duration", "5", "--json").out)
    compared = answer("optimize", *words)["policies"]
    (of_law,) = [row for row in compared if row["policy"] == law]
    assert 0.999 < of_law["over_best"] < 1.02
    assert of_law["cost"] == pytest.approx(flown["cost"] + flown["cost_to_go"], rel=5e-5)
    assert flown["policy"]["name"] == law
    assert abs(flown["final"]["angle"]) < 0.02  # rad, of 1.2 rad at first
    if law == "predictive":
        counts = flown["policy"]["samples"]
        assert counts["planned"] + counts["linear"] == round(5.0 / flown["policy"]["dt"])
        assert counts["first_plan"] == pytest.approx(flown["cost"], rel=0.05)


@pytest.mark.slow
def test_the_flexible_aircraft_converges_inside_its_envelope_from_the_papers_start():
    """From x(0) at 10 deg, where the exact policy leaves the envelope, the flight stays inside and
    costs at most 2 % more than the best flight that `hfa optimize` finds, 4560.
    """
    point, game = model_at(10.0).point, game_at(10.0)
    model = point.model
    start = {"speed": 5.0, "alpha": 0.05}
    weights = game.Q, game.R
    planned, exact = (
        hfa.fly(model, point, policy, 3.0, initial=start, predict=False, weights=weights)
        for policy in (predictive(model, point, *weights), hfa.solve(game))
    )
    assert planned.ok
    assert planned.cost < 1.02 * 4560.0
    places = model.state_places(model.linear)
    assert np.abs((planned.states[-1] - point.x)[places]).max() < 0.05
    assert exact.departure is not None
