"""Chunks computed by several threads of one process, as workers of a cluster do: the bits of one
after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from extension import Extension
from known_models import exact_gain, model_at
from numpy.typing import NDArray

import hfa_model
from hfa_model import default_parameters
from hfa_model.vectors import STATES
from hfa_support.native.bound import cached_per_thread
from trim.hfa.level_flight import LEVEL_FLIGHT
from trim.limits import Limits
from trim.sweeps.sweep import run_points

policies = Extension("hfa_flight.policies")
scenarios = Extension("hfa_flight.scenario")
members = Extension("hfa_flight.monte_carlo")

PARAMETERS = default_parameters().values
Rows = Mapping[str, NDArray]


def differing(chunk: Callable[[int], Rows], numbers: Sequence[int]) -> list[int]:
    """Chunks that come out otherwise on four threads than one after the other."""
    alone = [chunk(number) for number in numbers]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(chunk, numbers))
    same = [
        {name: a[name].tobytes() == b[name].tobytes() for name in a}
        for a, b in zip(alone, together, strict=True)
    ]
    return [number for number, names in zip(numbers, same, strict=True) if not all(names.values())]


@pytest.mark.parametrize("compile_code", [False, True])
def test_a_sweep(compile_code: bool) -> None:
    def chunk(number: int) -> Rows:
        rng = np.random.default_rng(number)
        values = np.column_stack(
            [np.radians(rng.uniform(0.0, 20.0, 200)), rng.uniform(25.0, 75.0, 200)]
        )
        rows = run_points(
            hfa_model.aircraft(), ("dihedral", "speed"), values, LEVEL_FLIGHT, None, compile_code
        )
        return {name: rows[name] for name in ("states", "inputs", "A", "B", "eigenvalues")}

    assert differing(chunk, range(5)) == []


def test_a_monte_carlo() -> None:
    point = model_at(15.0).point
    law = policies.GainPolicy("exact", exact_gain(15.0))
    scenario = scenarios.Scenario(0.2, uncertainty=scenarios.Uncertainty({"panel_mass": 0.1}))
    aircraft = hfa_model.aircraft(parameters=PARAMETERS)
    everywhere = Limits.of(aircraft, STATES, dict.fromkeys(STATES, (-1e9, 1e9)))
    plan = members.MonteCarlo(24, 0, aircraft, point, law, scenario, everywhere)
    assert (
        differing(lambda number: members.fly_members(plan, 4 * number, 4 * number + 4), range(6))
        == []
    )


def test_memory_that_threads_share_is_noticed() -> None:
    """`cached_per_thread` prevents a fault, which is planted here."""

    def chunk_with(memory_of: Callable[[], NDArray]) -> Callable[[int], Rows]:
        def chunk(number: int) -> Rows:
            memory = memory_of()
            memory[:] = number
            time.sleep(0.002)  # lets other threads run
            return {"number": memory.copy()}

        return chunk

    shared = np.zeros(3)
    assert differing(chunk_with(lambda: shared), range(20)) != []
    cached = cached_per_thread(None)(lambda: np.zeros(3))
    assert differing(chunk_with(cached), range(20)) == []
