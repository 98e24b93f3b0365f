"""The loop that a table of gains closes, on a box of the scheduling variable."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from controller.game.gain_schedule import GainSchedule
from controller.game.zero_sum import Game
from controller.hfa_game import usual_game
from controller.riccati.gare import solve_game
from controller.servo.design import Actuator
from controller.servo.scheduled_controller import ScheduledController
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown
from trim.linear.linear_model import linearize
from verification.proof.arithmetic.balls import TaylorModel, exact, matrix
from verification.proof.enclosures.trim_branch import Family, ModelForms, PlaceBox

#: Distance between two gains of `exact_gains`, in steps of the family: of the dihedral 2 deg.
_STEP = 2.0
#: With actuators these are the gains of the LQR on the plant with its slowest actuators, with R so
#: many times the usual: the usual weights ask for more bandwidth than such actuators have.
_SLOWER = 300.0


@dataclass(frozen=True, eq=False)
class Actuators:
    """ω own ζ + ω G v is added to ζ', v_i = λ_i(t) u_i(t - τ_i(t)), u = U ζ: the commands, through
    actuators.

    bandwidth: ω, rad/s, of all actuators, lies between the two. effectiveness: λ_i, of each input
    for itself and at any time. delay: τ_i, s, likewise, at most. own: (n, n), what actuators of 1
    rad/s do by themselves. G: (n, a). U: (places, a, n), linear between the places."""

    own: np.ndarray
    G: np.ndarray
    U: np.ndarray
    bandwidth: tuple[float, float]
    effectiveness: tuple[float, float] = (1.0, 1.0)
    delay: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class LoopTable(Shown):
    """ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ, ζ = (x, memory); K, M, N, X linear between
    the places.

    places: (G,), increasing, at least two. K: (G, m, n). M: (G, n, n): what ζ does by itself. N:
    (G, n, nx), X: (G, nx, n): what accelerations do to it, measured with the states X ζ. The nx
    states of the linear model come first; with n = nx it is u = -K x. The doubles of the table are
    the gains, exactly."""

    places: np.ndarray
    K: np.ndarray
    M: np.ndarray
    N: np.ndarray
    X: np.ndarray
    actuators: Actuators | None = None

    @classmethod
    def of(cls, table: GainSchedule | LoopTable) -> LoopTable:
        """The loop of a table of gains."""
        if isinstance(table, LoopTable):
            return table
        return cls.of_gains(table.file_breakpoints, table.gains, len(table.model.linear))

    @classmethod
    def of_gains(cls, places: np.ndarray, K: np.ndarray, count: int) -> LoopTable:
        """u = -K ζ of a model with so many linear states; where K has more columns, ζ has what
        rests."""
        g, _, n = K.shape
        return cls(
            np.asarray(places),
            K,
            np.zeros((g, n, n)),
            np.zeros((g, n, count)),
            np.zeros((g, count, n)),
        )

    def through(self, bandwidth: tuple[float, float], **uncertain: Any) -> LoopTable:
        """The gains' commands through actuators of first order: ζ = (x, a), u = -K x or -K ζ."""
        g, m, n = self.K.shape
        count = self.X.shape[1]
        if n not in (count, count + m):
            raise BadInputError(
                f"K has {n} columns; through actuators it takes {count}, or {count + m} with positions"
            )
        U = np.concatenate([-self.K, np.zeros((g, m, count + m - n))], axis=2)
        K = np.concatenate([np.zeros((g, m, count)), np.tile(-np.eye(m), (g, 1, 1))], axis=2)
        G = np.eye(count + m)[:, count:]
        return replace(
            LoopTable.of_gains(self.places, K, count),
            actuators=Actuators(-G @ G.T, G, U, bandwidth, **uncertain),
        )

    def at(self, box: PlaceBox) -> Callable[[np.ndarray], TaylorModel]:
        """What makes a table, such as K, the Taylor model of a box that crosses no place of the
        table."""
        index = int(np.searchsorted(self.places, box.low, side="right")) - 1
        first, second = (exact(place) for place in self.places[index : index + 2].tolist())

        def affine(values: np.ndarray) -> TaylorModel:
            slope = (matrix(values[index + 1]) - matrix(values[index])) / (second - first)
            return TaylorModel(
                matrix(values[index]) + (box.middle - first) * slope, slope * box.radius
            )

        return affine


def segments(table: LoopTable, low: float, high: float) -> list[PlaceBox]:
    """The interval, cut at the places of the table. BadInputError when the table does not reach."""
    if len(table.places) < 2:
        raise BadInputError("a table of gains needs at least two places, in increasing order")
    if not low < high:
        raise BadInputError(f"the interval goes from {low:g} to {high:g}; give the lower end first")
    first, last = float(table.places[0]), float(table.places[-1])
    if low < first or high > last:
        raise BadInputError(
            f"the table covers {first:g} to {last:g}, not {low:g} to {high:g}; prove it where it is"
        )
    cuts = [low, *(place for place in table.places.tolist() if low < place < high), high]
    return [PlaceBox(a, b) for a, b in pairwise(cuts)]


