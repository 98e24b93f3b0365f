"""A controller on a plant with actuators of choice: the closed loop, its poles, its margins at inputs and sensors, and
whether it is stable with every actuator that the aircraft may have: all corners, at every angle."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
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
