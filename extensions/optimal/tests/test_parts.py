"""Prices, gains, horizons, bounds and summaries of searched flights, computed by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_lyapunov

import hfa
from hfa_flight.envelope import Departure
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import Measurements
from hfa_flight.problem import flight_problem
from hfa_optimal.best_flight import PolicyFlight
from hfa_optimal.bracket import Bracket, bracket_of, bracket_sentence, bracket_table
from hfa_optimal.collocation import Proposal, collocation_points
from hfa_optimal.flights import Flights
from hfa_optimal.initial_conditions import StartFlights, StartsTable
from hfa_optimal.search import BestFlights, _distinct, difference_of_meshes, sampled
from hfa_optimal.smooth import smoothed
from hfa_optimal.tracking import exponentials, tracking_gains, tracking_rows

A = np.array([[0.0, 1.0], [-2.0, -0.3]])
B = np.array([[0.0, 0.5], [3.0, 0.0]])
CART = hfa.Model(
    "cart",
    {"position": hfa.Signal("m", min=-20.0, max=30.0), "velocity": hfa.Signal("m/s", nominal=4.0)},
    {"force": hfa.Signal("N", min=-2.0, max=5.0), "winch": hfa.Signal("m/s", nominal=0.5)},
    lambda x, u, p, w: (
        {
            "position": x.velocity + 0.5 * (u.winch - 1.0),
            "velocity": -2.0 * (x.position - 10.0) - 0.3 * x.velocity + 3.0 * (u.force - 1.0),
        },
        {},
    ),
    trim={"position": 10.0, "velocity": 0.0, "force": 1.0},
)
POINT = hfa.trim(CART)
PROBLEM = flight_problem(CART, POINT, np.diag([2.0, 0.5]), np.diag([1.0, 4.0]))
MODEL = hfa.linearize(CART, POINT)


def test_the_problem_is_the_linear_one() -> None:
    np.testing.assert_allclose(MODEL.A, A, atol=1e-12)
    np.testing.assert_allclose(MODEL.B, B, atol=1e-12)


def test_a_flight_costs_its_integral_and_the_linear_tail() -> None:
    """Saturated inputs are near a limit; a large tail does not converge and costs inf."""
    t = np.linspace(0.0, 2.0, 21)
    z = np.exp(-2.5 * t)[:, None] * [3.0, -1.0]
    v = np.column_stack([np.linspace(-2.9995, 3.0, 21), 0.1 * np.ones(21)])
    rows = Deviations(t, z, z, v, z[:, :0], z, {}, 7.0 * t)
    law = SimpleNamespace(name="law")
    flown = Flights(PROBLEM).priced(law, rows)
    tail = z[-1] @ PROBLEM.P @ z[-1]
    assert (flown.tail, flown.cost) == (pytest.approx(tail), pytest.approx(14.0 + tail))
    assert (flown.converges, flown.lost, flown.departure) == (True, False, None)
    assert flown.saturated == ("force",)
    np.testing.assert_allclose(flown.states[0], [13.0, -1.0])
    np.testing.assert_allclose(flown.inputs[0], [-1.9995, 1.1])
    assert flown.ending == "converges"
    inside = replace(rows, inputs=0.9 * v)
    assert Flights(PROBLEM).priced(law, inside).saturated == ()
    far = replace(rows, states=z[::-1] + np.array([18.0, 0.0]))
    lost = Flights(PROBLEM).priced(law, far)
    assert math.isinf(lost.cost)
    assert (lost.departure.state, lost.departure.limit) == ("position", 30.0)
    assert lost.ending == "leaves the envelope, does not converge"
    assert PolicyFlight.of(lost, 2.0).over_best is None
    record = PolicyFlight.of(flown, 2.0)
    assert (record.over_best, record.lost) == (pytest.approx(flown.cost / 2.0), False)


def test_flights_have_the_cost_of_their_policies() -> None:
    """Of a gain, z'Xz by SciPy's Lyapunov solution; inputs that do not move cost nothing."""
    problem = flight_problem(CART, POINT, np.diag([2.0, 0.5]), np.diag([1.0]), inputs=["force"])
    K = 0.5 * problem.K
    flights = Flights(problem)
    start = np.array([0.5, 0.2])
    flown = flights.fly(flights.of_gain("half", K), start, 60.0)
    closed = A - B[:, :1] @ K
    X = solve_continuous_lyapunov(closed.T, -(problem.Q + K.T @ problem.R @ K))
    assert flown.cost == pytest.approx(start @ X @ start, rel=1e-6)
    assert flown.integration is not None
    assert flown.integration.is_resolved


def test_the_step_resolves_the_fastest_mode() -> None:
    """A tenth of the time constant of the fastest mode of aircraft and loop, at most 5 ms."""
    fastest = max(np.abs(np.linalg.eigvals(each)).max() for each in (A, A - B @ PROBLEM.K))
    flights = Flights(PROBLEM, longest_step=1.0)
    assert flights.step == pytest.approx(0.1 / fastest, rel=1e-6)
    assert flights.tick == 8 * flights.step
    scenario = flights.scenario(2.5 * flights.tick)
    assert (scenario.ticks, scenario.tick) == (3, flights.tick)
    assert Flights(PROBLEM).step == 0.005


def proposal_of(lengths: list[float], seed: int = 0) -> Proposal:
    rng = np.random.default_rng(seed)
    count = len(lengths)
    z, v = rng.normal(size=(count, 2, 2)), rng.normal(size=(count + 1, 2))
    return Proposal(np.array(lengths), rng.normal(size=2), z, v, 1.0, 0.0, True)


def test_gains_along_a_proposal_solve_the_riccati_equation() -> None:
    """With another final cost, -P' = A'P + P A - P S P + Q backwards from the end."""
    final = np.array([[9.0, 1.0], [1.0, 4.0]])
    problem = replace(PROBLEM, P=final)
    proposal = proposal_of([0.3, 0.2, 0.5])
    S = B @ np.linalg.solve(problem.R, B.T)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        P = y.reshape(2, 2)
        return (A.T @ P + P @ A - P @ S @ P + problem.Q).ravel()

    found = tracking_gains(problem, proposal)
    for gain, left in zip(found, (1.0, 0.7, 0.5), strict=True):
        P = solve_ivp(rate, (0.0, left), final.ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(
            gain, np.linalg.solve(problem.R, B.T @ P.reshape(2, 2)), rtol=1e-6
        )
    for gain in tracking_gains(PROBLEM, proposal):
        np.testing.assert_allclose(gain, PROBLEM.K, rtol=1e-6)


def test_a_tracked_proposal_is_interpolated_and_limited() -> None:
    """v = v* - K (z - z*) within the limits, with z* and v* of the proposal; then -K z."""
    flights = Flights(PROBLEM)
    proposal = proposal_of([0.1, 0.13])
    policy = flights._tracking.loop.policy
    rows = tracking_rows(PROBLEM, proposal, flights.tick)
    gains = tracking_gains(PROBLEM, proposal)
    t, z = ca.SX.sym("t"), ca.SX.sym("z", 2)
    held = ca.SX.sym("held", rows.shape[1])
    none = ca.SX(0, 1)
    control = ca.Function(
        "u", [t, z, held], [policy.control(t, Measurements(z, z, none, none), none, held)]
    )
    lowest, highest = PROBLEM.input_limits
    at = np.array([0.3, -0.2])
    for time in (0.0, 0.02, 0.055, 0.101, 0.19):
        tick = int(time / flights.tick + 1e-9)
        step = flights.tick / 8
        before = step * math.floor(time / step + 1e-9)
        (ends, inputs) = proposal.at(np.array([before, before + step]))
        share = (time - before) / step
        wanted = ends[0] + share * (ends[1] - ends[0])
        K = gains[0 if tick * flights.tick < 0.1 - 1e-9 else 1]
        v = inputs[0] + share * (inputs[1] - inputs[0]) - K @ (at - wanted)
        found = np.array(control(time, at, rows[tick])).ravel()
        np.testing.assert_allclose(found, np.clip(v, lowest, highest), rtol=1e-6, err_msg=str(time))
    after = np.array(control(99.0, at, rows[-1])).ravel()
    np.testing.assert_allclose(after, np.clip(-PROBLEM.K @ at, lowest, highest), rtol=1e-9)


def test_exponentials_are_those_of_scipy() -> None:
    matrices = np.random.default_rng(2).normal(size=(5, 4, 4)) * [
        [[0.1]],
        [[1.0]],
        [[3.0]],
        [[9.0]],
        [[0.0]],
    ]
    for found, matrix in zip(exponentials(matrices), matrices, strict=True):
        np.testing.assert_allclose(found, expm(matrix), rtol=1e-8, atol=1e-9)


def test_a_proposal_is_a_parabola_in_each_interval() -> None:
    """Through the start and two Radau points; inputs are linear; after the end all is 0."""
    points = collocation_points()
    np.testing.assert_allclose(points, [0.0, 1.0 / 3.0, 1.0])
    lengths = np.array([0.5, 1.5])
    ends = np.array([0.0, 0.5, 2.0])
    parabola = lambda t: np.column_stack([1.0 + t - 2.0 * t**2, 3.0 - t])  # noqa: E731
    times = (ends[:-1, None] + lengths[:, None] * points[1:]).ravel()
    proposal = Proposal(
        lengths, parabola(np.zeros(1))[0], parabola(times).reshape(2, 2, 2), np.outer([1.0, 2.0, 8.0], [1.0, -1.0]), 1.0, 0.0, True
    )  # fmt: skip
    np.testing.assert_allclose(proposal.ends, ends)
    t = np.array([0.0, 0.3, 0.5, 1.0, 2.0, 2.1])
    z, v = proposal.at(t)
    np.testing.assert_allclose(z[:-1], parabola(t[:-1]), atol=1e-12)
    np.testing.assert_allclose(v[:, 0], [1.0, 1.6, 2.0, 4.0, 8.0, 0.0])
    assert not z[-1].any()
    guess = sampled(proposal.at, lengths)
    np.testing.assert_allclose(guess[0], parabola(times), atol=1e-12)
    np.testing.assert_allclose(guess[1], proposal.v)


def test_the_horizon_leaves_a_negligible_linear_cost() -> None:
    """The first quarter of the slowest time constant after which 3e-4 of the cost is left."""
    search = BestFlights(PROBLEM)
    loop = A - B @ PROBLEM.K
    step = 0.25 / -np.linalg.eigvals(loop).real.max()
    for start in (np.array([1.0, 0.0]), np.array([0.2, -3.0])):
        shares = []
        for count in range(60):
            z = expm(loop * step * count) @ start
            shares.append(z @ PROBLEM.P @ z / (start @ PROBLEM.P @ start))
        first = int(np.argmax(np.array(shares) <= 3e-4))
        assert search.horizon(start) == pytest.approx(1.2 * min(first, 40) * step)


def test_alternating_inputs_and_distinct_optima_are_recognized() -> None:
    """Six passes from one half to the other, and costs more than .2 % apart, at most two."""
    search = BestFlights(PROBLEM)
    for passes, size, named in ((7, 0.6, True), (6, 0.6, True), (5, 0.6, False), (7, 0.4, False)):
        v = np.zeros((12, 2))
        sides = np.array([(-1.0) ** n for n in range(passes + 1)] + [0.0] * (11 - passes))
        v[:, 0] = size * np.where(sides > 0, 4.0, 3.0) * sides
        text = search._alternating(proposal_of([1.0] * 11)._replace(v=v))
        assert ("force alternates" in text) == named, (passes, size)
    costs = {"a": 1.0, "b": 1.001, "c": 1.5, "d": 1.003}
    proposals = {name: proposal_of([1.0])._replace(cost=cost) for name, cost in costs.items()}
    assert _distinct(proposals) == ["a", "d"]
    assert difference_of_meshes({10: 5.0, 20: 2.0, 40: 2.1}) == pytest.approx(0.05)
    assert difference_of_meshes({20: 2.1, 40: 2.0}) == pytest.approx(0.05)


def test_bounds_bracket_the_least_cost() -> None:
    """A bound at the level of the certified set, or without a positive value, is set apart."""
    statement = SimpleNamespace(level=8.0, bound=lambda z: np.minimum(2.0 * z[:, 0], 8.0))
    inside, beyond, none = (
        bracket_of(statement, np.array([size, 0.0]), {"position": size, "velocity": 0.0}, cost)
        for size, cost in ((1.0, 3.0), (4.0, 10.0), (0.0, 1.0))
    )
    assert (inside.lower_bound, inside.beyond, beyond.lower_bound, beyond.beyond) == (
        2.0,
        False,
        8.0,
        True,
    )
    cases: list[tuple[list[tuple[Bracket, Any]], str]] = [
        ([(inside, 3.0), (inside, 5.0), (none, 1.0), (beyond, 10.0)],
         "between 1.00 and 2.50 of the best possible, 1 beyond the level"),
        ([(inside, 3.0)], "between 1.00 and 1.50 of the best possible"),
        ([(beyond, 10.0), (inside, None)], "beyond the level of the bound"),
        ([(none, 1.0), (inside, None)], "no flight with a positive lower bound ends at the trim"),
    ]  # fmt: skip
    for costs, words in cases:
        assert bracket_sentence(costs) == words
    table = bracket_table(CART, [inside, beyond])
    assert [row[1:] for row in table.rows] == [("2", "3"), ("8 (level)", "10")]
    assert table.rows[0][0] == "position +1 m, velocity +0 m/s"


def flown_by(name: str, cost: float | None, best: float | None, left: bool = False) -> PolicyFlight:
    departure = Departure("position", 1.0, 31.0, 30.0, "m") if left else None
    over = None if cost is None or best is None else cost / best
    return PolicyFlight(name, cost is not None, cost, over, departure, [])


def test_flights_from_many_initial_conditions_are_summarized() -> None:
    """Counts, and quantiles of the cost ratios of the flights that converge."""
    rows = [
        (2.0, None, [flown_by("lqr", 2.2, 2.0), flown_by("net", 6.0, 2.0, left=True)], 1.6),
        (1.0, "a reason", [flown_by("lqr", 1.3, 1.0), flown_by("net", None, 1.0)], 0.0),
        (None, "another", [flown_by("lqr", 9.0, None), flown_by("net", None, None)], 1.0),
    ]
    flights = tuple(
        StartFlights({"position": 1.0, "velocity": 0.0}, cost, reason, 0.001, 1.5, policies,
                     Bracket({"position": 1.0}, lower, cost, None))
        for cost, reason, policies, lower in rows
    )  # fmt: skip
    table = StartsTable(PROBLEM, flights, 4)
    assert (table.starts, table.found, table.refused, table.upper_bounds) == (3, 2, 1, 1)
    lqr, net = table.policies
    assert (lqr.lost, lqr.left, lqr.converged) == (0, 0, 2)
    assert (net.lost, net.left, net.converged) == (2, 1, 1)
    assert (lqr.median, lqr.high, lqr.worst) == pytest.approx((1.2, 1.28, 1.3))
    assert (net.median, net.high, net.worst) == pytest.approx((3.0, 3.0, 3.0))
    assert table.over_bound == pytest.approx([1.25])
    text = " ".join(table.report().text().split())
    assert text.startswith("Best flights: 2 of 3 found (interrupted; 4 requested)")
    records = table.report().records
    assert records.header[-1] == "lower_bound"
    assert records.rows[0] == (1.0, 0.0, 2.0, 1.5, 2.2, 6.0, 1.6)


def test_the_smooth_absolute_value_has_two_continuous_derivatives() -> None:
    """At the kink it is 3/8 of the half-width; its curvature is 0 at the ends of the blend."""
    points = np.linspace(-1.0, 1.0, 401)[:, None]
    width = 0.1 * points.std()
    x = ca.SX.sym("x")
    copy = smoothed(ca.Function("f", [x], [ca.fabs(x)]), points, 0.1)
    curvature = ca.Function("c", [x], [ca.hessian(copy(x), x)[0]])
    assert float(copy(0.0)) == pytest.approx(0.375 * width)
    for side in (-1.0, 1.0):
        assert float(copy(side * width)) == pytest.approx(width)
        assert abs(float(curvature(side * width * (1.0 - 1e-9)))) < 1e-6 / width
    assert float(curvature(0.0)) == pytest.approx(1.5 / width)
    step = smoothed(ca.Function("s", [x], [ca.if_else(x > 0.0, 3.0, 1.0)]), points, 0.1)
    t = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    blend = 0.5 + t * (15.0 - 10.0 * t**2 + 3.0 * t**4) / 16.0
    found = [float(step(each * width)) for each in t]
    assert found == pytest.approx((1.0 + 2.0 * blend).tolist())
