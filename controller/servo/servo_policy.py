"""A scheduled controller in flight: its matrices at the measured scheduling variable, its
measurements, commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.policies import FlownLaw, Seen, Unvaried
from controller.flight.signals import CommandSteps
from controller.servo.design_model import watched_outputs
from controller.servo.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.linear_table import LinearTable
from trim.point.operating_point import OperatingPoint

_UPDRAFT = "updraft"
_MATRICES = ("A", "B", "C", "D", "W")


class ScheduledTable:
    """Matrices (N, rows, columns) each, as a `LinearTable`: one function that is called and not
    written out."""

    def __init__(self, places: np.ndarray, stacks: Sequence[np.ndarray]) -> None:
        self._shapes = [stack.shape[1:] for stack in stacks]
        flat = np.hstack([stack.transpose(0, 2, 1).reshape(len(stack), -1) for stack in stacks])
        eta = ca.SX.sym("eta")
        looked_up = ca.densify(LinearTable(places, flat).expression(eta))
        self._function = ca.Function("table", [eta], [looked_up], {"never_inline": True})

    def at(self, place: ca.SX) -> tuple[ca.SX, ...]:
        """Each matrix at a value of the scheduling variable."""
        ends = np.cumsum([0, *(rows * columns for rows, columns in self._shapes)]).tolist()
        parts = ca.vertsplit(self._function(place), ends)
        return tuple(
            ca.reshape(part, *shape) for part, shape in zip(parts, self._shapes, strict=True)
        )


class MeasuredOutputs:
    """y - Y0 = C x + D a + F w of named outputs of the linear model at a trim, x and a as
    deviations from it.

    w: the updraft, of a model that has one: an accelerometer feels alpha through the air.
    INPUT_position and INPUT_rate are those of the actuators."""

    def __init__(self, aircraft: Model, point: OperatingPoint, names: tuple[str, ...]) -> None:
        self.names, self.model = names, point.model
        inputs, air = tuple(self.model.inputs), (_UPDRAFT,) * (_UPDRAFT in self.model.disturbances)
        self.C, self.D, self.F, _ = watched_outputs(aircraft, point, names, disturbances=air)
        self.rates = np.zeros_like(self.D)
        for row, name in enumerate(names):
            of, _, what = name.rpartition("_")
            if of in inputs:
                (self.D if what == "position" else self.rates)[row, inputs.index(of)] = 1.0

    def at(self, seen: Seen) -> ca.SX:
        """y - Y0, (k,)."""
        y = ca.mtimes(ca.DM(self.C), seen.states)
        if seen.updraft.numel():
            y = y + ca.mtimes(ca.DM(self.F), seen.updraft)
        for matrix, moved in ((self.D, seen.positions), (self.rates, seen.rates)):
            if matrix.any():
                if not moved.numel():
                    kind = (
                        "rates of its actuators"
                        if matrix is self.rates
                        else "positions of its actuators"
                    )
                    raise BadInputError(
                        f"the law measures the {kind}, which this flight does not have; give actuators"
                    )
                y = y + ca.mtimes(ca.DM(matrix), moved)
        return y


@dataclass(frozen=True, eq=False)
class ServoPolicy(Unvaried):
    """x' = A(η) x + B(η) y + W(η) (u_applied - u),  u = C(η) x + D(η) y,  η the measured scheduling
    state.

    commands: names, and at(t), rate(t), end(t) of each, as `CommandSteps`. outputs: at(seen), what
    it measures. regulated: what is commanded. place: η of the trim in which the flight begins."""

    controller: ScheduledController
    commands: Any
    outputs: Any
    regulated: MeasuredOutputs
    place: float

    @property
    def memory_size(self) -> int:
        """The controller's states."""
        return len(self.controller.states)

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """u of the controller's inputs; 0, the trim, of the others."""
        _, _, C, D, _ = self._at(seen)
        return ca.mtimes(
            ca.DM(self._chosen), ca.mtimes(C, memory) + ca.mtimes(D, self._told(t, seen))
        )

    def memory_rate(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX, applied: ca.SX) -> ca.SX:
        """The rate of the states x of the controller."""
        A, B, _, _, W = self._at(seen)
        rate = ca.mtimes(A, memory) + ca.mtimes(B, self._told(t, seen))
        if not self.controller.W.any():
            return rate
        missed = ca.mtimes(ca.DM(self._chosen.T), applied - self.control(t, seen, memory, p))
        return rate + ca.mtimes(W, missed)

    def _told(self, t: ca.SX, seen: Seen) -> ca.SX:
        """[measured; commands]; an output without a command is commanded to stay at its trim."""
        signals = (self.commands.at(t), self.commands.rate(t), self.commands.end(t))
        rows = []
        for name in self.controller.commands:
            suffix = next(each for each in reversed(COMMAND_SIGNALS) if name.endswith(each))
            output, signal = name.removesuffix(suffix), signals[COMMAND_SIGNALS.index(suffix)]
            known = output in self.commands.names
            rows.append(signal[self.commands.names.index(output)] if known else ca.SX(0))
        return ca.vertcat(self.outputs.at(seen), *rows)

    def _at(self, seen: Seen) -> tuple[ca.SX, ...]:
        """A, B, C, D, W at the measured η."""
        model = self.regulated.model
        return self._table.at(self.place + seen.states[model.linear.index(model.schedule)])

    @property
    def _chosen(self) -> np.ndarray:
        """(m, l): the controller's inputs among all."""
        inputs = self.regulated.model.inputs
        return np.array([[float(name == one) for one in self.controller.inputs] for name in inputs])

    @cached_property
    def _table(self) -> ScheduledTable:
        return ScheduledTable(
            self.controller.places, [getattr(self.controller, name) for name in _MATRICES]
        )


def servo_law(
    controller: ScheduledController,
    commands: CommandSteps,
    aircraft: Model,
    point: OperatingPoint,
) -> FlownLaw:
    """The controller about a trim of the aircraft that it was made for, following commands.

    Its `fastest` is that of the controller alone: an estimator's mode, which the loop hardly moves;
    a gain without memory has none. BadInputError when it was made for another aircraft or other
    angles, or is not told of a commanded output."""
    told = [name.removesuffix(COMMAND_SIGNALS[0]) for name in controller.commands]
    for name in commands.names:
        refuse_unknown(f"controller {controller.name} follows no command of", name, told)
    schedule = point.model.schedule
    at = point.values[schedule]
    reached = np.append(at + commands.values[:, np.array(commands.names) == schedule], at)
    if len(controller.places) == 1:  # not scheduled: flown as it is at any angle
        reached = controller.places
    controller.refuse_other(aircraft, float(reached.min()), float(reached.max()))
    outputs, regulated = (
        MeasuredOutputs(aircraft, point, names)
        for names in (controller.measurements, commands.names)
    )
    policy = ServoPolicy(controller, commands, outputs, regulated, at)
    stacks = {name: getattr(controller, name) for name in ("places", *_MATRICES)}
    follows = {
        "times": commands.times,
        "values": commands.values,
        "filter": [commands.bandwidth, commands.damping],
    }
    identity = {"controller": stacks, "commands": {"names": list(commands.names), **follows}}
    fastest = float(np.abs(np.linalg.eigvals(controller.A)).max(initial=0.0))
    memory = np.zeros(len(controller.states))
    return FlownLaw(controller.name, policy, memory=memory, identity=identity, fastest=fastest)
