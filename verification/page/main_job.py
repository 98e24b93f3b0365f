"""The main job: both printed pairs regenerated, the sweep, and every asked angle with its game and its critic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from controller.analysis.solution_report import AnalysedGame, analyse_game
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import published_game
from controller.laws.certified import learn
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet
from hfa_model.printed_matrices import PublishedModel, published_models
from hfa_model.variants import variant_named
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import angle_text, in_degrees
from trim.linear.compare import printed_at
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import LEVEL_FLIGHT, TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from trim.sweeps.sweep import Sweep, sweep
from verification.critic.candidate import from_run
from verification.critic.check_result import CriticCheck, check_report
from verification.critic.critic_check import check_critic
from verification.regeneration.regeneration import Regeneration, regenerate_all

#: Dihedral angles of the sweep, rad: the paper's range and a little beyond.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: The angles that are shown in full: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: A page with more would be too large to file (3 MB of data), or take minutes.
MOST_SWEPT, MOST_ASKED = 151, 20


@dataclass(frozen=True, eq=False, repr=False)
class JudgedCritic(Reported):
    """The model, the run of the default law on the paper's game, and the verdict."""

    model: LinearModel
    run: LearningResult
    check: CriticCheck

    def report(self) -> Report:
        """The table of checks and the entries of P and K."""
        return check_report(self.check, *self.names)

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...], str, tuple[str, ...], tuple[str, ...]]:
        """States, inputs, what the model is called, units of states and inputs."""
        model, point = self.model, self.model.point
        origin = f"the model at dihedral {angle_text(point.states.dihedral)}, {point.dynamics} dynamics"
        return model.states, model.inputs, origin, model.state_units, model.input_units


def judged_critic(model: LinearModel) -> JudgedCritic:
    """A critic learned on a linear model with the default law and settings, compared with the exact game solution."""
    game = published_game(model.A, model.B)
    run = learn(game)
    time = run.settings["predefined_time"]
    return JudgedCritic(model, run, check_critic(game, from_run(game, run), run=run, predefined_time=time))


@dataclass(frozen=True, eq=False)
class Angle:
    """The trim and the linear model at a dihedral angle (rad); of an asked angle the game and its critic too.

    printed: None where the paper prints no pair. model, solution, critic: None where there is none; `reason` says why.
    """

    dihedral: float
    condition: TrimCondition
    model: LinearModel | None = None
    printed: PublishedModel | None = None
    solution: AnalysedGame | None = None
    critic: JudgedCritic | None = None
    reason: str = ""

    @property
    def dihedral_deg(self) -> float:
        """As it was asked for, degrees."""
        return in_degrees(self.dihedral)

    @property
    def ok(self) -> bool:
        """Whether there is a trim, a certified solution, and a critic that agrees with it."""
        return self.critic is not None and self.critic.check.ok


def trimmed_angle(
    aircraft: Aircraft,
    dihedral: float,
    outputs: tuple[str, ...] | None = None,
    flight: TrimCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
) -> Angle:
    """Trim and linearize a flight at a dihedral angle, rad; an angle without a trim keeps the reason."""
    condition = flight.at(dihedral, {"dihedral": dihedral})
    try:
        point = find_operating_point(aircraft, condition, start)
    except NoSolutionError as error:
        return Angle(dihedral, condition, reason=str(error))
    return Angle(dihedral, condition, linearize(aircraft, point, outputs=outputs))


def with_game(angle: Angle) -> Angle:
    """The same with the game solved, and a critic learned and compared with the solution."""
    model = angle.model
    if model is None:
        return angle
    angle = replace(angle, printed=printed_at(model.point))
    try:
        return replace(angle, solution=analyse_game(published_game(model.A, model.B)), critic=judged_critic(model))
    except NoSolutionError as error:
        return replace(angle, reason=str(error))


@dataclass(frozen=True, eq=False)
class StoredClaims:
    """The table of claims that `python -m studies.section5` stored, and the file it was read from."""

    path: Path
    table: dict[str, Any]


@dataclass(frozen=True, eq=False)
class MainJob:
    """One aircraft: both pairs regenerated, trims and models over the dihedral angle, asked angles in full.

    points: one for each angle of the sweep. claims: None where none were given.
    """

    aircraft: Aircraft
    parameters: ParameterSet
    regeneration: Regeneration
    sweep: Sweep
    points: tuple[Angle, ...]
    angles: tuple[Angle, ...]
    claims: StoredClaims | None = None

    @property
    def learned(self) -> bool:
        """Whether every learned critic agrees with the exact game solution."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """Whether everything holds; what became of the paper's claims is a finding and not counted."""
        return self.regeneration.ok and self.learned


def main_job(
    parameters: ParameterSet,
    dynamics: str,
    *,
    asked: Sequence[float] = ASKED,
    swept: np.ndarray = SWEEP,
    outputs: tuple[str, ...] | None = None,
    claims: StoredClaims | None = None,
    flight: TrimCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    progress: Progress = lambda *_: None,
) -> MainJob:
    """Regenerate both pairs, sweep the dihedral angle, and solve, learn and compare at each asked angle (rad).

    asked: the sweep visits these too. flight, start: the trimmed flight, as of `sweep`; the printed pairs are
    at the paper's condition.
    """
    aircraft = Aircraft(parameters.values, variant_named(dynamics))
    progress(0.0, 1.0, "printed pairs")
    regeneration = regenerate_all(aircraft)
    progress(0.05, 1.0, "sweep")
    swept = np.union1d(swept, asked)
    over = sweep(aircraft, {"dihedral": swept}, condition=flight, start=start)
    points = tuple(trimmed_angle(aircraft, float(angle), None, flight, start) for angle in swept)
    found = []
    for count, angle in enumerate(asked):
        progress(0.1 + 0.9 * count / len(asked), 1.0, f"dihedral {angle_text(angle)}")
        found.append(with_game(trimmed_angle(aircraft, angle, outputs, flight, start)))
    progress(1.0, 1.0)
    return MainJob(aircraft, parameters, regeneration, over, points, tuple(found), claims)
