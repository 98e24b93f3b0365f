"""A controller on a plant with actuators of choice: the closed loop, its poles, its margins at inputs and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from controller.design.design import Actuator, Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import ScheduledController
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import DiskMargin, disk_margin
from hfa_model.aircraft import Aircraft
from hfa_support.errors import NoSolutionError
from trim.linear.linear_model import LinearModel


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
    design = Design(
        controller.name,
        inputs=controller.inputs,
        actuators=actuators,
        sensors=dict.fromkeys(controller.measurements, 1.0),
        input_weights=dict.fromkeys(controller.inputs, 1.0),
    )
    return design_model(aircraft, model, design)


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
