"""A controller on a plant with actuators of choice: the closed loop, its poles, and its margins, one loop at a time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.design.design import Actuator, Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import ScheduledController
from controller.riccati.balancing import spectrum
from hfa_model.aircraft import Aircraft
from hfa_support.errors import NoSolutionError
from hfa_support.model import Model
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, Checked, below, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, shown_value
from trim.linear.linear_model import LinearModel, level_model

#: Ends of the ranges of the corners: share of a command that arrives, and rad/s.
EFFECTIVENESS, BANDWIDTH = (0.2, 1.0), (0.5, 2.0)
ORDERS = (1, 2)
#: Frequencies at which the loops are looked at.
GRID = 4000
TOGETHER = "all inputs"


@dataclass(frozen=True, eq=False)
class ServoLoop:
    """x' = A x + B u, y = C x of the plant with x_c' = Ak x_c + Bk y, u = Ck x_c + Dk y; the commands are at rest."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Ak: np.ndarray
    Bk: np.ndarray
    Ck: np.ndarray
    Dk: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """The matrix of [x; x_c] with the loop closed; NoSolutionError where its numbers overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.block([[self.A + self.B @ self.Dk @ self.C, self.B @ self.Ck], [self.Bk @ self.C, self.Ak]])
        if not np.isfinite(found).all():
            raise NoSolutionError("the closed loop overflows; check the actuators and the weights")
        return found

    @property
    def abscissa(self) -> float:
        """Largest real part of a pole of the closed loop, 1/s."""
        return spectrum(self.closed).abscissa


def servo_plant(
    aircraft: Aircraft | Model, model: LinearModel, controller: ScheduledController, actuators: Mapping[str, Actuator]
) -> DesignModel:
    """The linear model with these actuators, its sensors the measurements of the controller."""
    ones = dict.fromkeys(controller.measurements, 1.0), dict.fromkeys(controller.inputs, 1.0)
    own = controller.model
    loop = Design("loop", controller.inputs, actuators, sensors=ones[0], input_weights=ones[1], model=own)
    return design_model(aircraft, model, loop)


def servo_loop(plant: DesignModel, controller: ScheduledController) -> ServoLoop:
    """The controller where the plant is. Where inputs move a measured output at once, that path is closed."""
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.values[controller.model.schedule])
    measured = len(controller.measurements)
    Bk, Dk = Bk[:, :measured], Dk[:, :measured]
    if np.any(plant.D):  # u = Ck x_c + Dk (C x + D u)
        closing = np.linalg.inv(np.eye(len(Dk)) - Dk @ plant.D)
        Ck, Dk = closing @ Ck, closing @ Dk
        Ak, Bk = Ak + Bk @ plant.D @ Ck, Bk @ (np.eye(measured) + plant.D @ Dk)
    return ServoLoop(plant.A, plant.B, plant.C, Ak, Bk, Ck, Dk)


class LoopMargin(NamedTuple):
    """Margins of one loop while all others stay closed; of "all inputs": the same factor or delay in every input.

    gain: dB, to the nearest instability, up or down. phase: deg. crossover: rad/s, where |l| = 1 with this phase.
    delay: s. inf where no gain, phase or delay ends stability, crossover nan where |l| is never 1.
    """

    loop: str
    gain: float
    phase: float
    crossover: float
    delay: float


def loop_margins(loop: ServoLoop, inputs: tuple[str, ...], sensors: tuple[str, ...]) -> tuple[LoopMargin, ...]:
    """At every input, every sensor, and at all inputs at once. NoSolutionError when the loop is unstable.

    With S = (I + L)⁻¹ of all inputs (sensors) the loop broken at one is l = 1/S_ii - 1; at all inputs at once
    they are the eigenvalues of L (jω).
    """
    found = spectrum(loop.closed)
    if found.abscissa >= 0.0:
        raise NoSolutionError(f"the loop has a pole at {found.abscissa:+.4g} 1/s: an unstable loop has no margins")
    poles, modes = np.linalg.eig(loop.closed)
    limits = np.abs(np.concatenate([poles, np.linalg.eigvals(loop.A), np.linalg.eigvals(loop.Ak)]))
    grid = np.geomspace(1e-2 * max(limits.min(), 1e-3), 1e2 * limits.max(), GRID)
    decays = 1.0 / (1j * grid[:, None] - poles)
    nk = len(loop.Ak)

    def sensitivity(enters: np.ndarray, leaves: np.ndarray) -> np.ndarray:
        within = ((leaves @ modes) * decays[:, None, :]) @ np.linalg.solve(modes, enters)
        return np.asarray(np.eye(len(leaves)) + within)

    asked = np.hstack([loop.Dk @ loop.C, loop.Ck])
    at_inputs = sensitivity(np.vstack([loop.B, np.zeros((nk, loop.B.shape[1]))]), asked)
    seen = np.hstack([loop.C, np.zeros((len(loop.C), nk))])
    at_sensors = sensitivity(np.vstack([loop.B @ loop.Dk, loop.Bk]), seen)
    single = [
        _margin_of(name, (1.0 / S[:, i, i] - 1.0)[:, None], grid)
        for names, S in ((inputs, at_inputs), (sensors, at_sensors))
        for i, name in enumerate(names)
    ]
    loci = np.linalg.eigvals(np.linalg.inv(at_inputs)) - 1.0
    orders = np.array(list(itertools.permutations(range(loci.shape[1]))))
    nearest = orders[np.abs(loci[1:, orders] - loci[:-1, None]).sum(axis=2).argmin(axis=1)]
    followed = list(itertools.accumulate(nearest, lambda before, step: step[before], initial=orders[0]))
    return (*single, _margin_of(TOGETHER, np.take_along_axis(loci, np.array(followed), 1), grid))


def _margin_of(name: str, loops: np.ndarray, grid: np.ndarray) -> LoopMargin:
    """loops: l (jω) of each, (N, k). Crossings are interpolated between the frequencies of the grid."""
    gain = phase = delay = math.inf
    crossover = math.nan
    for values in loops.T:
        where, share = _crossings(values.imag)
        real = values.real[where] + share * np.diff(values.real)[where]
        real = real[real < 0.0]
        gain = min(gain, float(np.abs(20.0 * np.log10(-real)).min(initial=math.inf)))
        where, share = _crossings(np.log(np.maximum(np.abs(values), 1e-300)))
        there = values[where] + share * np.diff(values)[where]
        frequencies = grid[where] * (grid[where + 1] / grid[where]) ** share
        angles = np.angle(-there)
        if len(angles) and np.degrees(np.abs(angles).min()) < phase:
            phase, crossover = np.degrees(np.abs(angles).min()), frequencies[np.abs(angles).argmin()]
        delay = min(delay, float((np.mod(angles, 2.0 * np.pi) / frequencies).min(initial=math.inf)))
    return LoopMargin(name, gain, float(phase), float(crossover), delay)


def _crossings(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the sign changes, and the share of the way to the next value at which it does."""
    where = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    return where, values[where] / (values[where] - values[where + 1])


