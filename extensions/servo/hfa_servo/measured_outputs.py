"""Outputs of the linear model, as a controller measures them during a flight."""

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
    """Measured outputs y - Y0 = C x + D a + F w + G a' of the linear model at a trim.

    The outputs may include the actuator states INPUT_position and INPUT_rate.

    x: deviations of the states of the linear model
    a: deviations of the actuator positions, with the actuator rates a'
    w: updraft, for a model with this disturbance
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
        """Return the deviations y - Y0 of the outputs from their trim values, (k,).

        Raises BadInputError if the outputs depend on actuator positions or rates that the flight
        does not have.
        """
        y = ca.mtimes(ca.DM(self.C), measurements.states)
        if measurements.updraft.numel():
            y = y + ca.mtimes(ca.DM(self.F), measurements.updraft)
        y = y + _moved(self.D, measurements.positions, "positions")
        return y + _moved(self.G, measurements.rates, "rates")


def _moved(matrix: np.ndarray, moved: ca.SX, what: str) -> ca.SX:
    """Return the effect of the actuators on the outputs, matrix @ moved, or 0 for a zero matrix.

    moved: actuator positions or rates, empty for a flight without actuator states
    what: "positions" or "rates", for the message

    Raises BadInputError if the matrix is not zero and `moved` is empty.
    """
    if not matrix.any():
        return ca.SX(0)
    if not moved.numel():
        raise BadInputError(
            f"the controller measures actuator {what}, which this flight does not have; give"
            " actuators with these states"
        )
    return ca.mtimes(ca.DM(matrix), moved)
