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
from hfa_aircraft.model import Model
from hfa_model import choice
from hfa_model.parameters import ParameterSet
from hfa_model.published import published_models
from hfa_model.variants import variant_named
from hfa_page.flights import StoredFlights
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.text import beside_unit, in_degrees, shown_value
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim
from trim.sweeps.sweep import Sweep, sweep
from verification.critic.critic_check import verify
from verification.regeneration import Regeneration, regenerate_all
from verification.verdict import Verdict

#: Dihedral angles of the sweep, rad, from the paper's range to slightly beyond it.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: Key of the paper's aircraft.
HFA = "hfa"
#: Values of the scheduling variable of another aircraft, relative to that of its default trim.
BESIDE = np.linspace(0.75, 1.5, 31)
#: Angles shown in detail by default: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: Largest numbers of angles. More would make the file too large (3 MB of data) or take minutes.
MOST_SWEPT = 151
MOST_ASKED = 20


@dataclass(frozen=True, eq=False)
class Position:
    """Results at a value of the scheduling variable: trim and linear model.

    At a requested dihedral angle, the results also include the exact solution of the paper's game,
    and the verdict on a critic learned with the default law.

    value: value of the variable, rad for an angle
    condition: condition of the trim
    model: linear model, or None without a trim
    solution: exact solution of the game, or None if not computed
    check: verdict on the learned critic, or None if not computed
    reason: why model, solution or check could not be computed, or ""
    """

    value: float
    condition: TrimCondition
    model: LinearModel | None = None
    solution: Solution | None = None
    check: Verdict | None = None
    reason: str = ""

    @property
    def label(self) -> str:
        """The value in words, "5 deg"."""
        unit = self.condition.model.unit(self.condition.model.schedule)
        return beside_unit(shown_value(self.value, unit), unit)

    @property
    def dihedral_deg(self) -> float:
        """The value of an angle in degrees."""
        return in_degrees(self.value)

    @property
    def ok(self) -> bool:
        """True if the learned critic agrees with a certified solution. False without a trim or
        solution.
        """
        return self.check is not None and self.check.ok


@dataclass(frozen=True, eq=False)
class Slider:
    """Trims and linear models of an aircraft over its scheduling variable.

    key: name of the aircraft in the page
    sweep: sweep of the variable
    points: trim and linear model at each of its values
    first: number of the point that is shown first
    """

    key: str
    sweep: Sweep
    points: tuple[Position, ...]
    first: int

    def picture(self, name: str) -> str:
        """Return the name of the file of a picture."""
        return name if self.key == HFA else f"{self.key}_{name}"


def slider_over(
    key: str,
    model: Model,
    values: np.ndarray,
    first: float,
    outputs: tuple[str, ...] | None = None,
    flight: TrimCondition | None = None,
    start: OperatingPoint | None = None,
) -> Slider:
    """Return the trims and linear models of an aircraft over its scheduling variable.

    key: name of the aircraft in the page
    values: values of the variable, rad for an angle
    first: the value that is shown first
    outputs: names of the outputs of the linear models, or None for all
    flight: condition of the trims, apart from the variable; by default the usual one
    start: initial point of the search for these trims, or None
    """
    flight = usual_condition(model) if flight is None else flight
    over = sweep(model, {model.schedule: values}, condition=flight, start=start)
    points = tuple(_position(model, value, outputs, flight, start) for value in values.tolist())
    return Slider(key, over, points, values.tolist().index(first))


def slider_beside(model: Model) -> Slider:
    """Return the trims and linear models of another aircraft about its default trim.

    Raises BadInputError for an aircraft without a scheduling variable, or without limits of one
    that is 0 at this trim.
    """
    if not model.schedule:
        raise BadInputError(
            f"{model.name} declares no schedule, the variable of the page's slider; declare it"
        )
    usual = trim(model)[model.schedule]
    limits = model.limits[model.schedule]
    if not (usual or np.isfinite(limits).all()):
        raise BadInputError(
            f"{model.name}: {model.schedule} is 0 at the default trim; declare its min and max, "
            "the ends of the page's slider"
        )
    values = np.clip(usual * BESIDE, *limits) if usual else np.linspace(*limits, len(BESIDE))
    return slider_over("beside", model, np.union1d(values, usual), usual)


def _position(
    aircraft: Model,
    value: float,
    outputs: tuple[str, ...] | None,
    flight: TrimCondition,
    start: OperatingPoint | None,
) -> Position:
    """Return the trim and the linear model at a value, or the reason why there is no trim."""
    condition = flight.at(value, {aircraft.schedule: value})
    try:
        point = trim(aircraft, condition, start)
    except NoSolutionError as error:
        return Position(value, condition, reason=str(error))
    return Position(value, condition, linearize(aircraft, point, outputs=outputs))


def with_game(angle: Position) -> Position:
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
    slider: trims and linear models over the dihedral angle
    angles: requested angles, with games and critics
    flights: stored results of a study, or None
    beside: trims and linear models of another aircraft, or None
    """

    parameters: ParameterSet
    regeneration: Regeneration
    slider: Slider
    angles: tuple[Position, ...]
    flights: StoredFlights | None = None
    beside: Slider | None = None

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """The sliders of all aircraft, that of the paper's first."""
        return (self.slider,) if self.beside is None else (self.slider, self.beside)

    @property
    def learned(self) -> bool:
        """True if the learned critic agrees with the exact solution at every requested angle."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """True if the printed pairs are regenerated and every learned critic agrees."""
        return self.regeneration.ok and self.learned


def main_job(
    parameters: ParameterSet,
    dynamics: str,
    *,
    asked: Sequence[float],
    swept: np.ndarray,
    outputs: tuple[str, ...] | None,
    flight: TrimCondition,
    start: OperatingPoint | None,
    progress: Progress,
) -> MainJob:
    """Return the results of `hfa report`, without stored ones and other aircraft.

    Both printed pairs (A, B) are regenerated at the paper's condition, and the dihedral angle is
    swept. At each requested angle, the game is solved, and a critic is learned and compared with
    the solution.

    parameters: parameters of the aircraft
    dynamics: name of the aircraft's dynamics
    asked: requested angles, rad, which are added to the sweep
    swept: angles of the sweep, rad
    outputs: names of the outputs of the linear models, or None for all
    flight: condition of the trims of the sweep
    start: initial point of the search for these trims, or None
    """
    aircraft = choice.aircraft(variant_named(dynamics), parameters.values)
    progress(0.0, 1.0, "printed pairs")
    regeneration = regenerate_all(aircraft)
    progress(0.05, 1.0, "sweep")
    swept = np.union1d(swept, asked)
    slider = slider_over(HFA, aircraft, swept, min(asked), outputs, flight, start)
    in_full = []
    for count, angle in enumerate(point for point in slider.points if point.value in asked):
        progress(0.1 + 0.9 * count / len(asked), 1.0, f"dihedral {angle.label}")
        in_full.append(with_game(angle))
    progress(1.0, 1.0)
    return MainJob(parameters, regeneration, slider, tuple(in_full))
