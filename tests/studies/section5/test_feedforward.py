"""The exact feedforward: its equation, its two derivations, its optimality, and what it is worth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from game_samples import INITIAL, game_models
from linear_flight import LinearFlight, simulate
from scipy.integrate import quad

from controller import Game
from hfa_support import BadInputError
from studies.section5.feedforward import Exosystem, exosystem, exosystem_feedforward, paper_reference
from verification import solve_game

MODELS = sorted(game_models())
ZERO = np.zeros(6)


def _paper_disturbance(t: float) -> np.ndarray:
    """d(t) of the paper (Section 5.1)."""
    slow = np.array([0.1, 0.2, 0.2, 0.1, 0.1, 0.1])
    return 1.1 * slow * np.where([True, True, False, True, False, True], math.sin(0.1 * t), math.cos(0.1 * t))


# References -----------------------------------------------------------------------------------------------------


def test_reference_of_the_paper() -> None:
    reference = paper_reference()
    for t in (0.0, 1.7, 20.0):
        exact = [7.0 + 0.01 * t + 2.0 * math.sin(0.5 * t), 0.1, 0.0, 0.0, 0.5, 0.0]
        np.testing.assert_allclose(reference.reference(t), exact, rtol=1e-13)
        rate = [0.01 + math.cos(0.5 * t), 0.0, 0.0, 0.0, 0.0, 0.0]
        np.testing.assert_allclose(reference.C @ reference.omega @ reference.state(t), rate, atol=1e-13)


def test_exosystem_makes_constants_ramps_and_both_phases() -> None:
    parts = np.arange(8.0).reshape(4, 2) + 1.0
    reference = exosystem(parts[0], parts[1], (3.0, parts[2], parts[3]))
    for t in (0.0, 0.4, 5.0):
        exact = parts[0] + parts[1] * t + parts[2] * math.sin(3.0 * t) + parts[3] * math.cos(3.0 * t)
        np.testing.assert_allclose(reference.reference(t), exact, rtol=1e-12)


# The equation of s ----------------------------------------------------------------------------------------------


def test_feedforward_satisfies_its_differential_equation(game: Game) -> None:
    P, reference = solve_game(game).P, paper_reference()
    P_s = exosystem_feedforward(game, P, reference)
    loop, step = game.A - game.S @ P, 1e-3
    for t in (0.0, 3.0, 17.0):
        # s' by central difference (order 4), independent of Ω
        s = [P_s @ reference.state(t + k * step) for k in (-2, -1, 1, 2)]
        rate = (s[0] - 8.0 * s[1] + 8.0 * s[2] - s[3]) / (12.0 * step)
        xd = [reference.reference(t + k * step) for k in (-2, -1, 1, 2)]
        xd_rate = (xd[0] - 8.0 * xd[1] + 8.0 * xd[2] - xd[3]) / (12.0 * step)
        r = game.A @ reference.reference(t) - xd_rate
        now = P_s @ reference.state(t)
        residual = rate + loop.T @ now + P @ r
        assert np.abs(residual).max() < 1e-9 * np.abs(P @ r).max()


def test_constant_reference_has_a_constant_feedforward(game: Game) -> None:
    P, level = solve_game(game).P, np.array([7.0, 0.1, 0.0, 0.0, 0.5, 0.0])
    P_s = exosystem_feedforward(game, P, exosystem(level, ZERO))
    exact = -np.linalg.solve((game.A - game.S @ P).T, P @ game.A @ level)
    np.testing.assert_allclose(P_s[:, 0], exact, rtol=1e-10)
    assert np.abs(P_s[:, 1:]).max() < 1e-9 * np.abs(exact).max()


def test_reference_that_the_aircraft_follows_by_itself_needs_none(game: Game) -> None:
    free = Exosystem(np.array(game.A), np.eye(6), INITIAL)  # x_d' = A x_d: r = 0
    assert not exosystem_feedforward(game, solve_game(game).P, free).any()


def test_references_without_a_bounded_answer_are_refused(game: Game) -> None:
    P = solve_game(game).P
    exploding = Exosystem(np.array([[0.3]]), np.ones((6, 1)), np.ones(1))
    with pytest.raises(BadInputError, match=r"the reference grows at 0.3 rad/s, the closed loop decays at 0.2"):
        exosystem_feedforward(game, P, exploding)
    with pytest.raises(BadInputError, match=r"the reference has 2 states; the game has 6"):
        exosystem_feedforward(game, P, exosystem(*np.zeros((2, 2))))
    with pytest.raises(BadInputError, match="give the stabilizing P of the game"):
        exosystem_feedforward(game, -P, paper_reference())


# Optimality -----------------------------------------------------------------------------------------------------


class _Tracking:
    """The tracking game on the reference of the paper, with its exact policies and a way to leave them."""

    def __init__(self, game: Game) -> None:
        self.game, self.P, self.reference = game, solve_game(game).P, paper_reference()
        self.P_s = exosystem_feedforward(game, self.P, self.reference)
        self.G = self.reference.forcing(game.A)

    def w(self, t: float) -> np.ndarray:
        return np.array([1.0, t, math.sin(0.5 * t), math.cos(0.5 * t)])

    def s(self, t: float) -> np.ndarray:
        return self.P_s @ self.w(t)

    def fly(
        self,
        times: np.ndarray,
        *,
        push: Callable[[float], np.ndarray] = lambda t: np.zeros(5),
        gust: Callable[[float], np.ndarray] = lambda t: ZERO,
        feedforward: float = 1.0,
        worst_case: float = 1.0,
    ) -> LinearFlight:
        game = self.game
        return simulate(
            game,
            lambda t, z: -game.R_inverse_B_transposed @ (self.P @ z + feedforward * self.s(t)) + push(t),
            lambda t, z: worst_case * game.E.T @ (self.P @ z + self.s(t)) / game.delta**2 + gust(t),
            INITIAL - self.reference.reference(0.0),
            times,
            lambda t: self.G @ self.w(t),
        )

    def total(self, flight: LinearFlight) -> float:
        """Cost to the end plus the value from there on, up to a constant that no policy changes."""
        z = flight.states[-1]
        return float(flight.cost[-1] + z @ self.P @ z + 2.0 * self.s(flight.times[-1]) @ z)


def test_exact_policies_cost_what_the_value_says(game: Game) -> None:
    """J(0, T) + V(z(T), T) = V(z(0), 0) with c(0) - c(T) = ∫ 2 s'r - s'S s dt."""
    tracking, end = _Tracking(game), 8.0
    flight = tracking.fly(np.array([0.0, end]))
    z = flight.states[0]

    def rate(t: float) -> float:
        s = tracking.s(t)
        return float(2.0 * s @ tracking.G @ tracking.w(t) - s @ game.S @ s)

    constant, _ = quad(rate, 0.0, end, epsrel=1e-12, limit=200)
    value = z @ tracking.P @ z + 2.0 * tracking.s(0.0) @ z + constant
    assert tracking.total(flight) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_leaving_the_feedforward_costs_to_second_order(game: Game, seed: int) -> None:
    """u + ε v costs exactly ε² ∫ v'R v against the exact d, and d + ε g gains exactly -ε² δ² ∫ g'g."""
    tracking, rng = _Tracking(game), np.random.default_rng(seed)
    end, v, g = 6.0, rng.standard_normal(5), rng.standard_normal(6)
    best = tracking.total(tracking.fly(np.array([0.0, end])))
    pulse = end * 3.0 / 8.0  # ∫ sin⁴(π t/end) dt
    shape = [lambda t, size=size: size * math.sin(math.pi * t / end) ** 2 for size in (1.0, 0.1)]
    exact = float(v @ game.R @ v) * pulse
    pushed = [tracking.total(tracking.fly(np.array([0.0, end]), push=lambda t, f=f: f(t) * v)) - best for f in shape]
    assert pushed[0] == pytest.approx(exact, rel=1e-5)
    assert math.log10(pushed[0] / pushed[1]) == pytest.approx(2.0, abs=0.01)
    exact = -(game.delta**2) * float(g @ g) * pulse
    blown = [tracking.total(tracking.fly(np.array([0.0, end]), gust=lambda t, f=f: f(t) * g)) - best for f in shape]
    assert blown[0] == pytest.approx(exact, rel=1e-5)
    assert math.log10(blown[0] / blown[1]) == pytest.approx(2.0, abs=0.01)


def test_a_wrong_feedforward_is_not_optimal() -> None:
    """The planted error: with s one percent off, a push exists that lowers the cost."""
    tracking = _Tracking(game_models()[MODELS[0]])
    times = np.array([0.0, 6.0])
    assert tracking.total(tracking.fly(times, feedforward=1.01)) > tracking.total(tracking.fly(times)) + 1e-3
    assert tracking.total(tracking.fly(times, feedforward=0.0)) > tracking.total(tracking.fly(times)) + 1.0


def test_feedforward_tracks_the_speed_a_thousand_times_better(game: Game) -> None:
    """Root mean square of z over 10-20 s, as the paper flies it: with and without s, with and without d(t)."""
    tracking, times = _Tracking(game), np.linspace(0.0, 20.0, 401)
    late = times >= 10.0
    error = {}
    for feedforward in (0.0, 1.0):
        for windy in (False, True):
            flight = tracking.fly(
                times,
                feedforward=feedforward,
                worst_case=0.0,
                gust=_paper_disturbance if windy else (lambda t: ZERO),
            )
            error[feedforward, windy] = np.sqrt(np.mean(flight.states[late] ** 2, axis=0))
    for (feedforward, windy), rms in error.items():
        print(f"feedforward={feedforward:g} d={windy}: z1 {rms[0]:.3g} ft/s, z2 {rms[1]:.3g}, z5 {rms[4]:.3g} rad")
    assert error[1.0, False][0] < 1e-3 * error[0.0, False][0]
    assert error[1.0, True][0] < 0.2 * error[0.0, True][0]
    assert np.all(error[1.0, False][[0, 1, 4]] < error[0.0, False][[0, 1, 4]])
    assert error[1.0, False][1] > 0.05  # the weights of the paper leave the angle of attack untracked even so
