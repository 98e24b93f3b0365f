"""The aircraft with its parameters as an input of the loop: compiled once, simulated with any of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from controller.flight.plants import Equations, NonlinearPlant, Plant, SevenStates, spread
from hfa_model.dynamics import rates
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUTS, STATES, Input, State
from hfa_support.errors import BadInputError, refuse_unknown
from trim.point.operating_point import OperatingPoint

_N, _M = len(STATES), len(INPUTS)
#: Of [f0, A, B, b].
_COLUMNS = 1 + _N + _M + 1


class UncertainPlant(Plant, Protocol):
    """A plant about a trim of the nominal aircraft, whose own parameters come as numbers p later."""

    def constants(self, parameters: np.ndarray) -> np.ndarray:
        """p for parameters (18,) in the order of `Parameters`."""


@dataclass(frozen=True, eq=False)
class UncertainAircraft(SevenStates):
    """X' = f(X0 + x, U0 + u, w; θ) + d: `NonlinearPlant` with the parameters θ as an input, p = θ (18,)."""

    constants_size = len(Parameters._fields)

    variant: Variant
    point: OperatingPoint

    def constants(self, parameters: np.ndarray) -> np.ndarray:
        """The parameters themselves."""
        return parameters

    def rate(self, x: Any, u: Any, d: Any, updraft: Any = 0.0, p: Any = None) -> Any:
        """f(X0 + x, U0 + u, w; p), disturbed."""
        flown = Equations(Parameters(*ca.vertsplit(p)), self.variant)
        return NonlinearPlant(flown, self.point).rate(x, u, d, updraft)


@dataclass(frozen=True, eq=False)
class UncertainLinearization(SevenStates):
    """x' = f0(θ) + A(θ) x + B(θ) u + b(θ) w + d: what `UncertainAircraft` is to first order in x, u and w.

    f0, A, B, b: f and its exact derivatives at the nominal trim (X0, U0, 0), column by column in p. f0 is not zero
    where θ is not nominal: the trim of the design is not the trim of the aircraft.
    """

    constants_size = _N * _COLUMNS

    variant: Variant
    point: OperatingPoint

    def constants(self, parameters: np.ndarray) -> np.ndarray:
        """[f0, A, B, b] of these parameters, (98,)."""
        at = self.point
        flat = _expansion(self.variant)(np.array(at.states), np.array(at.inputs), parameters)
        return np.array(flat).ravel(order="F")

    def rate(self, x: Any, u: Any, d: Any, updraft: Any = 0.0, p: Any = None) -> Any:
        """[f0, A, B, b] [1; x; u; w], disturbed. BadInputError for a gust that differs along the span."""
        if isinstance(updraft, ca.SX) and updraft.numel() != 1:
            raise BadInputError("the linear members meet one updraft at every panel; simulate the nonlinear ones")
        known = ca.mtimes(ca.reshape(p, _N, _COLUMNS), ca.vertcat(1.0, x, u, updraft))
        return known + ca.mtimes(ca.DM(spread()), d)


#: Kind of plant -> its class.
PLANTS: dict[str, type[UncertainAircraft] | type[UncertainLinearization]] = {
    "nonlinear": UncertainAircraft,
    "linear": UncertainLinearization,
}


def uncertain_plant(kind: str, variant: Variant, point: OperatingPoint) -> UncertainPlant:
    """The plant of one of `PLANTS`. Raises BadInputError for another name."""
    refuse_unknown("unknown plant", kind, PLANTS)
    return PLANTS[kind](variant, point)


@lru_cache(maxsize=4)
def _expansion(variant: Variant) -> ca.Function:
    """(X0, U0, θ) -> [f0, A, B, b], (7, 14)."""
    X, U, theta = (ca.SX.sym(name, size) for name, size in (("X", _N), ("U", _M), ("p", len(Parameters._fields))))
    x, u, w = ca.SX.sym("x", _N), ca.SX.sym("u", _M), ca.SX.sym("w")
    f = ca.vertcat(
        *rates(State(*ca.vertsplit(X + x)), Input(*ca.vertsplit(U + u)), Parameters(*ca.vertsplit(theta)), variant, w)
    )
    whole = ca.horzcat(f, *(ca.jacobian(f, part) for part in (x, u, w)))
    zero = ca.substitute(whole, ca.vertcat(x, u, w), ca.DM.zeros(_N + _M + 1))
    return ca.Function("expansion", [X, U, theta], [ca.densify(zero)])
