"""Growing jobs: time and memory versus the number of points, flights or states, or network width.

`python -m benchmarks.jobs_scale points 1000` runs one job of that size and prints its time and
memory. The time excludes the start of the process and the import of the libraries.
"""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np

import hfa
from benchmarks.report import Growth, Size, value_text
from controller.critic.network.critic import from_network
from controller.hfa_files import published_game
from controller.riccati.gare import unconfirmed_solution
from hfa.main import main
from hfa_flight.envelope import flight_envelope
from hfa_flight.policies.policy import GainPolicy
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.samples.store import stream_members
from hfa_flight.scenario import Scenario, Uncertainty
from trim.point.solve import level_model
from trim.sweeps.store import stream_sweep
from trim.sweeps.sweep_plan import Steps, SweepPlan
from verification.box import ordinary_box
from verification.critic.critic_check import verify
from verification.scope import Scope

UNCERTAIN = Uncertainty(
    errors={"panel_mass": 0.02, "lift_slope": 0.02, "hinge_damping": 0.05},
    noise={"alpha": 0.001, "pitch_rate": 0.001},
    turbulence=hfa.Turbulence((1.0, 1750.0)),
)
#: Job -> name in the report, unit of the size, and sizes. A quick run uses the first two.
_GROWING: dict[str, tuple[str, str, tuple[int, ...]]] = {
    "points": ("sweep into a store", "points", (100, 1_000, 10_000, 100_000, 1_000_000)),
    "flights": ("flights of 0.1 s into a store", "flights", (10, 100, 1_000, 10_000, 30_000)),
    "states": ("one certified game", "states", (2, 6, 12, 25, 50, 100, 200, 400)),
    "solve": ("`hfa.solve`, certified and confirmed", "states", (6, 24, 48, 96)),
    "solve_command": ("`hfa solve --model`, with its margins", "states", (6, 24, 48, 96)),
    "networks": (
        "check of a network with two hidden layers",
        "units a layer",
        (8, 16, 64, 128, 256, 512, 1024),
    ),
}


def _growth(job: str, quick: bool) -> list[Growth]:
    """Return the run time and peak memory of a job at increasing sizes."""
    name, unit, sizes = _GROWING[job]
    measured = []
    for size in sizes[:2] if quick else sizes:
        command = [sys.executable, "-m", "benchmarks.jobs_scale", job, str(size)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        measured.append(Size(**json.loads(done.stdout)))
        seconds = value_text(measured[-1].seconds)
        print(f"{name}, {size} {unit}: {seconds}", file=sys.stderr)
    return [Growth(name, unit, tuple(measured))]


def _points(count: int, folder: Path) -> Callable[[], object]:
    """Return a function that stores trims of the HFA at `count` dihedral angles."""
    steps = Steps(0.0, float(np.radians(20.0)) / count, count)
    plan = SweepPlan({"dihedral": steps}, hfa.aircraft())
    return lambda: stream_sweep(plan, folder / "store.zarr")


def _flights(count: int, folder: Path) -> Callable[[], object]:
    """Return a function that stores `count` simulated flights in turbulence with the exact gain."""
    plan = gain_plan(count, duration=0.1)
    return lambda: stream_members(plan, folder / "store.zarr")


def gain_plan(members: int, duration: float) -> MonteCarlo:
    """Return a Monte Carlo run of the nonlinear aircraft with the exact gain.

    The dihedral angle is 15 degrees.

    members: number of simulations
    duration: s
    """
    aircraft = hfa.aircraft()
    scenario = Scenario(duration, uncertainty=UNCERTAIN)
    model = level_model(aircraft, float(np.radians(15.0)))
    policy = GainPolicy("exact", unconfirmed_solution(published_game(model.A, model.B)).K)
    return MonteCarlo(
        members, 0, aircraft, model.point, policy, scenario, flight_envelope(aircraft, model.point)
    )


def _states(count: int, folder: Path) -> Callable[[], object]:
    """Return a function that solves a random game with `count` states."""
    game = random_game(count)
    return lambda: unconfirmed_solution(game)


def random_game(states: int, seed: int = 0) -> hfa.Game:
    """Return a random game with one input for every three states and two disturbances.

    A game of one or two states has one input.

    states: number of states
    seed: the same seed gives the same game
    """
    rng = np.random.default_rng(seed)
    inputs = max(1, states // 3)
    A = rng.standard_normal((states, states)) / np.sqrt(states)
    B = rng.standard_normal((states, inputs))
    E = 0.1 * rng.standard_normal((states, 2))
    return hfa.Game(A, B, E, np.eye(states), np.eye(inputs), 20.0)


def _solve(count: int, folder: Path) -> Callable[[], object]:
    """Return a function that solves a random game with `count` states, and confirms its cost."""
    game = random_game(count)
    return lambda: hfa.solve(game)


def _solve_command(count: int, folder: Path) -> Callable[[], object]:
    """Return a function that runs `hfa solve` on a plant file with `count` states."""
    game = random_game(count)
    plant = folder / "plant.npz"
    np.savez(plant, **{name: getattr(game, name) for name in ("A", "B", "E", "Q", "R")})
    words = ["solve", "--model", str(plant), "--delta", str(game.delta)]
    words += ["-o", str(folder / "solution.json")]

    def run() -> None:
        with redirect_stdout(io.StringIO()):
            code = main(words)
        assert code == 0

    return run


def _networks(width: int, folder: Path) -> Callable[[], object]:
    """Return a function that checks a random network of two layers in the usual box."""
    model = level_model(hfa.aircraft(), float(np.radians(15.0)))
    game = published_game(model.A, model.B)
    rng = np.random.default_rng(0)
    layers = {}
    inputs = len(game.A)
    for number, outputs in ((0, width), (2, width), (4, game.B.shape[1])):
        layers[f"{number}.weight"] = rng.standard_normal((outputs, inputs)) / np.sqrt(inputs)
        layers[f"{number}.bias"] = np.zeros(outputs)
        inputs = outputs
    np.savez(folder / "network.npz", **layers)
    critic = from_network(game, folder / "network.npz", activation="tanh")
    return lambda: verify(game, critic, scope=Scope(box=ordinary_box(), flights=0))


def _sized(job: str, count: int) -> Size:
    """Return the measured time and memory of a growing job at one size."""
    prepared = {
        "points": _points,
        "flights": _flights,
        "states": _states,
        "solve": _solve,
        "solve_command": _solve_command,
        "networks": _networks,
    }
    smallest = _GROWING[job][2][0]
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as folder:
        prepared[job](smallest, Path(first))()
        run = prepared[job](count, Path(folder))
        start = time.perf_counter()
        run()
        seconds = time.perf_counter() - start
    return Size(count, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


JOBS = {name: partial(_growth, name) for name in _GROWING}

if __name__ == "__main__":
    import xarray  # noqa: F401  # loaded before the clock starts, as in a session that works
    import zarr  # noqa: F401

    print(json.dumps(_sized(sys.argv[1], int(sys.argv[2]))._asdict()))
