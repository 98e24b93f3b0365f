"""Linear models along a flight, at states that are not necessarily equilibria."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arguments import ArrayLike, checks_arguments
from hfa_support.errors import BadInputError


class Along(NamedTuple):
    """Linear models at N states of a flight.

    rates: f, time derivatives of the states, (N, n).
    A: ∂f/∂x, (N, n, n).
    B: ∂f/∂u, (N, n, m).
    """

    rates: np.ndarray
    A: np.ndarray
    B: np.ndarray


@checks_arguments
def models_along(model: Model, states: ArrayLike, inputs: ArrayLike) -> Along:
    """Return the exact linear models at states (N, n) and inputs (N, m) along a flight.

    Small deviations δx from the flight follow δx' = A(t) δx + B(t) δu. The states need not be
    equilibria. Raises BadInputError if a shape is wrong or a derivative is not finite.
    """
    n = len(model.states)
    m = len(model.inputs)
    x = np.atleast_2d(np.asarray(states, dtype=float))
    u = np.atleast_2d(np.asarray(inputs, dtype=float))
    if x.shape[1:] != (n,) or u.shape != (len(x), m):
        raise BadInputError(
            f"states and inputs have shapes {x.shape} and {u.shape}; give (N, {n}) and (N, {m})"
        )
    function = model.functions(()).map(len(x))
    f, _, A, B, *_ = function(x.T, u.T, np.tile(model.p[:, None], (1, len(x))))
    # CasADi concatenates the results for the states horizontally.
    tables = (np.array(table).reshape(n, len(x), -1).transpose(1, 0, 2) for table in (f, A, B))
    rates, A, B = tables
    finite = np.isfinite(np.concatenate([rates, A, B], axis=2)).all(axis=(1, 2))
    rates = rates[:, :, 0]
    if not finite.all():
        first = int(np.argmin(finite))
        names = (*model.states, *model.inputs)
        values = dict(zip(names, (*x[first], *u[first]), strict=True))
        reason = model.message_of_not_finite(rates[first], values, list(model.states))
        raise BadInputError(f"state {first} of the flight: {reason}")
    return Along(rates, A, B)
