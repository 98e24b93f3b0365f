"""Modes: exact numbers of known systems, names and participation of the aircraft's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa_model import LINEAR_STATES, Aircraft
from trim import level_model, modes_of
from trim.linear.printed import eigenvalue_errors


@pytest.mark.parametrize("damping", [0.1, 0.7, -0.2])
def test_an_oscillator_has_its_textbook_numbers(damping: float) -> None:
    """x'' + 2 ζ ω x' + ω² x = 0, ω = 3 rad/s."""
    (mode,) = modes_of(np.array([[0.0, 1.0], [-9.0, -6.0 * damping]]), ("alpha", "pitch_rate"))
    assert mode.frequency == pytest.approx(3.0, rel=1e-14)
    assert mode.damping == pytest.approx(damping, rel=1e-13)
    assert mode.period == pytest.approx(2 * math.pi / (3 * math.sqrt(1 - damping**2)), rel=1e-13)
    time = math.log(2) / (3 * abs(damping))
    halves, doubles = (time, math.inf) if damping > 0 else (math.inf, time)
    assert (mode.time_to_half, mode.time_to_double) == pytest.approx((halves, doubles), rel=1e-13)
    assert mode.stable == (damping > 0)
    assert mode.eigenvalue.imag > 0
    assert mode.name == "short period"


def test_participation_is_the_sensitivity_of_the_eigenvalue() -> None:
    """|∂λ_i/∂a_kk|, normalized: differentiated here by a small change of the diagonal instead of eigenvectors."""
    A = np.array([[-1.0, 2.0, 0.3], [-3.0, -0.5, 0.1], [0.2, 0.4, -0.1]])
    states = ("alpha", "pitch_rate", "speed")
    h = 1e-6
    for mode in modes_of(A, states):
        shifts = []
        for k in range(3):
            moved = [np.linalg.eigvals(A + sign * h * np.diag(np.eye(3)[k])) for sign in (1, -1)]
            near = [values[np.argmin(np.abs(values - mode.eigenvalue))] for values in moved]
            shifts.append(abs(near[0] - near[1]) / (2 * h))
        expected = np.array(shifts) / sum(shifts)
        np.testing.assert_allclose([mode.participation[name] for name in states], expected, atol=1e-8)


@pytest.mark.parametrize("degrees", [0.0, 1.0, 2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 16.0, 17.5, 20.0])
def test_modes_of_the_aircraft(aircraft: Aircraft, degrees: float) -> None:
    model = level_model(aircraft, float(np.radians(degrees)))
    modes = modes_of(model.A, model.states)
    names = [mode.name for mode in modes]
    assert len(set(names)) == len(names)
    assert {name.partition(" (")[0] for name in names} == {"short period", "phugoid", "dihedral"}
    for mode in modes:
        assert tuple(mode.participation) == LINEAR_STATES
        assert sum(mode.participation.values()) == pytest.approx(1.0, rel=1e-12)
    # Each eigenvalue once, a conjugate pair as one mode, fastest first.
    found = [value for mode in modes for value in {mode.eigenvalue, mode.eigenvalue.conjugate()}]
    assert len(found) == 6
    assert eigenvalue_errors(np.array(found), np.linalg.eigvals(model.A)).max() < 1e-11
    frequencies = [mode.frequency for mode in modes]
    assert frequencies == sorted(frequencies, reverse=True)
    by_name = {mode.name: mode for mode in modes}
    assert by_name["short period"].frequency > 5 * by_name["phugoid"].frequency
