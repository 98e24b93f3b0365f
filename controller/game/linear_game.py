"""Games on a linear model, with weights given as matrices or by signal name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.weights import (
    default_delta,
    default_disturbance,
    default_weight,
    weights_of_sizes,
)
from controller.game.zero_sum import Game
from hfa_aircraft.limits import Limits
from hfa_aircraft.signals import PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError
from hfa_support.matrices import in_order, labels_of
from trim.linear.linear_model import LinearModel, is_state_space

if TYPE_CHECKING:
    import control


def game(
    linear: LinearModel | control.StateSpace,
    *,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    E: ArrayLike | None = None,
    N: ArrayLike | None = None,
    delta: float | None = None,
    sizes: Mapping[str, float] | None = None,
) -> Game:
    """Return the game J = ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt on a linear model.

    The plant is z' = A z + B u + E d. The game keeps the names and units of the model. The defaults
    are those of the commands: of the paper's flexible aircraft, the Q, R, delta and E of the paper.

    linear: the linear model, or a `StateSpace` in continuous time
    Q: (n, n), or its diagonal, (n,), or state -> weight, with 0 for all other states
    R: (m, m), or its diagonal, (m,), or input -> weight, for every input. The defaults of Q and R
        are those of the paper's aircraft, or in the file of a linear plant, else diag(1/nominal²)
    delta: > 0; inf for LQR, without a disturbance; by default 200 for the paper's aircraft, for
        others inf
    E: (n, k), disturbance matrix; by default the identity. E=linear.E is the matrix of the model's
        winds.
    N: (n, m), cross weights; by default 0, without Q or R those in the file of a linear plant
    sizes: state or input -> deviation, in place of Q and R: deviations that are as bad as one
        another, with the weights 1/size² (Bryson's rule). A state without a size has no weight;
        each input has one

    Rows and columns of tables of pandas are put into the order of the states and inputs.

    Raises BadInputError if a name is unknown or the weight of an input is missing, and as `Game`
    does.

    >>> import hfa, numpy as np
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> hfa.game(linear, Q={"speed": 0.01}, R=np.ones(5)).Q.diagonal().tolist()
    [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    if is_state_space(linear):
        linear = LinearModel.of(linear)
    if sizes is not None:
        if Q is not None or R is not None:
            raise BadInputError("sizes define Q and R; give sizes, or Q and R")
        weights = weights_of_sizes(sizes, linear.states, linear.inputs)
        Q, R = weights["Q"], weights["R"]
    names = names_of_linear(linear)
    if E is not None and linear.disturbances and np.array_equal(E, linear.E):
        names = names._replace(disturbances=linear.disturbances)
    default = partial(
        default_weight, model=linear.model, states=linear.states, inputs=linear.inputs
    )
    if N is None and (Q is None or R is None):
        N = default("N")
    return Game(
        A=linear.A,
        B=linear.B,
        E=default_disturbance(linear.model, linear.states)
        if E is None
        else in_order("E", E, linear.states, ()),
        Q=default("Q") if Q is None else _weights("Q", Q, linear.states),
        R=default("R") if R is None else _weights("R", R, linear.inputs),
        delta=default_delta(linear.model) if delta is None else delta,
        N=in_order("N", N, linear.states, linear.inputs),
        names=names,
        half_widths=widths_within_limits(linear),
    )


def _weights(matrix: str, given: Any, names: tuple[str, ...]) -> Any:
    """Return Q or R in the order of the names, or name -> weight."""
    if len(labels_of(given)) == 1:
        return dict(given)
    return in_order(matrix, given, names, names)


def widths_within_limits(linear: LinearModel) -> np.ndarray | None:
    """Return the half-widths (n,) of the largest box of states within their limits about the trim.

    The result is None if a state has no limits, or the trim is at or beyond a limit.
    """
    limits = Limits.of(linear.model, linear.states)
    trim = linear.point.states._asdict()
    at_trim = np.array([trim[name] for name in linear.states], dtype=float)
    half_widths = np.minimum(at_trim - limits.lowest, limits.highest - at_trim)
    if not np.all(np.isfinite(half_widths) & (half_widths > 0.0)):
        return None
    return half_widths


def names_of_linear(linear: LinearModel) -> PlantNames:
    """Return the names and units of a linear model's states and inputs.

    The `origin` of the result names the model and its flight condition.
    """
    origin = f"{linear.model.title} {linear.point.at_scheduled}".rstrip()
    return PlantNames(linear.states, linear.inputs, linear.state_units, linear.input_units, origin)
