"""Tracking errors of a controller during a flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_flight.flight_history import Deviations
from hfa_flight.signals import CommandSteps
from hfa_servo.measured_outputs import MeasuredOutputs


class Tracked(NamedTuple):
    """An output and its command during a flight.

    output, command: (N,), deviations from trim
    unit: unit of the output
    rms, largest: rms and largest absolute difference, in `unit`
    """

    name: str
    output: np.ndarray
    command: np.ndarray
    unit: str
    rms: float
    largest: float


def tracked(flight: Deviations, outputs: MeasuredOutputs, commands: CommandSteps) -> list[Tracked]:
    """Return each commanded output of a flight with its command. The output has no sensor noise."""
    model = outputs.model
    rows = [list(model.states).index(name) for name in model.linear]
    values = flight.states[:, rows] @ outputs.C.T + flight.inputs @ outputs.D.T
    if outputs.F.size:
        values += flight.updrafts[:, None] @ outputs.F.T
    followed = []
    for name, output, command in zip(
        commands.names, values.T, commands.sampled(flight.times).T, strict=True
    ):
        errors = np.abs(output - command)
        rms = float(np.sqrt(np.mean(errors**2)))
        unit = model.unit(model.part(name)[0])
        followed.append(Tracked(name, output, command, unit, rms, float(errors.max())))
    return followed
