"""Loops for other tools: the aircraft alone, under a gain, or under a scheduled controller behind actuators; the
controller as a pair of C files for a flight computer; and an example, a loop of 100 Hz in C around it.

What a simulation works out, commands, measured outputs, updraft and held inputs, an exported loop gets as arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.design.design import COMMAND_FILTER, signal_unit
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from controller.export.c_model import c_positions, c_table, comment_lines, displaced, filled
from controller.flight.actuators import Actuators
from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import UPDRAFT, NonlinearPlant
from controller.flight.scenario import Scenario
from controller.policy.policies import GainPolicy, Memoryless, Policy, Seen, Unvaried, gain_constants
from controller.policy.servo_policy import ServoPolicy, servo_law
from controller.policy.signals import CommandSteps
from hfa_model.aircraft import Aircraft
from hfa_support.model import Model
from hfa_support.native.c_code import c_function
from hfa_support.reporting.text import shown_value
from trim.point.operating_point import OperatingPoint

HEADER, SOURCE = "hfa_controller.h", "hfa_controller.c"
#: C has no empty arrays: the one number of a memory or of commands that a controller does not have.
_UNUSED = "unused"
EXAMPLE = "controller_100hz.c"
#: What is commanded, in the unit of the first command, and how long it is simulated, s.
COMMANDED, SECONDS = 0.01, 20


class Given(Memoryless, Unvaried):
    """An argument in place of what a simulation works out: of a `ServoPolicy` the commands (value, their rate, end) or
    the measured outputs, of a loop the reference, the inputs or the updraft."""

    def __init__(self, value: ca.SX, slope: ca.SX | None = None, goal: ca.SX | None = None, names: Any = ()) -> None:
        self.size, self.names = value.numel(), names
        self._value, self._slope, self._goal = value, slope, goal

    def at(self, *_: object) -> Any:
        """The argument."""
        return self._value

    control = updraft = at

    def rate(self, *_: object) -> Any:
        """The rate of the commands."""
        return self._slope

    def end(self, *_: object) -> Any:
        """What the commands are on their way to."""
        return self._goal


def commandable(controller: ScheduledController) -> tuple[str, ...]:
    """Outputs that the controller can be commanded."""
    value = COMMAND_SIGNALS[0]
    return tuple(name.removesuffix(value) for name in controller.commands if name.endswith(value))


def filter_rates(controller: ScheduledController, r: ca.SX, slope: ca.SX, goal: ca.SX) -> ca.SX:
    """[r'; r''] of r'' = ω² (goal - r) - 2 ζ ω r', the filter of `CommandSteps`."""
    bandwidth, damping = controller.command_filter or COMMAND_FILTER
    return ca.vertcat(slope, bandwidth**2 * (goal - r) - 2 * damping * bandwidth * slope)


def controller_function(policy: ServoPolicy) -> ca.Function:
    """(dihedral, measured, memory, command, lowest, highest) -> (u, memory'), u within the limits.

    memory = [controller; r; r'], command: what r is on its way to. Deviations from trim; the dihedral absolute, rad.
    """
    made, names = policy.controller, commandable(policy.controller)
    model = policy.regulated.model
    measured = ca.SX.sym("measured", len(made.measurements))
    memory = ca.SX.sym("memory", len(made.states) + 2 * len(names))
    dihedral, command = ca.SX.sym("dihedral"), ca.SX.sym("command", len(names))
    lowest, highest = (ca.SX.sym(name, len(model.inputs)) for name in ("lowest", "highest"))
    own, r, slope = ca.vertsplit(memory, [0, *np.cumsum([len(made.states), len(names), len(names)]).tolist()])
    told = replace(policy, commands=Given(r, slope, command, names), outputs=Given(measured))
    states = ca.SX(len(model.linear), 1)
    states[model.linear.index(model.schedule)] = dihedral - policy.place
    nothing = ca.SX(0, 1)
    seen, t = Seen(states, states, nothing, nothing), ca.SX.sym("t")
    u = ca.fmin(ca.fmax(told.control(t, seen, own, nothing), lowest), highest)
    rate = ca.vertcat(told.memory_rate(t, seen, own, nothing, u), filter_rates(made, r, slope, command))
    arguments = [dihedral, measured, memory, command, lowest, highest]
    return ca.Function("controller", arguments, [ca.densify(u), ca.densify(rate)], {"cse": True})


def trimmed_policy(controller: ScheduledController, aircraft: Aircraft | Model, point: OperatingPoint) -> ServoPolicy:
    """The controller about a trim, without commands.

    BadInputError when it was made for another aircraft or other angles.
    """
    law = servo_law(controller, CommandSteps((), np.zeros(0), np.zeros((0, 0))), aircraft, point)
    assert isinstance(law.policy, ServoPolicy)
    return law.policy


def longest_step(controller: ScheduledController) -> float:
    """1 ms, or less where the fastest mode of the controller asks for it, s."""
    return 1.0 / max(float(np.abs(np.linalg.eigvals(controller.A)).max(initial=0.0)), 1e3)


def c_controller_texts(
    controller: ScheduledController, aircraft: Aircraft | Model, point: OperatingPoint, origin: str
) -> dict[str, str]:
    """File -> its text: header and source. origin: where it comes from, lines of text.

    BadInputError as in `trimmed_policy`.
    """
    made, names = controller, commandable(controller)
    policy, longest = trimmed_policy(controller, aircraft, point), longest_step(controller)
    scheduled = made.model.schedule
    arguments = (scheduled, "measured", "memory", "command", "lowest", "highest")
    memory = [*made.states, *(f"{name}{signal}" for signal in COMMAND_SIGNALS[:2] for name in names)] or [_UNUSED]
    names_and_units: dict[str, tuple[Sequence[str], Sequence[str]]] = {
        "measured": (made.measurements, [signal_unit(made.model, name) for name in made.measurements]),
        "command": (names, [signal_unit(made.model, name) for name in names]) if names else ([_UNUSED], [""]),
    }
    tables = [
        c_table(f"const char *const hfa_{kind}_{what}", [f'"{word}"' for word in words])
        for kind, both in names_and_units.items()
        for what, words in zip(("name", "unit"), both, strict=True)
    ]
    return {
        HEADER: filled(
            "hfa_controller.h.in",
            origin=comment_lines(origin),
            name=comment_lines(made.name),
            lowest=shown_value(made.places[0], made.model.unit(scheduled)),
            highest=made.model.describe(scheduled, made.places[-1]),
            scheduled=scheduled,
            memory=c_positions(memory, [""] * len(memory), "MEMORY_"),
            measured=c_positions(*names_and_units["measured"], "MEASURED_"),
            command=c_positions(*names_and_units["command"], "COMMAND_"),
            inputs=len(point.inputs),
            longest=longest,
        ),
        SOURCE: filled(
            "hfa_controller.c.in",
            origin=comment_lines(origin),
            tables="\n".join(tables),
            scheduled=scheduled,
            function=c_function(controller_function(policy), "controller", arguments, ("u", "rate")),
            longest=repr(longest),
        ),
    }


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

    function: (y, v) -> (f, g), g empty where u are among v. flown: how many of the states, the first, are those of the
    aircraft. longest_step: s, that Runge-Kutta 4 may take.
    """

    function: ca.Function
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    flown: int
    longest_step: float = 1e-3


def aircraft_loop(aircraft: Aircraft | Model, point: OperatingPoint) -> ExportedLoop:
    """X' = f(X, U, w): v = [U; w], w the updraft of a model that has one."""
    model, w = aircraft.model, _updraft(aircraft)
    U = ca.SX.sym("U", len(model.inputs))
    X, rate, _ = _closed(aircraft, point, Given(U - ca.DM(np.array(point.inputs))), w)
    function = ca.Function("loop", [X, ca.vertcat(U, w)], [rate, ca.DM(0, 1)])
    return ExportedLoop(function, _states(point), (), (*_inputs(point), *_air(model)), len(model.states))


def gain_loop(aircraft: Aircraft | Model, point: OperatingPoint, gain: np.ndarray) -> ExportedLoop:
    """U = U0 - K (x - X0 - reference): v = [w; reference (k,)]."""
    model, w = aircraft.model, _updraft(aircraft)
    reference, policy = ca.SX.sym("reference", len(model.linear)), GainPolicy(*gain.shape)
    X, rate, U = _closed(aircraft, point, policy, w, constants=gain_constants(gain), reference=reference)
    told = tuple(Channel(f"reference_{name}", model.unit(name)) for name in model.linear)
    function = ca.Function("loop", [X, ca.vertcat(w, reference)], [rate, U])
    return ExportedLoop(function, _states(point), _inputs(point), (*_air(model), *told), len(model.states))


def controller_loop(
    aircraft: Aircraft | Model, point: OperatingPoint, controller: ScheduledController, actuators: Actuators
) -> ExportedLoop:
    """The loop that `fly` integrates, with the command filter as states: v = [w; commanded values].

    y = [X; actuators; controller; r; r']: actuators and commands as deviations from trim. BadInputError when the
    controller was made for another aircraft or other angles, or an actuator cannot hold the trim.
    """
    names, w = commandable(controller), _updraft(aircraft)
    r, slope, goal = (ca.SX.sym(name, len(names)) for name in ("r", "slope", "goal"))
    policy = replace(trimmed_policy(controller, aircraft, point), commands=Given(r, slope, goal, names))
    Y, rate, U = _closed(aircraft, point, policy, w, actuators=actuators)
    filtered = filter_rates(controller, r, slope, goal)
    function = ca.Function(
        "loop", [ca.vertcat(Y, r, slope), ca.vertcat(w, goal)], [ca.vertcat(rate, filtered), U], {"cse": True}
    )
    units = [signal_unit(controller.model, name) for name in names]
    states = (
        *_states(point),
        *_actuator_states(actuators, point.model),
        *(Channel(f"controller_{name}", None) for name in controller.states),
        *(Channel(f"command_{name}_filtered", unit) for name, unit in zip(names, units, strict=True)),
        *(Channel(f"command_{name}_filtered_rate", None) for name in names),
    )
    inputs = tuple(Channel(f"command_{name}", unit) for name, unit in zip(names, units, strict=True))
    told = (*_air(aircraft.model), *inputs)
    return ExportedLoop(function, states, _inputs(point), told, len(point.states), longest_step(controller))


def held_loop(
    aircraft: Aircraft | Model, point: OperatingPoint, controller: ScheduledController, actuators: Actuators
) -> tuple[ca.Function, tuple[Channel, ...]]:
    """(y, u) -> (y', dihedral, measured) of the inputs u (m,) that a computer holds, y = [X; actuators], and y.

    u, actuators and measured as deviations from trim. BadInputError as in `controller_loop`, and when the controller
    measures what these actuators do not have.
    """
    policy, u = trimmed_policy(controller, aircraft, point), ca.SX.sym("u", len(point.inputs))
    Y, rate, _ = _closed(aircraft, point, Given(u), ca.SX(0, 1), actuators=actuators)
    n = len(point.states)
    X, moved = Y[:n], Y[n:]
    x = NonlinearPlant(aircraft, point).seen(X - ca.DM(np.array(point.states)))
    seen = Seen(x, x, actuators.position(moved, np.array(point.inputs)), actuators.rates(moved))
    scheduled = list(point.model.states).index(point.model.schedule)
    sensed = [X[scheduled], ca.densify(policy.outputs.at(seen))]
    return ca.Function("loop", [Y, u], [rate, *sensed], {"cse": True}), (
        *_states(point),
        *_actuator_states(actuators, point.model),
    )


def _closed(
    aircraft: Aircraft | Model,
    point: OperatingPoint,
    policy: Policy,
    w: ca.SX,
    *,
    constants: np.ndarray | None = None,
    reference: ca.SX | None = None,
    actuators: Actuators | None = None,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Y = [X; actuators; memory], its rate, and U."""
    told: dict[str, Any] = {} if reference is None else {"reference": Given(reference)}
    trim, gust = np.array(point.inputs), Given(w) if w.numel() else None
    scenario = Scenario(gust=gust, actuators=actuators, **told)
    loop = ClosedLoop(NonlinearPlant(aircraft, point), policy, scenario, trim)
    t, Y, _ = loop.symbols()
    offsets = np.zeros(Y.numel())
    offsets[: len(point.states)] = point.states
    now = loop.at(t, Y - ca.DM(offsets), ca.SX(ca.DM(np.zeros(0) if constants is None else constants)))
    return Y, ca.densify(now.rate), ca.densify(now.inputs + ca.DM(trim))


def _updraft(aircraft: Aircraft | Model) -> ca.SX:
    """The updraft of a model that has one, else (0, 1)."""
    return ca.SX.sym("w", int(UPDRAFT in aircraft.model.disturbances))


def _air(model: Model) -> tuple[Channel, ...]:
    return (Channel(UPDRAFT, model.unit(UPDRAFT)),) if UPDRAFT in model.disturbances else ()


def _states(point: OperatingPoint) -> tuple[Channel, ...]:
    model = point.model
    return tuple(
        Channel(name, each.unit, getattr(point.states, name), each.nominal, model.rate_unit(name))
        for name, each in model.states.items()
    )


def _inputs(point: OperatingPoint) -> tuple[Channel, ...]:
    given = point.model.inputs.items()
    return tuple(Channel(name, each.unit, getattr(point.inputs, name), each.nominal) for name, each in given)


def _actuator_states(actuators: Actuators, model: Model) -> list[Channel]:
    """Deviations from trim, and with order 2 their rates."""
    suffixes = ("actuator", "actuator_rate")[: actuators.order]
    return [
        Channel(f"{name}_{suffix}", each.unit if suffix == "actuator" else None, size=each.nominal)
        for suffix in suffixes
        for name, each in model.inputs.items()
    ]


def controller_example(
    controller: ScheduledController,
    aircraft: Aircraft | Model,
    point: OperatingPoint,
    actuators: Actuators,
    origin: str,
) -> str:
    """The text of `EXAMPLE`; it needs `hfa_controller.h` and `.c`. BadInputError as in `held_loop`."""
    function, states = held_loop(aircraft, point, controller, actuators)
    names, trim = commandable(controller), np.array(point.inputs)
    model, (state, amount) = point.model, displaced(point.model)
    commanded = f"{COMMANDED:g} {signal_unit(controller.model, names[0])} of {names[0]}" if names else "nothing"
    return filled(
        f"{EXAMPLE}.in",
        origin=comment_lines(origin),
        command=commanded,
        commanded=COMMANDED if names else 0.0,
        seconds=SECONDS,
        states=len(states),
        displaced=list(model.states).index(state),
        amount=amount,
        unit=model.unit(state),
        scheduled=model.schedule,
        dihedral=list(model.states).index(model.schedule),
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
