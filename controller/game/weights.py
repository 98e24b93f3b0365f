"""Default weights of a game, and one-line text of weights."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from controller.game.zero_sum import Game
from hfa_aircraft.model import Model

#: Matrices with more entries are summarized.
_SHOWN = 40


def nominal_weights(model: Model, names: Iterable[str]) -> np.ndarray:
    """Return diag(1/nominal²) for these states or inputs.

    With these weights, the cost rate of a deviation of nominal size is 1.
    """
    return np.diag([model.signals[name].nominal ** -2.0 for name in names])


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


def cost_text(
    model: Model,
    names: Sequence[str],
    Q: np.ndarray,
    R: np.ndarray,
    of_file: Collection[str] = (),
) -> str:
    """Return Q and R as one line of text, marked as "file", or as "default" where they equal
    1/nominal².

    The text is, for example, "Q diag(1, 2), R diag(1) (default 1/nominal^2)".

    names: states of Q, then inputs of R
    of_file: names of the weights that a plant file contains
    """
    parts = []
    for name, weight, signals in (("Q", Q, names[: len(Q)]), ("R", R, names[len(Q) :])):
        is_usual = np.allclose(weight, nominal_weights(model, signals), rtol=1e-12, atol=0.0)
        source = " (file)" if name in of_file else " (default 1/nominal^2)" * is_usual
        parts.append(f"{name} {matrix_text(weight)}{source}")
    return ", ".join(parts)


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
