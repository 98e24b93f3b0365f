"""Monte Carlo of flights on all cores against the members one by one."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from benchmarks.members_case import critic_plan
from benchmarks.report import Row
from benchmarks.timing import in_turn
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from controller.monte_carlo.stored_members import fly_member, stream_monte_carlo

_EFFICIENCY = 0.85


def rows(quick: bool = False) -> list[Row]:
    """As many processes as there are cores; their start, the compiled loop and the store: all of it counts."""
    cores = os.cpu_count() or 1
    workers = max(2, cores)
    members, alone, duration, repeats = (4, 1, 0.05, 1) if quick else (40 * workers, 4, 20.0, 3)
    plan = critic_plan(members, duration)

    def one_by_one() -> None:
        for member in range(alone):
            fly_member(plan, member)

    timing = in_turn(lambda: _stored(plan, workers), one_by_one, units=members, peer_units=alone, repeats=repeats)
    return [
        Row(
            f"Monte Carlo of that flight (errors, noise, turbulence) on {workers} processes, per member",
            "the members one by one",
            timing,
            _EFFICIENCY * cores,
            f"{timing.ratio / cores:.2f} of {cores} cores, {members} members a run with the start of the processes; "
            f"1000 members would take {1000 * timing.ours / 60:.3g} min",
        )
    ]


def _stored(plan: MonteCarlo, workers: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = stream_monte_carlo(plan, Path(folder) / "members.zarr", count=workers)
        assert store.missing() == []
        assert (store.read("flown") == plan.scenario.duration).all(), "a member left: its flight was shorter"
