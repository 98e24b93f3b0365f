"""A linear flight through commands: the controller at one angle, its command filter, actuators of choice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controller.design.command_shaping import command_rates
from controller.design.design import Feedforward
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController

#: s, of the record. The response to commands held in a step is exact.
STEP = 0.1


class CommandFlight(NamedTuple):
    """errors: rms of measured minus commanded output, by output. rate: largest rate of an input's position, rad/s."""

    errors: dict[str, float]
    rate: float


def fly_commands(
    plant: DesignModel,
    controller: ScheduledController,
    ends: np.ndarray,
    each: float,
    command_filter: Feedforward,
) -> CommandFlight:
    """Follow r'' = ω² r_end - 2 ζ ω r' - ω² r with r_end = ends[k] for `each` s, one row after the other.

    plant: of `servo_plant`, its inputs behind actuators. ends: (K, q), in the order of the integrated outputs, about
    the trim. The record is of `STEP`. A loop that grows beyond the numbers has infinite errors.
    """
    from scipy.linalg import expm

    outputs = commanded(controller)
    rows = [controller.measurements.index(name) for name in outputs]
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.states.dihedral)
    told = _told(controller, outputs)
    p, n, nk, q = len(controller.measurements), len(plant.A), len(Ak), len(outputs)
    Bw, Dw = Bk[:, p:] @ told, Dk[:, p:] @ told
    Bk, Dk = Bk[:, :p], Dk[:, :p]
    S = command_rates(command_filter, q)
    loop = np.block(
        [
            [plant.A + plant.B @ Dk @ plant.C, plant.B @ Ck, plant.B @ Dw],
            [Bk @ plant.C, Ak, Bw],
            [np.zeros((3 * q, n + nk)), S],
        ]
    )
    step, per = expm(STEP * loop), round(each / STEP)
    record = np.zeros((len(ends) * per + 1, len(loop)))
    with np.errstate(over="ignore", invalid="ignore"):
        for number, end in enumerate(ends):
            record[number * per, -q:] = end
            for k in range(number * per, (number + 1) * per):
                record[k + 1] = step @ record[k]
        errors = record[:, :n] @ plant.C[rows].T - record[:, n + nk : n + nk + q]
        rms = np.nan_to_num(np.sqrt(np.mean(errors**2, axis=0)), nan=np.inf)
        moving = [plant.states.index(f"{name}_position") for name in controller.inputs]
        rate = np.nan_to_num(np.abs(record @ loop[moving].T).max(), nan=np.inf)
    return CommandFlight(dict(zip(outputs, rms.tolist(), strict=True)), float(rate))


def commanded(controller: ScheduledController) -> tuple[str, ...]:
    """Outputs that the controller is told a command of."""
    value = COMMAND_SIGNALS[0]
    return tuple(name.removesuffix(value) for name in controller.commands if name.endswith(value))


def _told(controller: ScheduledController, outputs: Sequence[str]) -> np.ndarray:
    """The commands of the controller from w = [r; r'; r_end], (commands, 3q)."""
    names = [f"{output}{signal}" for signal in COMMAND_SIGNALS for output in outputs]
    return np.eye(len(names))[[names.index(name) for name in controller.commands]]
