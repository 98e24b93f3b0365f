"""Time histories of flights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from hfa_support.reporting.report import Reported


@dataclass(frozen=True, repr=False)
class Deviations(Reported):
    """Time history of a flight in deviations from the trim, one row for each of N steps.

    times: (N,), s
    states: (N, n), states of the plant
    errors: (N, k), z = x - x_d of the states of the linear model, without noise
    inputs: (N, m)
    limited: (N, n), absolute values of the variables with limits
    winds: disturbance of the model that the scenario sets -> (N,)
    cost: (N,), cost from the start of the flight, or None for a loop without a cost
    integration_error: sum of the errors of the steps of the integration that could not be made
        short enough, relative to the largest deviation in nominal values; otherwise 0
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    limited: np.ndarray
    winds: dict[str, np.ndarray]
    cost: np.ndarray | None = None
    integration_error: float = 0.0


def series(
    model: Model, states: np.ndarray, inputs: np.ndarray, name: str, p: np.ndarray
) -> np.ndarray:
    """Return the values, (N,), of a state, an input or an output of a model during a flight.

    states, inputs: absolute, (N, n) and (N, m)
    p: parameters of the simulated model

    Raises BadInputError if the name is unknown.
    """
    refuse_unknown("unknown variable", name, (*model.states, *model.inputs, *model.outputs))
    if name in model.states:
        return np.asarray(states[:, list(model.states).index(name)])
    if name in model.inputs:
        return np.asarray(inputs[:, list(model.inputs).index(name)])
    count = len(states)
    parameters = np.tile(p[:, None], (1, count))
    # (X, U, p) -> (rates, this output), of all N rows at once
    _, outputs = model.functions((name,)).map(count)(states.T, inputs.T, parameters)
    return np.array(outputs).ravel()
