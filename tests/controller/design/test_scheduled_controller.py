"""The scheduled controller: its interpolation, and whom it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from controllers import small_controller

from hfa_model import Aircraft, default_parameters
from hfa_support import BadInputError


@pytest.mark.parametrize(
    ("degrees", "shares"),
    [(5.0, (1, 0, 0)), (7.5, (0.5, 0.5, 0)), (18.0, (0, 0.2, 0.8)), (-30.0, (1, 0, 0)), (60.0, (0, 0, 1))],
)
def test_matrices_are_linear_between_the_angles(
    published_aircraft: Aircraft, degrees: float, shares: tuple[float, ...]
) -> None:
    controller = small_controller(published_aircraft)
    expected = np.dot(shares, np.arange(3.0))
    for number, matrix in enumerate(controller.at(math.radians(degrees))):
        np.testing.assert_allclose(matrix, expected + 10.0 * number, rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"A": np.zeros((3, 2, 2))}, r"A is \(3, 2, 2\); it must be \(3, 1, 1\)"),
        ({"D": np.full((3, 1, 4), math.nan)}, "D has a number that is not finite"),
        ({"dihedrals": np.array([0.2, 0.1, 0.3])}, "dihedrals must increase"),
        ({"measurements": ("pitch_rate", "lift")}, "unknown measurement 'lift'"),
        ({"states": ("A = 1000",)}, "a state is called 'A = 1000'; give letters, digits and _ as in C"),
        ({"states": ("\x1b",)}, r"a state is called '\\x1b'"),
        ({"commands": ("dihedral_command", "dihedral_wish")}, "unknown command 'dihedral_wish'"),
        ({"inputs": ("flaps",)}, "unknown input 'flaps'"),
        ({"command_filter": (0.5,)}, "command_filter must be a bandwidth and a damping"),
        ({"command_filter": (0.5, 2.0, 1.0)}, "command_filter must be a bandwidth and a damping"),
        ({"command_filter": (0.5, math.inf)}, "command_filter must be a bandwidth and a damping"),
        ({"command_filter": (0.0, 2.0)}, "command_filter must be a bandwidth and a damping"),
    ],
)
def test_what_no_flight_could_rely_on_is_refused(
    published_aircraft: Aircraft, changed: dict[str, object], message: str
) -> None:
    with pytest.raises(BadInputError, match=f"controller small: {message}"):
        small_controller(published_aircraft, **changed)


def test_another_aircraft_and_other_angles_are_refused(published_aircraft: Aircraft) -> None:
    controller = small_controller(published_aircraft)
    controller.refuse_other(published_aircraft, math.radians(5.0), math.radians(20.0))
    with pytest.raises(BadInputError, match="covers dihedral 5 to 20 deg; 4 to 11 deg is asked for"):
        controller.refuse_other(published_aircraft, math.radians(4.0), math.radians(11.0))
    with pytest.raises(BadInputError, match="designed for published dynamics, the aircraft has newton"):
        controller.refuse_other(Aircraft(dynamics="newton"), 0.1, 0.2)
    heavier = default_parameters().values._replace(panel_mass=11.0)
    with pytest.raises(BadInputError, match="an aircraft with other parameters"):
        controller.refuse_other(Aircraft(heavier), 0.1, 0.2)
