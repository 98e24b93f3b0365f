"""Exact game solutions with certificates, against SciPy's solver without one."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Row
from benchmarks.timing import in_turn
from controller.game.zero_sum import published_game
from controller.riccati.gare_batch import solve_games
from hfa_model import LINEAR_STATES, STATES, default_parameters
from hfa_model.variants import variant_named
from trim.sweeps.level_flights import level_conditions, solve_level_flights


def rows(quick: bool = False) -> list[Row]:
    """1000 models between 0 and 20 degrees."""
    count = 20 if quick else 1000
    from scipy.linalg import block_diag, solve_continuous_are

    conditions = level_conditions(("dihedral",), np.radians(np.linspace(0.0, 20.0, count))[:, None])
    flights = solve_level_flights(variant_named("published"), default_parameters().values, conditions)
    index = [STATES.index(name) for name in LINEAR_STATES]
    A, B = flights.A[:, index][:, :, index], flights.B[:, index]
    game = published_game(A[count // 2], B[count // 2])
    weights = block_diag(game.R, -(game.delta**2) * np.eye(6))

    def ours():
        assert solve_games(A, B, game).certified.all()

    def peer():
        for a, b in zip(A[::5], B[::5], strict=True):
            solve_continuous_are(a, np.hstack([b, game.E]), game.Q, weights)

    timing = in_turn(ours, peer, units=count, peer_units=count / 5)
    return [
        Row(
            f"{count} game Riccati equations, certified",
            "SciPy solve_continuous_are, no certificate",
            timing,
            1 / 2.5,
        )
    ]
