"""Exact linear models at an operating point."""

from __future__ import annotations

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.linear.linear_model import LinearModel
from trim.linear.output_model import UPDRAFT, output_model
from trim.point.operating_point import OperatingPoint


def linearize(
    aircraft: Aircraft,
    point: OperatingPoint,
    *,
    full: bool = False,
    outputs: tuple[str, ...] | None = None,
    disturbances: tuple[str, ...] | None = None,
    ground_drag: bool = False,
) -> LinearModel:
    """A = ∂f/∂X, B = ∂f/∂U, C = ∂y/∂X, D = ∂y/∂U, E = ∂f/∂w, F = ∂y/∂w at (X0, U0) in still air, by algorithmic
    differentiation (exact to rounding).

    Returns the six states of the paper's model (Section 2.2), or all seven with altitude when `full`.
    outputs: names of `hfa_model.outputs` or of states; None for the states of the model.
    disturbances: winds w with names of `hfa_model.winds`, ft/s; None for the uniform updraft where outputs are asked
    for. ground_drag: with these winds the drag takes the speed over ground, not that through the air.
    BadInputError when the point belongs to other dynamics than the aircraft, or an output or a wind is unknown.
    """
    if point.dynamics != aircraft.variant.name:
        raise BadInputError(
            f"the operating point was trimmed with {point.dynamics!r} dynamics, the aircraft has "
            f"{aircraft.variant.name!r}; trim it again"
        )
    _, A, B = aircraft.jacobians(np.array(point.states), np.array(point.inputs))
    watched = None
    if outputs is not None or disturbances is not None:
        seen = outputs or (STATES if full else LINEAR_STATES)
        watched = output_model(aircraft, point, seen, STATES, disturbances or UPDRAFT, ground_drag=ground_drag)
    model = LinearModel(A, B, STATES, INPUTS, point, watched)
    return model if full else model.select(LINEAR_STATES)
