"""Proofs for tests, one of every kind, each computed once per process, and loops of the
aircraft.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from known_models import exact_gain, game_at, model_at

import hfa
from controller import basis
from controller.critic.critic import from_parts
from hfa import Game, prove_critic, prove_solution, solve
from hfa.paper import default_parameters, published_game
from hfa_aircraft.about import Source
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model, Signal
from hfa_model import INPUTS, LINEAR_STATES
from hfa_prove import Family, prove_schedule
from hfa_prove.certificate import sealed
from hfa_prove.search.loops import Intervals, Loop, exact_gains, loop_of_gains
from hfa_prove.search.proof import Proof
from hfa_prove.statements.schedule import Controller, FixedActuators
from hfa_support.provenance import Provenance

#: Provenance of the certificates of the tests.
ORIGIN = Provenance("a test", "published")


def family(dynamics: str = "published") -> Family:
    """Return the trims of the identified aircraft in the paper's flight condition."""
    return Family(hfa.aircraft(dynamics, default_parameters().values))


def exact_loop(*angles: float, dynamics: str = "published") -> Loop:
    """Return the loop with the gains of the exact game at these dihedral angles, deg."""
    gains = np.array([exact_gain(angle, dynamics) for angle in angles])
    return loop_of_gains(hfa.aircraft(dynamics), angles, gains)


def through_actuators(*angles: float, delay: float = 0.02, slowest: float = 1.8) -> Loop:
    """Return the loop of an LQR with uncertain actuators of effectiveness 0.5 to 1.

    The highest bandwidth that the statement covers is 10 rad/s.

    delay: largest delay, s
    slowest: lowest bandwidth that the statement covers, rad/s
    """
    eye = np.eye(5)
    gains = []
    for angle in angles:
        model = model_at(angle)
        game = published_game(model)
        A = np.block([[model.A, model.B], [np.zeros((5, 6)), -1.8 * eye]])
        B = np.vstack([np.zeros((6, 5)), 1.8 * eye])
        Q = np.pad(game.Q, (0, 5))
        gains.append(solve(Game(A, B, np.eye(11), Q, 300 * game.R, np.inf)).K)
    intervals = Intervals((slowest, 10.0), (0.5, 1.0), delay)
    return loop_of_gains(hfa.aircraft(), angles, np.array(gains), intervals)


def scalar_game(delta: float) -> Game:
    """Return the game a = -1, b = e = q = r = 1, with the equation p² (1 - 1/δ²) + 2 p - 1 = 0."""
    one = np.eye(1)
    return Game(A=-one, B=one, E=one, Q=one, R=one, delta=delta)


def between(places: Any, values: Any, place: float) -> np.ndarray:
    """Return the linear interpolation of a table of matrices.

    places: (g,), breakpoints
    values: (g, rows, columns)
    """
    flat = np.array(values).reshape(len(values), -1)
    entries = [np.interp(place, places, column) for column in flat.T]
    return np.array(entries).reshape(np.shape(values)[1:])


@dataclass(frozen=True)
class LoopInDoubles:
    """The loop ζ' = base ζ + W (lag ζ + G v), v = U ζ, in doubles, assembled block by block.

    W is the diagonal matrix of the bandwidths. The controllers measure states and positions of
    actuators, and v is delayed.
    """

    base: np.ndarray
    lag: np.ndarray
    G: np.ndarray
    U: np.ndarray


def loop_in_doubles(loop: Any, A: np.ndarray, B: np.ndarray, angle: float) -> LoopInDoubles:
    """Return the closed loop in doubles at a dihedral angle.

    loop: an object with controller and actuators, such as a statement
    A, B: linear model of the aircraft at the angle
    """
    controller = loop.controller
    A_c, B_c, C_c, D_c = (
        between(controller.breakpoints, getattr(controller, name), angle) for name in "ABCD"
    )
    n = len(A)
    k = len(A_c)
    a = len(controller.inputs)
    orders = () if loop.actuators is None else loop.actuators.order
    second = [i for i, order in enumerate(orders) if order == 2]
    size = n + len(orders) + len(second) + k
    measured = np.zeros((len(controller.measurements), size))
    for row, name in enumerate(controller.measurements):
        if name in LINEAR_STATES:
            measured[row, LINEAR_STATES.index(name)] = 1.0
        else:
            measured[row, n + controller.inputs.index(name.removesuffix("_position"))] = 1.0
    moved = B[:, [INPUTS.index(name) for name in controller.inputs]]
    U = D_c @ measured
    U[:, size - k :] += C_c
    base = np.zeros((size, size))
    lag = np.zeros((size, size))
    G = np.zeros((size, a))
    base[:n, :n] = A
    base[size - k :] = B_c @ measured
    base[size - k :, size - k :] += A_c
    if loop.actuators is None:
        base[:n] += moved @ U
        return LoopInDoubles(base, lag, G, U)
    base[:n, n : n + a] = moved
    for i, order in enumerate(orders):
        driven = n + i
        if order == 2:
            driven = n + a + second.index(i)
            lag[n + i, driven] = 1.0
            lag[driven, driven] = -2.0 * loop.actuators.damping[i]
        lag[driven, n + i], G[driven, i] = -1.0, 1.0
    return LoopInDoubles(base, lag, G, U)


