"""What an FMU holds: the aircraft alone, under a gain, or under a scheduled controller behind actuators; and an example
for the C files of a controller, a loop of 100 Hz around it in which its aircraft is simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.design.design import signal_unit
from controller.design.scheduled_controller import ScheduledController
from controller.export.c_model import c_table, comment_lines
from controller.export.exported_controller import (
    GivenCommands,
    GivenInputs,
    GivenUpdraft,
    commandable,
    filled,
    filter_rates,
    longest_step,
    trimmed_policy,
)
from controller.flight.actuators import Actuators
from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import NonlinearPlant
from controller.policy.policies import GainPolicy, Policy, Seen, gain_constants
from controller.policy.signals import zero
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import (
    INPUT_SCALES,
    INPUT_UNITS,
    INPUTS,
    LINEAR_STATES,
    RATE_UNITS,
    STATE_SCALES,
    STATE_UNITS,
    STATES,
)
from hfa_support.native.c_code import c_function
from trim.point.operating_point import OperatingPoint

EXAMPLE = "controller_100hz.c"
#: What is commanded, in the unit of the first command, and how long it is simulated, s.
COMMANDED, SECONDS = 0.01, 20


class Channel(NamedTuple):
    """One number of a loop. unit: None where it depends on the controller. size: one scaled unit."""

    name: str
    unit: str | None
    start: float = 0.0
    size: float = 1.0
    rate_unit: str | None = None


@dataclass(frozen=True, eq=False)
class ExportedLoop:
    """y' = f(y, v), and the inputs u = g(y, v) of the aircraft where something sets them; absolute values.

    function: (y, v) -> (f, g), g empty where u are among v. longest_step: s, that Runge-Kutta 4 may take.
    """

    function: ca.Function
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    longest_step: float = 1e-3


def aircraft_loop(aircraft: Aircraft, point: OperatingPoint) -> ExportedLoop:
    """X' = f(X, U, w): v = [U; w]."""
    X, U, w = ca.SX.sym("X", len(STATES)), ca.SX.sym("U", len(INPUTS)), ca.SX.sym("w")
    x, u = X - ca.DM(np.array(point.states)), U - ca.DM(np.array(point.inputs))
    rate = NonlinearPlant(aircraft, point).rate(x, u, ca.DM.zeros(len(LINEAR_STATES)), w)
    function = ca.Function("loop", [X, ca.vertcat(U, w)], [ca.densify(rate), ca.DM(0, 1)])
    return ExportedLoop(function, _states(point), (), (*_inputs(point), _UPDRAFT))


def gain_loop(aircraft: Aircraft, point: OperatingPoint, gain: np.ndarray) -> ExportedLoop:
    """U = U0 - K (x - X0 - reference): v = [w; reference (6,)]."""
    reference, w = ca.SX.sym("reference", len(LINEAR_STATES)), ca.SX.sym("w")
    policy = GainPolicy(zero(len(INPUTS)))
    X, rate, U = _closed(aircraft, point, policy, w, constants=gain_constants(gain), reference=reference)
    told = tuple(Channel(f"reference_{name}", getattr(STATE_UNITS, name)) for name in LINEAR_STATES)
    function = ca.Function("loop", [X, ca.vertcat(w, reference)], [rate, U])
    return ExportedLoop(function, _states(point), _inputs(point), (_UPDRAFT, *told))


def controller_loop(
    aircraft: Aircraft, point: OperatingPoint, controller: ScheduledController, actuators: Actuators
) -> ExportedLoop:
    """The loop that `fly` integrates, with the command filter as states: v = [w; commanded values].

    y = [X; actuators; controller; r; r']: actuators and commands as deviations from trim. BadInputError when the
    controller was made for another aircraft or other angles, or an actuator cannot hold the trim.
    """
    names, w = commandable(controller), ca.SX.sym("w")
    r, slope, goal = (ca.SX.sym(name, len(names)) for name in ("r", "slope", "goal"))
    policy = replace(trimmed_policy(controller, aircraft, point), commands=GivenCommands(names, r, slope, goal))
    Y, rate, U = _closed(aircraft, point, policy, w, actuators=actuators)
    filtered = filter_rates(controller, r, slope, goal)
    function = ca.Function(
        "loop", [ca.vertcat(Y, r, slope), ca.vertcat(w, goal)], [ca.vertcat(rate, filtered), U], {"cse": True}
    )
    units = [signal_unit(name) for name in names]
    states = (
        *_states(point),
        *_actuator_states(actuators),
        *(Channel(f"controller_{name}", None) for name in controller.states),
        *(Channel(f"command_{name}_filtered", unit) for name, unit in zip(names, units, strict=True)),
        *(Channel(f"command_{name}_filtered_rate", None) for name in names),
    )
    inputs = tuple(Channel(f"command_{name}", unit) for name, unit in zip(names, units, strict=True))
    return ExportedLoop(function, states, _inputs(point), (_UPDRAFT, *inputs), longest_step(controller))