class LoopRow(NamedTuple):
    """At one value of the scheduling variable, behind the actuator of each input: the abscissa, 1/s, and the margins,
    () where unstable."""

    place: float
    actuators: tuple[Actuator, ...]
    abscissa: float
    loops: tuple[LoopMargin, ...]

    @property
    def text(self) -> str:
        """The actuators, for a person."""
        kinds = dict.fromkeys(
            f"order {each.order}, {each.bandwidth:g} rad/s" + f", {each.effectiveness:g}" * (each.effectiveness != 1.0)
            for each in self.actuators
        )
        return " and ".join(kinds) or "none"


@dataclass(frozen=True, eq=False, repr=False)
class LoopTable(Checked, Reported):
    """A controller at every angle behind every actuator. what: which actuators, for the title."""

    controller: ScheduledController
    what: str
    rows: tuple[LoopRow, ...]

    @property
    def unstable(self) -> int:
        """Number of unstable loops."""
        return sum(row.abscissa >= 0.0 for row in self.rows)

    @property
    def worst(self) -> LoopRow:
        """The row of the largest abscissa."""
        return max(self.rows, key=lambda row: row.abscissa)

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every loop is stable."""
        where = f"worst at {self._at(self.worst)}, {self.worst.text}"
        reason = f"unstable in {self.unstable} of {len(self.rows)} loops, {where}"
        return (below("largest_abscissa", self.worst.abscissa, 0.0, reason),)

    def _at(self, row: LoopRow) -> str:
        """5 deg."""
        return self.controller.model.describe(self.controller.model.schedule, row.place)

    def report(self) -> Report:
        """The verdict, and the smallest margins of each loop and of each angle."""
        by, unit = (model := self.controller.model).schedule, model.unit(model.schedule)
        by_loop: dict[tuple[str, ...], list[tuple[LoopRow, LoopMargin]]] = {}
        by_angle: dict[tuple[str, ...], list[tuple[LoopRow, LoopMargin]]] = {}
        for row, each in [(one, each) for one in self.rows for each in one.loops]:
            by_loop.setdefault((row.text, each.loop), []).append((row, each))
            if each.loop != TOGETHER:
                by_angle.setdefault((shown_value(row.place, unit),), []).append((row, each))
        header = ("gain dB", "at", "phase deg", "rad/s", "at", "delay ms")
        tables = [
            Table(
                (*names, *header),
                [(*place, *_smallest(found, names == (by,), self._at)) for place, found in grouped.items()],
            )
            for names, grouped in ((("actuators", "loop"), by_loop), ((by,), by_angle))
            if grouped
        ]
        stable = f"{len(self.rows) - self.unstable} of {len(self.rows)} loops stable"
        title = f"{self.what} of controller {self.controller.name}, {self.controller.called}"
        verdict = "PASS" if self.ok else "FAIL"
        return Report(f"{title}: {verdict}, {stable}", (*tables, checks_block(self.checks)), data=self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: angles in rad, delays in s."""
        by = self.controller.model.schedule
        rows = [
            {
                by: row.place,
                "abscissa": row.abscissa,
                "actuators": list(map(vars, row.actuators)),
                "loops": [each._asdict() for each in row.loops],
            }
            for row in self.rows
        ]
        return {"ok": self.ok, "rows": rows, "checks": [check.to_dict() for check in self.checks]}


