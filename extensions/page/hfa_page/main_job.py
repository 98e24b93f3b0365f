"""Computation of the results on the page of `hfa report`.

The results are trims over the scheduling variable, and games at requested values of it; of the
paper's aircraft also the regeneration of both printed pairs, and critics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.hfa_game import published_game
from controller.learning.laws import learn
from controller.riccati.gare import Solution, solve
from hfa.options.games import weighted_game
from hfa_aircraft.model import Model
from hfa_model.parameters import ParameterSet
from hfa_model.published import published_models
from hfa_page.flights import StoredFlights
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.rows import Row, Sheet
from hfa_support.reporting.text import beside_unit, in_degrees, shown_value
from trim.hfa.reports import trim_report
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim
from trim.reports.book import Condition
from trim.reports.models import stacked
from trim.sweeps.result import Sweep
from trim.sweeps.sweep_plan import SweepPlan
from verification.critic_check import verify
from verification.regeneration import Regeneration
from verification.verdict import Verdict

if TYPE_CHECKING:
    from hfa_flight.simulate.flight import Flight


#: Dihedral angles of the sweep, rad, from the paper's range to slightly beyond it.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: Values of the scheduling variable of another aircraft, relative to that of its first trim.
_SHARES_OF_TRIM_VALUE = np.linspace(0.75, 1.5, 31)
#: Angles shown in detail by default: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: Largest numbers of angles. More would make the file too large (3 MB of data) or take minutes.
MOST_SWEPT = 151
MOST_ASKED = 20


@dataclass(frozen=True, eq=False)
class Position:
    """Results at a value of the scheduling variable: trim and linear model.

    At a requested value, the results also include the exact solution of the game, and of the
    paper's game the verdict on a critic learned with the default law.

    value: value of the variable, rad for an angle
    condition: condition of the trim
    model: linear model, or None without a trim
    solution: exact solution of the game, or None if not computed
    check: verdict on the learned critic, or None if not computed
    reason: why the first of model, solution and check could not be computed, or ""
    """

    value: float
    condition: TrimCondition
    model: LinearModel | None = None
    solution: Solution | None = None
    check: Verdict | None = None
    reason: str = ""

    @cached_property
    def report(self) -> Report:
        """The sheet of the trim, or the reason why there is none."""
        return without_trim(self.reason) if self.point is None else trim_report(self.point)

    @property
    def point(self) -> OperatingPoint | None:
        """The trim, or None."""
        return None if self.model is None else self.model.point

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


def without_trim(reason: str) -> Report:
    """Return the sheet of a condition without a trim: the reason."""
    return Report(reason, sheet=Sheet.of([("findings", [Row("failure", reason)], ())]))


@dataclass(frozen=True, eq=False)
class Slider:
    """Trims and linear models of an aircraft over its scheduling variable.

    sweep: the trims and linear models of `points`, as a sweep of the variable
    points: trim and linear model at each value of the variable
    first: number of the point that is shown first
    """

    sweep: Sweep
    points: tuple[Position, ...]
    first: int

    @property
    def trimmed(self) -> int:
        """Number of points with a trim."""
        return sum(point.model is not None for point in self.points)


#: Array of a sweep -> axes, and attribute of a linear model.
_SWEPT_ARRAYS = {
    "states": (("all states",), "point.x"),
    "inputs": (("input",), "point.u"),
    "A": (("state", "state"), "A"),
    "B": (("state", "input"), "B"),
}


def slider_over(
    model: Model,
    values: np.ndarray,
    first: float,
    outputs: tuple[str, ...] | None,
    condition: TrimCondition,
    start: OperatingPoint | None,
) -> Slider:
    """Return the trims and linear models of an aircraft over its scheduling variable.

    values: values of the variable, rad for an angle
    first: the value that is shown first
    outputs: names of the outputs of the linear models, or None for all
    condition: that of the trims, apart from the variable
    start: initial point of the search for these trims, or None
    """
    plan = SweepPlan({model.schedule: values}, model, condition, start)
    points = []
    for value in values.tolist():
        at_value = condition.at(value, {model.schedule: value})
        try:
            point = trim(model, at_value, start)
        except NoSolutionError as error:
            points.append(Position(value, at_value, reason=str(error)))
        else:
            points.append(Position(value, at_value, linearize(model, point, outputs=outputs)))

    # Axes of the arrays of a sweep: trims have all states, and linear models the linear ones.
    names = {"all states": model.state_names, "state": model.linear, "input": model.input_names}
    linear = [position.model for position in points]
    arrays: dict[str, Any] = {**stacked(linear, _SWEPT_ARRAYS, names)}
    notes = {
        row: known.nonsmooth_points
        for row, known in enumerate(linear)
        if known is not None and known.nonsmooth_points
    }
    swept = Sweep(
        plan,
        values[:, None],
        tuple(position.reason for position in points),
        nonsmooth_points=notes,
        **arrays,
    )
    return Slider(swept, tuple(points), values.tolist().index(first))


def values_about(point: OperatingPoint) -> np.ndarray:
    """Return the values of the slider of an aircraft: 0.75 to 1.5 of the value at a trim, or all
    between the limits if that is 0.

    Raises BadInputError for a variable that is 0 there and has no limits.
    """
    model = point.model
    at_trim = point[model.schedule]
    limits = model.limits[model.schedule]
    if not (at_trim or np.isfinite(limits).all()):
        raise BadInputError(
            f"{model.name}: {model.schedule} is 0 at its trim; declare its min and max, the ends "
            "of the page's slider, or give --sweep"
        )
    values = (
        np.clip(at_trim * _SHARES_OF_TRIM_VALUE, *limits)
        if at_trim
        else np.linspace(*limits, len(_SHARES_OF_TRIM_VALUE))
    )
    return np.union1d(values, at_trim)


def with_game(angle: Position, weights: Mapping[str, Any] | None) -> Position:
    """Return the results at a value with the solution of the game and, for the paper's game, the
    verdict on a learned critic. If these do not exist, the results have the reason.

    Without a trim or a weight, the results are returned unchanged.

    weights: as for `weighted_game`, or None for those of the paper
    """
    model = angle.model
    if model is None or weights == {}:  # of another aircraft without --Q and --R
        return angle
    try:
        game = published_game(model) if weights is None else weighted_game(weights, model).game
        angle = replace(angle, solution=solve(game))
        if weights is not None:
            return angle
        return replace(angle, check=verify(game, learn(game)))
    except NoSolutionError as error:
        return replace(angle, reason=str(error))


@dataclass(frozen=True, eq=False)
class MainJob:
    """Results of `hfa report` for one aircraft.

    slider: trims and linear models over the scheduling variable
    angles: requested values of it, with games and critics
    book: rows of --conditions, each with its sheet
    parameters: parameters of the paper's aircraft, with their sources
    regeneration: comparison of the paper's aircraft with both printed pairs (A, B), else None
    flights: stored results of a study, or None
    """

    slider: Slider
    angles: tuple[Position, ...]
    book: Sequence[Condition] = ()
    parameters: ParameterSet | None = None
    regeneration: Regeneration | None = None
    flights: StoredFlights | None = None

    @property
    def learned(self) -> bool:
        """True if the learned critic agrees with the exact solution at every requested angle."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """True if the printed pairs are regenerated and every learned critic agrees, or if the
        first position of another aircraft has a trim.
        """
        if self.regeneration is None:
            return self.slider.points[self.slider.first].model is not None
        return self.regeneration.ok and self.learned


def games_over(
    slider: Slider,
    asked: Sequence[float],
    progress: Progress,
    weights: Mapping[str, Any] | None = None,
) -> tuple[Position, ...]:
    """Return the requested positions of a slider with their games.

    weights: as for `with_game`
    """
    variable = slider.sweep.model.schedule
    requested = []
    for count, position in enumerate(point for point in slider.points if point.value in asked):
        # The trims over the slider have had the first tenth of the progress.
        progress(0.1 + 0.9 * count / len(asked), 1.0, f"{variable} {position.label}")
        requested.append(with_game(position, weights))
    progress(1.0, 1.0)
    return tuple(requested)


_TITLE = "A flight in turbulence"
#: Duration of the flight, s, and level of the turbulence.
_DURATION = 20.0
_TURBULENCE = "moderate"
#: Standard deviations of the sensors' noise in a sample: ft/s, deg and deg/s.
_SPEED_NOISE = 0.3
_ANGLE_NOISE = {"alpha": 0.17, "pitch": 0.11, "dihedral": 0.11}
_RATE_NOISE = {"pitch_rate": 0.17, "dihedral_rate": 0.17}
_NOT_COVERED = (
    "One flight with one seed: gusts of other shapes, biased or late sensors, other parameters and "
    "motions that the model does not have are not covered."
)


def flight_in_turbulence(angle: Position) -> Report:
    """Return the section on a flight in moderate turbulence at the altitude of a trim, or with the
    reason why it is missing.

    angle: trim, linear model and solution of the game at a dihedral angle
    """
    try:
        from hfa_flight.air.sensors import at_trim

        flight = _flown(angle)
    except ImportError:
        return Report(_TITLE, ("Not on this page: the package hfa_flight is not installed.",))
    except (BadInputError, NoSolutionError) as error:
        return Report(_TITLE, (f"Not on this page: {error}",))
    limits = flight.envelope
    trim = at_trim(flight.point, limits.names)
    away = flight.deviations.limited - trim
    # Largest share of the way from the trim to a limit, of each state: one of the two is positive.
    used = np.maximum(away / (limits.highest - trim), away / (limits.lowest - trim)).max(axis=0)
    nearest = int(used.argmax())
    at_limit = max(flight.share_at_limits.values())  # of the input that is at a limit longest
    figures = (
        f"{flight.title().splitlines()[0]}. Exact gain at {angle.label} behind its Kalman filter, "
        f"with sensor noise, in {_TURBULENCE} turbulence of MIL-F-8785C that begins in calm: "
        f"{limits.names[nearest]} comes nearest to a limit, {100.0 * used[nearest]:.0f} % of the "
        f"way from the trim; an input is at a limit for {100.0 * at_limit:.2g} % of the time. "
    )
    text = (
        f"Exact gain behind its filter in {_TURBULENCE} turbulence: states, their limits and inputs"
    )
    picture = Picture("turbulence.png", text, lambda: flight.figure(text))
    return Report(
        _TITLE,
        (figures + _NOT_COVERED, picture),
        data={"ok": flight.ok, "departure": flight.departure, "rms_error": flight.rms_error},
    )


def _flown(angle: Position) -> Flight:
    """Return the flight of the exact gain behind a Kalman filter in turbulence.

    Raises NoSolutionError without a trim or a solution of the game.
    """
    from hfa_flight.air.scenario import Scenario, Uncertainty
    from hfa_flight.air.turbulence import Turbulence
    from hfa_flight.policies.filter import filter
    from hfa_flight.samples.fly import fly

    if angle.model is None or angle.solution is None:
        raise NoSolutionError(angle.reason)
    point, model = angle.model.point, angle.model.point.model
    angles = {name: math.radians(noise) for name, noise in (_ANGLE_NOISE | _RATE_NOISE).items()}
    noise = {"speed": _SPEED_NOISE, **angles}
    air = Turbulence(_TURBULENCE, float(point["altitude"]))
    policy = filter(angle.model, noise, air).policy(angle.solution)
    # The noise and the gusts are drawn with the seed 0, as for the first of several flights.
    scenario = Scenario(_DURATION, uncertainty=Uncertainty(noise=noise, turbulence=air))
    return fly(model, point, policy, scenario=scenario.drawn(0, 0, point), predict=False)
