"""The worst updraft: no other costs more, and it costs what is said."""

from __future__ import annotations

import math

import numpy as np
import pytest
from known_models import model_at
from scipy.linalg import expm
from servo_cases import measured_servo

from controller import design_model, load_design
from hfa_model import Aircraft
from verification import OutputGame, solve_game, solve_output_feedback
from verification.synthesis.gust_cost import GustCost, estimated_gust_cost, gust_cost


def test_a_long_harmonic_updraft_of_the_worst_frequency_costs_what_is_said(published_aircraft: Aircraft) -> None:
    built = design_model(published_aircraft, model_at(11.0), load_design("simvfa-1"))
    game = built.game()
    K = solve_game(game).K
    found = gust_cost(built, game, K)
    paid = game.Q + K.T @ game.R @ K

    def mean_cost(frequency: float) -> float:
        """Of cos(ωt), in the long run, per (ft/s)² s of it."""
        z = np.linalg.solve(1j * frequency * np.eye(len(K.T)) - game.A + game.B @ K, built.gust)[:, 0]
        return float((z.conj() @ paid @ z).real)

    assert mean_cost(found.frequency) == pytest.approx(found.cost)
    assert all(mean_cost(frequency) <= found.cost * (1 + 1e-9) for frequency in np.geomspace(1e-3, 1e2, 200))
    assert 200.0 * found.dihedral**2 == pytest.approx(found.cost)
    assert f"costs {found.cost:.4g}, as much as {math.degrees(found.dihedral):.3g} deg of dihedral" in found.text()
    assert found.to_dict() == {**found._asdict(), "updraft": {"value": 1.0, "unit": "ft/s"}}


def test_who_estimates_pays_what_the_whole_loop_says(published_aircraft: Aircraft) -> None:
    built = design_model(published_aircraft, model_at(11.0), measured_servo(feedforward=None))
    game = built.game()
    exact = solve_output_feedback(OutputGame(game, built.C, built.D, built.V))
    found = estimated_gust_cost(built, game, (exact.Ak, exact.Bk, exact.Ck))
    loop = np.block([[game.A, game.B @ exact.Ck], [exact.Bk @ built.C, exact.Ak]])
    gust = np.vstack([built.gust, np.zeros((len(exact.Ak), 1))])
    z = np.linalg.solve(1j * found.frequency * np.eye(len(loop)) - loop, gust)[:, 0]
    z, u = z[: len(game.A)], exact.Ck @ z[len(game.A) :]
    assert float((z.conj() @ game.Q @ z + u.conj() @ game.R @ u).real) == pytest.approx(found.cost)


def test_a_pulse_costs_less_than_the_worst(published_aircraft: Aircraft) -> None:
    """1 ft/s for 1 s in the time domain: ∫ z' paid z dt by steps."""
    built = design_model(published_aircraft, model_at(11.0), load_design("simvfa-1"))
    game = built.game()
    K = solve_game(game).K
    loop, paid = game.A - game.B @ K, game.Q + K.T @ game.R @ K
    step = expm(0.01 * np.block([[loop, built.gust], [np.zeros((1, len(loop) + 1))]]))
    state, cost = np.zeros(len(loop) + 1), 0.0
    for k in range(8000):
        state[-1] = 1.0 if k < 100 else 0.0
        state = step @ state
        cost += 0.01 * state[:-1] @ paid @ state[:-1]
    assert 0.0 < cost < gust_cost(built, game, K).cost


@pytest.mark.parametrize(
    ("frequency", "dihedral", "said"),
    [
        (0.0, 0.01, "a steady one, costs 3, as much as 0.573 deg of dihedral for 1 s"),
        (2.5, math.nan, "at 2.5 rad/s, costs 3"),
    ],
)
def test_the_worst_updraft_is_said(frequency: float, dihedral: float, said: str) -> None:
    assert GustCost(3.0, frequency, dihedral).text() == f"Worst updraft with the energy of 1 ft/s for 1 s: {said}"
