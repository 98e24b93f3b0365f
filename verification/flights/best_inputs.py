"""Which gust can be withstood at all: the best movement of the surfaces for one who knows the gust when it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.envelope import Envelope
from controller.flight.plants import NonlinearPlant
from hfa_model.kinematics import angle_of_attack
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATE_SCALES, STATES, State
from hfa_support.errors import NoSolutionError
from trim.point.condition import CONTROL_LIMITS

#: s: how long the flight lasts, at the end of which it is back at trim, and for how long a command is held.
SECONDS, STEP = 20.0, 0.1
#: Share of the way from trim to each limit that is used: the rest is room for the error of the discretization.
SHARE = 0.8
#: Units of peak, ft/s, and commands, rad, in which the problem is well scaled; weight of what smooths the commands.
_PEAK, _COMMAND, _SMOOTH = 10.0, 0.2, 1e-4
_ALTITUDE = STATES.index("altitude")


class BestInputs(NamedTuple):
    """peak: ft/s. times: (N + 1,), s. states: (N + 1, 7) and commands: (N, m), absolute; each held for `STEP`."""

    peak: float
    times: np.ndarray
    states: np.ndarray
    commands: np.ndarray


def best_inputs(
    plant: NonlinearPlant, envelope: Envelope, names: Sequence[str], length: float, sign: float, bandwidth: float
) -> BestInputs:
    """max |p| over commands c(t) of the inputs `names`, the others at trim, behind actuators a' = ω (c - a):

        X' = f(X, U, w),  w = p/2 (1 - cos(2π V t / length)),  from trim to trim (altitude free) in `SECONDS`,

    states, alpha through the air, and commands within `SHARE` of their limits. length: ft. sign: of p. bandwidth ω:
    rad/s. The rule of the implicit midpoint, solved by IPOPT: a local optimum, larger ones may be withstood too.
    NoSolutionError when it finds none. Source: Waechter and Biegler, Math. Programming 106 (2006).
    """
    X0, U0 = np.array(plant.point.states), np.array(plant.point.inputs)
    rows, m, n = [INPUTS.index(name) for name in names], len(names), len(STATES) + len(names)
    count = round(SECONDS / STEP)
    x, c, w = ca.SX.sym("x", n), ca.SX.sym("c", m), ca.SX.sym("w")
    u = ca.SX.zeros(len(INPUTS))
    u[rows] = x[len(STATES) :]
    moved = ca.vertcat(
        plant.rate(x[: len(STATES)], u, ca.SX.zeros(len(LINEAR_STATES)), w), bandwidth * (c - x[len(STATES) :])
    )
    rate = ca.Function("rate", [x, c, w], [moved])
    through_air = angle_of_attack(State(*ca.vertsplit(x[: len(STATES)] + ca.DM(X0))), w)
    alpha = ca.Function("alpha", [x, w], [through_air])

    scale = ca.DM(np.append(STATE_SCALES, np.full(m, _COMMAND)))
    z, commands, p = ca.MX.sym("z", n, count + 1), ca.MX.sym("c", m, count), ca.MX.sym("p")
    states, peak = ca.diag(scale) @ z, _PEAK * p
    times = STEP * np.arange(count + 1)
    shape, between = (ca.DM(_shape(at, plant, length)).T for at in (times, times[:-1] + STEP / 2))
    slopes = rate.map(count)((states[:, 1:] + states[:, :-1]) / 2, _COMMAND * commands, between * peak)
    defects = (states[:, 1:] - states[:, :-1] - STEP * slopes) / ca.repmat(scale, 1, count)
    angles = alpha.map(count + 1)(states, shape * peak)

    low, high, angle_limits = _limits(plant, envelope, rows)
    of_commands = [np.tile(side[len(STATES) :] / _COMMAND, count) for side in (low, high)]
    low, high = (side / np.array(scale).ravel() for side in (low, high))
    fixed = np.arange(n) != _ALTITUDE
    lowest, highest = np.tile(low, (count + 1, 1)), np.tile(high, (count + 1, 1))
    lowest[0] = highest[0] = lowest[-1, fixed] = highest[-1, fixed] = 0.0
    of_peak = sorted([0.0, math.copysign(math.inf, sign)])
    problem: dict[str, Any] = {
        "x": ca.veccat(z, commands, p),
        "f": -math.copysign(1.0, sign) * p + _SMOOTH * ca.sumsqr(commands[:, 1:] - commands[:, :-1]),
        "g": ca.veccat(defects, angles),
    }
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 500},
    }
    solver = ca.nlpsol("best_inputs", "ipopt", problem, options)
    still = np.zeros(n * count)
    found = solver(
        x0=0.0,
        lbx=np.concatenate([lowest.ravel(), of_commands[0], of_peak[:1]]),
        ubx=np.concatenate([highest.ravel(), of_commands[1], of_peak[1:]]),
        lbg=np.append(still, np.full(count + 1, angle_limits[0])),
        ubg=np.append(still, np.full(count + 1, angle_limits[1])),
    )
    if not solver.stats()["success"]:
        raise NoSolutionError(f"no best inputs were found: {solver.stats()['return_status']}; try another gust")
    values = np.array(found["x"]).ravel()
    path = values[: n * (count + 1)].reshape(count + 1, n) * np.array(scale).ravel()
    moves = _COMMAND * values[n * (count + 1) : -1].reshape(count, m) + U0[rows]
    return BestInputs(_PEAK * float(values[-1]), times, path[:, : len(STATES)] + X0, moves)


def _limits(
    plant: NonlinearPlant, envelope: Envelope, rows: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Lowest and highest deviations of [X; positions], (n,) each; lowest and highest angle of attack, absolute."""
    X0, place = np.array(plant.point.states), STATES.index("alpha")
    low, high = (SHARE * (np.array(side) - X0) for side in (envelope.lowest, envelope.highest))
    angles = X0[place] + low[place], X0[place] + high[place]
    low[place], high[place] = -math.pi / 3, math.pi / 3  # over ground: only the angle through the air is limited
    moves = SHARE * (np.array(CONTROL_LIMITS) - np.array(plant.point.inputs)[:, None])[rows]
    return np.append(low, moves[:, 0]), np.append(high, moves[:, 1]), angles


def _shape(times: np.ndarray, plant: NonlinearPlant, length: float) -> np.ndarray:
    """w / p."""
    phase = 2.0 * np.pi * np.minimum(plant.point.states.speed * times / length, 1.0)
    return np.asarray((1.0 - np.cos(phase)) / 2.0)
