"""Critics with 55 to 105 weights, learned for design models from random initial critics.

They are exact by the predefined time.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_models import model_at
from learning_samples import abscissa, random_start
from project import ROOT
from reference_riccati import relative_error
from servo_cases import SIMVFA, simvfa_design

import hfa
from controller import GeneralizedPlant, basis
from controller.learning.recording import natural_spread
from hfa import Game, Solution, learn, solve
from hfa_design import load_design
from hfa_design.design import Design
from hfa_design.design_model import design_model
from hfa_flight.actuators import Actuator

#: delta of a finite game. The smallest delta of `simvfa-1` is 95.
DELTA = 200.0
SEARCHED = ROOT / "studies" / "servo" / "designs" / "servo_three.toml"
#: Name -> number of states and of weights.
SIZES = {
    "simvfa-1": (10, 55),
    "simvfa-2": (12, 78),
    "three inputs": (14, 105),
    "searched": (10, 55),
    "its filter": (10, 55),
}


def design_of(name: str) -> Design:
    """Return the design with this name.

    "three inputs" is `simvfa-2` with the ailerons of the center panel as a third input.
    """
    if name != "three inputs":
        return simvfa_design(name) if name in SIMVFA else load_design(str(SEARCHED), hfa.aircraft())
    two = simvfa_design("simvfa-2")
    more = {"aileron_center": Actuator(2)}
    weights = {**two.input_weights, "aileron_center": 50.0}
    return replace(
        two, inputs=(*two.inputs, *more), actuators={**two.actuators, **more}, input_weights=weights
    )


@cache
def exact(name: str) -> tuple[Game, Solution]:
    built = design_model(hfa.aircraft(), model_at(11.0), design_of(name))
    game = built.game() if built.sensors else built.game().with_delta(DELTA)
    if name == "its filter":
        game = GeneralizedPlant.measured(game, built.C, built.V).sides[1].game(game.delta)
    return game, solve(game)


@pytest.mark.parametrize("starts", [1, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in ("simvfa-1", "its filter") else pytest.mark.slow)
        for name in SIZES
    ],
)
def test_learning_settles_from_every_initial_critic(name: str, starts: int) -> None:
    """From every random initial critic, learning settles within 10 s at the exact P and K.

    The errors are at most 1e-8.
    """
    game, solution = exact(name)
    functions = basis("quadratic", len(game.A))
    assert (len(game.A), functions.size) == SIZES[name]
    wrong = []
    stabilizing = 0
    latest = 0.0
    largest = np.zeros(2)
    for index in range(starts):
        weights = random_start(index, game, solution.P, functions, natural_spread(game).tolist())
        stabilizing += abscissa(game.A - game.S_control @ functions.matrix(weights)) < 0.0
        samples = functions.size + index % 80
        found = learn(game, seed=index, tick=0.2, samples=samples, initial_weights=tuple(weights))
        errors = relative_error(found.P, solution.P), relative_error(found.K, solution.K)
        largest = np.maximum(largest, errors)
        latest = max(latest, found.settling_time)
        if not (found.settled and max(errors) <= 1e-8 and found.settling_time <= 10.0):
            wrong.append((index, errors, found.outcome))
    assert wrong == []
    if starts == 1000:
        print(
            f"{name}: eP {largest[0]:.0e}, eK {largest[1]:.0e}, {stabilizing} stabilizing, settled"
            f" at {latest:.2g} s"
        )
        assert 0 < stabilizing < starts
