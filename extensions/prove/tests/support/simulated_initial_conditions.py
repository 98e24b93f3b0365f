"""Simulate flights from a proved set, and count those that leave the set or do not converge.

python extensions/prove/tests/support/simulated_initial_conditions.py FILE.json N [FILE.py:NAME]

N: number of flights
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from hfa_prove.check import check_certificate
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.loop_values import DisturbedValues, LoopValues
from hfa_prove.statements.region import RegionStatement

#: Steps per time constant of the fastest mode, and duration in time constants of the slowest mode.
_STEPS = 4.0
_CONSTANTS = 4.0
#: Part of the level below which a flight has converged, and tolerance of leaving the level.
_RETURNED = 0.1
_ABOVE = 1e-6
#: Number of flights that are simulated together.
_CHUNK = 20_000


def count_departures(
    statement: RegionStatement, count: int, seed: int = 0, farther: float = 1.0
) -> tuple[int, int]:
    """Return the number of flights that leave the set or a limit, and of those that do not
    converge.

    Half of the `count` flights begin in {V <= rho} and half on its boundary. With disturbances, the
    worst disturbance for V acts all the time, and the second number is 0.

    statement: a proved statement
    farther: factor on the initial conditions. Above 1, leaving the set is not counted.
    """
    in_y = PolynomialFunction.of_terms(statement.terms)
    V = in_y.substituted(statement.piece.M).scaled(1.0 / statement.rho)
    disturbed = bool(statement.loop.disturbances)
    loop = statement.loop
    at = np.array(list(statement.equilibrium.values()))
    plant = DisturbedValues(loop, at, V.slope) if disturbed else LoopValues(loop, at)
    generator = np.random.default_rng(seed)
    left = 0
    late = 0
    for begin in range(0, count, _CHUNK):
        starts = farther * random_points(V, statement, min(_CHUNK, count - begin), generator)
        one_left, one_late = _simulate(plant, V, starts, np.inf if farther > 1.0 else 1.0)
        left += one_left
        late += 0 if disturbed else one_late
    return left, late


def random_points(
    V: PolynomialFunction, statement: RegionStatement, count: int, generator: np.random.Generator
) -> np.ndarray:
    """Return random points z, (count, n), half uniform in {V <= 1} and half on its boundary."""
    ends = np.array([max(-low, high) for low, high in statement.extents.values()])
    n = len(ends)
    rows = np.linalg.inv(np.linalg.cholesky(V.matrix())).T
    rays = generator.normal(size=(count, n))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays = rays @ rows.T
    rays *= np.min(ends / np.maximum(np.abs(rays), 1e-300), axis=1)[:, None]
    edge = rays * V.edge(rays, 1.0)[:, None]
    shares = np.ones((count, 1))
    shares[: count // 2] = generator.uniform(size=(count // 2, 1)) ** (1 / n)
    return np.asarray(edge * shares * (1.0 - 1e-9))


def _simulate(
    plant: LoopValues, V: PolynomialFunction, starts: np.ndarray, level: float
) -> tuple[int, int]:
    """Return the number of flights that leave {V <= level} or a limit, and of those that do not
    converge.

    The second number counts flights within the set and limits that do not converge in the simulated
    time.
    """
    modes = np.linalg.eigvals(plant.J)
    step = 1.0 / (_STEPS * float(np.max(np.abs(modes))))
    seconds = _CONSTANTS / float(np.min(np.abs(modes.real)))
    z = starts
    left = 0
    for _ in range(int(np.ceil(seconds / step))):
        k1 = plant.rates(z)
        k2 = plant.rates(z + step / 2 * k1)
        k3 = plant.rates(z + step / 2 * k2)
        k4 = plant.rates(z + step * k3)
        z = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        values = V(z)
        gone = plant.away(z) | ~(values <= level * (1.0 + _ABOVE))
        left += int(gone.sum())
        z = z[~gone & (values > _RETURNED)]
        if not len(z):
            break
    return left, len(z)


if __name__ == "__main__":
    from hfa_aircraft.loading import load_model

    model = load_model(sys.argv[3]) if len(sys.argv) > 3 else None
    proved = check_certificate(Path(sys.argv[1]), model=model).statement
    print(sys.argv[1], sys.argv[2], *count_departures(proved, int(sys.argv[2])))