def _smallest(found: list[tuple[LoopRow, LoopMargin]], by_angle: bool, at: Callable[[LoopRow], str]) -> tuple[str, ...]:
    """Cells of the smallest gain, phase and delay, and where: the loop and its actuators, or the angle."""

    def place(row: LoopRow, each: LoopMargin) -> str:
        return f"{each.loop}, {row.text}" if by_angle else at(row)

    gain = min(found, key=lambda pair: pair[1].gain)
    phase = min(found, key=lambda pair: pair[1].phase)
    delay = min(each.delay for _, each in found)
    angle = f"{phase[1].phase:.0f}", f"{phase[1].crossover:.3g}", place(*phase)
    return f"{gain[1].gain:.1f}", place(*gain), *angle, f"{1e3 * delay:.0f}"


def check_margins(
    aircraft: Aircraft | Model,
    controller: ScheduledController,
    places: np.ndarray,
    bandwidths: Sequence[float],
    *,
    progress: Progress | None = None,
) -> LoopTable:
    """Margins about the trims at `places` (N,), behind actuators of both orders and these bandwidths (rad/s),
    alike in all inputs; without any where `bandwidths` is empty. BadInputError as `check_corners`."""
    count, rates = len(controller.inputs), {f"{name}_rate" for name in controller.inputs}
    orders = ORDERS[1:] if rates & set(controller.measurements) else ORDERS
    kinds = [(Actuator(*kind),) * count for kind in itertools.product(orders, bandwidths)] or [()]
    return LoopTable(controller, "Margins", tuple(_rows(aircraft, controller, places, kinds, True, progress)))


def check_corners(
    aircraft: Aircraft | Model, controller: ScheduledController, *, progress: Progress | None = None
) -> LoopTable:
    """Stability at every corner of `EFFECTIVENESS` and `BANDWIDTH`, each input by itself, for both orders.

    The plant is linear, about the level trim at each angle of the controller. BadInputError when the controller is for
    another aircraft.
    """
    ends = list(itertools.product(EFFECTIVENESS, BANDWIDTH))
    kinds = [
        tuple(Actuator(order, bandwidth, effectiveness=share) for share, bandwidth in each)
        for order in ORDERS
        for each in itertools.product(ends, repeat=len(controller.inputs))
    ]
    rows = _rows(aircraft, controller, controller.places, kinds, False, progress)
    return LoopTable(controller, "Corners of the actuators", tuple(rows))


def _rows(
    aircraft: Aircraft | Model,
    controller: ScheduledController,
    places: np.ndarray,
    kinds: Iterable[tuple[Actuator, ...]],
    margins: bool,
    progress: Progress | None,
) -> Iterable[LoopRow]:
    controller.refuse_other(aircraft, float(places.min()), float(places.max()))
    for place in told(places.tolist(), progress):
        model = level_model(aircraft, place)
        for kind in kinds:
            actuators = dict(zip(controller.inputs, kind, strict=False))
            loop = servo_loop(servo_plant(aircraft, model, controller, actuators), controller)
            known = margins and loop.abscissa < 0.0
            loops = loop_margins(loop, controller.inputs, controller.measurements) if known else ()
            yield LoopRow(place, kind, loop.abscissa, loops)
