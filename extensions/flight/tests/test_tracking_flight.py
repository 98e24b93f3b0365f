"""`hfa fly --reference`: errors with and without the exact feedforward, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer, hfa as run
from known_models import game_at, model_at

import hfa
from hfa_aircraft.waveform import Harmonic, Waveform, constant
from hfa_flight import Scenario
from hfa_flight.commands.tracking import tracking_of
from hfa_flight.policies.policy import OpenLoop
from hfa_support.errors import BadInputError

AT_15 = ("fly", "--dihedral", "15", "--dynamics", "newton")


#: v' = u - v, x' = v.
CART = hfa.Model(
    "cart",
    {"position": hfa.Signal("ft"), "speed": hfa.Signal("ft/s")},
    {"force": hfa.Signal("lbf")},
    lambda x, u, p, w: ({"position": x.speed, "speed": u.force - x.speed}, {}),
    trim={"position": 0.0, "speed": 0.0},
    steady=("speed",),
)


def test_a_linear_aircraft_tracks_with_the_late_errors_of_its_linear_model() -> None:
    """After 15 s, u = -K z + u_d has the late error of a sine, and -K z that without feedforward."""
    point = hfa.trim(CART)
    linear = hfa.linearize(CART, point)
    solution = hfa.solve(hfa.game(linear, Q=np.eye(2), R=np.eye(1)))
    tracking = hfa.track(linear, solution, {"position": "0.5sin(0.7t)", "speed": "0.1"})
    flight = hfa.fly(CART, point, tracking, 20.0, predict=False)
    late = flight.time > 15.0
    for flown, inputs in (
        (flight, tracking.inputs),
        (
            hfa.fly(CART, point, solution, scenario=flight.loop.scenario, predict=False),
            constant(np.zeros(1)),
        ),
    ):
        errors = tracking.late_error(inputs).sampled(flight.time[late])
        np.testing.assert_allclose(flown.flight.errors[late], errors, atol=2e-3)
    assert np.abs(errors).max() > 0.1
    law = OpenLoop("none", held=np.zeros((1, 1)))
    with pytest.raises(BadInputError, match="requires a policy u = -K z, not the none"):
        tracking_of(linear, tracking.game, law, {})


def test_a_reference_adds_the_late_errors_of_both_flights() -> None:
    """The errors are from the reference, of a flight with the feedforward and one without."""
    words = ("fly", "--dihedral", "15", "--law", "exact", "--reference", "dihedral=0.5sin(3t)")
    data = answer(*words, "--duration", "1")
    rms = list(data["rms_error"].values())
    assert data["late_rms_errors"] == rms
    plain = data["late_rms_errors_without_feedforward"]
    assert data["tracking"]["rms_errors"] != data["tracking"]["rms_errors_without_feedforward"]
    assert all(one != other for one, other in zip(rms, plain, strict=True))
    game = game_at(15.0)
    sine = np.array([np.radians(0.5) * (name == "dihedral") for name in data["rms_error"]])
    waveform = Waveform(0.0 * sine, 0.0 * sine, (Harmonic(3.0, sine, 0.0 * sine),))
    scenario = Scenario(1.0, reference=waveform)
    point = model_at(15.0).point
    flown = hfa.fly(point.model, point, hfa.solve(game), scenario=scenario, predict=False)
    np.testing.assert_allclose(plain, list(flown.rms_error.values()), rtol=1e-6)


@pytest.mark.slow
def test_errors_of_a_small_command_are_those_of_the_linear_model() -> None:
    """With feedforward, the late errors of a slow sine are predicted, and smaller than without."""
    data = answer(*AT_15, "--reference", "dihedral=0.5sin(0.3141592653589793t)")
    flown = np.array(data["late_rms_errors"])
    plain = np.array(data["late_rms_errors_without_feedforward"])
    # The second half of 20 s is half a period; after the transients, this is a mean over periods.
    predicted = np.array(data["tracking"]["rms_errors"])
    assert flown == pytest.approx(predicted, rel=0.1, abs=3e-5)
    assert np.all(flown < plain)
    assert data["tracking"]["reachable"] is True


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_a_policy_of_weights_flies_and_is_refused_with_a_reference() -> None:
    answer("solve", "--dihedral", "15", "--order", "3", "-o", "value.npz")
    words = ("fly", "--dihedral", "15", "--weights", "value.npz", "--duration", "1")
    assert answer(*words, "--initial", "alpha=0.1")["departure"] is None
    result = run(*words, "--reference", "dihedral=1")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "requires a policy u = -K z" in result.err
    answer("solve", "--dihedral", "15", "-o", "gain.npz")
    assert "requires" not in run(*words[:4], "gain.npz", "--reference", "dihedral=1").err


@pytest.mark.parametrize(
    "words", [("--law", "none"), ("--command", "dihedral=1:2"), ("--reference", "gamma=1")]
)
def test_other_requests_are_refused(words: tuple[str, ...]) -> None:
    result = run(*AT_15, "--reference", "dihedral=1", *words)
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
