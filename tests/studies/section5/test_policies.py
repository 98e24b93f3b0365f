"""Policies of Section 5: the published update law in flight, and the optimal feedforward."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from game_samples import INITIAL, game_models
from linear_flight import LinearFlight, simulate
from scipy.integrate import quad
from simulated_cases import measurements_of

from controller import random_pool
from hfa import BadInputError, Game, solve
from hfa.paper import published_game
from hfa_flight.signals import zero
from hfa_model import published_models
from studies.section5.configuration import PaperFlight
from studies.section5.critic_policy import CriticPolicy, forcing
from studies.section5.feedforward import Exosystem, exosystem, exosystem_feedforward
from studies.update_law.published_law import (
    PublishedLaw,
    PublishedSettings,
    Sample,
    bellman,
    normaliser,
    published_law,
    update_direction,
)

REFERENCE = PaperFlight.REFERENCE
PAPER = exosystem(
    REFERENCE.constant,
    REFERENCE.slope,
    *((wave.frequency, wave.sine, wave.cosine) for wave in REFERENCE.harmonics),
)


def law_with(index: int = 0, **changes: Any) -> PublishedLaw:
    model = published_models()[index]
    game = published_game(model.A, model.B)
    chosen = PublishedSettings(**{"gains": (3.0, 5.0), "samples": 30} | changes)
    return published_law(
        game, chosen, 0, random_pool(game, 200, 0, np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1]))
    )


def expected(
    law: PublishedLaw, r: np.ndarray, z: np.ndarray, W: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return u and W' of Eq. (46), computed by `studies.update_law` for the drift F = A z + r.

    r: forcing by the reference, (6,)
    z: tracking error, (6,)
    W: weights, (M,)
    """
    e = law.equations
    s = law.settings
    y = (z / e.scales)[None, :]
    gradient = law.basis.gradient(y)
    drift = ((law.game.A @ z + r) / e.scales)[None, :]
    cost = np.einsum("ji,ji->j", y @ e.Q, y)
    sigma, residual = bellman(gradient, drift, cost, law.S, W, W)
    n = normaliser(sigma, s.normalisation)
    stored = law.recorded(W)
    everything = Sample(
        np.vstack([sigma / n[:, None], stored.regressors]),
        np.concatenate([residual / n, stored.residuals]),
    )
    u = -0.5 * law.game.R_inverse_B_transposed @ ((gradient[0].T @ W) / e.scales)
    return u, update_direction(everything, s.gamma, *law.gains, s.eta)


def input_and_rate(
    policy: CriticPolicy, t: float, z: np.ndarray, W: np.ndarray, p: float
) -> tuple[np.ndarray, np.ndarray]:
    symbols = [
        ca.SX.sym("t"),
        ca.SX.sym("z", 6),
        ca.SX.sym("W", policy.law.basis.size),
        ca.SX.sym("p", 1),
    ]
    now, z_, memory, constants = symbols
    told = now, measurements_of(z_), memory, constants
    u_ = policy.control(*told)
    function = ca.Function("critic", symbols, [u_, policy.memory_rate(*told, u_)])
    u, rate = function(t, z, W, p)
    return np.array(u).ravel(), np.array(rate).ravel()


@pytest.mark.parametrize(
    ("normalisation", "coordinates", "basis", "told"),
    [
        ("root", "raw", "paper", True),
        ("squared", "scaled", "quadratic+linear", True),
        ("root", "scaled", "paper", False),
        ("squared", "raw", "quadratic+linear", False),
    ],
)
def test_the_right_sides_are_equal(
    normalisation: str, coordinates: str, basis: str, told: bool
) -> None:
    """Input and weight rate of the policy that learns in flight equal an independent computation.

    All interpretations of the paper are tested.
    """
    law = law_with(normalisation=normalisation, coordinates=coordinates, basis=basis)
    r = forcing(law.game.A, REFERENCE) if told else zero(6)
    policy = CriticPolicy("critic", law, r)
    rng = np.random.default_rng(1)
    for _ in range(5):
        t = rng.uniform(0.0, 20.0)
        z = rng.normal(size=6) * np.array([2.0, 0.1, 0.1, 0.5, 0.5, 0.5])
        W = law.equations.scaled(rng.normal(size=law.basis.size) * 100.0)
        u, rate = input_and_rate(policy, t, z, W, 1.0)
        u_expected, rate_expected = expected(law, r.at(t), z, W)
        np.testing.assert_allclose(u, u_expected, rtol=1e-12, atol=1e-12 * np.abs(u_expected).max())
        np.testing.assert_allclose(
            rate, rate_expected, rtol=1e-10, atol=1e-12 * np.abs(rate_expected).max()
        )


