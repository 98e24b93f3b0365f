"""`hfa learn` in a flight of the linear model: weights, errors, overflow and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa
from known_models import game_at

from controller.learning.laws import learner_of
from controller.learning.ticks import run
from hfa_aircraft.waveform import zero
from hfa_flight.commands.learning import Signals, learned_in_flight

#: A flight of 0.02 s in which the modified law learns.
BRIEF = ("learn", "--dihedral", "5", "--law", "modified", "--set", "predefined_time=0.02")
START = np.array([0.5, 0.01, 0.0, 0.02, 0.0, 0.0])
STILL = zero(6)


def test_weights_are_those_of_the_law_by_small_euler_steps() -> None:
    """Without signals, the weights of the flight are those of the law's own Euler steps."""
    game = game_at(5.0)
    start = tuple(START.tolist())
    settings = {"predefined_time": 0.02, "step": 1e-4}
    signals = Signals(START, STILL, STILL, STILL)
    flown, flight = learned_in_flight(game, "modified", 0, settings, signals)
    assert flight.flown.errors[0] == pytest.approx(START)
    errors = []
    for parts in (1, 4):
        law = learner_of(
            game, "modified", 0, **settings | {"step": 1e-4 / parts}, flight_start=start
        )
        euler = law.conclude(run(law))
        change = np.linalg.norm(flown.weights[-1] - flown.weights[0])
        errors.append(np.linalg.norm(euler.weights[-1] - flown.weights[-1]) / change)
    assert max(errors) < 0.01


@pytest.mark.slow
def test_signals_change_what_is_learned() -> None:
    """Initial condition, reference and noise reach the law; errors are measured from x_d."""
    plain = answer(*BRIEF, "--initial", "alpha=1", code=1)
    noisy = answer(*BRIEF, "--initial", "alpha=1", "--noise", "pitch=1cos(3t)", code=1)
    tracking = answer(*BRIEF, "--initial", "alpha=1", "--reference", "speed=7", code=1)
    assert plain["flight"]["duration"] == pytest.approx(0.02)
    assert plain["flight"]["largest_errors"][0] < 1.0
    assert tracking["flight"]["largest_errors"][0] == pytest.approx(7.0)
    for other in (noisy, tracking):
        assert np.abs(np.array(other["W"]) - plain["W"]).max() > 1e-6 * np.abs(plain["W"]).max()


def test_the_law_as_printed_overflows_in_its_first_step() -> None:
    result = hfa("learn", "--dihedral", "5", "--law", "published", "--reference", "speed=7")
    assert (result.code, result.out, result.err.count("\n")) == (1, "", 1)
    assert "step 1 (t = 0.0001 s)" in result.err


def test_gains_of_another_law_fly_and_its_critic_is_unchanged() -> None:
    words = ("learn", "--dihedral", "5", "--set", "predefined_time=1")
    flown = answer(*words, "--reference", "dihedral=1")
    assert flown["W"] == answer(*words)["W"]
    assert flown["flight"]["largest_errors"][4] >= np.radians(1.0) * (1.0 - 1e-9)


def test_a_plant_without_an_aircraft_is_refused(folder: Path) -> None:
    plant = {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], "Q": [1, 1], "R": [1]}
    (folder / "plant.json").write_text(json.dumps(plant))
    result = hfa("learn", "--model", "plant.json", "--reference", "x1=1")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "--reference" in result.err
