"""The game of who sees only measured outputs, as a generalized plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from controller.game.array_file import checked_matrix
from controller.game.zero_sum import LARGEST, Game, check_definite
from controller.riccati.frequency_response import square_root
from controller.riccati.generalized_plant import (
    GeneralizedPlant,
    OutputFeedback,
    PlantDeltaMin,
    central_controller as central,
    minimum_plant_delta,
    scaled_root,
    solve_plant,
)
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown


@dataclass(frozen=True, eq=False, repr=False)
class OutputGame(Shown):
    """The game of `game` for who sees only y = C z + D u + n.

    C: (p, n). D: (p, m). V: (p, p) intensity of the measurement noise n, symmetric positive definite: n = V^½ v with v
    part of the disturbance, J = ∫ z'Qz + u'Ru - δ² (d'd + v'v). BadInputError when a shape or a sign is wrong.
    """

    game: Game
    C: np.ndarray
    D: np.ndarray
    V: np.ndarray

    def __post_init__(self) -> None:
        """Check everything once, so that no solver has to."""
        for name in ("C", "D", "V"):
            object.__setattr__(self, name, checked_matrix(name, getattr(self, name), LARGEST))
        n, m = self.game.B.shape
        p = len(self.C)
        for name, shape in (("C", (p, n)), ("D", (p, m)), ("V", (p, p))):
            found = getattr(self, name).shape
            if found != shape:
                raise BadInputError(f"{name} has shape {found}; with these outputs and states it must be {shape}")
        if p == 0:
            raise BadInputError("no output is measured; name at least one")
        check_definite("V", self.V, strictly=True)

    @property
    def dual(self) -> Game:
        """The game whose Riccati equation is the filter's: A', C', Q^½, E E', V in place of A, B, E, Q, R."""
        return Game(
            A=self.game.A.T,
            B=self.C.T,
            E=scaled_root(self.game.Q),
            Q=self.game.S_disturbance,
            R=self.V,
            delta=self.game.delta,
        )

    @cached_property
    def plant(self) -> GeneralizedPlant:
        """From w = (d, v) to z = (Q^½ x, R^½ u)."""
        game, noise = self.game, square_root(self.V)
        n, m, p, k = len(game.A), len(game.R), len(noise), game.E.shape[1]
        return GeneralizedPlant(
            A=game.A,
            B1=np.hstack([game.E, np.zeros((n, p))]),
            B2=game.B,
            C1=np.vstack([scaled_root(game.Q).T, np.zeros((m, n))]),
            D12=np.vstack([np.zeros((n, m)), square_root(game.R)]),
            C2=self.C,
            D21=np.hstack([np.zeros((p, k)), noise]),
            D22=self.D,
        )

    def with_delta(self, delta: float) -> OutputGame:
        """The same at another disturbance weight."""
        return replace(self, game=self.game.with_delta(delta))


def solve_output_feedback(problem: OutputGame) -> OutputFeedback:
    """A'X + XA + Q - X (B R⁻¹B' - δ⁻²E E') X = 0,   A Y + Y A' + E E' - Y (C'V⁻¹C - δ⁻²Q) Y = 0,   ρ(XY) < δ²,

        Ck = -R⁻¹B'X,  Bk = Z Y C'V⁻¹,  Z = (I - δ⁻² Y X)⁻¹,  Ak = A + δ⁻²E E'X + B Ck - Bk (C + D Ck).

    delta = inf is LQG. Raises NoSolutionError that names which of the three conditions fails, or the check.
    Source: Doyle, Glover, Khargonekar, Francis, IEEE Trans. Automatic Control 34 (1989), 831-847, Theorem 3.
    """
    found = solve_plant(problem.plant, problem.game.delta)
    assert isinstance(found, OutputFeedback)
    return found


def minimum_output_delta(problem: OutputGame) -> PlantDeltaMin:
    """The smallest δ of the three conditions, bracketed; NoSolutionError when they fail at δ = inf."""
    return minimum_plant_delta(problem.plant)


def central_controller(problem: OutputGame, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ak, Bk, Ck of `solve_output_feedback` from X and Y, whatever they are: nothing is certified."""
    return central(problem.plant, X, Y, problem.game.delta)[:3]