def test_another_law_is_detected() -> None:
    """The comparison of weight rates detects another exponent η and a missing reference."""
    law = law_with()
    z = np.array([1.0, 0.1, 0.0, 0.1, 0.2, 0.0])
    W = np.linspace(-50.0, 100.0, law.basis.size)
    _, rate = input_and_rate(CriticPolicy("critic", law, zero(6)), 0.0, z, W, 1.0)
    told = forcing(law.game.A, REFERENCE)
    others = [
        input_and_rate(CriticPolicy("critic", law, told), 0.0, z, W, 1.0)[1],
        expected(replace(law, settings=replace(law.settings, eta=0.7)), np.zeros(6), z, W)[1],
    ]
    for other in others:
        assert (
            np.abs(other - rate).max() > 1e-6 * np.abs(rate).max()
        )  # the agreement in the test above is 1e-12


def test_forcing_is_the_rate_that_a_reference_adds() -> None:
    """The forcing equals A x_d - x_d', with x_d' by finite differences."""
    A = published_models()[0].A
    r = forcing(A, REFERENCE)
    for t in (0.0, 1.3, 17.0):
        h = 1e-5
        slope = (REFERENCE.at(t + h) - REFERENCE.at(t - h)) / (2 * h)
        np.testing.assert_allclose(r.at(t), A @ REFERENCE.at(t) - slope, atol=1e-8)


# The exact feedforward.


def test_feedforward_satisfies_its_differential_equation(game: Game) -> None:
    """The feedforward s(t) satisfies its differential equation, with derivatives by central
    differences.
    """
    P = solve(game).P
    P_s = exosystem_feedforward(game, P, PAPER)
    loop = game.A - game.S @ P
    step = 1e-3
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12e-3
    for t in (0.0, 3.0, 17.0):
        around = [t + k * step for k in (-2, -1, 1, 2)]
        r = game.A @ REFERENCE.at(t) - weights @ np.array([REFERENCE.at(each) for each in around])
        rate = weights @ np.array([P_s @ PAPER.state(each) for each in around])
        assert (
            np.abs(rate + loop.T @ P_s @ PAPER.state(t) + P @ r).max() < 1e-9 * np.abs(P @ r).max()
        )


def test_a_constant_reference_gives_constant_feedforward(game: Game) -> None:
    """A constant reference has a constant feedforward. A free motion of the plant as reference
    has none.
    """
    P = solve(game).P
    level = np.array([7.0, 0.1, 0.0, 0.0, 0.5, 0.0])
    P_s = exosystem_feedforward(game, P, exosystem(level, np.zeros(6)))
    exact = -np.linalg.solve((game.A - game.S @ P).T, P @ game.A @ level)
    np.testing.assert_allclose(P_s[:, 0], exact, rtol=1e-10)
    assert np.abs(P_s[:, 1:]).max() < 1e-9 * np.abs(exact).max()
    free = Exosystem(np.array(game.A), np.eye(6), INITIAL)  # x_d' = A x_d: r = 0
    assert not exosystem_feedforward(game, P, free).any()


