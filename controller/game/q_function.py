"""Q-function of a game in discrete time: the cost of one step, followed by the cost z'P z."""

from __future__ import annotations

import math

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError
from hfa_support.matrices import LARGEST, checked_matrix, shape_text

#: Asymmetry of H relative to its largest entry that rounding to six printed digits explains.
_ROUNDED = 1e-6


def q_function(game: Game, P: np.ndarray) -> np.ndarray:
    """Return H (n + m + k, n + m + k) of the Q-function Q(x, u, w) = [x; u; w]'H [x; u; w].

      H = [[Q, N, 0], [N', R, 0], [0, 0, -δ² I]] + α [A B E]'P [A B E]

    With δ = inf, H is over (x, u), (n + m, n + m).

    P: (n, n)
    """
    plant = np.hstack([game.A, game.B])
    weights = game.weights
    if math.isfinite(game.delta):
        plant = np.hstack([plant, game.E])
        disturbances = game.E.shape[1]
        weights = np.pad(weights, (0, disturbances))
        weights[-disturbances:, -disturbances:] = -(game.delta**2) * np.eye(disturbances)
    return np.asarray(weights + game.discount * plant.T @ P @ plant)


def q_extremum(game: Game, H: np.ndarray) -> dict[str, np.ndarray]:
    """Return P, K and L, name -> matrix, at the extremum of a Q-function over u and w.

      [K; -L] = H_aa⁻¹ H_ax,  P = H_xx - H_xa H_aa⁻¹ H_ax,  a = (u, w)

    L is omitted if H is over (x, u).

    H: symmetric matrix of the Q-function, over (x, u, w) or (x, u). With δ = inf, only over (x,
        u).

    Raises BadInputError if H has a wrong shape or is not symmetric, or if H_aa is singular.
    """
    n, m = game.B.shape
    shapes = {"(x, u)": (n + m,) * 2}
    if math.isfinite(game.delta):
        shapes["(x, u, w)"] = (n + m + game.E.shape[1],) * 2
    H = checked_matrix("H", H, LARGEST)
    if H.shape not in shapes.values():
        rules = [f"{shape_text(shape)} over {vectors}" for vectors, shape in shapes.items()]
        raise BadInputError(f"H is {shape_text(H.shape)}; give {' or '.join(rules)}")
    asymmetry = np.abs(H - H.T)
    if asymmetry.max() > _ROUNDED * np.abs(H).max():
        row, column = np.unravel_index(asymmetry.argmax(), H.shape)
        raise BadInputError(
            f"H is not symmetric (row {row + 1}, column {column + 1}); give (H + H')/2"
        )
    try:
        gains = np.linalg.solve(H[n:, n:], H[n:, :n])
    except np.linalg.LinAlgError as error:
        raise BadInputError(
            "the block of H over the inputs is singular, so no optimal input exists; correct H"
        ) from error
    parts = {"P": H[:n, :n] - H[:n, n:] @ gains, "K": gains[:m]}
    if len(H) > n + m:
        parts["L"] = -gains[m:]
    return parts
