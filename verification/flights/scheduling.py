"""A schedule of certified gains over the scheduling variable η of a model, and a flight through a
slow change of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.nonlinear_flight import NonlinearFlight, fly
from controller.flight.policies import Measurements, Policy
from controller.flight.scenario import Scenario
from controller.game.gain_schedule import GainTable
from controller.game.zero_sum import Game
from controller.hfa_game import published_game
from controller.learning.certified import learned_value
from controller.riccati.balancing import spectrum
from controller.riccati.gare import solve_game
from hfa_aircraft import Model
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.linear_table import LinearTable
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, degrees, shown_unit
from trim.hfa.level_flight import level_flight
from trim.limits import Limits
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point

#: Flight before and after a change, s.
LEAD, REST = 5.0, 15.0


@dataclass(frozen=True)
class ScheduledChange:
    """η_d(t) = start + (end - start) (10 τ³ - 15 τ⁴ + 6 τ⁵), τ = (t - begin)/duration held in [0,
    1]; s.

    Rate and acceleration are continuous and 0 at both ends. BadInputError when the duration is not
    positive."""

    start: float
    end: float
    begin: float
    duration: float

    def __post_init__(self) -> None:
        """A change takes time."""
        refuse_unless_positive("the time of the change", self.duration, " s")

    def at(self, t: Any) -> tuple[ca.SX, ca.SX]:
        """η_d(t) and η_d'(t)."""
        tau, size = (
            ca.fmin(ca.fmax((t - self.begin) / self.duration, 0.0), 1.0),
            self.end - self.start,
        )
        place = self.start + size * tau**3 * (10 - 15 * tau + 6 * tau**2)
        return place, size / self.duration * 30 * tau**2 * (1 - tau) ** 2


@dataclass(frozen=True, eq=False)
class GridPoint:
    """One gain: where, K (m, k), the abscissa of A - B K, 1/s; of a law also its relative distance
    from the exact one, the abscissa of A - S P, 1/s, and how many certificates hold."""

    point: OperatingPoint
    gain: np.ndarray
    control_abscissa: float
    distance: float | None = None
    game_abscissa: float | None = None
    certificates: int | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Schedule(Reported):
    """Trims X0(η), U0(η) and gains K(η), linear between the points of the grid and constant beyond
    its ends.

    grid: two points or more, η increasing, certified unless the gains came from a file. between:
    the largest abscissa of A - B K halfway between them, with the interpolated K, 1/s."""

    grid: tuple[GridPoint, ...]
    between: float = np.nan

    @property
    def model(self) -> Model:
        """Whose trims these are."""
        return self.grid[0].point.model

    @property
    def places(self) -> np.ndarray:
        """η of the grid, (G,)."""
        return np.array([row.point.values[self.model.schedule] for row in self.grid])

    @property
    def tables(self) -> tuple[LinearTable, LinearTable, LinearTable]:
        """X0(η), (n,), U0(η), (m,), and K(η), (m, k)."""
        rows = [(row.point.states, row.point.inputs, row.gain) for row in self.grid]
        states, inputs, gains = (
            LinearTable(self.places, np.array(each)) for each in zip(*rows, strict=True)
        )
        return states, inputs, gains

    def report(self) -> Report:
        """The grid, and what holds between its points."""
        name, unit = self.model.schedule, self.model.unit(self.model.schedule)
        rows = [
            (
                f"{float(degrees(at, unit)[0]):g}",
                f"{row.control_abscissa:.4f}",
                "-" if row.game_abscissa is None else f"{row.game_abscissa:.4f}",
                "-" if row.distance is None else f"{row.distance:.1e}" if row.distance else "0",
                "-" if row.certificates is None else f"{row.certificates} hold",
            )
            for row, at in zip(self.grid, self.places.tolist(), strict=True)
        ]
        abscissae = ("abscissa A-BK 1/s", "abscissa A-SP 1/s", "K off the exact", "certificates")
        between = f"halfway between the points, interpolated gain: largest abscissa of A-BK {self.between:.4f} 1/s"
        return Report(
            "Schedule of certified gains",
            [(Table((f"{name} {shown_unit(unit)}", *abscissae), rows), between)],
        )

    def at(self, place: float) -> GridPoint:
        """The grid point nearest to η."""
        return self.grid[int(np.argmin(np.abs(self.places - place)))]


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledPolicy(Policy):
    """u = U0(η_d(t)) - U_base - K(η) z, with η = η_base + x_d,η + z_η the measured one; also its
    own reference x_d(t) = X0(η_d(t)) - X_base, (k,), with η' = η_d'(t) where the model has that
    rate as a state, `NAME_rate`.

    The trims follow the commanded η and the gain the measured one. So, linearized about a trim, the
    policy is u = -K z with the K of that trim: U0 of the measured η would add the gain ∂U0/∂η, and
    z is 0 at a trim, so that ∂K/∂η adds nothing."""

    schedule: Schedule
    change: ScheduledChange
    base: OperatingPoint

    @property
    def size(self) -> int:
        """States of the linear model."""
        return len(self.schedule.model.linear)

    def at(self, t: Any) -> ca.SX:
        """x_d(t); a CasADi column."""
        model, (place, rate) = self.schedule.model, self.change.at(t)
        deviation = self.schedule.tables[0].expression(place) - ca.DM(np.array(self.base.states))
        rows = {
            name: deviation[row] for row, name in enumerate(model.states) if name in model.linear
        }
        moving = f"{model.schedule}_rate"
        return ca.vertcat(*(rows | ({moving: rate} if moving in rows else {})).values())

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """U0 - U_base - K z."""
        model, (_, inputs, gains) = self.schedule.model, self.schedule.tables
        row = model.linear.index(model.schedule)
        measured = self.base.values[model.schedule] + self.at(t)[row] + measurements.error[row]
        trimmed = inputs.expression(self.change.at(t)[0]) - ca.DM(np.array(self.base.inputs))
        K = ca.reshape(gains.expression(measured), self.size, len(model.inputs)).T
        return trimmed - ca.mtimes(K, measurements.error)


