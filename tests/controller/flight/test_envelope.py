"""The envelope: which state left first, and limits of the user's own."""

from __future__ import annotations

import numpy as np
import pytest
from flight_cases import FlownCase

from controller import flight_envelope
from hfa_model import STATES
from hfa_support import BadInputError


def test_speed_and_altitude_are_limited_about_the_trim(newton: FlownCase) -> None:
    at, low, high = newton.point.states, newton.envelope.lowest, newton.envelope.highest
    assert (low.speed, high.speed) == (at.speed / 2, 2 * at.speed)
    assert (at.altitude - low.altitude, high.altitude - at.altitude) == (1000.0, 1000.0)
    assert high.pitch_rate == -low.pitch_rate > 0.0


@pytest.mark.parametrize("name", STATES)
def test_each_state_can_be_the_first(newton: FlownCase, name: str) -> None:
    """A planted path that leaves in one state, and later in another: the first one is named."""
    index, later = STATES.index(name), (STATES.index(name) + 1) % len(STATES)
    middle = (np.array(newton.envelope.lowest) + np.array(newton.envelope.highest)) / 2
    path = np.tile(middle, (10, 1))
    path[4:, index] = newton.envelope.highest[index] * 1.01 + 1e-3
    path[6:, later] = np.nan
    departure = newton.envelope.departure(0.1 * np.arange(10), path)
    assert departure is not None
    assert (departure.state, departure.limit) == (name, newton.envelope.highest[index])
    assert departure.time == pytest.approx(0.4)
    assert newton.envelope.departure(np.arange(4.0), path[:4]) is None


def test_the_envelope_can_be_changed_and_must_hold_the_trim(newton: FlownCase) -> None:
    p, point = newton.aircraft.parameters, newton.point
    narrow = flight_envelope(p, point, {"dihedral": (0.2, 0.3)})
    assert (narrow.lowest.dihedral, narrow.highest.dihedral) == (0.2, 0.3)
    assert narrow.highest.alpha == newton.envelope.highest.alpha
    with pytest.raises(BadInputError, match="no state 'roll'"):
        flight_envelope(p, point, {"roll": (0.0, 1.0)})
    with pytest.raises(BadInputError, match=r"has dihedral 15 deg, outside the envelope's 0 deg to 5\.72958 deg"):
        flight_envelope(p, point, {"dihedral": (0.0, 0.1)})
