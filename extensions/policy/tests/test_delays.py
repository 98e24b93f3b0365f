"""The smallest unstable delay of the sampled loop, compared with flights."""

import numpy as np
import pytest
from policy_cases import AIRCRAFT, aircraft, flown_samples, stored_deployment, trims

from hfa_flight.held_step import parts_of_a_sample
from hfa_flight.initial_box import start_box
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.sampled_loop import chain_of, delays
from hfa_policy.assessor import Assessor
from hfa_policy.flights import SampledFlight

#: Duration of a flight, s, and size of the deviation relative to the initial-condition box.
END = 60.0
SMALL = 1e-6


def deviation_grows(name, point, equilibrium, delay):
    """Return whether a small deviation between two flights grows.

    A deviation grows if it is larger at the end than in the middle, or exceeds 100 times its
    initial size. One of the flights begins at the equilibrium.

    delay: s
    """
    deployment = stored_deployment(name)
    deployed = Deployed(deployment, aircraft(name))
    parts = parts_of_a_sample([point], deployment.dt)
    flight = SampledFlight(deployed, deployment.dt, delay, parts)
    rows = [list(point.model.states).index(state) for state in point.model.linear]
    widths = start_box(point.model, point)
    trim = deployed.trim_vector(point)
    flown = []
    for share in (0.0, SMALL):
        start = equilibrium.states.copy()
        start[rows] += share * widths
        memory = np.tile(equilibrium.inputs, flight.whole + 1)
        count = round(END / deployment.dt)
        flown.append(flown_samples(flight, start, trim, count, memory=memory)[1:, rows])
    deviations = (np.abs(flown[1] - flown[0]) / widths).max(axis=1)
    second = round(1.0 / deployment.dt)
    middle = len(deviations) // 2
    grows = deviations[-second:].max() > deviations[middle - second : middle].max()
    return bool(grows or deviations.max() > 100.0 * SMALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", AIRCRAFT)
def test_the_smallest_unstable_delay_agrees_with_flights(name):
    """Flights are stable one sample below the smallest unstable delay, and unstable at this delay."""
    deployment = stored_deployment(name)
    point = trims(name)[0]
    assessor = Assessor(Deployed(deployment, aircraft(name)), (point,), samples=0)
    equilibrium = assessor.places(assessor.flight())[0].equilibrium
    assert equilibrium is not None
    limit = delays(equilibrium, deployment.dt, deployment.delay).limit
    assert limit is not None
    if limit > 0.0:
        before = limit - deployment.dt
        assert chain_of(equilibrium, deployment.dt, before).radius < 1.0
        assert not deviation_grows(name, point, equilibrium, before)
    assert deviation_grows(name, point, equilibrium, limit)
