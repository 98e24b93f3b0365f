"""Exact feedforward of a game for a reference."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("hfa_flight")

from typing import Any

from game_samples import INITIAL, game_models
from linear_flight import LinearFlight, simulate

from hfa import Game, LinearModel, solve, track

#: Constant, ramp and two sinusoids in several states.
COMMAND = {
    "x1": "7+0.01t+2sin(0.5t)",
    "x2": "0.1+0.03cos(1.3t)",
    "x3": "0.002t+0.02sin(1.3t)",
    "x5": "0.5+0.1sin(1.3t)",
}


def exact_feedforward(game: Game) -> Any:
    """Return the exact feedforward of a game for the command."""
    linear = LinearModel.of(game.A, game.B)
    own = Game(game.A, game.B, game.E, game.Q, game.R, game.delta, game.N)
    return track(linear, solve(own), COMMAND).exact


@pytest.fixture(params=["plain", "cross weights"])
def game(request: pytest.FixtureRequest) -> Game:
    """The paper's game at 5 deg, also with cross weights N."""
    found = game_models()[min(game_models())]
    if request.param == "plain":
        return found
    N = 0.1 * np.random.default_rng(3).standard_normal((6, 5))
    return replace(found, Q=found.Q + np.eye(6), R=found.R + np.eye(5), N=N)


def test_feedforward_satisfies_its_differential_equation(game: Game) -> None:
    """The costate s(t) satisfies -s' = (A - S P)'s + P r, with derivatives by central differences."""
    P = solve(game).P
    exact = exact_feedforward(game)
    s, reference = exact.costate, exact.reference
    plain = game.without_cross_weights
    loop = plain.A - plain.S @ P
    step = 1e-3
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12e-3
    for t in (0.0, 3.0, 17.0):
        around = [t + k * step for k in (-2, -1, 1, 2)]
        r = game.A @ reference.at(t) - weights @ np.array([reference.at(each) for each in around])
        rate = weights @ np.array([s.at(each) for each in around])
        assert np.abs(rate + loop.T @ s.at(t) + P @ r).max() < 1e-9 * np.abs(P @ r).max()


class _Tracking:
    """The game of tracking the reference, with simulations of several policies."""

    def __init__(self, game: Game) -> None:
        self.game, self.P = game, solve(game).P
        self.exact = exact_feedforward(game)

    def fly(
        self,
        end: float,
        push: Callable[[float], np.ndarray] = lambda t: np.zeros(5),
        gust: Callable[[float], np.ndarray] = lambda t: np.zeros(6),
        share: float = 1.0,
    ) -> LinearFlight:
        K = self.game.gain(self.P)
        return simulate(
            self.game,
            lambda t, z: -K @ z + share * self.exact.inputs.at(t) + push(t),
            lambda t, z: (
                self.game.E.T @ self.P @ z / self.game.delta**2
                + self.exact.disturbance.at(t)
                + gust(t)
            ),
            INITIAL - self.exact.reference.at(0.0),
            np.array([0.0, end]),
            self.exact.forcing.at,
        )

    def total(self, flight: LinearFlight) -> float:
        """Return the cost of a flight plus the value of its final state, without c(T).

        c(T) does not depend on the policies.
        """
        z = flight.states[-1]
        s = self.exact.costate.at(flight.times[-1])
        return float(flight.cost[-1] + z @ self.P @ z + 2.0 * s @ z)


@pytest.mark.slow
def test_costs_of_exact_policies_equal_the_value() -> None:
    """The exact policies have the cost J(0, T) = V(z(0), 0) - V(z(T), T).

    c(0) - c(T) is T times the cost per second. A feedforward that is 1 % larger costs more.
    """
    tracking = _Tracking(game_models()[min(game_models())])
    end = 8.0
    flight = tracking.fly(end)
    z = flight.states[0]
    constant = end * tracking.exact.cost_per_second(end)
    value = z @ tracking.P @ z + 2.0 * tracking.exact.costate.at(0.0) @ z + constant
    assert tracking.total(flight) == pytest.approx(value, rel=1e-9)
    assert tracking.total(tracking.fly(end, share=1.01)) > tracking.total(flight) + 1e-3


@pytest.mark.slow
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
