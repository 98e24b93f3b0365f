"""What the tests prove: the identified aircraft with tables of gains; one proof of every kind, made
once a process."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from known_models import exact_gain, game_at, model_at

import hfa_model
from controller import Game, basis, published_game
from controller.critic.critic import from_parts
from hfa_model import default_parameters
from hfa_model.provenance import Provenance
from verification import (
    Family,
    coarsest_grid,
    prove_critic,
    prove_schedule,
    prove_solution,
    solve_game,
)
from verification.proof.checker.checker import sealed
from verification.proof.search.certificate import Proof
from verification.proof.search.scheduled_loop import LoopTable

#: What the certificates of the tests bear.
ORIGIN = Provenance("a test", "published")


def family(dynamics: str = "published") -> Family:
    """The paper's flights of the identified aircraft."""
    return Family(hfa_model.aircraft(dynamics, default_parameters().values))


def exact_table(*angles: float, dynamics: str = "published") -> LoopTable:
    """The exact game's gains at the angles, deg."""
    return LoopTable.of_gains(
        np.array(angles), np.array([exact_gain(angle, dynamics) for angle in angles]), 6
    )


def through_actuators(*angles: float, delay: float = 0.02) -> LoopTable:
    """An LQR on the slowest of actuators from 1.8 to 10 rad/s, of effectiveness 0.5 to 1."""
    eye, gains = np.eye(5), []
    for angle in angles:
        model = model_at(angle)
        game = published_game(model)
        A = np.block([[model.A, model.B], [np.zeros((5, 6)), -1.8 * eye]])
        B = np.vstack([np.zeros((6, 5)), 1.8 * eye])
        gains.append(
            solve_game(Game(A, B, np.eye(11), np.pad(game.Q, (0, 5)), 300 * game.R, np.inf)).K
        )
    table = LoopTable.of_gains(np.array(angles), np.array(gains), 6)
    return table.through((1.8, 10.0), effectiveness=(0.5, 1.0), delay=delay)


def scalar_game(delta: float) -> Game:
    """a = -1, b = e = q = r = 1: p² (1 - 1/δ²) + 2 p - 1 = 0."""
    one = np.eye(1)
    return Game(A=-one, B=one, E=one, Q=one, R=one, delta=delta)


def between(places: Any, values: Any, place: float) -> np.ndarray:
    """A table of matrices, linear between its places."""
    flat = np.array(values).reshape(len(values), -1)
    return np.array([np.interp(place, places, column) for column in flat.T]).reshape(
        np.shape(values)[1:]
    )


def delayed_abscissa(
    table: LoopTable,
    A: np.ndarray,
    B: np.ndarray,
    w: float,
    arrives: np.ndarray,
    late: float,
    place: float | None = None,
) -> float:
    """Abscissa of ζ' = F ζ + ω G Λ U ζ(t - τ): of the generator of the delay equation on
    polynomials of degree 12 over the delay (Breda, Maset, Vermiglio, SIAM J. Sci. Comput. 27,
    2005); at the first place unless given."""
    own, at = table.actuators, table.places[0] if place is None else place
    assert own is not None
    K, M, N, X, U = (
        between(table.places, each, at) for each in (table.K, table.M, table.N, table.X, own.U)
    )
    x = np.eye(len(A), len(M))
    now = x.T @ (A @ x - B @ K) + N @ (A @ X - B @ K) + M + w * own.own
    later, n, count = w * own.G @ np.diag(arrives) @ U, len(now), 13
    if late < 1e-6:
        return float(np.linalg.eigvals(now + later).real.max())
    nodes = np.cos(np.pi * np.arange(count) / (count - 1))
    values = np.polynomial.chebyshev.chebvander(nodes, count - 1)
    slopes = np.polynomial.chebyshev.chebder(np.eye(count))
    change = np.polynomial.chebyshev.chebval(nodes, slopes).T @ np.linalg.inv(values)
    generator = np.kron(2.0 / late * change, np.eye(n))
    generator[:n] = 0.0
    generator[:n, :n], generator[:n, -n:] = now, later
    return float(np.linalg.eigvals(generator).real.max())


