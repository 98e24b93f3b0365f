"""A discrete-time plant as a `Model`, for simulations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from controller.game.game_file import stored_game
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_support.errors import BadInputError


def step_model(path: Path) -> Model:
    """Return the model of a discrete-time plant with the rates A x + B u - x.

    The rates are the change of the state in one step.

    path: plant file

    Raises BadInputError if the plant is in continuous time.
    """
    problem = stored_game(path).discrete
    if problem is None:
        raise BadInputError(
            f'{path} is in continuous time, but hfa fly --model requires time = "discrete"; for '
            "a continuous-time plant, give --aircraft FILE.npz instead of --model"
        )
    step = problem.step
    names = step.names

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        rates = {}
        for i, name in enumerate(names.states):
            rates[name] = -x[i]
            for j in range(len(names.states)):
                rates[name] += step.A[i, j] * x[j]
            for j in range(len(names.inputs)):
                rates[name] += step.B[i, j] * u[j]
        return rates, {}

    states = {
        name: Signal(unit or "1")
        for name, unit in zip(names.states, names.state_units, strict=True)
    }
    inputs = {
        name: Signal(unit or "1")
        for name, unit in zip(names.inputs, names.input_units, strict=True)
    }
    return Model(str(path), states, inputs, equations)
