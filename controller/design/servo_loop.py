"""A controller on a plant with actuators of choice: the closed loop, its poles, its margins at inputs and sensors, and
whether it is stable with every actuator that the aircraft may have: all corners, at every angle."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.design.design import Actuator, Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import ScheduledController
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import DiskMargin, disk_margin
from hfa_model.aircraft import Aircraft
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, Checked, below, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from trim.linear.linear_model import LinearModel, level_model

#: Ends of the ranges of the corners: share of a command that arrives, and rad/s.
EFFECTIVENESS, BANDWIDTH = (0.2, 1.0), (0.5, 2.0)
ORDERS = (1, 2)
#: Frequencies at which the loops are looked at.
GRID = 4000


@dataclass(frozen=True, eq=False)
class ServoLoop:
    """x' = A x + B u + gust w, y = C x + F w of the plant with x_c' = Ak x_c + Bk y, u = Ck x_c + Dk y.

    w: an updraft, ft/s. The commands are at rest.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Ak: np.ndarray
    Bk: np.ndarray
    Ck: np.ndarray
    Dk: np.ndarray
    gust: np.ndarray
    F: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """The matrix of [x; x_c] with the loop closed; NoSolutionError where its numbers overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.block([[self.A + self.B @ self.Dk @ self.C, self.B @ self.Ck], [self.Bk @ self.C, self.Ak]])
        if not np.isfinite(found).all():
            raise NoSolutionError("the closed loop overflows; check the actuators and the weights")
        return found

    @property
    def disturbed(self) -> np.ndarray:
        """The column of w in the rates of [x; x_c] with the loop closed."""
        return np.vstack([self.gust + self.B @ self.Dk @ self.F, self.Bk @ self.F])

    @property
    def abscissa(self) -> float:
        """Largest real part of a pole of the closed loop, 1/s."""
        return spectrum(self.closed).abscissa

    def margin_at_inputs(self) -> DiskMargin:
        """All commands at once multiplied by their own complex factors. NoSolutionError when the loop is unstable."""
        nk = len(self.Ak)
        A = np.block([[self.A, np.zeros((len(self.A), nk))], [self.Bk @ self.C, self.Ak]])
        B = np.vstack([self.B, np.zeros((nk, self.B.shape[1]))])
        return _margin(A, B, -np.hstack([self.Dk @ self.C, self.Ck]))

    def margin_at_sensors(self) -> DiskMargin:
        """All measurements at once multiplied by their own complex factors. NoSolutionError as above."""
        nk = len(self.Ak)
        A = np.block([[self.A, self.B @ self.Ck], [np.zeros((nk, len(self.A))), self.Ak]])
        B = np.vstack([self.B @ self.Dk, self.Bk])
        return _margin(A, B, -np.hstack([self.C, np.zeros((len(self.C), nk))]))


def servo_plant(
    aircraft: Aircraft, model: LinearModel, controller: ScheduledController, actuators: Mapping[str, Actuator]
) -> DesignModel:
    """The linear model with these actuators, its sensors the measurements of the controller; E of the updraft."""
    ones = dict.fromkeys(controller.measurements, 1.0), dict.fromkeys(controller.inputs, 1.0)
    loop = Design("loop", controller.inputs, actuators, sensors=ones[0], input_weights=ones[1])
    return design_model(aircraft, model, loop)


def servo_loop(plant: DesignModel, controller: ScheduledController) -> ServoLoop:
    """The controller at the dihedral of the plant. Where inputs move a measured output at once, that path is closed."""
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.states.dihedral)
    measured = len(controller.measurements)
    Bk, Dk = Bk[:, :measured], Dk[:, :measured]
    if np.any(plant.D):  # u = Ck x_c + Dk (C x + D u)
        closing = np.linalg.inv(np.eye(len(Dk)) - Dk @ plant.D)
        Ck, Dk = closing @ Ck, closing @ Dk
        Ak, Bk = Ak + Bk @ plant.D @ Ck, Bk @ (np.eye(measured) + plant.D @ Dk)
    return ServoLoop(plant.A, plant.B, plant.C, Ak, Bk, Ck, Dk, plant.gust, plant.F)


def _margin(A: np.ndarray, B: np.ndarray, K: np.ndarray) -> DiskMargin:
    game = Game(A=A, B=B, E=np.zeros((len(A), 1)), Q=np.eye(len(A)), R=np.eye(B.shape[1]), delta=np.inf)
    return disk_margin(game, K)


class LoopMargin(NamedTuple):
    """What one loop bears while all others stay closed; of "all inputs": the same factor or delay in every input.

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
    orders = [list(each) for each in itertools.permutations(range(loci.shape[1]))]
    for k in range(1, len(loci)):  # in the order of the ones before
        apart = [np.abs(loci[k][order] - loci[k - 1]).sum() for order in orders]
        loci[k] = loci[k][orders[int(np.argmin(apart))]]
    return (*single, _margin_of("all inputs", loci, grid))


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