@cache
def unstable_between(low: float, high: float) -> LoopTable:
    """Gains that stabilize at both angles and not halfway, found by trying."""
    models = [model_at(angle) for angle in (low, (low + high) / 2, high)]
    K, random = exact_gain(low), np.random.default_rng(0)
    sizes = np.linalg.norm(K, axis=1)[:, None]
    for _ in range(5000):
        change = random.standard_normal(K.shape) * sizes * random.choice([0.5, 1.0, 2.0])
        other = random.standard_normal(K.shape) * sizes
        first, last = K + change, K - change + other
        gains = first, (first + last) / 2, last
        loops = np.array(
            [model.A - model.B @ gain for model, gain in zip(models, gains, strict=True)]
        )
        abscissae = np.linalg.eigvals(loops).real.max(axis=1)
        if abscissae[0] < -0.1 and abscissae[2] < -0.1 and abscissae[1] > 0.2:
            return LoopTable.of_gains(np.array([low, high]), np.array([first, last]), 6)
    raise AssertionError("no such table was found")


def forge(path: Path, content: dict[str, Any]) -> Path:
    """The file as a certificate with this content and the digests of it."""
    closing = ("digest", "provenance", "checksum")
    head = json.dumps({key: value for key, value in content.items() if key not in closing})[:-1]
    path.write_text(sealed(head, json.dumps(content["provenance"])))
    return path


def _with_memory() -> LoopTable:
    """Throttle and elevators through lags that are states of the loop."""
    exact, rows = exact_table(14.0, 14.125), np.arange(5)
    K, M = np.zeros((2, 5, 11)), np.zeros((2, 11, 11))
    K[:, rows, 6 + rows], M[:, 6 + rows, 6 + rows], M[:, 6:, :6] = -1.0, -400.0, -400.0 * exact.K
    return replace(LoopTable.of_gains(exact.places, K, 6), M=M)


def _critic(game: Game, *flights: Any) -> Proof:
    """W and K that are off by 1e-6 and 1e-3."""
    exact, functions = solve_game(game), basis("quadratic", len(game.A))
    parts = {"W": functions.weights(exact.P) * (1 + 1e-6), "K": exact.K * (1 + 1e-3)}
    return prove_critic(game, from_parts(game, parts), *flights)


PLANT = Game(
    A=[[0.0, 1.0], [2.0, -1.0]], B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=50.0
)
#: Every kind of certificate, with every part that one may have.
PROOFS = {
    "rate": lambda: prove_schedule(family(), exact_table(14.0, 14.125), 14.0, 14.125, moving=True),
    "memory": lambda: prove_schedule(family(), _with_memory(), 14.0, 14.0625),
    "actuators": lambda: prove_schedule(family(), through_actuators(14.0, 14.125), 14.0, 14.125),
    "crossing": lambda: prove_schedule(family(), exact_table(16.6875, 16.6895), 16.6875, 16.6895),
    "errors": lambda: prove_schedule(
        replace(family(), spread=default_parameters().standard_errors),
        exact_table(14.0, 14.0625),
        14.0,
        14.0625,
    ),
    "solution": lambda: prove_solution(game_at(14.5), family(), 14.5),
    "critic": lambda: _critic(game_at(14.5), family(), 14.5),
    "scalar": lambda: prove_solution(scalar_game(2.0)),
    "plant": lambda: _critic(PLANT),
    "lpv": lambda: coarsest_grid(family(), 14.0, 14.0625, 1e-2),
}


@cache
def proved(kind: str) -> Proof:
    return PROOFS[kind]()


def content(proof: Proof) -> dict[str, Any]:
    """Of its certificate."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "certificate.json"
        proof.write(path, ORIGIN)
        found: dict[str, Any] = json.loads(path.read_text())
        return found


@cache
def certificate(kind: str) -> dict[str, Any]:
    """The content of a certificate; not to be changed."""
    return content(proved(kind))
