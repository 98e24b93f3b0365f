"""Everything about one dihedral angle: trim, linear model, its print, the exact game solution, a learned critic."""

from __future__ import annotations

from dataclasses import dataclass

from controller.game.zero_sum import published_game
from hfa_model.aircraft import Aircraft
from hfa_model.published import PublishedModel
from hfa_model.reporting.text import in_degrees
from hfa_model.support.errors import NoSolutionError
from trim.linear.compare import printed_at
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import TrimCondition
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from verification.meaning.solution_report import AnalysedGame, analyse_game
from verification.published.judged_critic import JudgedCritic, judged_critic


@dataclass(frozen=True, eq=False)
class TrimmedAngle:
    """The trim and the linear model at a dihedral angle (rad); without a trim no model, and `reason` says why."""

    dihedral: float
    condition: TrimCondition
    model: LinearModel | None = None
    reason: str = ""

    @property
    def dihedral_deg(self) -> float:
        """As it was asked for, degrees."""
        return in_degrees(self.dihedral)


@dataclass(frozen=True, eq=False)
class AngleResult:
    """A trimmed angle with its print, and on the paper's game the exact solution and the critic learned.

    printed: None where the paper prints no pair. solution, critic: None where there is none, `reason` says why.
    """

    trimmed: TrimmedAngle
    printed: PublishedModel | None = None
    solution: AnalysedGame | None = None
    critic: JudgedCritic | None = None
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether there is a trim, a certified solution, and a critic that agrees with it."""
        return self.critic is not None and self.critic.check.ok


def trimmed_angle(
    aircraft: Aircraft,
    dihedral: float,
    outputs: tuple[str, ...] | None = None,
    flight: NamedCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
) -> TrimmedAngle:
    """Trim and linearize a flight at a dihedral angle; an angle without a trim keeps the reason."""
    condition = flight.at(dihedral, {"dihedral": dihedral})
    try:
        point = find_operating_point(aircraft, condition, start)
    except NoSolutionError as error:
        return TrimmedAngle(dihedral, condition, reason=str(error))
    return TrimmedAngle(dihedral, condition, linearize(aircraft, point, outputs=outputs))


def angle_result(
    aircraft: Aircraft,
    dihedral: float,
    outputs: tuple[str, ...] | None = None,
    flight: NamedCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
) -> AngleResult:
    """The same with the game solved, and a critic learned and compared with the solution."""
    trimmed = trimmed_angle(aircraft, dihedral, outputs, flight, start)
    model = trimmed.model
    if model is None:
        return AngleResult(trimmed, reason=trimmed.reason)
    printed = printed_at(model.point)
    try:
        solution = analyse_game(published_game(model.A, model.B))
        return AngleResult(trimmed, printed, solution, judged_critic(model))
    except NoSolutionError as error:
        return AngleResult(trimmed, printed, reason=str(error))
