"""One certificate of every kind and of every part that one may have, proved once for all tests of the checker."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import game_at
from proof_cases import ORIGIN, exact_table, family, scalar_game, through_actuators

from controller import Game, basis
from controller.game.critic_file import StoredCritic
from controller.riccati.gare import solve_game
from hfa_model import Aircraft, default_parameters
from verification import Family, coarsest_grid, prove_critic, prove_rate, prove_schedule
from verification.proof.certificate_file import ScheduleCertificate, write_certificate
from verification.proof.lpv_grid import certify
from verification.proof.scheduled_loop import LoopTable
from verification.proof.solution_proof import critic_claim, prove_solution, solution_claim

Content = dict[str, Any]
KINDS = ("rate", "memory", "actuators", "crossing", "errors", "solution", "critic", "scalar", "plant", "lpv")


def _schedule(path: Path, flights: Family, table: LoopTable, low: float, high: float, *, rate: bool = False) -> None:
    proof = prove_schedule(flights, table, low, high)
    motion = prove_rate(flights, table, low, high) if rate else None
    ScheduleCertificate(flights, table, low, high, path, ORIGIN).finish(proof, motion)


def _with_memory() -> LoopTable:
    """Throttle and elevators through lags that are states of the loop."""
    exact, rows = exact_table(14.0, 14.125), np.arange(5)
    K, M = np.zeros((2, 5, 11)), np.zeros((2, 11, 11))
    K[:, rows, 6 + rows], M[:, 6 + rows, 6 + rows], M[:, 6:, :6] = -1.0, -400.0, -400.0 * exact.K
    return replace(LoopTable.of_gains(exact.places, K, 6), M=M)


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Content]:
    folder, known = tmp_path_factory.mktemp("proofs"), default_parameters()
    files = {kind: folder / f"{kind}.json" for kind in KINDS}
    wide = Family(Aircraft(known.values), spread=known.standard_errors)
    _schedule(files["rate"], family(), exact_table(14.0, 14.125), 14.0, 14.125, rate=True)
    _schedule(files["memory"], family(), _with_memory(), 14.0, 14.0625)
    _schedule(files["actuators"], family(), through_actuators(14.0, 14.125), 14.0, 14.125)
    _schedule(files["crossing"], family(), exact_table(16.6875, 16.6895), 16.6875, 16.6895)
    _schedule(files["errors"], wide, exact_table(14.0, 14.0625), 14.0, 14.0625)
    aircraft, plant = (
        game_at(14.5),
        Game(A=[[0.0, 1.0], [2.0, -1.0]], B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=50.0),
    )
    for name, game, flights, degrees in (
        ("solution", aircraft, family(), 14.5),
        ("scalar", scalar_game(2.0), None, None),
    ):
        proof = prove_solution(game, flights, degrees)
        write_certificate(files[name], ORIGIN, "game", *solution_claim(proof))
    for name, game, flights, degrees in (("critic", aircraft, family(), 14.5), ("plant", plant, None, None)):
        exact, functions = solve_game(game), basis("quadratic", len(game.A))
        stored = StoredCritic(functions.weights(exact.P) * (1 + 1e-6), None, exact.K * (1 + 1e-3))
        found = prove_critic(game, stored, functions, flights, degrees)
        write_certificate(files[name], ORIGIN, "game", *critic_claim(found))
    certify(coarsest_grid(family(), 14.0, 14.0625, 1e-2), files["lpv"], ORIGIN)
    return {kind: json.loads(path.read_text()) for kind, path in files.items()}