def closed_loop(table: LoopTable, forms: ModelForms) -> TaylorModel:
    """ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ on a box that crosses no place of the
    table."""
    affine, (count, n) = table.at(forms.box), table.X.shape[1:]
    states, steered = matrix(np.eye(count, n)), forms.B * affine(table.K)
    loop = states.transpose() * (forms.A * states - steered) + affine(table.M)
    return loop + affine(table.N) * (forms.A * affine(table.X) - steered) if table.N.any() else loop


#: Of the angles, deg: they were degrees before they became radians.
_DIGITS = 10
_ACCELERATION = "vertical_acceleration_short_period"


def servo_table(
    controller: ScheduledController,
    actuators: Mapping[str, Actuator],
    speed: float,
    model: Model,
    **uncertain: Any,
) -> LoopTable:
    """ζ = (x, a, x_c): the aircraft, its actuators, the controller, commands at rest.

    a: positions, then of order 2 rates / ω, of the actuators of the controller's inputs; every
    input needs one. Measured may be states and `vertical_acceleration_short_period`, V (A(α, α) α +
    B(α, ·) u), V the speed, ft/s. uncertain: intervals of `Actuators` in place of the numbers of
    the actuators. BadInputError names what is missing or measured otherwise."""
    inputs, linear, all_inputs = controller.inputs, list(model.linear), list(model.inputs)
    missing = [name for name in inputs if name not in actuators]
    if missing:
        raise BadInputError(
            f"controller {controller.name}: {missing[0]} has no actuator; name a design that has one"
        )
    own = [actuators[name] for name in inputs]
    second = [i for i, each in enumerate(own) if each.order == 2]
    m, nx, alpha = len(inputs), len(linear), linear.index("alpha") if "alpha" in linear else 0
    start = nx + m + len(second)
    count, size = len(controller.breakpoints), start + len(controller.states)
    K, M = np.zeros((count, len(all_inputs), size)), np.zeros((count, size, size))
    N, X = np.zeros((count, size, nx)), np.zeros((count, nx, size))
    X[:, alpha, alpha] = 1.0
    measured, memory = np.zeros((len(controller.measurements), size)), slice(start, size)
    B, D = (each[..., : len(measured)] for each in (controller.B, controller.D))
    for row, name in enumerate(controller.measurements):
        if name in linear:
            measured[row, linear.index(name)] = 1.0
        elif name != _ACCELERATION or model.part(name)[1] != ("alpha",):
            raise BadInputError(
                f"controller {controller.name}: a proof takes no measurement of {name}"
            )
        elif D[..., row].any():
            raise BadInputError(
                f"controller {controller.name}: {name} reaches the inputs at once; filter it"
            )
        else:
            N[:, memory, alpha] = speed * B[..., row]
    U = D @ measured
    U[..., memory] += controller.C
    M[:, memory] = B @ measured
    M[:, memory, memory] += controller.A
    lag, G = np.zeros((size, size)), np.zeros((size, m))
    for i, (name, each) in enumerate(zip(inputs, own, strict=True)):
        row = nx + i
        K[:, all_inputs.index(name), row] = -1.0
        if each.order == 2:
            row = nx + m + second.index(i)
            lag[nx + i, row], lag[row, row] = 1.0, -2.0 * each.damping
        lag[row, nx + i], G[row, i] = -1.0, 1.0
    in_degrees = model.schedule_unit == "deg"
    places = (
        np.round(np.degrees(controller.breakpoints), _DIGITS)
        if in_degrees
        else controller.breakpoints
    )
    table = LoopTable(places, K, M, N, X)
    if uncertain:
        return replace(table, actuators=Actuators(lag, G, U, **uncertain))
    # Each actuator as it is: in its rows times its bandwidth, with its effectiveness.
    rows = [nx + i for i in range(m)] + [nx + m + i for i in range(len(second))]
    speeds = np.zeros((size, 1))
    speeds[rows, 0] = [own[i].bandwidth for i in (*range(m), *second)]
    return replace(
        table, M=M + speeds * (lag + G @ (np.diag([each.effectiveness for each in own]) @ U))
    )


def exact_gains(
    family: Family, low: float, high: float, uncertain: Mapping[str, Any], **changes: Any
) -> LoopTable:
    """The gains of the exact game between two places, in `_STEP`s; with actuators, `uncertain` as
    `through` takes them, also from their positions. changes: of the usual game."""
    places = np.linspace(low, high, max(2, math.ceil((high - low) / (_STEP * family.step)) + 1))
    gains = []
    for place in places.tolist():
        point = family.point(place)
        model = linearize(point.model, point)
        game = usual_game(family.model, model.A, model.B, **changes)
        if uncertain:
            (n, m), w = model.B.shape, uncertain["bandwidth"][0]
            A = np.block([[model.A, model.B], [np.zeros((m, n)), -w * np.eye(m)]])
            B = np.vstack([np.zeros((n, m)), w * np.eye(m)])
            Q, R = np.pad(game.Q, (0, m)), game.R * (1.0 if "R" in changes else _SLOWER)
            game = Game(A, B, np.eye(n + m), Q, R, changes.get("delta", np.inf))
        gains.append(solve_game(game).K)
    table = LoopTable.of_gains(places, np.array(gains), len(family.model.linear))
    return table.through(**uncertain) if uncertain else table