class ActuatorMargins(NamedTuple):
    """Margins at one angle, rad, behind actuators of one order and bandwidth (rad/s); () where the loop is unstable."""

    dihedral: float
    order: int
    bandwidth: float
    abscissa: float
    loops: tuple[LoopMargin, ...]

    @property
    def actuators(self) -> str:
        """For a person."""
        return f"order {self.order}, {self.bandwidth:g} rad/s" if self.order else "none"


@dataclass(frozen=True, eq=False, repr=False)
class MarginTable(Checked, Reported):
    """Margins of a controller loop by loop, at every angle, behind every actuator."""

    controller: ScheduledController
    rows: tuple[ActuatorMargins, ...]

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every loop is stable."""
        worst = max(self.rows, key=lambda row: row.abscissa)
        where = f"{in_degrees(worst.dihedral):g} deg, actuators {worst.actuators}"
        return (below("largest_abscissa", worst.abscissa, 0.0, f"the loop is unstable at {where}"),)

    def report(self) -> Report:
        """The smallest margins of each loop, and of each angle."""
        stable = [(row, each) for row in self.rows for each in row.loops]
        by_loop: dict[tuple[str, str], list[tuple[ActuatorMargins, LoopMargin]]] = {}
        by_angle: dict[float, list[tuple[ActuatorMargins, LoopMargin]]] = {}
        for row, each in stable:
            by_loop.setdefault((row.actuators, each.loop), []).append((row, each))
            if each.loop != "all inputs":
                by_angle.setdefault(row.dihedral, []).append((row, each))
        loops = [(*names, *_smallest(found, "deg")) for names, found in by_loop.items()]
        angles = [(f"{in_degrees(angle):g}", *_smallest(found, "loop")) for angle, found in by_angle.items()]
        header = ("gain dB", "at", "phase deg", "rad/s", "at", "delay ms")
        return Report(
            f"Margins of controller {self.controller.name}, one loop at a time: {'stable' if self.ok else 'UNSTABLE'}",
            (
                Table(("actuators", "loop", *header), loops),
                Table(("dihedral", *header), angles),
                checks_block(self.checks),
            ),
            data=self.to_dict(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: angles in rad, delays in s."""
        rows = [{**row._asdict(), "loops": [each._asdict() for each in row.loops]} for row in self.rows]
        return {"ok": self.ok, "rows": rows, "checks": [check.to_dict() for check in self.checks]}


def _smallest(found: list[tuple[ActuatorMargins, LoopMargin]], where: str) -> tuple[str, ...]:
    """Cells of the smallest gain, phase and delay; where: the angle ("deg"), or the loop and its actuators."""

    def place(pair: tuple[ActuatorMargins, LoopMargin]) -> str:
        row, each = pair
        return f"{in_degrees(row.dihedral):g} deg" if where == "deg" else f"{each.loop}, {row.actuators}"

    gain = min(found, key=lambda pair: pair[1].gain)
    phase = min(found, key=lambda pair: pair[1].phase)
    delay = min(found, key=lambda pair: pair[1].delay)
    return (
        f"{gain[1].gain:.1f}",
        place(gain),
        f"{phase[1].phase:.0f}",
        f"{phase[1].crossover:.3g}",
        place(phase),
        f"{1e3 * delay[1].delay:.0f}",
    )


def check_margins(
    aircraft: Aircraft,
    controller: ScheduledController,
    dihedrals: np.ndarray,
    bandwidths: Sequence[float],
    *,
    progress: Progress | None = None,
) -> MarginTable:
    """The loops about the level trims at `dihedrals` (N,), rad, behind actuators of both orders and these bandwidths
    (rad/s) in every input; without any where `bandwidths` is empty. BadInputError as `check_corners`."""
    controller.refuse_other(aircraft, float(dihedrals.min()), float(dihedrals.max()))
    rates = {f"{name}_rate" for name in controller.inputs}
    orders = ORDERS[1:] if rates & set(controller.measurements) else ORDERS
    kinds = list(itertools.product(orders, bandwidths)) or [(0, math.inf)]
    rows = []
    for dihedral in told(dihedrals.tolist(), progress):
        model = level_model(aircraft, dihedral)
        for order, bandwidth in kinds:
            actuators = {name: Actuator(order, bandwidth) for name in controller.inputs if order}
            loop = servo_loop(servo_plant(aircraft, model, controller, actuators), controller)
            stable = loop.abscissa < 0.0
            loops = loop_margins(loop, controller.inputs, controller.measurements) if stable else ()
            rows.append(ActuatorMargins(dihedral, order, bandwidth, loop.abscissa, loops))
    return MarginTable(controller, tuple(rows))


