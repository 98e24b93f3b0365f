"""One rule for the pitch angle, alpha + gamma: the same limits in single trims, in sweeps and in chunks."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import STATES, Aircraft
from trim import TrimError, find_operating_point, level_flight, release
from trim.sweeps.points import BEYOND_LIMITS, TRIMMED, trim_points

#: Flight-path angle and angle of attack, deg, around a pitch angle of 60 deg; the last beyond 60 deg of path only.
ANGLES = [(57.1, 2.8), (57.3, 2.8), (59.0, 2.8), (59.0, 0.9), (60.5, 2.0), (61.0, 0.5), (60.2, -0.3)]


@pytest.fixture(scope="module")
def strong(published_aircraft: Aircraft) -> Aircraft:
    """A light aircraft with an engine that holds any climb, its controls far from their limits."""
    parameters = published_aircraft.parameters
    thrust, mass = 100 * parameters.thrust_per_throttle, 0.9 * parameters.panel_mass
    return Aircraft(parameters._replace(thrust_per_throttle=thrust, panel_mass=mass))


@pytest.mark.parametrize(("gamma", "alpha"), ANGLES)
def test_a_chunk_and_a_trim_agree(strong: Aircraft, gamma: float, alpha: float) -> None:
    values = np.radians([[gamma, alpha]])
    chunk = trim_points(strong, ("gamma", "alpha"), values)
    condition = level_flight(0.0, gamma=float(values[0, 0]), alpha=float(values[0, 1]))
    if gamma + alpha <= 60:
        assert find_operating_point(strong, condition).status == "trimmed"
        assert chunk.status[0] == TRIMMED
    else:
        with pytest.raises(TrimError, match=r"pitch would have to be .* deg, it must lie between -60 deg and 60 deg$"):
            find_operating_point(strong, condition)
        assert (chunk.status[0], chunk.limiting[0]) == (BEYOND_LIMITS, STATES.index("pitch"))


def test_limits_that_hold_only_together_are_checked(strong: Aircraft) -> None:
    """alpha and gamma both free: each within its limits, their sum not."""
    lifted = find_operating_point(
        strong, level_flight(0.0, gamma=float(np.radians(62.0)), limits={"pitch": (-2.0, 2.0)})
    )
    held = {name: getattr(lifted.inputs, name) for name in ("throttle", "aileron_outer")}
    both = release(level_flight(0.0), free=("alpha", "gamma"), hold=held)
    with pytest.raises(TrimError, match=r"pitch would have to be 64\.8 deg, it must lie between -60 deg and 60 deg"):
        find_operating_point(strong, both, lifted)
