"""Export of a scheduled controller as expressions and as C with an example of a 100 Hz loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from hfa_aircraft.march.march import saturated
from hfa_aircraft.model import Model
from hfa_flight.actuators import ActuatorBank
from hfa_flight.export.c_text import (
    comment_lines,
    constant_tables,
    displaced_state,
    filled,
    name_tables,
    or_unused,
    positions,
    units_of,
)
from hfa_flight.export.exported_loop import Argument, Channel, ExportedLoop, Steering, exported_loop
from hfa_flight.policies.controller import MeasuredOutputs, ServoPolicy, servo_policy
from hfa_flight.policies.policy import Measurements
from hfa_flight.schedule.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from hfa_flight.signals import COMMAND_FILTER, CommandSteps
from hfa_support.native.c_code import c_function
from hfa_support.reporting.text import shown_value
from trim.point.operating_point import OperatingPoint

#: Names of the header, the source and the example.
CONTROLLER_FILES = ("hfa_controller.h", "hfa_controller.c", "controller_100hz.c")
#: Command in the example, in the unit of the first commanded output.
COMMANDED = 0.01
#: Duration of the example, s.
SECONDS = 20


@dataclass(frozen=True)
class CommandArguments:
    """Commands of an exported controller as symbols, with the methods of `CommandSteps`.

    names: commanded outputs
    value: filtered commands r, (k,)
    slope: rates r' of the filtered commands, (k,)
    goal: unfiltered commands, (k,)
    """

    names: tuple[str, ...]
    value: ca.SX
    slope: ca.SX
    goal: ca.SX

    def at(self, t: ca.SX) -> ca.SX:
        """Return the filtered commands r, (k,), for any time t."""
        return self.value

    def rate(self, t: ca.SX) -> ca.SX:
        """Return the rates r' of the filtered commands, (k,), for any time t."""
        return self.slope

    def end(self, t: ca.SX) -> ca.SX:
        """Return the unfiltered commands, (k,), for any time t."""
        return self.goal


def commandable(controller: ScheduledController) -> tuple[str, ...]:
    """Return the names of the outputs for which the controller accepts commands."""
    value = COMMAND_SIGNALS[0]
    return tuple(name.removesuffix(value) for name in controller.commands if name.endswith(value))


def controller_steering(
    controller: ScheduledController, model: Model, point: OperatingPoint
) -> Steering:
    """Return the steering of an exported loop by a controller, whose arguments are the commands.

    The filtered commands r are states: r'' = ω² (goal - r) - 2 ζ ω r', with the bandwidth ω and the
    damping ζ of the command filter. The longest step is 1 ms, or 1/|λ| for the fastest eigenvalue λ
    of the controller.

    Raises BadInputError if the controller was made for another model, or does not cover the
    scheduling variable at the trim.
    """
    names = commandable(controller)
    r, slope, goal = (ca.SX.sym(name, len(names)) for name in ("r", "slope", "goal"))
    none = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    servo = servo_policy(controller, none, model, point)
    bandwidth, damping = controller.command_filter or COMMAND_FILTER
    acceleration = bandwidth**2 * (goal - r) - 2 * damping * bandwidth * slope
    units = units_of(model, names)
    states = [Channel(f"controller_{name}", None) for name in controller.states]
    states += [Channel(f"command_{name}_filtered", unit) for name, unit in units.items()]
    states += [Channel(f"command_{name}_filtered_rate", None) for name in names]
    return Steering(
        policy=replace(servo, commands=CommandArguments(names, r, slope, goal)),
        arguments=[Channel(f"command_{name}", unit) for name, unit in units.items()],
        v=goal,
        states=tuple(states),
        filtered=ca.vertcat(r, slope),
        filtered_rate=ca.vertcat(slope, acceleration),
        longest_step=1.0 / max(servo.fastest, 1e3),
    )


def c_controller_texts(
    controller: ScheduledController,
    model: Model,
    point: OperatingPoint,
    origin: str,
    actuators: ActuatorBank | None = None,
) -> dict[str, str]:
    """Return the C files of a controller, file name -> text: header, source and an example.

    The example simulates the closed loop. It is included if actuators are given.

    origin: provenance, for comments
    actuators: actuators of the example, or None

    Raises BadInputError if the controller was made for another model or does not cover the
    scheduling variable at the trim, a trim input is outside its actuator's limits, or the
    controller measures actuator states that do not exist.
    """
    header, source, example = CONTROLLER_FILES
    steering = controller_steering(controller, model, point)
    names = commandable(controller)
    memory = [*controller.states]
    for suffix in COMMAND_SIGNALS[:2]:
        memory += [f"{name}{suffix}" for name in names]
    measured = units_of(model, controller.measurements)
    command = or_unused(units_of(model, names))
    scheduled = model.schedule
    arguments = (scheduled, "measured", "memory", "command", "lowest", "highest")
    function = _controller_function(point, steering)
    texts = {
        header: filled(
            header,
            origin=comment_lines(origin),
            name=comment_lines(controller.name),
            lowest=shown_value(controller.breakpoints[0], model.unit(scheduled)),
            highest=model.describe(scheduled, controller.breakpoints[-1]),
            scheduled=scheduled,
            memory=positions(or_unused(dict.fromkeys(memory, "")), "MEMORY_"),
            measured=positions(measured, "MEASURED_"),
            command=positions(command, "COMMAND_"),
            inputs=len(point.inputs),
            longest=steering.longest_step,
        ),
        source: filled(
            source,
            origin=comment_lines(origin),
            tables=constant_tables(
                name_tables("measured", measured) | name_tables("command", command)
            ),
            scheduled=scheduled,
            function=c_function(function, "controller", arguments, ("u", "rate")),
            longest=repr(steering.longest_step),
        ),
    }
    if actuators is not None:
        outputs = MeasuredOutputs(model, point, controller.measurements)
        texts[example] = _example(point, outputs, actuators, command, origin)
    return texts