class Corner(NamedTuple):
    """Actuators at one angle, rad; effectiveness and bandwidth (rad/s) of each input, in order."""

    dihedral: float
    order: int
    effectiveness: tuple[float, ...]
    bandwidth: tuple[float, ...]

    def text(self, inputs: tuple[str, ...]) -> str:
        """For a person."""
        each = (
            f"{name} {share:g} at {bandwidth:g} rad/s"
            for name, share, bandwidth in zip(inputs, self.effectiveness, self.bandwidth, strict=True)
        )
        return f"{in_degrees(self.dihedral):g} deg, order {self.order}, {', '.join(each)}"


class Found(NamedTuple):
    """A figure and the corner where it is worst."""

    value: float
    corner: Corner


@dataclass(frozen=True, eq=False, repr=False)
class CornerCheck(Checked, Reported):
    """What became of every corner: the largest abscissa, 1/s, and the smallest disk margins, 0 where it is unstable."""

    controller: ScheduledController
    loops: int
    unstable: int
    abscissa: Found
    at_inputs: Found
    at_sensors: Found

    @property
    def checks(self) -> tuple[Check, ...]:
        """Stable at every corner."""
        where = self.abscissa.corner.text(self.controller.inputs)
        reason = f"unstable at {self.unstable} of {self.loops} corners, worst at {where}"
        return (below("largest_abscissa", self.abscissa.value, 0.0, reason),)

    def report(self) -> Report:
        """Verdict, worst corner, smallest margins."""
        inputs = self.controller.inputs
        found = {
            "largest abscissa, 1/s": self.abscissa,
            "smallest disk margin at the inputs": self.at_inputs,
            "smallest disk margin at the sensors": self.at_sensors,
        }
        rows = [(name, f"{each.value:.4g}", each.corner.text(inputs)) for name, each in found.items()]
        name, dynamics = self.controller.name, self.controller.dynamics
        return Report(
            f"Corners of the actuators for controller {name}, {dynamics} dynamics: "
            f"{'PASS' if self.ok else 'FAIL'}, {self.loops - self.unstable} of {self.loops} loops stable",
            (
                f"effectiveness {_ends(EFFECTIVENESS)}, bandwidth {_ends(BANDWIDTH)} rad/s, each input by itself, "
                f"orders {ORDERS[0]} and {ORDERS[1]}",
                Table(("worst of all corners", "value", "where"), rows),
                checks_block(self.checks),
            ),
            data=self.to_dict(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; angles in rad."""
        figures = {name: getattr(self, name) for name in ("abscissa", "at_inputs", "at_sensors")}
        return {
            "ok": self.ok,
            "loops": self.loops,
            "unstable": self.unstable,
            **{name: {"value": each.value, **each.corner._asdict()} for name, each in figures.items()},
            "checks": [check.to_dict() for check in self.checks],
        }


def check_corners(
    aircraft: Aircraft, controller: ScheduledController, *, progress: Progress | None = None
) -> CornerCheck:
    """Close the loop at every corner of `EFFECTIVENESS` and `BANDWIDTH`, each input by itself, for both orders.

    The plant is linear, about the level trim at each angle of the controller. BadInputError when the controller is for
    another aircraft.
    """
    angles = controller.dihedrals
    controller.refuse_other(aircraft, float(angles.min()), float(angles.max()))
    worst: list[Found] = []
    unstable = loops = 0
    for dihedral in told(angles.tolist(), progress):
        model = level_model(aircraft, dihedral)
        for corner, loop in corner_loops(aircraft, model, controller):
            abscissa, loops = loop.abscissa, loops + 1
            margins = [0.0, 0.0]
            if abscissa < 0.0:
                margins = [loop.margin_at_inputs().disk, loop.margin_at_sensors().disk]
            else:
                unstable += 1
            figures = [Found(value, corner) for value in (abscissa, *margins)]
            sides = (max, min, min)
            worst = [
                choose(before, now, key=lambda found: found.value)
                for choose, before, now in zip(sides, worst or figures, figures, strict=True)
            ]
    return CornerCheck(controller, loops, unstable, *worst)


def corner_loops(
    aircraft: Aircraft, model: LinearModel, controller: ScheduledController
) -> Iterator[tuple[Corner, ServoLoop]]:
    """Every corner at the angle of a linear model, and its loop."""
    n = len(controller.inputs)
    shares_of_all = itertools.product(EFFECTIVENESS, repeat=n)
    bandwidths_of_all = itertools.product(BANDWIDTH, repeat=n)
    for order, shares, bandwidths in itertools.product(ORDERS, shares_of_all, bandwidths_of_all):
        actuators = {
            name: Actuator(order=order, effectiveness=share, bandwidth=bandwidth)
            for name, share, bandwidth in zip(controller.inputs, shares, bandwidths, strict=True)
        }
        plant = servo_plant(aircraft, model, controller, actuators)
        yield Corner(model.point.states.dihedral, order, shares, bandwidths), servo_loop(plant, controller)


def _ends(values: tuple[float, float]) -> str:
    return f"{values[0]:g} to {values[1]:g}"
