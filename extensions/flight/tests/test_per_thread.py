"""Monte Carlo simulations in several threads of a process give the same bits as in one thread."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from known_models import exact_gain, model_at
from numpy.typing import NDArray
from threads import Rows, differing

import hfa
from hfa.paper import default_parameters
from hfa_aircraft.limits import Limits
from hfa_flight.policies.policy import GainPolicy
from hfa_flight.samples.monte_carlo import MonteCarlo, cached_per_thread, fly_members
from hfa_flight.scenario import Scenario, Uncertainty
from hfa_model.vectors import STATES

PARAMETERS = default_parameters().values


def test_threads_give_equal_members() -> None:
    """Members simulated on several threads equal those simulated in sequence."""
    point = model_at(15.0).point
    law = GainPolicy("exact", exact_gain(15.0))
    scenario = Scenario(0.2, uncertainty=Uncertainty({"panel_mass": 0.1}))
    aircraft = hfa.aircraft(parameters=PARAMETERS)
    everywhere = Limits.of(aircraft, STATES, dict.fromkeys(STATES, (-1e9, 1e9)))
    plan = MonteCarlo(24, 0, aircraft, point, law, scenario, everywhere)
    assert differing(lambda number: fly_members(plan, 4 * number, 4 * number + 4), range(6)) == []


def test_memory_shared_by_threads_is_detected() -> None:
    """A computation whose threads share memory is detected by its wrong results.

    With memory from `cached_per_thread`, the results are right.
    """

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