def delayed_abscissa(
    loop: Any,
    A: np.ndarray,
    B: np.ndarray,
    w: float,
    arrives: np.ndarray,
    late: float,
    angle: float,
) -> float:
    """Return the spectral abscissa of ζ' = F ζ + ω G Λ U ζ(t - τ).

    The generator of the delay equation is approximated on polynomials of degree 12.
    Source: Breda, Maset, Vermiglio, SIAM J. Sci. Comput. 27, 2005.

    w: ω, rad/s
    arrives: diagonal of Λ, the effectiveness
    late: τ, s
    """
    parts = loop_in_doubles(loop, A, B, angle)
    now = parts.base + w * parts.lag
    later = w * parts.G @ np.diag(arrives) @ parts.U
    n = len(now)
    count = 13
    if late < 1e-6:
        return float(np.linalg.eigvals(now + later).real.max())
    nodes = np.cos(np.pi * np.arange(count) / (count - 1))
    values = np.polynomial.chebyshev.chebvander(nodes, count - 1)
    slopes = np.polynomial.chebyshev.chebder(np.eye(count))
    change = np.polynomial.chebyshev.chebval(nodes, slopes).T @ np.linalg.inv(values)
    generator = np.kron(2.0 / late * change, np.eye(n))
    generator[:n] = 0.0
    generator[:n, :n] = now
    generator[:n, -n:] = later
    return float(np.linalg.eigvals(generator).real.max())


@cache
def unstable_between(low: float, high: float) -> Loop:
    """Return the loop of random gains that stabilize at both of two angles but not halfway."""
    models = [model_at(angle) for angle in (low, (low + high) / 2, high)]
    K = exact_gain(low)
    random = np.random.default_rng(0)
    sizes = np.linalg.norm(K, axis=1)[:, None]
    for _ in range(5000):
        change = random.standard_normal(K.shape) * sizes * random.choice([0.5, 1.0, 2.0])
        other = random.standard_normal(K.shape) * sizes
        first = K + change
        last = K - change + other
        gains = first, (first + last) / 2, last
        loops = np.array(
            [model.A - model.B @ gain for model, gain in zip(models, gains, strict=True)]
        )
        abscissae = np.linalg.eigvals(loops).real.max(axis=1)
        if abscissae[0] < -0.1 and abscissae[2] < -0.1 and abscissae[1] > 0.2:
            return loop_of_gains(hfa.aircraft(), [low, high], np.array([first, last]))
    raise AssertionError("no such table was found")


def forge(path: Path, content: dict[str, Any]) -> Path:
    """Write a certificate with this content and correct digests, and return its path."""
    closing = ("digest", "provenance", "checksum")
    head = json.dumps({key: value for key, value in content.items() if key not in closing})[:-1]
    path.write_text(sealed(head, json.dumps(content["provenance"])))
    return path


def with_memory(order: int = 1, lag: float = 0.002) -> Loop:
    """Return the loop of a controller that measures states through filters, with fast actuators.

    order: order of the actuators
    lag: time constant of the filters, s
    """
    gains = np.array([exact_gain(angle) for angle in (14.0, 14.125)])
    eye = np.tile(np.eye(6) / lag, (2, 1, 1))
    controller = Controller(
        breakpoints=np.array([14.0, 14.125]),
        inputs=INPUTS,
        measurements=LINEAR_STATES,
        A=-eye,
        B=eye,
        C=-gains,
        D=np.zeros((2, 5, 6)),
    )
    ones = np.ones(5)
    return Loop(controller, FixedActuators((order,) * 5, 0.7 * ones, 300.0 * ones, ones))


