"""Default cost and disturbance of a game, and one-line text of weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from controller.game.zero_sum import Game
from hfa_aircraft.model import Model
from hfa_support.errors import (
    BadInputError,
    numbers_in,
    prefix_errors,
    refuse_unknown,
    refuse_unless_positive,
)
from hfa_support.matrices import LARGEST, checked_matrix, shape_text
from hfa_support.reporting.text import with_unit

#: Matrices with more entries are summarized.
_SHOWN = 40


def default_weight(
    matrix: str, model: Model, states: Sequence[str], inputs: Sequence[str]
) -> np.ndarray:
    """Return the default Q, R or N: that of the model, else diag(1/nominal²) or 0.

    With diag(1/nominal²), the cost rate of a deviation of nominal size is 1.

    matrix: "Q", "R" or "N"
    states, inputs: linear states and inputs of the rows and columns

    Raises BadInputError, which names the model, if the matrix in the file has a wrong shape.
    """
    names_of = {"Q": (states, states), "R": (inputs, inputs), "N": (states, inputs)}
    rows, columns = names_of[matrix]
    stored = model.about.weights.get(matrix)
    if stored is None and matrix == "N":
        return np.zeros((len(states), len(inputs)))
    if stored is None:
        return np.diag([model.signals[name].nominal ** -2.0 for name in rows])
    if isinstance(stored, Mapping):
        declared = [stored.get(name, 0.0) for name in rows]
        units = [model.native_factor(name) for name in rows]
        return np.diag(declared / np.square(units))
    # A plant file has the weights of states and inputs divided by their nominal values.
    weight = _matrix_of_file(matrix, model)
    places = {name: place for place, name in enumerate(model.linear)}
    places |= {name: place for place, name in enumerate(model.inputs)}
    row_places = [places[name] for name in rows]
    column_places = [places[name] for name in columns]
    weight_of_names = weight[np.ix_(row_places, column_places)]
    return np.asarray(weight_of_names / np.outer(model.nominal(rows), model.nominal(columns)))


def weights_of_sizes(
    sizes: Mapping[str, float], states: Sequence[str], inputs: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return Q and R, name -> 1/size², of deviations that are as bad as one another.

    Source: Bryson and Ho, Applied Optimal Control, 1975, Section 5.2.

    Raises BadInputError for an unknown name, and a size that is not positive.
    """
    for name, size in sizes.items():
        refuse_unknown("sizes has an unknown name", name, (*states, *inputs))
        refuse_unless_positive(f"the size of {name}", size)
    weights = {name: 1.0 / size / size for name, size in sizes.items()}
    signals = {"Q": states, "R": inputs}
    return {
        matrix: {name: weights[name] for name in names if name in weights}
        for matrix, names in signals.items()
    }


def sizes_text(game: Game) -> str:
    """Return the sizes of which Q and R are 1/size² as text: "speed 10 ft/s, alpha 5 deg"."""
    states, inputs, state_units, input_units, *_ = game.names
    weights = np.diag(game.weights).tolist()
    rows = zip(states + inputs, state_units + input_units, weights, strict=True)
    return ", ".join(f"{name} {with_unit(w**-0.5, unit, 0.0)}" for name, unit, w in rows if w)


def _matrix_of_file(matrix: str, model: Model) -> np.ndarray:
    """Return Q, R or N of the file of a linear plant, for all linear states and inputs.

    Raises BadInputError, which names the model, if the matrix has a wrong shape.
    """
    n, m = len(model.linear), len(model.inputs)
    shape = {"Q": (n, n), "R": (m, m), "N": (n, m)}[matrix]
    with prefix_errors(model.name):
        weight = numbers_in(matrix, model.about.weights[matrix])
        if weight.ndim == 1 and matrix != "N":
            weight = np.diag(weight)
        weight = checked_matrix(matrix, weight, LARGEST)
        if weight.shape != shape:
            rule = f"give {shape_text(shape)}, to match A and B"
            raise BadInputError(f"{matrix} is {shape_text(weight.shape)}; {rule}")
    return weight


def default_delta(model: Model) -> float:
    """Return the default disturbance weight δ: that of the model, else inf (LQR)."""
    return float(model.about.weights.get("delta", np.inf))


def default_disturbance(model: Model, states: Sequence[str]) -> np.ndarray:
    """Return the default E, (n, k): a column for each state that the model names, or for all.

    A column is a unit in which the model declares the rate of the state.
    """
    named = model.about.weights.get("E", states)
    disturbed = [place for place, name in enumerate(states) if name in named]
    units = [model.rate_scale(name) / model.native.rate_scale(name) for name in states]
    return np.diag(units)[:, disturbed]


def weights_line(game: Game, whose: Mapping[str, str] | None = None) -> str:
    """Return Q, R and delta, N unless it is 0, and E as one line of text.

    The text is, for example, "Q diag(1, 2) (given), R diag(1) (default), delta inf (default), E
    identity".

    whose: "Q", "R", "delta" and "N" -> source of the weight; None if all weights are those of a
        given game
    """
    texts = {"Q": matrix_text(game.Q), "R": matrix_text(game.R), "delta": f"{game.delta:g}"}
    if game.N.any():
        texts["N"] = matrix_text(game.N)
    whose = whose or dict.fromkeys(texts, "of the game")
    weights = [f"{name} {text} ({whose[name]})" for name, text in texts.items()]
    return ", ".join([*weights, disturbance_text(game)])


def disturbance_text(game: Game) -> str:
    """Return the disturbance matrix of a game as text: "E identity", "E gust" or "E [0; 1]"."""
    if np.array_equal(game.E, np.eye(len(game.A))):
        return "E identity"
    return f"E {', '.join(game.names.disturbances) or matrix_text(game.E)}"


def matrix_text(matrix: np.ndarray) -> str:
    """Return a weight matrix as one line of text: "diag(1, 2)" or "[1 0; 3 2]".

    If more than `_SHOWN` numbers would be listed, the text contains their count and range instead.
    """
    diagonal = np.diag(matrix)
    is_diagonal = len(matrix) == matrix.shape[1] and np.array_equal(matrix, np.diag(diagonal))
    shown = diagonal if is_diagonal else matrix
    if shown.size > _SHOWN:
        kind = "diag" if is_diagonal else "matrix"
        return f"{kind} of {shown.size} entries from {shown.min():g} to {shown.max():g}"
    if is_diagonal:
        return f"diag({', '.join(f'{entry:g}' for entry in diagonal)})"
    rows = [" ".join(f"{entry:g}" for entry in row) for row in matrix]
    return f"[{'; '.join(rows)}]"