def test_references_without_a_bounded_response_are_refused(game: Game) -> None:
    """A reference that grows faster than the closed loop decays is refused, as is a wrong P."""
    P = solve(game).P
    exploding = Exosystem(np.array([[0.3]]), np.ones((6, 1)), np.ones(1))
    with pytest.raises(
        BadInputError, match=r"the reference grows at 0.3 rad/s, the closed loop decays at 0.2"
    ):
        exosystem_feedforward(game, P, exploding)
    with pytest.raises(BadInputError, match="give the stabilizing P of the game"):
        exosystem_feedforward(game, -P, PAPER)


class _Tracking:
    """The game of tracking the paper's reference, with simulations of several policies."""

    def __init__(self, game: Game) -> None:
        self.game, self.P = game, solve(game).P
        self.P_s, self.G = exosystem_feedforward(game, self.P, PAPER), PAPER.forcing(game.A)

    def w(self, t: float) -> np.ndarray:
        return np.array([1.0, t, math.sin(0.5 * t), math.cos(0.5 * t)])

    def s(self, t: float) -> np.ndarray:
        return self.P_s @ self.w(t)

    def fly(
        self,
        end: float,
        push: Callable[[float], np.ndarray] = lambda t: np.zeros(5),
        gust: Callable[[float], np.ndarray] = lambda t: np.zeros(6),
        feedforward: float = 1.0,
    ) -> LinearFlight:
        game = self.game
        return simulate(
            game,
            lambda t, z: (
                -game.R_inverse_B_transposed @ (self.P @ z + feedforward * self.s(t)) + push(t)
            ),
            lambda t, z: game.E.T @ (self.P @ z + self.s(t)) / game.delta**2 + gust(t),
            INITIAL - REFERENCE.at(0.0),
            np.array([0.0, end]),
            lambda t: self.G @ self.w(t),
        )

    def total(self, flight: LinearFlight) -> float:
        """Return the cost of a flight plus the value of its final state, without c(T).

        c(T) does not depend on the policies.
        """
        z = flight.states[-1]
        return float(flight.cost[-1] + z @ self.P @ z + 2.0 * self.s(flight.times[-1]) @ z)


def test_costs_of_exact_policies_equal_the_value(game: Game) -> None:
    """The exact policies have the cost J(0, T) = V(z(0), 0) - V(z(T), T).

    c(0) - c(T) is ∫ 2 s'r - s'S s dt. A feedforward that is 1 % larger costs more.
    """
    tracking = _Tracking(game)
    end = 8.0
    flight = tracking.fly(end)
    z = flight.states[0]

    def rate(t: float) -> float:
        s = tracking.s(t)
        return float(2.0 * s @ tracking.G @ tracking.w(t) - s @ game.S @ s)

    constant, _ = quad(rate, 0.0, end, epsrel=1e-12, limit=200)
    value = z @ tracking.P @ z + 2.0 * tracking.s(0.0) @ z + constant
    assert tracking.total(flight) == pytest.approx(value, rel=1e-9)
    assert tracking.total(tracking.fly(end, feedforward=1.01)) > tracking.total(flight) + 1e-3


def test_deviations_change_the_cost_to_second_order() -> None:
    """A deviation from the exact policies changes the cost to second order.

    The input u + ε v increases the cost by ε² ∫ v'R v. The disturbance d + ε g changes the cost by
    -ε² δ² ∫ g'g.
    """
    game = game_models()[min(game_models())]
    tracking = _Tracking(game)
    rng = np.random.default_rng(0)
    end = 6.0
    v = rng.standard_normal(5)
    g = rng.standard_normal(6)
    best = tracking.total(tracking.fly(end))
    pulse = end * 3.0 / 8.0  # ∫ sin⁴(π t/end) dt
    costs = (("push", v, float(v @ game.R @ v)), ("gust", g, -(game.delta**2) * float(g @ g)))
    for name, way, exact in costs:
        found = [
            tracking.total(
                tracking.fly(
                    end, **{name: lambda t, e=e, d=way: e * math.sin(math.pi * t / end) ** 2 * d}
                )
            )
            - best
            for e in (1.0, 0.1)
        ]
        assert found[0] == pytest.approx(exact * pulse, rel=1e-5)
        assert math.log10(found[0] / found[1]) == pytest.approx(2.0, abs=0.01)
