"""Controllers and actuators of proofs, from gains, designs and exact solutions of games."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.hfa_game import usual_game
from controller.riccati.gare import unconfirmed_solution
from hfa_aircraft.model import Model
from hfa_flight.actuators import Actuator
from hfa_flight.schedule.gain_schedule import GainSchedule
from hfa_flight.schedule.scheduled_controller import ScheduledController
from hfa_prove.search.family import Box, Family
from hfa_prove.statements.schedule import (
    Actuators,
    Controller,
    FixedActuators,
    UncertainActuators,
    measurable,
)
from hfa_support.errors import BadInputError
from trim.point.linearize import linearize

#: Distance between two breakpoints of `exact_gains`, in steps of the family; 2 deg for the
#: dihedral.
_STEP = 2.0
#: Factor on R for the LQR of the plant with its slowest actuators. The usual weights would need
#: more bandwidth than such actuators have.
_SLOWER = 300.0
#: Digits of breakpoints in degrees, which were converted to radians and back.
_DIGITS = 10


@dataclass(frozen=True)
class Intervals:
    """Intervals of uncertain actuators.

    bandwidth: lowest and highest bandwidth, rad/s
    effectiveness: lowest and highest effectiveness, a factor on the command
    delay: largest delay, s
    """

    bandwidth: tuple[float, float]
    effectiveness: tuple[float, float] = (1.0, 1.0)
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Loop:
    """Controller and actuators in the proof of a schedule.

    controller: the controller
    actuators: the actuators, or None
    """

    controller: Controller
    actuators: Actuators | None = None

    def segments(self, low: float, high: float) -> list[Box]:
        """Return the parts of the interval [low, high] between breakpoints of the controller.

        Raises BadInputError if the breakpoints do not cover the interval, or unless low < high.
        """
        if not low < high:
            raise BadInputError(
                f"the interval is {low:g} to {high:g}; give two different finite ends, "
                "the lower first"
            )
        breakpoints = self.controller.breakpoints.tolist()
        first = breakpoints[0]
        last = breakpoints[-1]
        if low < first or high > last:
            raise BadInputError(
                f"the table of gains covers {first:g} to {last:g}, not {low:g} to {high:g}; choose "
                "an interval within the table"
            )
        cuts = [low, *(cut for cut in breakpoints if low < cut < high), high]
        return [Box(*ends) for ends in pairwise(cuts)]


def loop_of_gains(
    model: Model, breakpoints: Any, K: np.ndarray, intervals: Intervals | None = None
) -> Loop:
    """Return the loop of a gain schedule u = -K x.

    The loop has uncertain first-order actuators if intervals are given.

    breakpoints: values of the scheduling variable, (g,)
    K: gains, (g, m, n), or (g, m, n + m) if intervals are given. The last m columns then multiply
        the
        positions of the actuators.
    intervals: intervals of bandwidth, effectiveness and delay of the actuators, or None

    Raises BadInputError if there are fewer than two breakpoints or K has a wrong number of columns.
    """
    if len(breakpoints) < 2:
        raise BadInputError(
            f"a single gain K is given; give K at two or more values of {model.schedule}, in "
            "increasing order"
        )
    count, m, columns = K.shape
    n = len(model.linear)
    inputs = tuple(model.inputs)
    if columns not in ((n, n + m) if intervals else (n,)):
        raise BadInputError(
            f"K has {columns} columns; give {n} for the states"
            + (f", or {n + m} for states and actuator positions" if intervals else "")
        )
    positions = tuple(f"{name}_position" for name in inputs)
    measurements = (*model.linear, *positions)[:columns]
    controller = Controller(
        breakpoints=np.asarray(breakpoints, dtype=float),
        inputs=inputs,
        measurements=measurements,
        A=np.zeros((count, 0, 0)),
        B=np.zeros((count, 0, columns)),
        C=np.zeros((count, m, 0)),
        D=-np.asarray(K),
    )
    if intervals is None:
        return Loop(controller)
    return Loop(controller, _uncertain([1] * m, [1.0] * m, intervals))


def loop_of_schedule(gains: GainSchedule, intervals: Intervals | None = None) -> Loop:
    """Return the loop of a gain schedule.

    intervals: intervals of uncertain actuators, or None
    """
    return loop_of_gains(gains.model, gains.file_breakpoints, gains.gains, intervals)


def loop_of_servo(
    controller: ScheduledController,
    actuators: Mapping[str, Actuator],
    model: Model,
    intervals: Intervals | None = None,
) -> Loop:
    """Return the loop of a scheduled controller with its actuators, without the command inputs.

    actuators: input -> actuator of the design
    intervals: intervals of bandwidth, effectiveness and delay that replace the actuators' values,
        or None

    Raises BadInputError with the name of an input without an actuator or of an unsupported
    measurement.
    """
    where = f"controller {controller.name}:"
    missing = [name for name in controller.inputs if name not in actuators]
    if missing:
        raise BadInputError(
            f"{where} input {missing[0]} has no actuator; give a design with an "
            f"actuator for {missing[0]}"
        )
    for name in controller.measurements:
        if name not in measurable(model):
            raise BadInputError(
                f"{where} a proof does not support the measurement {name}; remove this measurement"
            )
    measured = len(controller.measurements)
    breakpoints = controller.breakpoints
    if model.schedule_unit == "deg":
        breakpoints = np.round(np.degrees(controller.breakpoints), _DIGITS)
    stated = Controller(
        breakpoints=breakpoints,
        inputs=tuple(controller.inputs),
        measurements=tuple(controller.measurements),
        A=controller.A,
        B=controller.B[..., :measured],
        C=controller.C,
        D=controller.D[..., :measured],
    )
    designed = [actuators[name] for name in controller.inputs]
    orders = [actuator.order for actuator in designed]
    dampings = [actuator.damping for actuator in designed]
    if intervals is not None:
        return Loop(stated, _uncertain(orders, dampings, intervals))
    bandwidths = np.array([actuator.bandwidth for actuator in designed])
    effectiveness = np.array([actuator.effectiveness for actuator in designed])
    fixed = FixedActuators(tuple(orders), np.array(dampings), bandwidths, effectiveness)
    return Loop(stated, fixed)


def exact_gains(
    family: Family, low: float, high: float, intervals: Intervals | None, **changes: Any
) -> Loop:
    """Return the loop of the gains of the exact game at breakpoints from `low` to `high`.

    intervals: intervals of uncertain actuators, or None. With intervals, the game is that of the
        aircraft with its slowest actuators, without disturbance unless delta is changed.
    changes: weights that differ from the default game, name -> value

    Raises NoSolutionError if a breakpoint has no trim or the game there has no solution.
    """
    model = family.model
    count = max(2, math.ceil((high - low) / (_STEP * family.step)) + 1)
    breakpoints = np.linspace(low, high, count)
    gains = []
    for breakpoint in breakpoints.tolist():
        point = family.point(breakpoint)
        linear = linearize(point.model, point)
        game = usual_game(model, linear.A, linear.B, **changes)
        if intervals is not None:
            game = _with_slowest_actuators(game, intervals.bandwidth[0], changes)
        gains.append(unconfirmed_solution(game).K)
    return loop_of_gains(model, breakpoints, np.array(gains), intervals)


def _with_slowest_actuators(game: Game, slowest: float, changes: Mapping[str, Any]) -> Game:
    """Return the game of the aircraft with first-order actuators, whose positions have no weight.

    slowest: bandwidth of the actuators, rad/s
    changes: weights that the user typed, name -> value. Without R, the default R is multiplied by
        `_SLOWER`. Without delta, the game has no disturbance.
    """
    n, m = game.B.shape
    A = np.block([[game.A, game.B], [np.zeros((m, n)), -slowest * np.eye(m)]])
    B = np.vstack([np.zeros((n, m)), slowest * np.eye(m)])
    Q = np.pad(game.Q, (0, m))
    R = game.R if "R" in changes else _SLOWER * game.R
    return Game(A, B, np.eye(n + m), Q, R, changes.get("delta", np.inf))


def _uncertain(
    orders: Sequence[int], dampings: Sequence[float], intervals: Intervals
) -> UncertainActuators:
    """Return uncertain actuators with the given orders and damping ratios.

    orders: 1 or 2, for each input
    dampings: damping ratio, for each input
    """
    return UncertainActuators(
        tuple(orders),
        np.array(dampings, dtype=float),
        intervals.bandwidth,
        intervals.effectiveness,
        intervals.delay,
    )
