"""Flights of one controller: linear through commands and turbulence, nonlinear through gusts; the best there can be."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller import (
    ActuatorFault,
    Actuators,
    CommandSteps,
    Envelope,
    Game,
    OneMinusCosine,
    Scenario,
    ScheduledController,
    flight_envelope,
)
from controller.design.design import Actuator
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import COMMAND_SIGNALS
from controller.design.servo_loop import ServoLoop
from controller.export.exported_loop import commandable
from controller.flight.nonlinear_flight import fly_law
from controller.flight.plants import NonlinearPlant
from controller.policy.servo_policy import servo_law
from controller.riccati.frequency_response import square_root, swept_gain
from hfa_model import INPUTS, LINEAR_STATES, STATES, Aircraft, Input, State
from hfa_model.kinematics import angle_of_attack
from hfa_model.vectors import STATE_SCALES
from hfa_support import NoSolutionError, Report
from hfa_support.reporting.text import Table
from studies.servo.feedforward import Feedforward, command_rates
from studies.servo.tuning import InGust
from trim import LinearModel, level_model
from trim.point.condition import CONTROL_LIMITS

#: s, of the record of a flight through commands. The response to commands held in a step is exact.
RECORD = 0.1
#: s: step of a flight in a gust, how often the envelope is looked at, and how long it lasts.
STEP, TICK, SECONDS = 0.01, 0.2, 30.0
#: ft/s: the largest peak that is tried, and how closely the peak is found that ends a flight.
LARGEST, APART = 60.0, 0.5
#: ft: of the gusts of `gust_limits`.
LENGTH = 400.0
#: s: how long the flight of the best inputs lasts, which ends at trim, and for how long a command is held.
BEST_SECONDS, HELD = 20.0, 0.1
#: Share of the way from trim to each limit that is used: the rest is room for the error of the discretization.
SHARE = 0.8
#: Units of peak, ft/s, and commands, rad, in which the problem is well scaled; weight of what smooths the commands.
_PEAK, _COMMAND, _SMOOTH = 10.0, 0.2, 1e-4
_ALTITUDE = STATES.index("altitude")


def turbulence_rms(plant: DesignModel, loop: ServoLoop, intensity: float, scale: float) -> dict[str, float]:
    """Root mean square of every state of the plant in stationary Dryden turbulence, in its unit.

    w = sigma sqrt(τ) (1 + √3 τ s) / (1 + τ s)² n,  τ = scale / V,  n white: A_t P + P A_t' + b b' = 0 of the loop with
    the filter of the air. intensity: sigma, ft/s. scale: ft. The loop must be stable. Source: MIL-F-8785C, 3.7.1.2.
    """
    from scipy.linalg import solve_continuous_lyapunov

    tau = scale / plant.model.point.states.speed
    air = np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])
    w = intensity * math.sqrt(tau) * np.array([[1.0, math.sqrt(3.0) * tau]])
    total = np.block([[loop.closed, loop.disturbed @ w], [np.zeros((2, len(loop.closed))), air]])
    white = np.zeros((len(total), 1))
    white[-1] = 1.0 / tau**2
    covariance = solve_continuous_lyapunov(total, -white @ white.T)
    rms = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return dict(zip(plant.states, rms.tolist(), strict=False))


def gust_share(aircraft: Aircraft, model: LinearModel, controller: ScheduledController, gust: InGust) -> float:
    """Largest share of the way from the trim to a limit of the envelope that the nonlinear aircraft goes in a gust.

    w = peak/2 (1 - cos(2π V t / length)), alpha through the air, no commands, positions within `CONTROL_LIMITS`,
    `SECONDS` in all. 2 - t / `SECONDS` when it leaves the envelope at t: 1 is what is just held.
    """
    point, names = model.point, commandable(controller)
    still = CommandSteps(names, np.zeros(0), np.zeros((0, len(names))))
    scenario = Scenario(
        duration=SECONDS,
        step=STEP,
        tick=TICK,
        actuators=flown_actuators(gust.actuator),
        gust=OneMinusCosine(gust.length, gust.peak, point.states.speed),
    )
    envelope = flight_envelope(aircraft, point)
    law = servo_law(controller, still, aircraft, point)
    flown = fly_law(NonlinearPlant(aircraft, point), law, scenario, envelope)
    if flown.departure is not None:
        return 2.0 - flown.departure.time / SECONDS
    states = flown.states.copy()
    states[:, STATES.index("alpha")] = flown.angles_of_attack
    trim, limits = np.array(point.states), np.array([envelope.lowest, envelope.highest])
    return float(((states - trim)[:, None] / (limits - trim)).max())


def gust_held(aircraft: Aircraft, model: LinearModel, controller: ScheduledController, gust: InGust) -> float:
    """Largest peak, ft/s, > 0, that is stood in the direction of `gust`, its smaller ones too, to within `APART`.

    `LARGEST` when nothing up to it ends the flight. Peaks are tried in steps of ten times `APART`, then halved.
    """

    def stood(peak: float) -> bool:
        signed = gust._replace(peak=math.copysign(peak, gust.peak))
        return gust_share(aircraft, model, controller, signed) <= 1.0

    low, high = 0.0, 10.0 * APART
    while stood(high):
        if high >= LARGEST:
            return LARGEST
        low, high = high, min(high + 10.0 * APART, LARGEST)
    while high - low > APART:
        middle = (low + high) / 2.0
        low, high = (middle, high) if stood(middle) else (low, middle)
    return low


def flown_actuators(acting: Actuator, faults: tuple[ActuatorFault, ...] = ()) -> Actuators:
    """All five alike, within the control limits of a trim, without a limit of rate."""
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    lag, rate = (Input(*[each] * len(lowest)) for each in (1.0 / acting.bandwidth, np.inf))
    if acting.effectiveness != 1.0:
        faults = (ActuatorFault(0.0, acting.effectiveness, inputs=INPUTS[1:]), *faults)
    return Actuators(lag, lowest, highest, rate, acting.order, acting.damping, faults)


def fly_commands(
    plant: DesignModel,
    controller: ScheduledController,
    ends: np.ndarray,
    each: float,
    command_filter: Feedforward,
) -> tuple[dict[str, float], float]:
    """rms of measured minus commanded output, by output, and the largest rate of an input's position, rad/s, after

        r'' = ω² r_end - 2 ζ ω r' - ω² r with r_end = ends[k] for `each` s, one row after the other.

    plant: of `servo_plant`, its inputs behind actuators. ends: (K, q), in the order of the integrated outputs, about
    the trim. A loop that grows beyond the numbers has infinite errors.
    """
    from scipy.linalg import expm

    outputs = commandable(controller)
    rows = [controller.measurements.index(name) for name in outputs]
    Ak, Bk, Ck, Dk = controller.at(plant.model.point.states.dihedral)
    received = _received(controller, outputs)
    p, n, nk, q = len(controller.measurements), len(plant.A), len(Ak), len(outputs)
    Bw, Dw = Bk[:, p:] @ received, Dk[:, p:] @ received
    Bk, Dk = Bk[:, :p], Dk[:, :p]
    S = command_rates(command_filter, q)
    loop = np.block(
        [
            [plant.A + plant.B @ Dk @ plant.C, plant.B @ Ck, plant.B @ Dw],
            [Bk @ plant.C, Ak, Bw],
            [np.zeros((3 * q, n + nk)), S],
        ]
    )
    step, per = expm(RECORD * loop), round(each / RECORD)
    record = np.zeros((len(ends) * per + 1, len(loop)))
    with np.errstate(over="ignore", invalid="ignore"):
        for number, end in enumerate(ends):
            record[number * per, -q:] = end
            for k in range(number * per, (number + 1) * per):
                record[k + 1] = step @ record[k]
        errors = record[:, :n] @ plant.C[rows].T - record[:, n + nk : n + nk + q]
        rms = np.nan_to_num(np.sqrt(np.mean(errors**2, axis=0)), nan=np.inf)
        moving = [plant.states.index(f"{name}_position") for name in controller.inputs]
        rate = np.nan_to_num(np.abs(record @ loop[moving].T).max(), nan=np.inf)
    return dict(zip(outputs, rms.tolist(), strict=True)), float(rate)


def _received(controller: ScheduledController, outputs: Sequence[str]) -> np.ndarray:
    """The commands of the controller from w = [r; r'; r_end], (commands, 3q)."""
    names = [f"{output}{signal}" for signal in COMMAND_SIGNALS for output in outputs]
    return np.eye(len(names))[[names.index(name) for name in controller.commands]]


class BestInputs(NamedTuple):
    """peak: ft/s. times: (N + 1,), s. states: (N + 1, 7) and commands: (N, m), absolute; each held for `HELD`."""

    peak: float
    times: np.ndarray
    states: np.ndarray
    commands: np.ndarray


def best_inputs(
    plant: NonlinearPlant, envelope: Envelope, names: Sequence[str], length: float, sign: float, bandwidth: float
) -> BestInputs:
    """max |p| over commands c(t) of the inputs `names`, the others at trim, behind actuators a' = ω (c - a):

        X' = f(X, U, w),  w = p/2 (1 - cos(2π V t / length)),  from trim to trim (altitude free) in `BEST_SECONDS`,

    states, alpha through the air, and commands within `SHARE` of their limits. length: ft. sign: of p. bandwidth ω:
    rad/s. The rule of the implicit midpoint, solved by IPOPT: a local optimum, larger ones may be withstood too.
    NoSolutionError when it finds none. Source: Waechter and Biegler, Math. Programming 106 (2006).
    """
    X0, U0 = np.array(plant.point.states), np.array(plant.point.inputs)
    rows, m, n = [INPUTS.index(name) for name in names], len(names), len(STATES) + len(names)
    count = round(BEST_SECONDS / HELD)
    x, c, w = ca.SX.sym("x", n), ca.SX.sym("c", m), ca.SX.sym("w")
    u = ca.SX.zeros(len(INPUTS))
    u[rows] = x[len(STATES) :]
    moved = ca.vertcat(
        plant.rate(x[: len(STATES)], u, ca.SX.zeros(len(LINEAR_STATES)), {"updraft": w}),
        bandwidth * (c - x[len(STATES) :]),
    )
    rate = ca.Function("rate", [x, c, w], [moved])
    through_air = angle_of_attack(State(*ca.vertsplit(x[: len(STATES)] + ca.DM(X0))), w)
    alpha = ca.Function("alpha", [x, w], [through_air])

    scale = ca.DM(np.append(STATE_SCALES, np.full(m, _COMMAND)))
    z, commands, p = ca.MX.sym("z", n, count + 1), ca.MX.sym("c", m, count), ca.MX.sym("p")
    states, peak = ca.diag(scale) @ z, _PEAK * p
    times = HELD * np.arange(count + 1)
    shape, between = (ca.DM(_shape(at, plant, length)).T for at in (times, times[:-1] + HELD / 2))
    slopes = rate.map(count)((states[:, 1:] + states[:, :-1]) / 2, _COMMAND * commands, between * peak)
    defects = (states[:, 1:] - states[:, :-1] - HELD * slopes) / ca.repmat(scale, 1, count)
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


def gust_limits(aircraft: Aircraft, controller: ScheduledController) -> Report:
    """Gusts of `LENGTH` at the first and the last angle of a controller, up and down, behind actuators of order 1.

    held: the largest peak, ft/s, negative downward, that the controller stands. best: what the same surfaces can stand
    when the gust is known as it begins, a local optimum; nan where none was found.
    """
    found, actuator = [], Actuator()
    ends = sorted({float(controller.dihedrals[0]), float(controller.dihedrals[-1])})
    controller.refuse_other(aircraft, ends[0], ends[-1])
    for model, sign in itertools.product([level_model(aircraft, dihedral) for dihedral in ends], (1.0, -1.0)):
        plant, dihedral = NonlinearPlant(aircraft, model.point), model.point.states.dihedral
        envelope = flight_envelope(aircraft, model.point)
        held = gust_held(aircraft, model, controller, InGust(dihedral, actuator, LENGTH, sign))
        try:
            best = best_inputs(plant, envelope, controller.inputs, LENGTH, sign, actuator.bandwidth).peak
        except NoSolutionError:
            best = math.nan
        found.append({"dihedral": dihedral, "held": math.copysign(held, sign), "best": best})
    rows = [(f"{math.degrees(each['dihedral']):g}", f"{each['held']:.3g}", f"{each['best']:.3g}") for each in found]
    return Report(
        f"Gusts of {LENGTH:g} ft for controller {controller.name}, {controller.dynamics} dynamics",
        (f"largest peak held, ft/s, tried up to {LARGEST:g}", Table(("dihedral", "held", "best"), rows)),
        data={"length": LENGTH, "limits": found},
    )


def updraft_cost(built: DesignModel, game: Game, K: np.ndarray) -> Report:
    """The largest ∫ z'Qz + u'Ru of u = -K z over all updrafts w with ∫ w² dt = 1 ft²/s, from rest.

    cost: in the units of the weights. frequency: of the worst, rad/s. dihedral: rad, the error that costs as much in
    1 s; nan where the dihedral has no weight. game: of `built`.
    """
    loop, paid = game.A - game.B @ K, np.vstack([square_root(game.Q), square_root(game.R) @ K])
    closed = Game(loop, np.zeros((len(loop), 1)), built.gust, paid.T @ paid, np.eye(1), math.inf)
    found, place = swept_gain(closed, np.zeros((1, len(loop)))), built.states.index("dihedral")
    weight = float(game.Q[place, place])
    cost, alike = found.gain**2, found.gain / math.sqrt(weight) if weight > 0.0 else math.nan
    worst = f"Worst updraft with the energy of 1 ft/s for 1 s: at {found.frequency:.3g} rad/s"
    return Report(
        f"{worst}, costs {cost:.4g}, as much as {math.degrees(alike):.3g} deg of dihedral for 1 s",
        data={"cost": cost, "frequency": found.frequency, "dihedral": alike},
    )