def _example(
    point: OperatingPoint,
    outputs: MeasuredOutputs,
    actuators: ActuatorBank,
    command: dict[str, str],
    origin: str,
) -> str:
    """Return the C source of the example: a 100 Hz loop with aircraft, actuators and sensors."""
    model = point.model
    state, amount = displaced_state(model)
    loop = exported_loop(model, point, actuators=actuators)
    trim = point.u
    name, unit = next(iter(command.items()))
    is_commanded = name in model.measurable
    tables = {
        "static const char *const name": [f'"{channel.name}"' for channel in loop.states],
        "static const double begin": [channel.start for channel in loop.states],
        "static const double lowest": actuators.lowest - trim,
        "static const double highest": actuators.highest - trim,
    }
    function = _measured_loop(outputs, loop, actuators, point)
    results = ("rate", model.schedule, "measured")
    return filled(
        CONTROLLER_FILES[2],
        origin=comment_lines(origin),
        command=f"{COMMANDED:g} {unit} of {name}" if is_commanded else "nothing",
        commanded=COMMANDED if is_commanded else 0.0,
        seconds=SECONDS,
        states=len(loop.states),
        displaced=list(model.states).index(state),
        amount=amount,
        unit=model.unit(state),
        scheduled=model.schedule,
        place=list(model.states).index(model.schedule),
        tables=constant_tables(tables),
        function=c_function(function, "loop", ("y", "u"), results),
    )


def _controller_function(point: OperatingPoint, steering: Steering) -> ca.Function:
    """Return (scheduled, measured, memory, command, lowest, highest) -> (u, memory')."""
    model = point.model
    policy = steering.policy
    assert isinstance(policy, ServoPolicy)  # of `controller_steering`
    controller = policy.controller
    t = ca.SX.sym("t")
    none = ca.SX(0, 1)
    own = ca.SX.sym("own", len(controller.states))
    scheduled = ca.SX.sym("scheduled")
    measured = ca.SX.sym("measured", len(controller.measurements))
    lowest = ca.SX.sym("lowest", len(model.inputs))
    highest = ca.SX.sym("highest", len(model.inputs))
    policy = replace(policy, outputs=Argument(measured))
    states = ca.SX(len(model.linear), 1)
    states[model.linear.index(model.schedule)] = scheduled - policy.scheduled_at
    measurements = Measurements(states, states, none, none)
    u = saturated(policy.control(t, measurements, own, none), lowest, highest)
    rate = policy.memory_rate(t, measurements, own, none, u)
    memory = ca.vertcat(own, steering.filtered)
    results = [ca.densify(u), ca.densify(ca.vertcat(rate, steering.filtered_rate))]
    arguments = [scheduled, measured, memory, steering.v, lowest, highest]
    return ca.Function("controller", arguments, results, {"cse": True})


def _measured_loop(
    outputs: MeasuredOutputs, loop: ExportedLoop, actuators: ActuatorBank, point: OperatingPoint
) -> ca.Function:
    """Return the Function (y, u) -> (y', scheduling variable, measured outputs) in still air."""
    model = point.model
    trim = point.u
    y = ca.SX.sym("y", len(loop.states))
    u = ca.SX.sym("u", len(trim))
    still = ca.SX(len(loop.inputs) - len(trim), 1)
    rate, _ = loop.function.call([y, ca.vertcat(still, u + ca.DM(trim))], True)
    X = y[: loop.flown]
    moved = y[loop.flown :]
    names = list(model.states)
    rows = model.state_places(model.linear)
    x = X[rows] - ca.DM(point.x[rows])
    positions_of_actuators = actuators.position(moved, trim)
    measurements = Measurements(x, x, positions_of_actuators, actuators.rates(moved))
    measured = outputs.at(measurements)
    results = [ca.densify(rate), X[names.index(model.schedule)], ca.densify(measured)]
    return ca.Function("loop", [y, u], results, {"cse": True})
