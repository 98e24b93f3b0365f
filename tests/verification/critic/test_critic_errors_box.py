"""Which box a critic is compared over: the aircraft's where the plant is named so, else a convention that is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa

from controller import Game
from controller.riccati.balancing import balanced_units
from hfa_model import INPUTS, LINEAR_STATES
from verification.critic.critic_errors import ORDINARY_DEVIATIONS, ordinary_box

GAME = Game(-np.diag(np.arange(1.0, 7.0)), np.ones((6, 5)), np.eye(6), np.diag([1.0, 1e6, 1, 1, 1, 1]), np.eye(5), 5.0)
SMALL = Game(-np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 1e6]), np.eye(2), 5.0)
FEET, METRES = (f"{unit}/s" for unit in ("ft", "m"))
REST = ("rad", "rad", "rad/s", "rad", "rad/s")


@pytest.mark.parametrize(
    ("states", "inputs", "units", "speed"),
    [
        ((), (), (), 7.0),
        (LINEAR_STATES, INPUTS, (), 7.0),
        (LINEAR_STATES, INPUTS, (FEET, *REST), 7.0),
        (LINEAR_STATES, INPUTS, (METRES, *REST), 7.0 * 0.3048),
        (LINEAR_STATES, INPUTS, ("km/h", *REST), None),
        (tuple("abcdef"), INPUTS, (), None),
        (LINEAR_STATES[::-1], INPUTS, (), None),
        (LINEAR_STATES, tuple("abcde"), (), None),
    ],
)
def test_names_and_units_decide(
    states: tuple[str, ...], inputs: tuple[str, ...], units: tuple[str, ...], speed: float | None
) -> None:
    box = ordinary_box(GAME, states, inputs, units)
    if speed is None:
        assert "a convention" in box.about
        assert box.half_widths.tolist() == balanced_units(GAME).tolist()
    else:
        assert box.half_widths.tolist() == [speed, *ORDINARY_DEVIATIONS[1:]]
        assert box.about.startswith("ordinary deviations of the aircraft")
    assert ordinary_box(SMALL).half_widths.tolist() == balanced_units(SMALL).tolist()


def test_a_plant_of_that_size_that_is_not_the_aircraft_is_told_apart(tmp_path: Path) -> None:
    plant, critic = tmp_path / "plant.json", tmp_path / "critic.json"
    matrices = {name: getattr(GAME, name).tolist() for name in "ABEQR"} | {"delta": 50.0}
    names = {"states": list(LINEAR_STATES), "inputs": list(INPUTS)}
    for named in ({}, names):
        plant.write_text(json.dumps(matrices | named), encoding="utf-8")
        assert hfa("solve", "--model", str(plant), "-o", str(critic)).code == 0
        result = hfa("verify", "--model", str(plant), "--weights", str(critic))
        assert result.code == 0, result.out
        about = "ordinary deviations of the aircraft" if named else "balanced units of the game; a convention"
        assert f"\nBox of states: {about}" in result.out
