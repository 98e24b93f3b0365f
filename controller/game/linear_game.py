"""Games on a linear model, with weights given as matrices or by signal name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.names import names_of_linear
from controller.game.weights import nominal_weights
from controller.game.zero_sum import Game
from hfa_support.arguments import ArrayLike, checks_arguments
from hfa_support.errors import BadInputError, refuse_unknown, shown
from trim.linear.linear_model import LinearModel


@checks_arguments
def game(
    linear: LinearModel,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    delta: float = np.inf,
    E: ArrayLike | None = None,
    N: ArrayLike | None = None,
) -> Game:
    """Return the game J = ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt on a linear model.

    The plant is z' = A z + B u + E d. The game keeps the names and units of the model.

    linear: the linear model, with A and B
    Q: (n, n), or its diagonal, (n,), or state -> weight, with 0 for all other states; by default
        diag(1/nominal²)
    R: (m, m), or its diagonal, (m,), or input -> weight, for every input; by default
        diag(1/nominal²)
    delta: > 0; inf for LQR, without a disturbance
    E: (n, k), disturbance matrix; by default the matrix of the model's disturbances, or the
        identity if it has none
    N: (n, m), cross weights; by default 0

    Raises BadInputError if a name is unknown or the weight of an input is missing, and as `Game`
    does.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> hfa.game(linear, Q={"speed": 0.01}).Q.diagonal().tolist()
    [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    if E is None:
        E = linear.E if linear.disturbances else np.eye(len(linear.A))
    return Game(
        A=linear.A,
        B=linear.B,
        E=E,
        Q=_weights("Q", Q, linear, linear.states),
        R=_weights("R", R, linear, linear.inputs),
        delta=delta,
        N=N,
        names=names_of_linear(linear),
    )


def _weights(matrix: str, given: Any, linear: LinearModel, names: tuple[str, ...]) -> np.ndarray:
    """Return Q or R as an array, diag(1/nominal²) for None.

    A given matrix or diagonal keeps its shape.

    matrix: "Q" or "R", for messages
    given: a matrix, its diagonal, name -> weight, or None
    linear: linear model with the nominal values
    names: names of the states or inputs

    Raises BadInputError for an unknown name, a weight that is not a number, or an input without a
    weight.
    """
    if given is None:
        return nominal_weights(linear.model, names)
    if not isinstance(given, Mapping):
        return np.asarray(given)
    for name, weight in given.items():
        refuse_unknown(f"{matrix} weights an unknown name", name, names)
        if not isinstance(weight, (int, float, np.number)):
            raise BadInputError(f"the {matrix} weight of {name} is {shown(weight)}; give a number")
    missing = [name for name in names if name not in given]
    if matrix == "R" and missing:
        raise BadInputError(
            f"R has no weight for {', '.join(missing)}; give a weight for each input"
        )
    return np.diag([float(given.get(name, 0.0)) for name in names])
