"""What is flown, as deviations from one operating point: a linear model or the equations of any `Model`, whose
parameters are numbers or an input of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.envelope import ALPHA, ANGLE_OF_ATTACK, flown_through_air
from hfa_support.errors import BadInputError
from hfa_support.model import HasModel, Model, components
from trim.point.operating_point import OperatingPoint

#: The disturbance of a model that a gust is.
UPDRAFT = "updraft"
#: Disturbance of the model -> its value; those that are not there are 0.
Winds = Mapping[str, Any]


class Sizes(NamedTuple):
    """How many numbers: x, the states of the linear model among them, u."""

    states: int
    seen: int
    inputs: int


class Plant:
    """A plant in deviations x (n,) from its operating point, as CasADi expressions.

    chosen: (k, n), the states of the linear model among all. constants_size: length of p, what differs from flight to
    flight (the parameters of the aircraft, say).
    """

    constants_size = 0
    chosen: np.ndarray
    sizes: Sizes

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """x', for an input deviation u (m,), a disturbance d (k,) that adds to the rates of the states of the linear
        model, and disturbances of the model."""
        raise NotImplementedError

    def seen(self, x: ca.SX) -> ca.SX:
        """The deviations of the states of the linear model, (k,)."""
        return ca.mtimes(ca.DM(self.chosen), x)

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The deviation of alpha through the air where it is not alpha, (1,); else (0,)."""
        return ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class LinearPlant(Plant):
    """x' = A x + B u + d + E w. A: (n, n), B: (n, m), E: disturbance -> (n,), none unless given.

    BadInputError for a disturbance without its E.
    """

    A: np.ndarray
    B: np.ndarray
    E: Mapping[str, np.ndarray] = field(default_factory=dict)
    states: np.ndarray | None = None

    @classmethod
    def at(cls, aircraft: HasModel, point: OperatingPoint, winds: Sequence[str] = ()) -> LinearPlant:
        """All states of an aircraft, with the exact derivatives at an operating point, those by these disturbances
        among them: what `NonlinearPlant` is to first order."""
        model = aircraft.model
        found = model.at(point.states, point.inputs, disturbances=winds)
        return cls(found.A, found.B, dict(zip(winds, found.E.T, strict=True)), chosen_states(model))

    @property
    def chosen(self) -> np.ndarray:  # type: ignore[override]
        """`states`; all unless given."""
        return np.eye(len(self.A)) if self.states is None else self.states

    @property
    def sizes(self) -> Sizes:  # type: ignore[override]
        """By the shapes."""
        return Sizes(len(self.A), len(self.chosen), self.B.shape[1])

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """A x + B u + d + E w."""
        rate = ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u) + ca.mtimes(ca.DM(self.chosen.T), d)
        for name, w in (winds or {}).items():
            if name not in self.E:
                raise BadInputError(f"a linear model of A and B has no {name}; linearize the aircraft with it")
            rate = rate + ca.DM(self.E[name]) * w
        return rate


@dataclass(frozen=True, eq=False)
class NonlinearPlant(Plant):
    """X' = f(X, U, p, w) + d with X = X0 + x, U = U0 + u: the equations of an aircraft about an operating point.

    uncertain: the parameters of the model are an input, p. BadInputError when the point was trimmed with another model.
    """

    aircraft: HasModel
    point: OperatingPoint
    uncertain: bool = False

    def __post_init__(self) -> None:
        """A trim of other dynamics is none of this aircraft."""
        model = self.model
        self.point.refuse_other(model)
        sizes = Sizes(len(model.states), len(model.linear), len(model.inputs))
        chosen, count = chosen_states(model), len(model.parameters) if self.uncertain else 0
        for name, value in (("sizes", sizes), ("chosen", chosen), ("constants_size", count)):
            object.__setattr__(self, name, value)

    @property
    def model(self) -> Model:
        """Whose equations these are."""
        return self.aircraft.model

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """f(X0 + x, U0 + u, p, w), disturbed."""
        model = self.model
        X, U = self._absolute(x), components(ca.DM(np.array(self.point.inputs)) + u)
        parameters = components(p) if self.uncertain and p is not None else model.p.tolist()
        w = [(winds or {}).get(name, 0.0) for name in model.disturbances]
        return model.layout.expressions((X, U, parameters), (), w)[0] + ca.mtimes(ca.DM(self.chosen.T), d)

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The output `ANGLE_OF_ATTACK` in winds, of a model that has one beside alpha.

        BadInputError where it depends on an input: then it is no angle of the flow alone.
        """
        model = self.model
        if not winds or not flown_through_air(model):
            return ca.SX(0, 1)
        u, w = ca.SX.sym("u", len(model.inputs)), [winds.get(name, 0.0) for name in model.disturbances]
        given = self._absolute(x), components(u), model.p.tolist()
        angle = model.layout.expressions(given, (ANGLE_OF_ATTACK,), w)[1]
        if ca.depends_on(angle, u):
            raise BadInputError(f"{model.name}: {ANGLE_OF_ATTACK} depends on an input; rename that output")
        return angle - getattr(self.point.states, ALPHA)

    def _absolute(self, x: ca.SX) -> list[ca.SX]:
        return components(ca.DM(np.array(self.point.states)) + x)


def chosen_states(model: Model) -> np.ndarray:
    """(k, n): the states of the linear model among all."""
    return np.array([[float(name == other) for other in model.states] for name in model.linear])
