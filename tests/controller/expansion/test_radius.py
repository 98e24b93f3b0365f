"""The neighbourhood in which a value agrees with simulated flights of both players."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from known_models import game_at, model_at
from scipy.integrate import solve_ivp

import hfa
from controller.expansion.expansion import Expansion, expand
from controller.expansion.flights import Flights
from controller.expansion.radius import _relative, largest_errors, radii
from controller.expansion.series import directions
from hfa import BadInputError, Model, Signal


def pendulum(x, u, p, w):
    """Return a pendulum with a quadratic spring, which makes the terms of odd degree nonzero."""
    return {"a": x.b, "b": x.a + 0.8 * x.a**2 - x.a**3 / 6.0 - 0.1 * x.b + u.u}, {}


PENDULUM = Model(
    "pendulum", {"a": Signal(), "b": Signal()}, {"u": Signal()}, pendulum,
    trim={"a": 0.0, "b": 0.0},
)  # fmt: skip


@lru_cache(maxsize=8)
def expanded(degree: int, delta: float = 4.0) -> Expansion:
    linear = hfa.linearize(PENDULUM, hfa.trim(PENDULUM))
    game = hfa.game(linear, [1.0, 0.5], [2.0], delta, E=[[0.0], [1.0]])
    return expand(linear, hfa.solve(game), degree)


def states_at(expansion: Expansion, size: float, count: int, seed: int) -> np.ndarray:
    """Return states with z'Pz = size², (count, n)."""
    y = size * directions(expansion.states, count, seed)
    return np.linalg.solve(expansion.root.T, y.T).T


@pytest.mark.slow
@pytest.mark.parametrize("delta", [math.inf, 4.0])
def test_cost_of_a_flight_is_that_of_an_adaptive_integrator(delta: float) -> None:
    expansion = expanded(4, delta)
    game = expansion.game
    z0 = states_at(expansion, 0.5, 3, 1)

    def rates(t: float, w: np.ndarray) -> np.ndarray:
        z = w[:2]
        u = float(expansion.policy(z))
        d = np.zeros(1)
        paid = 0.0
        if math.isfinite(delta):
            d = np.array(expansion.disturbance(z))[:, 0]
            paid = delta**2 * d @ d
        moved, _ = pendulum(SimpleNamespace(a=z[0], b=z[1]), SimpleNamespace(u=u), None, None)
        disturbed = np.array([moved["a"], moved["b"]]) + game.E @ d
        return np.array([*disturbed, z @ game.Q @ z + u * game.R[0, 0] * u - paid])

    exact = [solve_ivp(rates, (0.0, 60.0), [*z, 0.0], rtol=1e-10, atol=1e-12).y[2, -1] for z in z0]
    flights = Flights(expansion)
    assert flights.costs(z0) == pytest.approx(exact, rel=2e-4)
    flights.step /= 4.0
    assert flights.costs(z0) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_relative_error_falls_with_the_power_of_the_degree(degree: int) -> None:
    """The error of V2 + ... + V_{d-1} falls by 2^(d-2) if the state is halved."""
    reference = expanded(5)
    flights = Flights(reference)
    loop = np.linalg.eigvals(reference.game.worst_case_loop(reference.solution.P))
    assert flights.step == pytest.approx(0.2 / np.abs(loop).max())
    assert flights.longest == pytest.approx(6.0 / np.abs(loop.real).min())
    flights.step /= 20.0
    error = []
    for size in (0.1, 0.05):
        z0 = states_at(reference, size, 20, 2)
        value = np.array(reference.value_to(degree - 1)(z0.T))[0]
        error.append(np.abs(value / flights.costs(z0) - 1.0).max())
    assert error[0] / error[1] == pytest.approx(2.0 ** (degree - 2), rel=0.15)


def test_flights_inside_the_radius_agree_and_some_outside_do_not() -> None:
    expansion = expanded(4)
    flights = Flights(expansion)
    for radius in expansion.radii:
        random = np.random.default_rng(99).uniform(size=(200, 1)) ** 0.5
        inside = random * states_at(expansion, math.sqrt(radius.c), 200, 99)
        outside = states_at(expansion, 1.3 * math.sqrt(radius.c), 200, 99)
        errors = []
        for z0 in (inside, outside):
            value = np.array(expansion.value_to(radius.degree)(z0.T))[0]
            errors.append(np.abs(value / flights.costs(z0) - 1.0).max())
        assert errors[0] <= 0.05 < errors[1]


@pytest.mark.slow
@pytest.mark.parametrize("degree", [3, 4, 5])
@pytest.mark.parametrize("degrees", [5.0, 15.0])
def test_other_flights_of_the_flexible_aircraft_agree(degrees: float, degree: int) -> None:
    """200 flights from the boundary of the set that the search did not fly agree, and so do 200
    from inside it.
    """
    expansion = expand(model_at(degrees), hfa.solve(game_at(degrees)), degree)
    flights = Flights(expansion)
    for radius in expansion.radii:
        boundary = states_at(expansion, math.sqrt(radius.c), 200, 99)
        random = np.random.default_rng(99).uniform(size=(200, 1)) ** (1.0 / expansion.states)
        z0 = np.vstack([boundary, random * boundary[::-1]])
        value = np.array(expansion.value_to(radius.degree)(z0.T))[0]
        assert np.abs(value / flights.costs(z0) - 1.0).max() < radius.share