def held_loop(
    aircraft: Aircraft, point: OperatingPoint, controller: ScheduledController, actuators: Actuators
) -> tuple[ca.Function, tuple[Channel, ...]]:
    """(y, u) -> (y', dihedral, measured) of the inputs u (5,) that a computer holds, y = [X; actuators], and y.

    u, actuators and measured as deviations from trim. BadInputError as in `controller_loop`, and when the controller
    measures what these actuators do not have.
    """
    policy, u = trimmed_policy(controller, aircraft, point), ca.SX.sym("u", len(INPUTS))
    Y, rate, _ = _closed(aircraft, point, GivenInputs(u), ca.SX(0), actuators=actuators)
    X, moved = Y[: len(STATES)], Y[len(STATES) :]
    x = NonlinearPlant(aircraft, point).seen(X - ca.DM(np.array(point.states)))
    seen = Seen(x, x, actuators.position(moved, np.array(point.inputs)), actuators.rates(moved))
    sensed = [X[STATES.index("dihedral")], ca.densify(policy.outputs.at(seen))]
    return ca.Function("loop", [Y, u], [rate, *sensed], {"cse": True}), (*_states(point), *_actuator_states(actuators))


class _Reference(NamedTuple):
    """x_d, (6,), as an argument."""

    values: ca.SX
    size: int = len(LINEAR_STATES)

    def at(self, t: object) -> ca.SX:
        return self.values


def _closed(
    aircraft: Aircraft,
    point: OperatingPoint,
    policy: Policy,
    w: ca.SX,
    *,
    constants: np.ndarray | None = None,
    reference: ca.SX | None = None,
    actuators: Actuators | None = None,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Y = [X; actuators; memory], its rate, and U."""
    none = zero(len(LINEAR_STATES))
    follow = none if reference is None else _Reference(reference)
    trim = np.array(point.inputs)
    loop = ClosedLoop(
        NonlinearPlant(aircraft, point), policy, follow, none, none, GivenUpdraft(w), actuators=actuators, trim=trim
    )
    t, Y, _ = loop.symbols()
    offsets = np.zeros(Y.numel())
    offsets[: len(STATES)] = point.states
    now = loop.at(t, Y - ca.DM(offsets), ca.SX(ca.DM(np.zeros(0) if constants is None else constants)))
    return Y, ca.densify(now.rate), ca.densify(now.inputs + ca.DM(trim))


_UPDRAFT = Channel("updraft", "ft/s")


def _states(point: OperatingPoint) -> tuple[Channel, ...]:
    return tuple(map(Channel, STATES, STATE_UNITS, point.states, STATE_SCALES, RATE_UNITS))


def _inputs(point: OperatingPoint) -> tuple[Channel, ...]:
    return tuple(map(Channel, INPUTS, INPUT_UNITS, point.inputs, INPUT_SCALES))


def _actuator_states(actuators: Actuators) -> list[Channel]:
    """Deviations from trim, and with order 2 their rates."""
    suffixes = ("actuator", "actuator_rate")[: actuators.order]
    return [
        Channel(f"{name}_{suffix}", unit if suffix == "actuator" else None, size=size)
        for suffix in suffixes
        for name, unit, size in zip(INPUTS, INPUT_UNITS, INPUT_SCALES, strict=True)
    ]


def controller_example(
    controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint, actuators: Actuators, origin: str
) -> str:
    """The text of `EXAMPLE`; it needs `hfa_controller.h` and `.c`. BadInputError as in `held_loop`."""
    function, states = held_loop(aircraft, point, controller, actuators)
    names, trim = commandable(controller), np.array(point.inputs)
    commanded = f"{COMMANDED:g} {signal_unit(names[0])} of {names[0]}" if names else "nothing"
    return filled(
        f"{EXAMPLE}.in",
        origin=comment_lines(origin),
        command=commanded,
        commanded=COMMANDED if names else 0.0,
        seconds=SECONDS,
        states=len(states),
        dihedral=STATES.index("dihedral"),
        tables="\n".join(
            [
                c_table("static const char *const name", [f'"{each.name}"' for each in states]),
                c_table("static const double begin", [each.start for each in states]),
                c_table("static const double lowest", actuators.lowest - trim),
                c_table("static const double highest", actuators.highest - trim),
            ]
        ),
        function=c_function(function, "loop", ("y", "u"), ("rate", "dihedral", "measured")),
    )
