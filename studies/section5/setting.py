"""What is simulated in Section 5: the two aircraft, their games and exact solutions, and the reference's signals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.zero_sum import Game, published_game
from controller.policy.signals import Harmonic, Signal
from controller.riccati.feedforward import Exosystem, exosystem, exosystem_feedforward
from controller.riccati.gare import GameSolution, solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import default_parameters
from hfa_model.printed_matrices import published_models
from hfa_model.vectors import LINEAR_STATES
from hfa_support.errors import refuse_unknown
from studies.section5.configuration import Configuration
from trim.linear.compare import regenerate
from trim.point.condition import CONTROL_LIMITS

#: The two aircraft of Section 5.1, degrees of dihedral.
CASE_I, CASE_II = 15.0, 5.0
#: Where A and B come from: this project's trim and linearization, or the paper's four decimals.
MATRICES = ("regenerated", "printed")
_ALPHA = LINEAR_STATES.index("alpha")


@dataclass(frozen=True, eq=False)
class PaperCase:
    """One aircraft of Section 5.1. trim_inputs: U0, (5,), of the trim that is linearized."""

    dihedral_deg: float
    game: Game
    trim_inputs: np.ndarray

    @property
    def input_limits(self) -> np.ndarray:
        """Lowest and highest deviations of the inputs, (2, 5), of those of a trim here; the paper has none."""
        limits: np.ndarray = np.array(CONTROL_LIMITS).T - self.trim_inputs
        return limits

    @cached_property
    def exact(self) -> GameSolution:
        """The exact solution of the game."""
        return solve_game(self.game)

    def reweighted(self, alpha_factor: float) -> PaperCase:
        """The same aircraft with the weight of the angle of attack multiplied."""
        factors = np.ones(len(LINEAR_STATES))
        factors[_ALPHA] = alpha_factor
        return replace(self, game=replace(self.game, Q=self.game.Q * np.diag(factors)))


@dataclass(frozen=True, eq=False)
class Setting:
    """The configuration and the two aircraft, 15 degrees first. matrices: one of `MATRICES`."""

    configuration: Configuration
    matrices: str
    cases: tuple[PaperCase, ...]

    def case(self, dihedral_deg: float) -> PaperCase:
        """The aircraft of that dihedral angle."""
        return next(case for case in self.cases if case.dihedral_deg == dihedral_deg)

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the numbers, as plain values."""
        models = [
            {"dihedral_deg": case.dihedral_deg, "A": case.game.A.tolist(), "B": case.game.B.tolist()}
            for case in self.cases
        ]
        return {"matrices": self.matrices, "models": models, "reading": self.configuration.to_dict()}


def make_setting(configuration: Configuration, matrices: str = "regenerated") -> Setting:
    """Both aircraft: trimmed and linearized with the published dynamics, or with the printed A and B.

    Raises BadInputError for an unknown source of matrices.
    """
    refuse_unknown("unknown matrices", matrices, MATRICES)
    aircraft = Aircraft(default_parameters().values, "published")
    cases = []
    for published in published_models():
        model = regenerate(aircraft, published)
        source = published if matrices == "printed" else model
        cases.append(PaperCase(published.dihedral_deg, published_game(source.A, source.B), model.input_offsets))
    return Setting(configuration, matrices, tuple(cases))


def generator(reference: Signal) -> Signal:
    """w = [1, t, sin f₁t, cos f₁t, ...]: the signals that a reference is made of, (2 + 2 k,)."""
    unit = np.eye(2 + 2 * len(reference.harmonics))
    waves = tuple(
        Harmonic(harmonic.frequency, unit[2 + 2 * i], unit[3 + 2 * i]) for i, harmonic in enumerate(reference.harmonics)
    )
    return Signal(unit[0], unit[1], waves)


def exosystem_of(reference: Signal) -> Exosystem:
    """x_d = C w, w' = Ω w, with the w of `generator`."""
    return exosystem(reference.constant, reference.slope, *reference.harmonics)


def feedforward(case: PaperCase, reference: Signal) -> np.ndarray:
    """F with u = -K z + F w(t) the exact answer to a reference: F = -R⁻¹B'P_s, (5, k)."""
    P_s = exosystem_feedforward(case.game, case.exact.P, exosystem_of(reference))
    return -case.game.R_inverse_B_transposed @ P_s