def change_over(model: Model, start: float, end: float, duration: float) -> ScheduledChange:
    """A change from start to end that begins after `LEAD` seconds. BadInputError when there is
    none, or when the scheduling variable is no state of the linear model, so that it cannot be
    measured and followed."""
    name = model.schedule
    if name not in model.linear:
        raise BadInputError(
            f"{model.name} is scheduled over {name or 'nothing'}; a schedule needs a state of linear"
        )
    if start == end:
        raise BadInputError(
            f"the {name} begins and ends at {model.describe(name, start)}; give two different ones"
        )
    return ScheduledChange(start, end, LEAD, duration)


def certified_schedule(
    aircraft: Model,
    places: np.ndarray,
    *,
    law: str = "exact",
    seed: int = 0,
    game: Callable[[LinearModel], Game] | None = None,
    settings: Mapping[str, Any] | None = None,
    gains: GainTable | None = None,
    condition: Callable[[float], TrimCondition] = level_flight,
    progress: Progress | None = None,
) -> Schedule:
    """Trim, linearize and solve or learn at every value of η (angles in rad); every gain must be
    certified.

    law: "exact", or a learning law. game: model -> game, the published one unless given. settings:
    of the law. gains: in place of a law, as they are, certified or not. condition: η -> trim.
    Raises NoSolutionError at the first value without a trim or without a certified gain."""
    if np.ndim(places) != 1 or len(places) < 2 or np.any(np.diff(places) <= 0.0):
        raise BadInputError("a schedule needs at least two values, in increasing order")

    def model_at(place: float) -> LinearModel:
        return linearize(aircraft, find_operating_point(aircraft, condition(place)))

    grid = []
    for place in told(places.tolist(), progress):
        model = model_at(place)
        if gains is None:
            given = published_game(model.A, model.B) if game is None else game(model)
            grid.append(_certified(model, given, law, seed, settings or {}))
        else:
            K = gains.table.at(place)
            grid.append(GridPoint(model.point, K, spectrum(model.A - model.B @ K).abscissa))
    _, _, table = Schedule(tuple(grid)).tables
    halfway = ((table.places[:-1] + table.places[1:]) / 2).tolist()
    models = zip(halfway, map(model_at, halfway), strict=True)
    between = max(spectrum(model.A - model.B @ table.at(place)).abscissa for place, model in models)
    return Schedule(tuple(grid), between)


def _certified(
    model: LinearModel, game: Game, law: str, seed: int, settings: Mapping[str, Any]
) -> GridPoint:
    exact = solve_game(game)
    P, gain, certificates = exact.P, exact.K, len(exact.certificate.checks)
    if law != "exact":
        learned = learned_value(game, law, seed, **settings)
        P, gain, certificates = learned.P, learned.K, len(learned.certificates)
    distance = float(np.linalg.norm(gain - exact.K) / np.linalg.norm(exact.K))
    control, whole = (spectrum(game.A - each).abscissa for each in (game.B @ gain, game.S @ P))
    return GridPoint(model.point, gain, control, distance, whole, certificates)


def fly_schedule(
    aircraft: Model,
    certified: Schedule,
    change: ScheduledChange,
    scenario: Scenario,
    envelope: Limits,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft along the trims of a change of η; the scenario's own reference is
    replaced.

    The change begins at a grid point, whose trim is the one that deviations count from.
    """
    begin = certified.at(change.start).point
    policy = ScheduledPolicy("scheduled", certified, change, begin)
    happens = replace(scenario, reference=policy)
    return fly(aircraft, begin, policy, happens, envelope, predict=False, progress=progress)


def schedule_report(result: NonlinearFlight, law: str) -> Report:
    """The report of a flight of `fly_schedule` with that of the schedule, whose gains `law` has
    made."""
    policy: Any = result.loop.policy
    flown, schedule, change, model = (
        result.report(),
        policy.schedule,
        policy.change,
        policy.schedule.model,
    )
    words = f", to {model.describe(model.schedule, change.end)} over {change.duration:g} s, law {law}, scheduled"
    grid = {
        "law": law,
        "dihedrals": schedule.places,
        "dihedral_units": model.unit(model.schedule),
        "gains": schedule.tables[2].values,
        "state_units": list(model.units(model.linear)),
        "control_abscissae": [row.control_abscissa for row in schedule.grid],
        "game_abscissae": [row.game_abscissa for row in schedule.grid],
        "distances_from_exact": [row.distance for row in schedule.grid],
        "largest_abscissa_between": schedule.between,
    }
    parts, data = (*flown.parts, *schedule.report().parts), {**flown.data, "schedule": grid}
    return replace(
        flown, title=result.title().replace(", law scheduled", words), parts=parts, data=data
    )
