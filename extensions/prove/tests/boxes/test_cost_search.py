"""Flights, linear programs and pieces of the search for a bound of the cost."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from as_proved import as_proved
from small_loops import P

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cover import OpenBoxError
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.clock import Clock
from hfa_prove.search.cost import CostBound, CostSearch, _Proved
from hfa_prove.search.cost_fit import CostProblem, Fit, TargetFlights, quadratic_piece
from hfa_prove.search.flights import Inputs, flight_costs
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import Limits, Plant
from hfa_support.errors import NoSolutionError


def plant_of(equations: Any, low: float, high: float) -> tuple[Plant, Equilibrium]:
    """Return a plant with two states and one limited input about 0."""
    model = Model("plant", {"a": Signal(), "b": Signal()}, {"u": Signal()}, equations, trim={})
    plant = Plant(model, {}, {"a": 0.0, "b": 0.0}, {"u": 0.0}, {}, {"u": (low, high)})
    at = cast(Any, SimpleNamespace(x=np.zeros(3)))
    return plant, at


def test_inputs_of_a_flight_minimize_the_hamiltonian() -> None:
    """No input within the limits has a lower p · f(z, v) + v'R v."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u + 0.2 * u.u**2 - ca.sin(x.a)}, {}

    plant, at = plant_of(equations, -0.5, 0.7)
    inputs = Inputs(plant, at, np.array([[1.5]]))
    random = np.random.default_rng(0)
    z = random.uniform(-1.0, 1.0, (60, 2))
    p = random.uniform(-4.0, 4.0, (60, 2))
    v = inputs.best(z, p)
    assert np.all((v >= -0.5) & (v <= 0.7))
    assert {-0.5, 0.7} < set(v.ravel().tolist())
    grid = np.linspace(-0.5, 0.7, 1201)
    price = p[:, 1:] * (grid + 0.2 * grid**2) + 1.5 * grid**2
    found = p[:, 1] * (v + 0.2 * v**2).ravel() + 1.5 * v.ravel() ** 2
    assert np.all(found <= price.min(axis=1) + 1e-6)
    assert np.allclose(inputs.rates(z, v)[:, 1], (v + 0.2 * v**2).ravel() - np.sin(z[:, 0]))
    assert np.allclose(inputs.linear(), [[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])


def test_flights_of_a_linear_plant_cost_the_quadratic_value() -> None:
    """Without active limits, the flights of the LQR cost z'P z. A flight that leaves costs inf."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u}, {}

    plant, at = plant_of(equations, -np.inf, np.inf)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    half = math.sqrt(0.5)
    b = math.sqrt(2.0 + 2.0 * half)  # of K = [1 / r, b / r] with r² = R
    K = np.array([[1.0 / half, b / half]])
    value = np.array([[b, half], [half, b * half]])
    J = np.array([[0.0, 1.0], [-K[0, 0], -K[0, 1]]])
    assert np.allclose(J.T @ value + value @ J + Q + K.T @ R @ K, 0.0)
    z = np.array([[1.0, 0.0], [0.0, 1.0], [-0.5, 1.5], [3.0, 0.0]])
    costs = flight_costs(
        Inputs(plant, at, R), (Q, R, value), lambda z: 2.0 * z @ value,
        lambda z: np.abs(z[:, 0]) < 2.0, z, Clock(60.0),
    )  # fmt: skip
    exact = np.einsum("ki,ij,kj->k", z, value, z)[:3]
    assert np.all((costs[:3] > exact) & (costs[:3] < 1.03 * exact))  # inputs are held in each step
    assert costs[3] == np.inf


def scalar_plant(equations: Any, limits: Limits) -> tuple[Plant, Equilibrium]:
    model = Model("scalar", {"x": Signal()}, {"u": Signal()}, equations, trim={})
    plant = Plant(model, {}, {"x": 0.0}, {"u": 0.0}, {}, limits)
    return plant, cast(Any, SimpleNamespace(x=np.zeros(2)))


@pytest.mark.parametrize("share", [0.6, 0.9])
def test_the_level_of_a_share_ends_where_its_inequality_fails(share: float) -> None:
    """x' = -x³ + u with q = r = 1 has p = 1, and W = a x² fails from the level (1 - a²) / 2."""
    plant, at = scalar_plant(lambda x, u, p, w: ({"x": u.u - x.x**3}, {}), {"x": (-3.0, 2.0)})
    one = np.eye(1)
    problem = CostProblem(plant, at, one, one, one, 4, 0.02)
    level = problem.permitted_level(share, 4.0)
    assert level == pytest.approx((1.0 - share**2) / 2.0, rel=1e-2)
    linear = CostProblem(
        *scalar_plant(lambda x, u, p, w: ({"x": u.u}, {}), {}), one, one, one, 4, 0.02
    )
    assert linear.permitted_level(share, 4.0) == np.inf
    assert problem.in_envelope(np.array([[-3.1], [-2.9], [1.9], [2.1]])).tolist() == [
        False, True, True, False,
    ]  # fmt: skip
    costs = problem.saturated_lqr_costs(np.array([[0.01], [2.5]]), Clock(60.0))
    assert costs[0] == pytest.approx(1e-4, rel=0.05)
    assert costs[1] == np.inf


def test_pieces_of_the_linear_cost_have_their_coordinates() -> None:
    """In y = M z, z'P z and the least of the inequality are diagonal, and samples fill the cube."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u - 0.5 * x.a}, {}

    plant, at = plant_of(equations, -1.0, 1.0)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    problem = CostProblem(plant, at, Q, R, P, 4, 0.02)
    z = problem.ball(300, 2.0, np.random.default_rng(0))
    assert z.shape == (300, 2)
    cost = np.einsum("ki,ij,kj->k", z, P, z)
    assert problem.linear_cost(z) == pytest.approx(cost)
    assert np.all(cost <= 2.0)
    assert np.max(cost) > 1.9
    M = problem.coordinates(0.75, z)
    N = np.linalg.inv(M)
    G = P @ np.array([[0.0], [1.0]])
    for form in (P, Q + 0.75 * G @ G.T / 0.5):
        turned = N.T @ form @ N
        assert np.allclose(turned, np.diag(np.diag(turned)), atol=1e-9)
    assert np.max(np.abs(z @ M.T)) <= 1.0 + 1e-9
    piece = quadratic_piece(problem, 0.75, 1.5)
    assert (piece.c, piece.whole) == (1.5, False)
    assert piece.W.at(z @ piece.M.T) == pytest.approx(0.75 * cost, rel=1e-6)
    inside = np.abs(z[0.75 * cost <= 1.5] @ piece.M.T)
    assert np.all(inside < 0.75)


def cost_search(saved: list[CostBound]) -> CostSearch:
    """Return the search for bounds of a double integrator, with known flights."""
    plant, at = plant_of(lambda x, u, p, w: ({"a": x.b, "b": u.u}, {}), -1.0, 1.0)
    search = CostSearch(
        plant, at, (0, 1), (np.eye(2), np.eye(1), P), np.array([2.0, 0.5]),
        degree=4, margin=0.1, clock=Clock(60.0), save=saved.append,
    )  # fmt: skip
    z = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [1.0, 1.0], [3.0, 0.0]])
    search.__dict__["_flights"] = (z, np.array([2.5, 1.0, 1.6, 4.0, np.inf]))
    return search


def test_targets_of_a_bound_are_its_poor_flights() -> None:
    """A fit considers flights up to the level that cost at least `least` and have a poor bound."""
    search = cost_search([])
    z, costs = search._flights
    assert search._good == pytest.approx(1.0 - 1.5 * 0.1)
    assert np.array_equal(search._bounds(), np.zeros(5))
    linear = np.einsum("ki,ij,kj->k", z, P, z)
    for c, least, chosen, weight in (
        (10.0, 0.0, [0, 1, 2, 3], 2.0), (10.0, 1.5, [0, 2, 3], 20.0),
        (0.9 * 2.5, 0.0, [0, 1, 2], 2.0), (0.9 * 2.499, 0.0, [1, 2], 2.0),
    ):  # fmt: skip
        found = search._target_flights(c, least)
        assert np.array_equal(found.z, z[chosen])
        assert np.array_equal(found.costs, costs[chosen])
        assert found.of_least == weight
    near = [0, 2, 3]  # costs from 0.3 c to c
    assert search._beyond(4.0) == pytest.approx(1.3 * max(1.0, np.max(linear[near] / costs[near])))
    assert search._beyond(1.0) == pytest.approx(1.3 * linear[1] / 1.0)
    assert search._beyond(0.5) == 1.3


def test_a_bound_of_the_cost_states_its_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shares of the box, medians, levels and numbers of boxes are those of the proved pieces."""
    saved: list[CostBound] = []
    search = cost_search(saved)
    W = PolynomialFunction.quadratic(0.5 * P * 25.0)
    piece = Piece(0.2 * np.eye(2), W.rounded(), 1.5)
    known = as_proved(SimpleNamespace(pieces=(piece,)), sizes=(4,))
    linear = search.problem.linear_cost(search.starts)
    assert np.all(np.abs(search.starts) <= [2.0, 0.5])
    assert np.max(np.abs(search.starts), axis=0) == pytest.approx([2.0, 0.5], rel=0.01)
    gain = np.mean(np.minimum(0.5 * linear, 1.5) / linear)
    assert search._gain(0.5, 1.5) == pytest.approx(gain / 1e-6)
    search._search = lambda: None  # type: ignore[method-assign]
    found = search.found(known)
    assert search._level == 1.5
    assert search._fitted_at(1.5)
    covered = float(np.mean(0.5 * linear < 1.5))
    assert found.covered == pytest.approx((covered,))
    assert found.over_linear == pytest.approx((0.5,))
    assert (found.boxes, found.seconds, found.stopped) == ((4,), ((0.0, 0.0),), "")
    assert (found.witness.solved, found.witness.boxes) == (("a", "b"), (8,))
    assert found.statement.equilibrium == {"a": 0.0, "b": 0.0, "u": 0.0}
    present = np.minimum(0.5 * linear, 1.5)
    raised = np.maximum(np.minimum(0.75 * linear, 2.0) - present, 0.0) / linear
    assert search._gain(0.75, 2.0) == pytest.approx(np.mean(raised) / np.mean(present / linear))
    larger = _Proved(piece._replace(c=2.0), 5, (0.25, 0.75))
    assert search._tried(2.0, lambda: larger) is None
    assert [each.boxes for each in saved] == [(4, 5)]
    assert saved[0].seconds == ((0.0, 0.0), (0.25, 0.75))

    def refuted() -> Any:
        raise OpenBoxError("too narrow", np.zeros(2))

    assert isinstance(search._tried(9.0, refuted), OpenBoxError)
    assert search._stopped == "the level 9 is not proved: too narrow"
    assert len(saved) == 1
    empty = cost_search([])
    empty._search = refuted  # type: ignore[method-assign]
    with pytest.raises(OpenBoxError):
        empty.found()
    empty._search = lambda: None  # type: ignore[method-assign]
    empty._stopped = "nothing was tried"
    monkeypatch.setattr("hfa_prove.search.cost.kink_at", lambda plant, at: "a kink")
    with pytest.raises(
        NoSolutionError, match="no lower bound was proved: nothing was tried; a kink"
    ):
        empty.found()


def test_a_fitted_bound_is_just_below_the_exact_cost() -> None:
    """Of a linear plant without active limits, W is at most z'P z and close to (1 - margin) z'P z.

    Each row is the inequality divided by the running cost, or W / c >= 1.02 far out.
    """
    plant, at = plant_of(lambda x, u, p, w: ({"a": x.b, "b": u.u}, {}), -np.inf, np.inf)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    half = math.sqrt(0.5)
    b = math.sqrt(2.0 + 2.0 * half)
    exact = np.array([[b, half], [half, b * half]])
    problem = CostProblem(plant, at, Q, R, exact, 4, 0.1)
    z = problem.ball(50, 1.0, np.random.default_rng(0))
    wanted = TargetFlights(z, 1.0 * problem.linear_cost(z), 2.0)
    programs: list[int] = []
    fit = Fit(problem, 1.5, wanted, 1.3, programs.append)
    assert fit._W(z @ fit.M.T) == pytest.approx(0.9 * problem.linear_cost(z))
    v = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 1))
    rows, sides = fit._row(z, v)
    rate = np.sum((0.9 * 2.0 * z @ exact) * np.column_stack([z[:, 1], v]), axis=1)
    running = np.einsum("ki,ij,kj->k", z, Q, z) + 0.5 * v[:, 0] ** 2
    assert rows @ fit._W.coefficients == pytest.approx(rate / running, rel=1e-6, abs=1e-6)
    assert sides == pytest.approx(-(1.0 - 0.6 * 0.1))
    best = fit._best_inputs(z)
    assert best == pytest.approx(-(0.9 * z @ exact[:, 1:]) / 0.5, rel=1e-6)
    W = fit.fitted()
    assert programs
    found = W.at(z @ fit.M.T) / problem.linear_cost(z)
    assert np.all(found <= 1.0)
    assert np.all(found > 0.87)
    count = len(fit._rows)
    inner = np.array([0.2, -0.3])
    fit.refuted(inner)
    assert len(fit._rows) == count + 1
    rows, sides = fit._rows[-1], fit._sides[-1]
    own, side = fit._row(inner[None] @ fit.N.T, fit._best_inputs(inner[None] @ fit.N.T))
    assert len(rows) == 31
    assert (rows[0], sides[0]) == (pytest.approx(own[0]), side[0])
    fit.refuted(np.array([1.0, -0.3]))
    high = fit._W.monomials(np.array([[1.0, -0.3]]))[0] / 1.5
    assert fit._rows[-1][0] == pytest.approx(high)
    assert set(fit._sides[-1].tolist()) == {1.02}
    orthonormal = fit._orthonormal
    values = fit._W.monomials(fit._ball(3000) @ fit.M.T) @ orthonormal
    assert values.T @ values / 3000 == pytest.approx(np.eye(values.shape[1]), abs=0.35)
