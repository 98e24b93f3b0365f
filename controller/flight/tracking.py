"""How well a flight follows its commands, and how fast its actuators move."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.design.design import SHORT_PERIOD
from controller.flight.closed_loop import Flight
from controller.policy.commands import CommandSteps
from controller.policy.servo_policy import MeasuredOutputs
from hfa_model.outputs import unit_of
from hfa_model.vectors import LINEAR_ROWS
from hfa_support.reporting.text import Table, short_number, shown_unit


class Tracked(NamedTuple):
    """An output and its command, (N,) each as deviations from trim; root mean square and largest of their difference.

    Of the whole flight, in the output's unit.
    """

    name: str
    output: np.ndarray
    command: np.ndarray

    @property
    def unit(self) -> str:
        """Of the output and its command."""
        return unit_of(self.name.removesuffix(SHORT_PERIOD))

    @property
    def rms(self) -> float:
        """sqrt(mean (z - r)²)."""
        return float(np.sqrt(np.mean((self.output - self.command) ** 2)))

    @property
    def largest(self) -> float:
        """max |z - r|."""
        return float(np.abs(self.output - self.command).max())


def tracked(flight: Flight, outputs: MeasuredOutputs, commands: CommandSteps) -> tuple[Tracked, ...]:
    """Each commanded output of a flight beside its command, without the noise of the sensors."""
    air = np.broadcast_to(flight.updrafts.reshape(len(flight.times), -1), (len(flight.times), outputs.F.shape[1]))
    z = flight.states[:, LINEAR_ROWS] @ outputs.C.T + flight.inputs @ outputs.D.T + air @ outputs.F.T
    return tuple(map(Tracked, commands.names, z.T, commands.sampled(flight.times).T))


def fastest_inputs(flight: Flight) -> np.ndarray:
    """Largest |ΔU| / step of each input, (5,), per s."""
    if len(flight.times) < 2:
        return np.zeros(flight.inputs.shape[1])
    rates: np.ndarray = np.abs(np.diff(flight.inputs, axis=0)).max(axis=0) / (flight.times[1] - flight.times[0])
    return rates


def tracking_table(followed: tuple[Tracked, ...]) -> Table:
    """Degrees for angles."""
    rows = []
    for each in followed:
        sizes = (short_number(value, each.unit) for value in (each.rms, each.largest))
        rows.append((each.name, shown_unit(each.unit), *sizes))
    return Table(("commanded output", "unit", "rms error", "largest error"), rows)
