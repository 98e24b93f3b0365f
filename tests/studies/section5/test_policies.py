"""Policies of Section 5: the published update law in flight."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from simulated_cases import measurements_of

from controller import random_pool
from hfa import Game
from hfa.paper import published_game
from hfa_flight import Waveform
from hfa_model import published_models
from studies.section5.configuration import PaperFlight
from studies.section5.critic_policy import CriticPolicy
from studies.section5.laws.published import (
    PublishedLaw,
    PublishedSettings,
    Sample,
    bellman,
    normaliser,
    published_law,
    update_direction,
)
from studies.section5.learned_gains import certified_gains

REFERENCE = PaperFlight.REFERENCE
NOTHING = Waveform(np.zeros(6), np.zeros(6))


def forcing(A: np.ndarray) -> Waveform:
    """Return A x_d - x_d' of the reference x_d."""
    return REFERENCE.through(A) + REFERENCE.rate().through(-np.eye(6))


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
    """Return u and W' of Eq. (46), computed sample by sample for the drift F = A z + r.

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
    r = forcing(law.game.A) if told else NOTHING
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


def test_the_last_certified_gain_flies() -> None:
    """x' = x + u: P = 3 and 9 are certified, P = .5 does not stabilize, -3 is no value."""
    game = Game(np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    run = SimpleNamespace(
        basis="quadratic",
        time=np.array([0.0, 0.1, 0.25, 0.3, 0.4]),
        weights=np.array([[0.5], [-3.0], [3.0], [9.0], [0.5]]),
    )
    gains, first = certified_gains(game, run, 0.1, np.array([[7.0]]))
    assert (gains.ravel().tolist(), first) == ([7.0, 7.0, 7.0, 9.0, 9.0], pytest.approx(0.3))
