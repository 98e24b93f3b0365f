"""Default weights of a game, and one-line text of weights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from hfa_aircraft.model import Model

#: Matrices with more entries are summarized.
_SHOWN = 40


def nominal_weights(model: Model, names: Iterable[str]) -> np.ndarray:
    """Return diag(1/nominal²) for these states or inputs.

    With these weights, the cost rate of a deviation of nominal size is 1.
    """
    return np.diag([model.signals[name].nominal ** -2.0 for name in names])


def weights_line(
    Q: np.ndarray,
    R: np.ndarray,
    delta: float,
    whose: Mapping[str, str] | None = None,
    N: np.ndarray | None = None,
) -> str:
    """Return Q, R and delta, and N unless it is 0, as one line of text.

    The text is, for example, "Q diag(1, 2) (given), R diag(1) (default), delta inf (default)".

    whose: "Q", "R", "delta" and "N" -> source of the weight; None if all weights are those of a
        given game
    N: cross weights, (n, m), or None for 0
    """
    texts = {"Q": matrix_text(Q), "R": matrix_text(R), "delta": f"{delta:g}"}
    if N is not None and N.any():
        texts["N"] = matrix_text(N)
    whose = whose or dict.fromkeys(texts, "of the game")
    return ", ".join(f"{name} {text} ({whose[name]})" for name, text in texts.items())


def cost_text(model: Model, names: Sequence[str], Q: np.ndarray, R: np.ndarray) -> str:
    """Return Q and R as one line of text, marked as "default" where they equal 1/nominal².

    The text is, for example, "Q diag(1, 2), R diag(1) (default 1/nominal^2)".

    names: states of Q, then inputs of R
    """
    parts = []
    for name, weight, signals in (("Q", Q, names[: len(Q)]), ("R", R, names[len(Q) :])):
        is_usual = np.allclose(weight, nominal_weights(model, signals), rtol=1e-12, atol=0.0)
        parts.append(f"{name} {matrix_text(weight)}" + " (default 1/nominal^2)" * is_usual)
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
