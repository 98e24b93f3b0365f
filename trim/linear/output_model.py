"""Outputs of a linear model: y = C x + D u + F w, and the columns E of the winds w in the rates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.dynamics import by_name, symbols
from hfa_model.outputs import OUTPUTS, moment_of, outputs_of, unit_of
from hfa_model.variants import Variant
from hfa_model.vectors import LINEAR_STATES, STATES
from hfa_model.winds import DISTURBANCE_UNIT, DISTURBANCES, winds_named
from hfa_support.by_value import ByValue
from hfa_support.errors import BadInputError, refuse_unknown
from trim.point.operating_point import OperatingPoint

#: What w is unless winds are named.
UPDRAFT = ("updraft",)


@dataclass(frozen=True, eq=False)
class OutputModel(ByValue):
    """y - Y0 = C x + D u + F w,  x' = A x + B u + E w  beside the A and B of a linear model.

    C: (k, n). D: (k, m). F: (k, l). E: (n, l). w: winds with names of `hfa_model.winds`, ft/s. offsets: Y0, (k,).
    outputs, output_units, disturbances: names and units, in order.
    """

    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    E: np.ndarray
    offsets: np.ndarray
    disturbances: tuple[str, ...] = UPDRAFT

    @property
    def disturbance_units(self) -> tuple[str, ...]:
        """Unit of each wind, in order."""
        return (DISTURBANCE_UNIT,) * len(self.disturbances)

    def part(self, states: list[int], inputs: list[int]) -> OutputModel:
        """What is left when only the states and inputs at these positions move."""
        return replace(self, C=self.C[:, states], D=self.D[:, inputs], E=self.E[states])


def output_model(
    aircraft: Aircraft,
    point: OperatingPoint,
    names: tuple[str, ...],
    states: tuple[str, ...] = LINEAR_STATES,
    disturbances: tuple[str, ...] = UPDRAFT,
    *,
    ground_drag: bool = False,
) -> OutputModel:
    """C = ∂y/∂X, D = ∂y/∂U, F = ∂y/∂w, E = ∂f/∂w at the operating point in still air, exact to rounding.

    states: those of the linear model, in its order; the others are held at their offsets. disturbances: names of
    winds, and ground_drag: whether the drag takes the speed over ground, as in `hfa_model.winds`.
    BadInputError when a name is neither an output nor a state, is no wind, or named twice.
    """
    for what, chosen, known in (
        ("output", names, (*STATES, *OUTPUTS)),
        ("disturbance", disturbances, tuple(DISTURBANCES)),
    ):
        for name in chosen:
            refuse_unknown(f"unknown {what}", name, known)
            if chosen.count(name) > 1:
                raise BadInputError(f"{what} {name} is named twice; name it once")
    found = _derivatives(aircraft.variant, names, disturbances, ground_drag)(
        np.array(point.states), np.array(point.inputs), np.array(aircraft.parameters)
    )
    offsets, C, D, F, E = (np.array(ca.DM(part)) for part in found)
    rows = [STATES.index(name) for name in states]
    return OutputModel(names, tuple(map(unit_of, names)), C[:, rows], D, F, E[rows], offsets.ravel(), disturbances)


@lru_cache(maxsize=16)
def _derivatives(
    variant: Variant, names: tuple[str, ...], disturbances: tuple[str, ...], ground_drag: bool
) -> ca.Function:
    """(x, u, p) -> y, ∂y/∂x, ∂y/∂u, ∂y/∂w, ∂f/∂w at w = 0."""
    (x, u, p), w = symbols(), ca.SX.sym("w", len(disturbances))
    winds = winds_named(disturbances, ca.vertsplit(w), ground_drag=ground_drag)
    moment = moment_of(*by_name(x, u, p), variant, winds)
    y, f = ca.vertcat(ca.SX(0, 1), *outputs_of(moment, names)), ca.vertcat(*moment.rates)
    parts = [y, *(ca.jacobian(y, by) for by in (x, u, w)), ca.jacobian(f, w)]
    still = [ca.densify(ca.substitute(part, w, 0)) for part in parts]
    return ca.Function("outputs", [x, u, p], still)
