"""Jobs that grow: Monte Carlo on all cores, and cost and memory against size.

`python -m benchmarks.jobs_scale sweep 1000` runs one job of that size and prints its time, memory
and disk; the time is from an empty store to a full one, without the start of the process and the
import of the libraries."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import hfa
from benchmarks.jobs_flight import STEP, FlightCase
from benchmarks.report import Comparison, Limit, Row, Size, in_turn, value_text
from controller.hfa_files import published_game
from controller.riccati.gare import solve_game
from hfa_flight.envelope import flight_envelope
from hfa_flight.monte_carlo import MonteCarlo, fly_member
from hfa_flight.monte_carlo_store import stream_members
from hfa_flight.policies import GainPolicy
from hfa_flight.scenario import Scenario, Uncertainty
from hfa_flight.turbulence import Turbulence
from hfa_model.vectors import STATES
from hfa_stores.sweep_store import stream_sweep
from trim.hfa.level_flight import level_flight
from trim.limits import Limits
from trim.linear.level_model import level_model
from trim.point.solve import find_operating_point
from trim.sweeps.sweep_plan import Steps, SweepPlan

_EFFICIENCY = 0.85
#: A row of the largest job may cost this much more than one of the cheapest smaller one, and need
#: as much memory.
_LINEAR = 0.8
#: The memory of the largest size is compared with that of the one before, of a few chunks.
_SIZES = {
    "sweep": (1_000, 10_000, 100_000, 300_000, 1_000_000),
    "members": (100, 1_000, 10_000, 100_000, 300_000),
}
_QUICK_SIZES = (1, 3)
#: A job of more rows is run once.
_THRICE = 10_000
_UNCERTAIN = Uncertainty(
    errors={"panel_mass": 0.02, "lift_slope": 0.02, "hinge_damping": 0.05},
    noise={"alpha": 0.001, "pitch_rate": 0.001},
    turbulence=Turbulence((1.0, 1750.0)),
)


def _sweep_store(quick: bool) -> list[Row]:
    """Points of a sweep into a store, by size."""
    return _growth("sweep", "points of a sweep into a store", quick)


def _member_store(quick: bool) -> list[Row]:
    """Short flights into a store, by size."""
    return _growth("members", "members of 0.1 s into a store", quick)


def _growth(job: str, name: str, quick: bool) -> list[Row]:
    sizes = _QUICK_SIZES if quick else _SIZES[job]
    measured = []
    for count in sizes:
        repeats = 1 if quick or count > _THRICE else 3
        measured.append(_median(job, count, repeats))
        print(f"{count} {name}: {value_text(measured[-1].seconds, 's')} each", file=sys.stderr)
    return growth(name, measured)


def critic_plan(members: int, duration: float = 20.0) -> MonteCarlo:
    """The flight of `FlightCase` by many members: 25 weights, 50 samples, step 1e-4 s, seven states
    at 5 degrees.

    The envelope is as good as none, so that every member flies to the end.
    """
    case = FlightCase()
    aircraft = hfa.aircraft()
    point = find_operating_point(aircraft, level_flight(float(np.radians(5.0))))
    initial = np.array([*case.start[:6], 0.0])
    signals = (case.reference, case.disturbance)
    scenario = Scenario(duration, STEP, 0.01, initial, *signals, uncertainty=_UNCERTAIN)
    everywhere = Limits.of(aircraft, STATES, dict.fromkeys(STATES, (-1e9, 1e9)))
    return MonteCarlo(members, 0, aircraft, point, case.flown, scenario, everywhere)


def gain_plan(members: int, duration: float = 20.0) -> MonteCarlo:
    """The nonlinear aircraft under the exact gain at 15 degrees, step 1e-3 s."""
    aircraft = hfa.aircraft()
    scenario = Scenario(duration, uncertainty=_UNCERTAIN)
    model = level_model(aircraft, float(np.radians(15.0)))
    law = GainPolicy("exact", solve_game(published_game(model.A, model.B)).K)
    return MonteCarlo(
        members, 0, aircraft, model.point, law, scenario, flight_envelope(aircraft, model.point)
    )


def _monte_carlo(quick: bool) -> list[Row]:
    """As many processes as cores; their start, the compiled loop and the store are included in the
    time."""
    cores = os.cpu_count() or 1
    workers = max(2, cores)
    members, alone, duration, repeats = (4, 1, 0.05, 1) if quick else (40 * workers, 4, 20.0, 3)
    plan = critic_plan(members, duration)

    def stored() -> None:
        with tempfile.TemporaryDirectory() as folder:
            dataset = stream_members(plan, Path(folder) / "members.zarr", workers=workers)
            assert (dataset.flown == duration).all(), "a member left: its flight was shorter"

    def one_by_one() -> None:
        for member in range(alone):
            fly_member(plan, member)

    timing = in_turn(stored, one_by_one, units=members, peer_units=alone, repeats=repeats)
    job = (
        f"Monte Carlo of that flight (errors, noise, turbulence) on {workers} processes, per member"
    )
    remark = (
        f"{timing.ratio / cores:.2f} of {cores} cores, {members} members a run with the start of"
        " the processes"
    )
    limit = Limit(timing.peer / cores, "a member on each core")
    return [Row(job, "the members one by one", timing, _EFFICIENCY * cores, remark, limit=limit)]


def growth(name: str, sizes: list[Size]) -> list[Row]:
    """Time and memory of the largest size against the best smaller one."""
    *smaller, largest = sizes
    cheapest = min(size.seconds for size in smaller)
    memory = smaller[-1].memory
    time_row = Comparison(largest.seconds, cheapest, cheapest / largest.seconds)
    remark = "; ".join(
        f"{size.rows}: {value_text(size.seconds, 's')}, {size.memory:.0f} MB" for size in sizes
    )
    job = f"{largest.rows} {name}"
    held = Comparison(largest.memory, memory, memory / largest.memory)
    return [
        Row(
            f"{job}, per row",
            "the cheapest smaller size",
            time_row,
            _LINEAR,
            remark,
            sizes=tuple(sizes),
        ),
        Row(f"{job}, memory", f"{smaller[-1].rows} of them", held, _LINEAR, unit="MB"),
    ]


def _median(job: str, count: int, repeats: int) -> Size:
    """The run of median time, each in a new process."""
    command = [sys.executable, "-m", "benchmarks.jobs_scale", job, str(count)]
    runs = [
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
        for _ in range(repeats)
    ]
    return sorted((Size(**json.loads(run)) for run in runs), key=lambda run: run.seconds)[
        repeats // 2
    ]


def _sized(job: str, count: int) -> Size:
    """Trims of `count` dihedral angles, or nonlinear flights of 0.1 s in turbulence, into a
    store."""
    steps = Steps(0.0, float(np.radians(20.0)) / count, count)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "store.zarr"
        start = time.perf_counter()
        if job == "sweep":
            stream_sweep(SweepPlan({"dihedral": steps}, hfa.aircraft()), path)
        else:
            stream_members(gain_plan(count, duration=0.1), path)
        seconds = (time.perf_counter() - start) / count
        disk = (
            sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file()) / count
        )
    return Size(count, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, disk)


JOBS = {"members": _monte_carlo, "sweep_store": _sweep_store, "member_store": _member_store}

if __name__ == "__main__":
    import xarray  # noqa: F401  # loaded before the clock starts, as in a session that works
    import zarr  # noqa: F401

    print(json.dumps(_sized(sys.argv[1], int(sys.argv[2]))._asdict()))
