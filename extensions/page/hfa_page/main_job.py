"""The main job: regeneration of both printed pairs, a sweep, and games and critics at requested
angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.hfa_files import published_game
from controller.learning.certified import learn
from controller.riccati.solution_report import AnalysedGame, solve
from hfa_aircraft.model import Model
from hfa_model import choice
from hfa_model.parameters import ParameterSet
from hfa_model.printed_matrices import published_models
from hfa_model.variants import variant_named
from hfa_page.claims import Claims
from hfa_page.flights import StoredFlights
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.text import in_degrees
from trim.hfa.level_flight import LEVEL_FLIGHT
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from trim.sweeps.sweep import Sweep, sweep
from verification.critic.critic_check import Scope, check_critic
from verification.critic.verdict import Verdict
from verification.hfa_box import ordinary_box
from verification.regeneration import Regeneration, regenerate_all

#: Dihedral angles of the sweep, rad: the paper's range and a little beyond.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: The angles that are shown in full: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: A page with more would be too large to file (3 MB of data), or take minutes.
MOST_SWEPT = 151
MOST_ASKED = 20


@dataclass(frozen=True, eq=False)
class Angle:
    """Trim and linear model at a dihedral angle, rad.

    A requested angle also has the exact solution of the paper's game, and a critic learned with the
    default law and compared with it.

    model, solution, check: None if not computed; `reason` states why.
    """

    dihedral: float
    condition: TrimCondition
    model: LinearModel | None = None
    solution: AnalysedGame | None = None
    check: Verdict | None = None
    reason: str = ""

    @property
    def dihedral_deg(self) -> float:
        """The requested angle, degrees."""
        return in_degrees(self.dihedral)

    @property
    def ok(self) -> bool:
        """True if there is a trim, a certified solution, and a critic that agrees with it."""
        return self.check is not None and self.check.ok


def trimmed_angle(
    aircraft: Model,
    dihedral: float,
    outputs: tuple[str, ...] | None,
    flight: TrimCondition,
    start: OperatingPoint | None,
) -> Angle:
    """Trim and linearize at a dihedral angle, rad. Without a trim the reason is kept."""
    condition = flight.at(dihedral, {"dihedral": dihedral})
    try:
        point = find_operating_point(aircraft, condition, start)
    except NoSolutionError as error:
        return Angle(dihedral, condition, reason=str(error))
    return Angle(dihedral, condition, linearize(aircraft, point, outputs=outputs))


def with_game(angle: Angle) -> Angle:
    """Return the angle with its game solved, and a learned critic compared with the solution."""
    model = angle.model
    if model is None:
        return angle
    game = published_game(model)
    try:
        angle = replace(angle, solution=solve(game))
        run = learn(game)
        scope = Scope(box=ordinary_box())
        return replace(angle, check=check_critic(game, run.critic(game), run=run, scope=scope))
    except NoSolutionError as error:
        return replace(angle, reason=str(error))


@dataclass(frozen=True, eq=False)
class MainJob:
    """Results for one aircraft: both printed pairs, a sweep of the dihedral angle, requested
    angles.

    points: one for each angle of the sweep
    claims, flights: None where none were given
    """

    aircraft: Model
    parameters: ParameterSet
    regeneration: Regeneration
    sweep: Sweep
    points: tuple[Angle, ...]
    angles: tuple[Angle, ...]
    claims: Claims | None = None
    flights: StoredFlights | None = None

    @property
    def learned(self) -> bool:
        """True if every learned critic agrees with the exact game solution."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """True if every check holds; verdicts on the paper's claims do not count."""
        return self.regeneration.ok and self.learned


def main_job(
    parameters: ParameterSet,
    dynamics: str,
    *,
    asked: Sequence[float] = ASKED,
    swept: np.ndarray = SWEEP,
    outputs: tuple[str, ...] | None = None,
    claims: Claims | None = None,
    flight: TrimCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    progress: Progress = lambda *_: None,
) -> MainJob:
    """Regenerate both pairs and sweep the dihedral angle.

    At each requested angle (rad) the game is solved, and a critic is learned and compared.

    asked: requested angles, which the sweep visits too
    flight, start: condition and initial point of the trims, as for `sweep`; the printed pairs are
        at the paper's condition
    """
    aircraft = choice.aircraft(variant_named(dynamics), parameters.values)
    progress(0.0, 1.0, "printed pairs")
    regeneration = regenerate_all(aircraft)
    progress(0.05, 1.0, "sweep")
    swept = np.union1d(swept, asked)
    over = sweep(aircraft, {"dihedral": swept}, condition=flight, start=start)
    points = tuple(trimmed_angle(aircraft, float(angle), outputs, flight, start) for angle in swept)
    in_full = []
    for count, angle in enumerate(point for point in points if point.dihedral in asked):
        progress(0.1 + 0.9 * count / len(asked), 1.0, f"dihedral {angle.dihedral_deg:.6g} deg")
        in_full.append(with_game(angle))
    progress(1.0, 1.0)
    return MainJob(aircraft, parameters, regeneration, over, points, tuple(in_full), claims)
