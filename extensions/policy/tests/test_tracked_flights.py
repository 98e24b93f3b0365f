"""`hfa assess --reference`: a sampled policy that tracks a command, and refusals."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa as run
from known_models import game_at

import hfa
from hfa import solve
from hfa_aircraft.waveform import Harmonic, Waveform, constant
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_policy.tracked_flights import tracked_flights

AT_15 = ("--dihedral", "15", "--dynamics", "newton")
COMMAND = ("--reference", "dihedral=1+0.5sin(0.3t)")


@pytest.fixture
def gain(folder: Path) -> str:
    np.savez(folder / "K.npz", K=solve(game_at(15.0, "newton")).K)
    return "K.npz"


def test_a_sampled_gain_on_a_linear_aircraft_has_the_late_errors_of_its_linear_model() -> None:
    """x' = v, v' = u - v, sampled every 10 ms: errors of a sine with feedforward and without."""
    cart = hfa.Model(
        "cart",
        {"position": hfa.Signal("ft"), "speed": hfa.Signal("ft/s")},
        {"force": hfa.Signal("lbf")},
        lambda x, u, p, w: ({"position": x.speed, "speed": u.force - x.speed}, {}),
        trim={"position": 0.0, "speed": 0.0},
        steady=("speed",),
    )
    point = hfa.trim(cart)
    linear = hfa.linearize(cart, point)
    K = hfa.solve(hfa.game(linear, Q=np.eye(2), R=np.eye(1))).K
    o = ca.SX.sym("o", 2)
    deployment = hfa.Deployment(
        policy={"file": ca.Function("gain", [o], [-ca.DM(K) @ o])},
        observation={"position": {}, "speed": {}},
        action={"force": {}},
        timing={"dt": 0.01},
    )
    sine = Harmonic(0.7, np.array([0.5]), np.zeros(1))
    reference = {"position": Waveform(np.zeros(1), np.zeros(1), (sine,))}
    found = tracked_flights(Deployed(deployment, cart), point, linear, reference)
    tracking, *flights = found
    for flown, inputs in zip(flights, (tracking.inputs, constant(np.zeros(1))), strict=True):
        late = flown.time > 15.0
        errors = tracking.late_error(inputs).sampled(flown.time[late])
        np.testing.assert_allclose(flown.flight.errors[late], errors, atol=5e-3)
    assert np.abs(errors).max() > 0.1


@pytest.mark.slow
def test_a_fast_sampled_gain_tracks_as_the_continuous_one(gain: str) -> None:
    """With a short sample time, the errors with and without feedforward are those of `hfa fly`."""
    words = ("assess", gain, "--sample-time", "0.005", "--samples", "0", *AT_15, *COMMAND)
    sampled = answer(*words)
    flown = answer("fly", *AT_15, "--law", "exact", *COMMAND)
    for key in ("late_rms_errors", "late_rms_errors_without_feedforward"):
        assert np.array(sampled[key]) == pytest.approx(np.array(flown[key]), rel=0.02)
    assert sampled["tracking"]["reachable"] is True


def test_several_trims_and_unknown_states_are_refused(gain: str) -> None:
    words = ("assess", gain, "--sample-time", "0.01", "--samples", "0")
    for more in (("--dihedral", "10,15", *COMMAND), (*AT_15, "--reference", "gamma=1")):
        result = run(*words, *more)
        assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
        assert "--reference" in result.err
