"""What delta means to a person: what the worst updraft costs, and how large an error of the dihedral costs as much."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from controller.design.design_model import DesignModel
from controller.game.zero_sum import Game
from controller.riccati.frequency_response import square_root, swept_gain
from hfa_support.reporting.text import shown_unit, shown_value

#: rad/s; an updraft of a lower frequency is as good as steady.
STEADY = 1e-4


class GustCost(NamedTuple):
    """The largest ∫ z'Qz + u'Ru over all updrafts w with ∫ w² dt = 1 ft²/s, from rest, and the frequency of the worst.

    cost: in the units of the weights. frequency: rad/s. dihedral: rad, the error that costs as much in 1 s; nan where
    the dihedral has no weight.
    """

    cost: float
    frequency: float
    dihedral: float

    def to_dict(self) -> dict[str, Any]:
        """With the steady updraft that has the energy in 1 s."""
        return {**self._asdict(), "updraft": {"value": 1.0, "unit": "ft/s"}}

    def text(self) -> str:
        """For a person."""
        error = f"{math.degrees(self.dihedral):.3g} deg of dihedral for 1 s"
        alike = "" if math.isnan(self.dihedral) else f", as much as {error}"
        kind = "a steady one" if self.frequency < STEADY else f"at {self.frequency:.3g} rad/s"
        worst = f"Worst updraft with the energy of {shown_value(1.0, 'ft/s')} {shown_unit('ft/s')} for 1 s: {kind}"
        return f"{worst}, costs {self.cost:.4g}{alike}"


def gust_cost(built: DesignModel, game: Game, K: np.ndarray) -> GustCost:
    """Of u = -K z. game: of `built`, with the weights that count. The column of the updraft is that of `built.gust`."""
    return _cost(
        built, game, game.A - game.B @ K, built.gust, np.vstack([square_root(game.Q), square_root(game.R) @ K])
    )


def estimated_gust_cost(
    built: DesignModel, game: Game, controller: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> GustCost:
    """Of x̂' = Ak x̂ + Bk y, u = Ck x̂ on sensors without noise; a gust that a sensor sees itself is left out of it."""
    Ak, Bk, Ck = controller
    loop = np.block([[game.A, game.B @ Ck], [Bk @ built.C, Ak + Bk @ built.D @ Ck]])
    n, m, nk = len(game.A), len(game.R), len(Ak)
    paid = np.block([[square_root(game.Q), np.zeros((n, nk))], [np.zeros((m, n)), square_root(game.R) @ Ck]])
    return _cost(built, game, loop, np.vstack([built.gust, np.zeros((len(Ak), 1))]), paid)


def _cost(built: DesignModel, game: Game, loop: np.ndarray, into: np.ndarray, paid: np.ndarray) -> GustCost:
    closed = Game(A=loop, B=np.zeros((len(loop), 1)), E=into, Q=paid.T @ paid, R=np.eye(1), delta=math.inf)
    found = swept_gain(closed, np.zeros((1, len(loop))))
    place = built.states.index("dihedral")
    weight = float(game.Q[place, place])
    alike = found.gain / math.sqrt(weight) if weight > 0.0 else math.nan
    return GustCost(found.gain**2, found.frequency, alike)
