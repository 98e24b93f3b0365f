"""The inputs that make the outputs follow a command filter exactly: Francis' regulator equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.design.design import Feedforward
from controller.design.design_model import DesignModel
from hfa_model.support.errors import BadInputError

#: Relative residual of the equations above which they have no solution.
RESIDUAL = 1e-9


class Regulator(NamedTuple):
    """The response x = Π w, u = Γ w to w = [r; r'; r_end]. states Π: (n, 3q). inputs Γ: (m, 3q). rates: S, w' = S w."""

    states: np.ndarray
    inputs: np.ndarray
    rates: np.ndarray


def command_rates(feedforward: Feedforward, outputs: int) -> np.ndarray:
    """S of the command filters r'' = ω² r_end - 2 ζ ω r' - ω² r, r_end constant; (3q, 3q)."""
    w, zeta = feedforward.bandwidth, feedforward.damping
    one = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * zeta * w, w**2], [0.0, 0.0, 0.0]])
    return np.kron(one, np.eye(outputs))


def regulator(plant: DesignModel, feedforward: Feedforward) -> Regulator:
    """A Π + B Γ = Π S,  C Π + D Γ = [I 0 0], with C, D of the sensors of `plant`, (q, n), which are to follow r.

    Of several solutions the smallest one. BadInputError when there is none: an output that no input moves at rest.
    Source: Francis, SIAM J. Control Optim. 15 (1977).
    """
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    (q, n), m = C.shape, B.shape[1]
    S = command_rates(feedforward, q)
    eye = np.eye(3 * q)
    equations = np.block(
        [[np.kron(eye, A) - np.kron(S.T, np.eye(n)), np.kron(eye, B)], [np.kron(eye, C), np.kron(eye, D)]]
    )
    wanted = np.concatenate([np.zeros(3 * q * n), np.eye(q, 3 * q).T.ravel()])
    found = np.linalg.lstsq(equations, wanted, rcond=1e-14)[0]
    if np.linalg.norm(equations @ found - wanted) > RESIDUAL * np.linalg.norm(wanted):
        raise BadInputError(
            f"design {plant.design.name}: no input makes {' and '.join(plant.sensors)} follow their commands; "
            "leave the feedforward out, or integrate other outputs"
        )
    states, inputs = found[: 3 * q * n].reshape(3 * q, n).T, found[3 * q * n :].reshape(3 * q, m).T
    return Regulator(states, inputs, S)
