"""Closed loop of a controller and a plant with given actuators: poles, and margins of each loop."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.riccati.balancing import Stability, abscissa_of
from controller.riccati.frequency_grid import frequency_grid
from controller.riccati.loop_margins import (
    LoopMargin,
    margin_of,
    single_margin,
)
from controller.riccati.margins import closed_at
from hfa_aircraft.model import Model
from hfa_design.design import Design, actuators_of
from hfa_design.design_models import DesignModel, design_model
from hfa_flight.actuators import Actuator
from hfa_flight.schedule.scheduled_controller import ScheduledController
from hfa_support.arguments import checks_arguments
from hfa_support.attributes import Advised
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.checks import Check, Checked, below, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table, shown_value
from trim.linear.linear_model import LinearModel
from trim.point.solve import level_model

#: Orders of the actuators for which margins are computed.
ORDERS = (1, 2)
#: Frequencies of the grid per decade, fine enough for the loop at all inputs.
PER_DECADE = 200
#: Modes slower than this, rad/s, do not extend the frequency grid.
SLOWEST = 1e-3
TOGETHER = "all inputs"
#: Real part, relative to the fastest pole, at which a slow pole is 0 within rounding.
_ROUNDING = -1e-10


@checks_arguments
@dataclass(frozen=True, eq=False)
class ServoLoop(Advised):
    """Closed loop of a plant and a controller at constant commands.

    The plant is x' = A x + B u, y = C x. The controller is x_c' = Ak x_c + Bk y, u = Ck x_c + Dk y.

    A: (n, n)
    B: (n, m)
    C: (p, n)
    Ak: (c, c)
    Bk: (c, p)
    Ck: (m, c)
    Dk: (m, p)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Ak: np.ndarray
    Bk: np.ndarray
    Ck: np.ndarray
    Dk: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """State matrix of the closed loop, with the states [x; x_c].

        Raises NoSolutionError if an entry overflows.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            by_plant = np.vstack([self.A + self.B @ self.Dk @ self.C, self.Bk @ self.C])
            matrix = np.hstack([by_plant, np.vstack([self.B @ self.Ck, self.Ak])])
        if not np.isfinite(matrix).all():
            raise NoSolutionError("the closed loop overflows; check the actuators and the weights")
        return matrix

    @property
    def stability(self) -> Stability:
        """Largest real part of the poles of the closed loop, 1/s, and that of a stable loop."""
        closed = self.closed
        return Stability(abscissa_of(closed), _ROUNDING * spectral_radius(closed))


@checks_arguments
def servo_plant(
    model: Model,
    linear: LinearModel,
    controller: ScheduledController,
    actuators: Mapping[str, Actuator],
) -> DesignModel:
    """Return the linear model with given actuators. Its sensors are the controller's measurements.

    actuators: input -> actuator
    """
    loop = Design(
        "loop",
        controller.inputs,
        actuators,
        sensors=dict.fromkeys(controller.measurements, 1.0),
        input_weights=dict.fromkeys(controller.inputs, 1.0),
        model=controller.model,
    )
    return design_model(model, linear, loop)


@checks_arguments
def servo_loop(plant: DesignModel, controller: ScheduledController) -> ServoLoop:
    """Return the closed loop of a controller and a plant at the plant's scheduling value.

    If inputs act directly on a measured output, this direct path is included in the controller's
    matrices.
    """
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.values[controller.model.schedule])
    measured = len(controller.measurements)
    Bk = Bk[:, :measured]
    Dk = Dk[:, :measured]
    if np.any(plant.D):  # u = Ck x_c + Dk (C x + D u)
        closing = np.linalg.inv(np.eye(len(Dk)) - Dk @ plant.D)
        Ck = closing @ Ck
        Dk = closing @ Dk
        Ak = Ak + Bk @ plant.D @ Ck
        Bk = Bk @ (np.eye(measured) + plant.D @ Dk)
    return ServoLoop(plant.A, plant.B, plant.C, Ak, Bk, Ck, Dk)


@checks_arguments
def servo_margins(
    loop: ServoLoop, inputs: tuple[str, ...], sensors: tuple[str, ...]
) -> dict[str, LoopMargin]:
    """Return the margins at each input and sensor, by name, with all other loops closed.

    The entry `TOGETHER` is for a gain, phase or delay common to all inputs.

    inputs, sensors: names of the inputs and of the sensors of the loop, in order

    Raises NoSolutionError if the closed loop is unstable.
    """
    closed = loop.closed
    matrices = (closed, loop.A, loop.Ak)
    poles = np.concatenate([np.linalg.eigvals(matrix) for matrix in matrices])
    grid = frequency_grid(poles[np.abs(poles) > SLOWEST], PER_DECADE)
    nk = len(loop.Ak)
    commands_of = np.hstack([loop.Dk @ loop.C, loop.Ck])
    by_commands = np.vstack([loop.B, np.zeros((nk, loop.B.shape[1]))])
    outputs_of = np.hstack([loop.C, np.zeros((len(loop.C), nk))])
    by_outputs = np.vstack([loop.B @ loop.Dk, loop.Bk])
    at_inputs = closed_at(closed, by_commands, commands_of)
    at_sensors = closed_at(closed, by_outputs, outputs_of)
    margins = {}
    for index, name in enumerate(inputs):
        margins[name] = single_margin(at_inputs, index)
    for index, name in enumerate(sensors):
        margins[name] = single_margin(at_sensors, index)
    margins[TOGETHER] = margin_of(lambda omega: np.linalg.eigvals(at_inputs.at(omega)), grid)
    return margins


class LoopRow(NamedTuple):
    """Margins at one scheduling value, with an actuator at each input.

    scheduled_at: the scheduling value
    actuators: actuator of each input
    stability: largest real part of the poles, 1/s, and that of a stable loop
    loops: name of the loop -> its margins; empty if the loop is unstable
    """

    scheduled_at: float
    actuators: tuple[Actuator, ...]
    stability: Stability
    loops: dict[str, LoopMargin]

    @property
    def text(self) -> str:
        """Text on the actuators, such as "order 1, 2 rad/s"."""
        kinds = [f"order {acting.order}, {acting.bandwidth:g} rad/s" for acting in self.actuators]
        return " and ".join(dict.fromkeys(kinds)) or "none"


class _Cell(NamedTuple):
    """Entry of a table of margins."""

    margin: LoopMargin
    where: str  # text that names the loop or the scheduling value of the margin


@dataclass(frozen=True, eq=False, repr=False)
class MarginTable(Checked, Result, Reported):
    """Margins of a controller at several scheduling values and with several actuators.

    rows: one for each scheduling value and set of actuators
    """

    controller: ScheduledController
    rows: tuple[LoopRow, ...]

    @property
    def single(self) -> tuple[LoopMargin, ...]:
        """Margins of all rows, without those of a change common to all inputs."""
        return tuple(
            margin for row in self.rows for name, margin in row.loops.items() if name != TOGETHER
        )

    @property
    def checks(self) -> tuple[Check, ...]:
        """The check that every loop is stable."""
        worst = max(self.rows, key=lambda row: row.stability.value - row.stability.limit)
        unstable = len(self.rows) - self._stable
        reason = (
            f"not stable in {unstable} of {len(self.rows)} loops, worst at {self._where(worst)},"
            f" {worst.text}"
        )
        return (below("largest_abscissa", *worst.stability, reason),)

    @property
    def _stable(self) -> int:
        """Number of stable loops."""
        return sum(row.stability.is_stable for row in self.rows)

    def _where(self, row: LoopRow) -> str:
        """Return the scheduling value of a row as text, such as "5 deg"."""
        model = self.controller.model
        return model.describe(model.schedule, row.scheduled_at)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"ok": self.ok, "checks": self.checks, "rows": self.data_rows}

    def report(self) -> Report:
        """Return the report: verdict, and tables of the smallest margins of each loop and at each
        scheduling value.
        """
        model = self.controller.model
        by_loop: dict[tuple[str, ...], list[_Cell]] = {}
        by_value: dict[tuple[str, ...], list[_Cell]] = {}
        has_several = len({row.text for row in self.rows}) > 1
        for row in self.rows:
            value = shown_value(row.scheduled_at, model.unit(model.schedule))
            for name, margin in row.loops.items():
                by_loop.setdefault((row.text, name), []).append(_Cell(margin, self._where(row)))
                if name != TOGETHER:
                    cell = _Cell(margin, f"{name}, {row.text}" if has_several else name)
                    by_value.setdefault((value,), []).append(cell)
        tables = []
        if by_loop:
            tables.append(_smallest_table(("actuators", "loop"), by_loop))
        if by_value:
            tables.append(_smallest_table((model.schedule,), by_value))
        stable = f"{self._stable} of {len(self.rows)} loops stable"
        verdict = f"{'PASS' if self.ok else 'FAIL'}, {stable}"
        title = f"Margins of controller {self.controller.name}, {self.controller.called}: {verdict}"
        return Report(title, (*tables, checks_block(self.checks)), data=self.as_data())

    @property
    def data_rows(self) -> list[dict[str, Any]]:
        """Margins as JSON data, with a row for each scheduling value and set of actuators.

        A row contains the spectral abscissa of the closed loop, and gain (dB), phase (deg),
        crossover (rad/s) and delay (s) of each loop.
        """
        by = self.controller.model.schedule
        rows = []
        for row in self.rows:
            loops = [
                {
                    "loop": name,
                    "gain": margin.gain,
                    "phase": margin.phase,
                    "crossover": margin.crossover,
                    "delay": margin.delay,
                }
                for name, margin in row.loops.items()
            ]
            actuators = [dict(vars(acting)) for acting in row.actuators]
            rows.append(
                {
                    by: row.scheduled_at,
                    "abscissa": row.stability.value,
                    "actuators": actuators,
                    "loops": loops,
                }
            )
        return rows


def _smallest_table(
    names: tuple[str, ...], cells_by_name: Mapping[tuple[str, ...], list[_Cell]]
) -> Table:
    """Return a table of the smallest gain, phase and delay margins, a row for each set."""
    rows = []
    for words, cells in cells_by_name.items():
        gain = min(cells, key=lambda cell: cell.margin.gain)
        phase = min(cells, key=lambda cell: cell.margin.phase)
        delay = min(cell.margin.delay for cell in cells)
        row = [*words, f"{gain.margin.gain:.1f}", gain.where]
        row += [f"{phase.margin.phase:.0f}", f"{phase.margin.crossover:.3g}", phase.where]
        rows.append((*row, f"{1e3 * delay:.0f}"))
    return Table((*names, "gain dB", "at", "phase deg", "rad/s", "at", "delay ms"), rows)


@checks_arguments
def check_margins(
    model: Model,
    controller: ScheduledController,
    scheduling_values: np.ndarray,
    bandwidths: Sequence[float] = (),
    *,
    progress: Progress | None = None,
) -> MarginTable:
    """Return the margins of a controller about the trims at several scheduling values.

    Each bandwidth is used with actuators of order 1 and of order 2, or of order 2 alone if the
    controller measures the rate of an actuator.

    scheduling_values: (N,)
    bandwidths: bandwidths of the actuators, rad/s, equal at all inputs; empty for the actuators of
        the controller's design

    Raises BadInputError if the controller was made for another model or does not cover the
    scheduling values.
    """
    lowest = float(scheduling_values.min())
    controller.refuse_other(model, lowest, float(scheduling_values.max()))
    inputs = controller.inputs
    measured = controller.measurements
    rates_measured = {f"{name}_rate" for name in inputs} & {*measured}
    orders = ORDERS[1:] if rates_measured else ORDERS
    banks: list[dict[str, Actuator]] = [
        dict.fromkeys(inputs, Actuator(order, bandwidth))
        for order, bandwidth in itertools.product(orders, bandwidths)
    ]
    rows = []
    for value in with_progress(scheduling_values.tolist(), progress):
        linear = level_model(model, value)
        for actuators in banks or [actuators_of(controller.name, controller.about)]:
            loop = servo_loop(servo_plant(model, linear, controller, actuators), controller)
            stability = loop.stability
            margins = servo_margins(loop, inputs, measured) if stability.is_stable else {}
            rows.append(LoopRow(value, tuple(actuators.values()), stability, margins))
    return MarginTable(controller, tuple(rows))