@pytest.mark.slow
@pytest.mark.parametrize("delta", ["1.05 delta_min", 200.0, math.inf])
def test_relative_error_of_the_flexible_aircraft_falls(delta: float | str) -> None:
    """The relative error of V2 + ... + Vd falls by 2^(d-1) within 15 % if the state is halved.

    It is compared at the smallest state whose error is above 100 times that of the simulation, in
    the direction of the paper's initial condition and in four random ones.
    """
    solution = hfa.solve(game_at(15.0))
    size = 1.05 * solution.delta_min if isinstance(delta, str) else delta
    reference = expand(model_at(15.0), hfa.solve(solution.game.with_delta(size)), 5)
    paper = reference.root.T @ np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    random = np.random.default_rng(0).standard_normal((4, 6))
    rays = np.vstack([paper, random])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    sizes = 0.08 * 0.5 ** np.arange(9)
    y = sizes[:, None, None] * rays
    z0 = np.linalg.solve(reference.root.T, y.reshape(-1, 6).T)
    flights = Flights(reference)
    step = flights.step
    costs = []
    for finer in (12.0, 24.0):
        flights.step = step / finer
        costs.append(flights.costs(z0.T).reshape(y.shape[:2]))
    coarse, fine = costs
    # An error of fourth order falls to a fifteenth of the difference.
    simulation = np.abs(coarse / fine - 1.0) / 15.0
    for degree in (2, 3, 4):
        value = np.array(reference.value_to(degree)(z0)).reshape(y.shape[:2])
        error = np.abs(value / fine - 1.0)
        for ray in range(len(rays)):
            seen = np.flatnonzero(error[:, ray] > 100.0 * simulation[:, ray])
            last = int(seen[-1])
            ratio = error[last - 1, ray] / error[last, ray]
            assert last > 0
            assert ratio == pytest.approx(2.0 ** (degree - 1), rel=0.15)


def test_radius_grows_with_the_degree_and_the_share() -> None:
    quadratic, whole = expanded(4).radii
    assert (quadratic.degree, whole.degree) == (2, 4)
    assert quadratic.c < whole.c
    tighter, _ = radii(replace(expanded(4), share=0.01))
    assert tighter.c < quadratic.c
    # Degree 2: the error is of first order in the state, and c of second order.
    assert quadratic.c / tighter.c == pytest.approx(25.0, rel=0.5)


def test_errors_of_the_figure_are_those_of_the_radius() -> None:
    """At the radius of a value its error is at most the share, and above it at a larger size."""
    expansion = expanded(4)
    sizes = np.sqrt([radius.c for radius in expansion.radii])
    errors = largest_errors(expansion, np.array([*sizes, *(1.3 * sizes)]))
    assert errors.shape == (3, 4)
    assert errors[0, 0] <= expansion.share < errors[0, 2]
    assert errors[2, 1] <= expansion.share < errors[2, 3]
    assert np.all(np.diff(errors[:, 0]) < 0.0)
    z0 = states_at(expansion, 0.5, 3, 1)
    costs = Flights(expansion).costs(z0)
    off = _relative(np.array([1.5, 0.5, 1.0]) * costs, costs * [1.0, 1.0, 0.0])
    assert off == pytest.approx([0.5, 0.5, math.inf])
    report = expansion.report()
    assert " has 12 coefficients," in report.title
    assert "within 5 %\n" in str(report.parts[0])
    _, *extents = report.parts[1].rows
    for shown, radius in zip(report.parts[1].rows[0][2:], expansion.radii, strict=True):
        assert float(shown) == pytest.approx(radius.c, rel=1e-2)
    for index, row in enumerate(extents):
        expected = [radius.extents[index] for radius in expansion.radii]
        assert [float(each) for each in row[2:]] == pytest.approx(expected, rel=1e-2)


@pytest.mark.slow
def test_the_figure_has_a_curve_for_each_degree() -> None:
    axes = expanded(5).figure().axes[0]
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["V2", "V2 + V3", "V2 + ... + V4", "V2 + ... + V5"]


def test_extents_are_those_of_the_ellipsoid() -> None:
    radius = expanded(3).radii[-1]
    P = expanded(3).solution.P
    assert radius.extents == pytest.approx(np.sqrt(radius.c * np.diag(np.linalg.inv(P))))


def test_linear_plant_agrees_everywhere() -> None:
    linear = hfa.LinearModel.of([[0.0, 1.0], [-1.0, 0.3]], [[0.0], [1.0]])
    solution = hfa.solve(hfa.game(linear, [1.0, 1.0], [2.0], delta=5.0))
    assert [radius.c for radius in expand(linear, solution, 3).radii] == [math.inf, math.inf]


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1])
def test_other_shares_are_refused(share: float) -> None:
    exact = expanded(2)
    linear = hfa.linearize(PENDULUM, hfa.trim(PENDULUM))
    with pytest.raises(BadInputError, match="share"):
        expand(linear, exact.solution, 2, share)
