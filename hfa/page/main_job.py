"""Computation of the results on the page of `hfa report`.

The results are the regeneration of both printed pairs, a sweep, and games and critics at requested
angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.hfa_files import published_game
from controller.learning.laws import learn
from controller.riccati.gare import Solution, solve
from hfa.page.claims import Claims
from hfa.page.flights import StoredFlights
from hfa_aircraft.model import Model
from hfa_model import choice
from hfa_model.parameters import ParameterSet
from hfa_model.published import published_models
from hfa_model.variants import variant_named
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.text import in_degrees
from trim.hfa.level_flight import LEVEL_FLIGHT
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim
from trim.sweeps.sweep import Sweep, sweep
from verification.critic.critic_check import verify
from verification.regeneration import Regeneration, regenerate_all
from verification.verdict import Verdict

#: Dihedral angles of the sweep, rad, from the paper's range to slightly beyond it.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: Angles shown in detail by default: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: Largest numbers of angles. More would make the file too large (3 MB of data) or take minutes.
MOST_SWEPT = 151
MOST_ASKED = 20


@dataclass(frozen=True, eq=False)
class Angle:
    """Results at a dihedral angle: trim and linear model.

    At a requested angle, the results also include the exact solution of the paper's game, and the
    verdict on a critic learned with the default law.

    dihedral: rad
    condition: condition of the trim
    model: linear model, or None without a trim
    solution: exact solution of the game, or None if not computed
    check: verdict on the learned critic, or None if not computed
    reason: why model, solution or check could not be computed, or ""
    """

    dihedral: float
    condition: TrimCondition
    model: LinearModel | None = None
    solution: Solution | None = None
    check: Verdict | None = None
    reason: str = ""

    @property
    def dihedral_deg(self) -> float:
        """The dihedral angle in degrees."""
        return in_degrees(self.dihedral)

    @property
    def ok(self) -> bool:
        """True if the learned critic agrees with a certified solution. False without a trim or
        solution.
        """
        return self.check is not None and self.check.ok


def trimmed_angle(
    aircraft: Model,
    dihedral: float,
    outputs: tuple[str, ...] | None,
    flight: TrimCondition,
    start: OperatingPoint | None,
) -> Angle:
    """Return the trim and the linear model at a dihedral angle, or the reason why there is no trim.

    dihedral: rad
    outputs: names of the outputs of the linear model, or None for all
    flight: condition of the trim, apart from the dihedral angle
    start: initial point of the search, or None
    """
    condition = flight.at(dihedral, {"dihedral": dihedral})
    try:
        point = trim(aircraft, condition, start)
    except NoSolutionError as error:
        return Angle(dihedral, condition, reason=str(error))
    return Angle(dihedral, condition, linearize(aircraft, point, outputs=outputs))


def with_game(angle: Angle) -> Angle:
    """Return the results at an angle, with the game's solution and the verdict on a learned critic.

    Without a trim, the results are returned unchanged. If the game has no solution or learning
    fails, the reason is stored.
    """
    model = angle.model
    if model is None:
        return angle
    game = published_game(model)
    try:
        angle = replace(angle, solution=solve(game))
        run = learn(game)
        return replace(angle, check=verify(game, run))
    except NoSolutionError as error:
        return replace(angle, reason=str(error))


@dataclass(frozen=True, eq=False)
class MainJob:
    """Results of `hfa report` for one aircraft.

    parameters: parameters of the aircraft, with their sources
    regeneration: comparison with both printed pairs (A, B)
    sweep: sweep of the dihedral angle
    points: trim and linear model at each angle of the sweep
    angles: requested angles, with games and critics
    claims, flights: stored results of studies, or None
    beside: trim of another aircraft, or None
    """

    aircraft: Model
    parameters: ParameterSet
    regeneration: Regeneration
    sweep: Sweep
    points: tuple[Angle, ...]
    angles: tuple[Angle, ...]
    claims: Claims | None = None
    flights: StoredFlights | None = None
    beside: OperatingPoint | None = None

    @property
    def learned(self) -> bool:
        """True if the learned critic agrees with the exact solution at every requested angle."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """True if the printed pairs are regenerated and every learned critic agrees.

        Verdicts on the paper's claims have no effect.
        """
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
    """Return the results of `hfa report`.

    Both printed pairs (A, B) are regenerated at the paper's condition, and the dihedral angle is
    swept. At each requested angle, the game is solved, and a critic is learned and compared with
    the solution.

    parameters: parameters of the aircraft
    dynamics: name of the aircraft's dynamics
    asked: requested angles, rad, which are added to the sweep
    swept: angles of the sweep, rad
    outputs: names of the outputs of the linear models, or None for all
    claims: stored claims that the page shows, or None
    flight: condition of the trims of the sweep
    start: initial point of the search for these trims, or None
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
