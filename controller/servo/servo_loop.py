"""A controller on a plant with actuators of choice: the closed loop, its poles, and its margins,
one loop at a time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import frequency_grid
from controller.riccati.margins import (
    LoopMargin,
    margin_of,
    shifted_sensitivity,
    single_margin,
    stable_poles,
)
from controller.servo.design import Actuator, Design
from controller.servo.design_model import DesignModel, design_model
from controller.servo.scheduled_controller import ScheduledController
from hfa_aircraft.model import Model
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, Checked, below, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, shown_value
from trim.linear.linear_model import LinearModel, level_model

#: Of the actuators behind which margins are computed.
ORDERS = (1, 2)
#: Frequencies of the grid, enough to follow the loops of all inputs; slower modes than this, rad/s,
#: do not extend it.
PER_DECADE, SLOWEST = 200, 1e-3
TOGETHER = "all inputs"


@dataclass(frozen=True, eq=False)
class ServoLoop:
    """x' = A x + B u, y = C x of the plant with x_c' = Ak x_c + Bk y, u = Ck x_c + Dk y; the
    commands are at rest."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Ak: np.ndarray
    Bk: np.ndarray
    Ck: np.ndarray
    Dk: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """The matrix of [x; x_c] with the loop closed; NoSolutionError where its numbers
        overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.block(
                [
                    [self.A + self.B @ self.Dk @ self.C, self.B @ self.Ck],
                    [self.Bk @ self.C, self.Ak],
                ]
            )
        if not np.isfinite(found).all():
            raise NoSolutionError("the closed loop overflows; check the actuators and the weights")
        return found

    @property
    def abscissa(self) -> float:
        """Largest real part of a pole of the closed loop, 1/s."""
        return spectrum(self.closed).abscissa


def servo_plant(
    aircraft: Model,
    model: LinearModel,
    controller: ScheduledController,
    actuators: Mapping[str, Actuator],
) -> DesignModel:
    """The linear model with these actuators, its sensors the measurements of the controller."""
    ones = dict.fromkeys(controller.measurements, 1.0), dict.fromkeys(controller.inputs, 1.0)
    own = controller.model
    loop = Design(
        "loop", controller.inputs, actuators, sensors=ones[0], input_weights=ones[1], model=own
    )
    return design_model(aircraft, model, loop)


def servo_loop(plant: DesignModel, controller: ScheduledController) -> ServoLoop:
    """The controller where the plant is. Where inputs move a measured output at once, that path is
    closed."""
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.values[controller.model.schedule])
    measured = len(controller.measurements)
    Bk, Dk = Bk[:, :measured], Dk[:, :measured]
    if np.any(plant.D):  # u = Ck x_c + Dk (C x + D u)
        closing = np.linalg.inv(np.eye(len(Dk)) - Dk @ plant.D)
        Ck, Dk = closing @ Ck, closing @ Dk
        Ak, Bk = Ak + Bk @ plant.D @ Ck, Bk @ (np.eye(measured) + plant.D @ Dk)
    return ServoLoop(plant.A, plant.B, plant.C, Ak, Bk, Ck, Dk)


def loop_margins(
    loop: ServoLoop, inputs: tuple[str, ...], sensors: tuple[str, ...]
) -> dict[str, LoopMargin]:
    """Of every input and every sensor while all other loops stay closed, and of all inputs: the
    same factor, phase or delay in each. NoSolutionError when the loop is unstable."""
    closed, nk = loop.closed, len(loop.Ak)
    poles = np.concatenate(
        [stable_poles(closed), np.linalg.eigvals(loop.A), np.linalg.eigvals(loop.Ak)]
    )
    grid = frequency_grid(poles[np.abs(poles) > SLOWEST], PER_DECADE)
    commanded = (
        np.hstack([loop.Dk @ loop.C, loop.Ck]),
        np.vstack([loop.B, np.zeros((nk, loop.B.shape[1]))]),
    )
    measured = (
        np.hstack([loop.C, np.zeros((len(loop.C), nk))]),
        np.vstack([loop.B @ loop.Dk, loop.Bk]),
    )
    found = dict[str, LoopMargin]()
    for names, (leaves, enters) in ((inputs, commanded), (sensors, measured)):
        M = shifted_sensitivity(closed, enters, leaves)
        found |= {name: single_margin(M, i, grid) for i, name in enumerate(names)}
    M = shifted_sensitivity(closed, commanded[1], commanded[0])
    return found | {
        TOGETHER: margin_of(lambda frequencies: np.linalg.eigvals(M(frequencies)), grid)
    }


class LoopRow(NamedTuple):
    """At one value of the scheduling variable, behind the actuator of each input: the abscissa,
    1/s, and the margins by the name of the loop, none where unstable."""

    place: float
    actuators: tuple[Actuator, ...]
    abscissa: float
    loops: dict[str, LoopMargin]

    @property
    def text(self) -> str:
        """The actuators, for a person."""
        kinds = dict.fromkeys(
            f"order {each.order}, {each.bandwidth:g} rad/s" for each in self.actuators
        )
        return " and ".join(kinds) or "none"


@dataclass(frozen=True, eq=False, repr=False)
class LoopTable(Checked, Reported):
    """A controller at every angle behind every actuator."""

    controller: ScheduledController
    rows: tuple[LoopRow, ...]

    @property
    def single(self) -> tuple[LoopMargin, ...]:
        """Of every loop that is opened alone, in every row."""
        return tuple(
            each for row in self.rows for name, each in row.loops.items() if name != TOGETHER
        )

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every loop is stable."""
        worst = max(self.rows, key=lambda row: row.abscissa)
        unstable = sum(row.abscissa >= 0.0 for row in self.rows)
        reason = f"unstable in {unstable} of {len(self.rows)} loops, worst at {self._at(worst)}, {worst.text}"
        return (below("largest_abscissa", worst.abscissa, 0.0, reason),)

    def _at(self, row: LoopRow) -> str:
        """5 deg."""
        return self.controller.model.describe(self.controller.model.schedule, row.place)

    def report(self) -> Report:
        """The verdict, and the smallest margins of each loop and of each angle."""
        model = self.controller.model
        by_loop, by_angle = (
            dict[tuple[str, ...], list[_Cell]](),
            dict[tuple[str, ...], list[_Cell]](),
        )
        for row in self.rows:
            place = shown_value(row.place, model.unit(model.schedule))
            for name, each in row.loops.items():
                by_loop.setdefault((row.text, name), []).append(_Cell(each, self._at(row)))
                if name != TOGETHER:
                    by_angle.setdefault((place,), []).append(_Cell(each, f"{name}, {row.text}"))
        header = ("gain dB", "at", "phase deg", "rad/s", "at", "delay ms")
        tables = [
            Table(
                (*names, *header), [(*place, *_smallest(cells)) for place, cells in found.items()]
            )
            for names, found in ((("actuators", "loop"), by_loop), ((model.schedule,), by_angle))
            if found
        ]
        stable = sum(row.abscissa < 0.0 for row in self.rows)
        verdict = f"{'PASS' if self.ok else 'FAIL'}, {stable} of {len(self.rows)} loops stable"
        title = f"Margins of controller {self.controller.name}, {self.controller.called}: {verdict}"
        return Report(title, (*tables, checks_block(self.checks)), data=self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: angles in rad, delays in s."""
        rows = [
            {
                self.controller.model.schedule: row.place,
                "abscissa": row.abscissa,
                "actuators": list(map(vars, row.actuators)),
                "loops": [
                    {"loop": name}
                    | {key: getattr(each, key) for key in ("gain", "phase", "crossover", "delay")}
                    for name, each in row.loops.items()
                ],
            }
            for row in self.rows
        ]
        return {"ok": self.ok, "rows": rows, "checks": [check.to_dict() for check in self.checks]}


class _Cell(NamedTuple):
    """A margin, and where it is."""

    margin: LoopMargin
    at: str


def _smallest(cells: list[_Cell]) -> tuple[str, ...]:
    """Cells of the smallest gain, phase and delay, and where."""
    gain, phase = (
        min(cells, key=lambda each: getattr(each.margin, key)) for key in ("gain", "phase")
    )
    angle = f"{phase.margin.phase:.0f}", f"{phase.margin.crossover:.3g}", phase.at
    return (
        f"{gain.margin.gain:.1f}",
        gain.at,
        *angle,
        f"{1e3 * min(each.margin.delay for each in cells):.0f}",
    )


def check_margins(
    aircraft: Model,
    controller: ScheduledController,
    places: np.ndarray,
    bandwidths: Sequence[float],
    *,
    progress: Progress | None = None,
) -> LoopTable:
    """Margins about the trims at `places` (N,), behind actuators of both orders and these
    bandwidths (rad/s), alike in all inputs; without any where `bandwidths` is empty. BadInputError
    when the controller is for another aircraft or for other places."""
    controller.refuse_other(aircraft, float(places.min()), float(places.max()))
    inputs, seen = controller.inputs, controller.measurements
    orders = ORDERS[1:] if {f"{name}_rate" for name in inputs} & {*seen} else ORDERS
    rows = []
    for place in told(places.tolist(), progress):
        model = level_model(aircraft, place)
        for kind in [*itertools.product(orders, bandwidths)] or [None]:
            actuators = {} if kind is None else dict.fromkeys(inputs, Actuator(*kind))
            loop = servo_loop(servo_plant(aircraft, model, controller, actuators), controller)
            margins = loop_margins(loop, inputs, seen) if loop.abscissa < 0.0 else {}
            rows.append(LoopRow(place, tuple(actuators.values()), loop.abscissa, margins))
    return LoopTable(controller, tuple(rows))