def two_trims(start: float = 1.0) -> Model:
    """Return the model x' = 1 + p - x² + u, with the trims ±sqrt(1 + p).

    One trim is stable and one is unstable.

    start: initial guess of the trim search
    """
    return Model(
        name="two trims",
        states={"x": Signal(nominal=1.0, start=start)},
        inputs={"u": Signal(nominal=1.0, min=-1.0, max=1.0)},
        parameters={"p": Signal(nominal=57.0, start=1.0)},
        equations=lambda x, u, p, w: ({"x": 1.0 + p.p - x.x * x.x + u.u}, {}),
        trim={"u": 0.0},
        schedule="p",
        source=Source("two_trims.py:TWO", "2" * 64),
    )


def _of_two_trims() -> Proof:
    loop = loop_of_gains(two_trims(), [1.0, 2.0], np.array([[[0.5]], [[0.6]]]))
    return prove_schedule(Family(two_trims()), loop, 1.0, 1.5, moving=True)


def _game_of_one_of_two() -> Proof:
    game = Game(A=[[-2 * np.sqrt(2.0)]], B=[[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=20.0)
    return prove_solution(game, Family(two_trims()), 1.0)


def _of_gtm() -> Proof:
    model = load_model("examples/gtm.py:GTM")
    flights = Family(model)
    return prove_schedule(flights, exact_gains(flights, 40.0, 41.0, None), 40.0, 41.0)


def _critic(game: Game, *flights: Any) -> Proof:
    """Return a proof about a critic whose W and K have relative errors of 1e-6 and 1e-3."""
    exact = solve(game)
    functions = basis("quadratic", len(game.A))
    parts = {"W": functions.weights(exact.P) * (1 + 1e-6), "K": exact.K * (1 + 1e-3)}
    return prove_critic(game, from_parts(game, parts), *flights)


PLANT = Game(
    A=[[0.0, 1.0], [2.0, -1.0]], B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=50.0
)
#: Proofs of every kind, which together contain every optional part.
PROOFS: dict[str, Callable[[], Proof]] = {
    "rate": lambda: prove_schedule(family(), exact_loop(14.0, 14.125), 14.0, 14.125, moving=True),
    "memory": lambda: prove_schedule(family(), with_memory(), 14.0, 14.0625),
    "second order": lambda: prove_schedule(family(), with_memory(order=2), 14.0, 14.0625),
    "actuators": lambda: prove_schedule(family(), through_actuators(14.0, 14.0625), 14.0, 14.0625),
    "crossing": lambda: prove_schedule(family(), exact_loop(16.6875, 16.6895), 16.6875, 16.6895),
    "errors": lambda: prove_schedule(
        replace(family(), spread=default_parameters().standard_errors),
        exact_loop(14.0, 14.0625),
        14.0,
        14.0625,
    ),
    "two trims": _of_two_trims,
    "gtm": _of_gtm,
    "one of two": _game_of_one_of_two,
    "solution": lambda: prove_solution(game_at(14.5), family(), 14.5),
    "critic": lambda: _critic(game_at(14.5), family(), 14.5),
    "scalar": lambda: prove_solution(scalar_game(2.0)),
    "plant": lambda: _critic(PLANT),
}


@cache
def proved(kind: str) -> Proof:
    return PROOFS[kind]()


def model_of(kind: str) -> Model | None:
    """Return the user's model for certificates of this kind, or None if they need none."""
    models = {
        "two trims": two_trims,
        "one of two": two_trims,
        "gtm": lambda: load_model("examples/gtm.py:GTM"),
    }
    return models[kind]() if kind in models else None


def content(proof: Proof) -> dict[str, Any]:
    """Return the content of the certificate of a proof."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "certificate.json"
        proof.write(path, ORIGIN)
        found: dict[str, Any] = json.loads(path.read_text())
        return found


@cache
def certificate(kind: str) -> dict[str, Any]:
    """Return the content of the certificate of this kind. It is shared and must not be changed."""
    return content(proved(kind))


@cache
def of_the_other_trim(kind: str) -> dict[str, Any]:
    """Return the content of a certificate about the unstable trim of the model with two trims."""
    other = two_trims(start=-1.0)
    if kind == "one of two":
        game = Game(A=[[2 * np.sqrt(2.0)]], B=[[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=20.0)
        return content(prove_solution(game, Family(other), 1.0))
    loop = loop_of_gains(other, [1.0, 2.0], np.array([[[9.0]], [[9.0]]]))
    return content(prove_schedule(Family(other), loop, 1.0, 1.5, moving=True))
