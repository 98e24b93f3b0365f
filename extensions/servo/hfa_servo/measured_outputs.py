"""Outputs of the linear model that a controller measures in flight."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air import UPDRAFT
from hfa_flight.policies import Measurements
from hfa_servo.design_model import watched_outputs
from hfa_support.errors import BadInputError
from trim.point.operating_point import OperatingPoint


class MeasuredOutputs:
    """Outputs y - Y0 = C x + D a + F w + G a' of the linear model at a trim, by name.

    x, a and a' are the deviations of the states of the linear model, the deviations of the
    positions of the actuators, and the rates of the actuators. INPUT_position and INPUT_rate are
    outputs too. w is the updraft, for a model that has one. An accelerometer measures alpha through
    the air.
    """

    def __init__(self, model: Model, point: OperatingPoint, names: tuple[str, ...]) -> None:
        self.names = names
        self.model = model
        winds = (UPDRAFT,) if UPDRAFT in model.disturbances else ()
        self.C, self.D, self.F, _ = watched_outputs(model, point, names, disturbances=winds)
        self.G = np.zeros_like(self.D)
        inputs = tuple(model.inputs)
        for row, name in enumerate(names):
            moved, _, what = name.rpartition("_")
            if moved in inputs:
                matrix = self.D if what == "position" else self.G
                matrix[row, inputs.index(moved)] = 1.0

    def at(self, measurements: Measurements) -> ca.SX:
        """Return y - Y0, (k,).

        Raises BadInputError where the outputs need actuators, or their rates, that the flight does
        not have.
        """
        y = ca.mtimes(ca.DM(self.C), measurements.states)
        if measurements.updraft.numel():
            y = y + ca.mtimes(ca.DM(self.F), measurements.updraft)
        y = y + _moved(self.D, measurements.positions, "positions")
        return y + _moved(self.G, measurements.rates, "rates")


def _moved(matrix: np.ndarray, moved: ca.SX, what: str) -> ca.SX:
    """Return the contribution of actuator positions and rates to the outputs, or 0 without
    entries."""
    if not matrix.any():
        return ca.SX(0)
    if not moved.numel():
        raise BadInputError(
            f"the law measures the {what} of its actuators, which this flight does not have;"
            " give actuators"
        )
    return ca.mtimes(ca.DM(matrix), moved)
