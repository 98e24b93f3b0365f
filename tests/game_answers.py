"""What the command-line tests of the game share: its answers, and the game at 15 degrees."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from cli import hfa

from controller.game import Game, published_game
from hfa_cli.main import DONE
from hfa_model import Aircraft, default_parameters
from trim.condition import level_flight
from trim.linearize import linearize
from trim.solve import trim

AT_15 = ("--dihedral", "15")
#: A certified run of a tenth of a second.
QUICK = ("--set", "tick=0.1")
LABELS = {"plant", "states", "inputs", "state_units", "input_units", "delta"}
HISTORY = {"times", "weights", "residual_norm", "law_residual_norm"}


def game_at_15() -> Game:
    """What `--dihedral 15` stands for."""
    aircraft = Aircraft(default_parameters().values)
    model = linearize(aircraft, trim(aircraft, level_flight(math.radians(15.0))))
    return published_game(model.A, model.B)


def answer(*words: str, code: int = DONE) -> dict[str, Any]:
    """What `hfa words... --json` prints: one JSON object, nothing else."""
    result = hfa(*words, "--json")
    assert (result.code, result.err) == (code, "")
    data = json.loads(result.out, parse_constant=pytest.fail)
    assert isinstance(data, dict)
    return data


def checks_of(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in data["checks"]}
