"""Loops for other tools: the aircraft alone, under a gain, or under a scheduled controller behind actuators; linear
models between the points of a sweep; the controller as a pair of C files, with a loop of 100 Hz as an example.

What a simulation works out, commands, measured outputs, updraft and held inputs, an exported loop gets as arguments.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controller.design.design import COMMAND_FILTER, signal_unit
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from controller.export.c_model import c_positions, c_table, comment_lines, displaced, filled
from controller.flight.actuators import Actuators
from controller.flight.closed_loop import ClosedLoop, Expressions, NonlinearPlant
from controller.flight.gusts import UPDRAFT
from controller.flight.scenario import Scenario
from controller.policy.policies import FlownLaw, Memoryless, Seen, Unvaried, gain_law
from controller.policy.servo_policy import ServoPolicy, servo_law
from controller.policy.signals import CommandSteps
from hfa_support.model import HasModel, Model
from hfa_support.native.c_code import c_function
from hfa_support.reporting.text import shown_value
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from trim.linear.varying import InterpolatedModel

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
    """(place, measured, memory, command, lowest, highest) -> (u, memory'), u within the limits.

    place: value of the scheduling variable, absolute; the rest as deviations from trim. memory = [controller; r; r'].
    command: what r is on its way to.
    """
    made, names = policy.controller, commandable(policy.controller)
    model = policy.regulated.model
    measured = ca.SX.sym("measured", len(made.measurements))
    memory = ca.SX.sym("memory", len(made.states) + 2 * len(names))
    place, command = ca.SX.sym("place"), ca.SX.sym("command", len(names))
    lowest, highest = (ca.SX.sym(name, len(model.inputs)) for name in ("lowest", "highest"))
    own, r, slope = ca.vertsplit(memory, [0, *np.cumsum([len(made.states), len(names), len(names)]).tolist()])
    told = replace(policy, commands=Given(r, slope, command, names), outputs=Given(measured))
    states = ca.SX(len(model.linear), 1)
    states[model.linear.index(model.schedule)] = place - policy.place
    nothing = ca.SX(0, 1)
    seen, t = Seen(states, states, nothing, nothing), ca.SX.sym("t")
    u = ca.fmin(ca.fmax(told.control(t, seen, own, nothing), lowest), highest)
    rate = ca.vertcat(told.memory_rate(t, seen, own, nothing, u), filter_rates(made, r, slope, command))
    arguments = [place, measured, memory, command, lowest, highest]
    return ca.Function("controller", arguments, [ca.densify(u), ca.densify(rate)], {"cse": True})


def trimmed_policy(controller: ScheduledController, aircraft: HasModel, point: OperatingPoint) -> ServoPolicy:
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
    controller: ScheduledController, aircraft: HasModel, point: OperatingPoint, origin: str
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


def exported_loop(
    aircraft: HasModel,
    point: OperatingPoint,
    gain: np.ndarray | None = None,
    controller: ScheduledController | None = None,
    actuators: Actuators | None = None,
) -> ExportedLoop:
    """X' = f(X, U, w), w the updraft of a model that has one, with what sets U: v, with a gain U = U0 - K (x - X0 - v),
    or the controller behind the actuators, with the command filter as states: v = what is commanded. Then v = [w; v].

    y = [X; actuators; controller; r; r']: actuators and commands as deviations from trim. BadInputError when the
    controller was made for another aircraft or other angles, or an actuator cannot hold the trim.
    """
    model, U0 = aircraft.model, np.array(point.inputs)
    w = ca.SX.sym("w", int(UPDRAFT in model.disturbances))
    air = tuple(Channel(UPDRAFT, model.unit(UPDRAFT)) for _ in range(w.numel()))
    inputs = tuple(Channel(*each, model.inputs[each[0]].nominal) for each in _named(model.inputs, model, point.inputs))
    states = _states(point, actuators)
    step, reference, filtered, rates = 1e-3, None, ca.SX(0, 1), ca.SX(0, 1)
    if controller is not None:
        names, step = commandable(controller), longest_step(controller)
        r, slope, v = (ca.SX.sym(name, len(names)) for name in ("r", "slope", "goal"))
        policy = replace(trimmed_policy(controller, aircraft, point), commands=Given(r, slope, v, names))
        law = FlownLaw(controller.name, policy)
        filtered, rates = ca.vertcat(r, slope), filter_rates(controller, r, slope, v)
        units = dict(zip(names, (signal_unit(model, name) for name in names), strict=True))
        told = tuple(Channel(f"command_{name}", unit) for name, unit in units.items())
        states += tuple(Channel(f"controller_{name}", None) for name in controller.states)
        states += tuple(Channel(f"command_{name}_filtered", unit) for name, unit in units.items())
        states += tuple(Channel(f"command_{name}_filtered_rate", None) for name in names)
    elif gain is not None:
        v, law = ca.SX.sym("reference", len(model.linear)), gain_law("gain", gain)
        told, reference = tuple(Channel(f"reference_{name}", model.unit(name)) for name in model.linear), Given(v)
    else:
        v, told = ca.SX.sym("U", len(U0)), inputs
        law = FlownLaw("none", Given(v - ca.DM(U0)))
    alone = controller is None and gain is None
    blown: Any = Given(w) if w.numel() else None
    scenario = Scenario(gust=blown, reference=reference, actuators=actuators)
    Y, now = _closed(aircraft, point, law, scenario)
    U = ca.DM(0, 1) if alone else ca.densify(now.inputs + ca.DM(U0))
    arguments, results = [ca.vertcat(Y, filtered), ca.vertcat(w, v)], [ca.densify(ca.vertcat(now.rate, rates)), U]
    function = ca.Function("loop", arguments, results, {"cse": True})
    outputs = () if alone else inputs
    return ExportedLoop(function, states, outputs, (*air, *told), len(model.states), step)


def interpolated_loop(between: InterpolatedModel) -> ExportedLoop:
    """x' = A(s) (x - X0(s)) + B(s) (u - U0(s)) of the states of the sweep; v = [u; s], s the variables of the sweep as
    inputs `scheduled_NAME`, from the middle of the grid on."""
    sweep, model = between.sweep, between.sweep.model
    middle = {name: float(axis[0] + axis[-1]) / 2 for name, axis in zip(sweep.variables, between.axes, strict=True)}
    trimmed, rows = between.at(**middle), [list(model.states).index(name) for name in sweep.model_states]
    x, u, s = (ca.SX.sym(name, size) for name, size in (("x", len(rows)), ("u", len(model.inputs)), ("s", len(middle))))
    X0, U0, A, B = between.to_casadi()(s)
    function = ca.Function(
        "loop", [x, ca.vertcat(u, s)], [ca.mtimes(A, x - X0[rows]) + ca.mtimes(B, u - U0), ca.DM(0, 1)], {"cse": True}
    )
    states = tuple(
        Channel(name, unit, value, model.states[name].nominal, model.rate_unit(name))
        for name, unit, value in _named(sweep.model_states, model, trimmed.states[rows])
    )
    inputs = [Channel(*each) for each in _named(model.inputs, model, trimmed.inputs)]
    scheduled = [Channel(f"scheduled_{name}", model.unit(name), value) for name, value in middle.items()]
    return ExportedLoop(function, states, (), (*inputs, *scheduled), len(states))


def _named(names: Iterable[str], model: Model, values: Iterable[float]) -> list[tuple[str, str, float]]:
    """Each name with its unit and its value."""
    return [(name, model.unit(name), float(value)) for name, value in zip(names, values, strict=True)]


def _closed(aircraft: HasModel, point: OperatingPoint, law: FlownLaw, scenario: Scenario) -> tuple[ca.SX, Expressions]:
    """Y = [X; actuators; memory], X absolute, and the loop there."""
    loop = ClosedLoop(NonlinearPlant(aircraft, point), law, scenario)
    t, Y, _ = loop.symbols()
    offsets = np.zeros(Y.numel())
    offsets[: len(point.states)] = point.states
    return Y, loop.at(t, Y - ca.DM(offsets), ca.SX(ca.DM(loop.constants()(0))))


def _states(point: OperatingPoint, actuators: Actuators | None) -> tuple[Channel, ...]:
    """X; the actuators as deviations from trim, with order 2 their rates."""
    model = point.model
    X = [
        Channel(*each, model.states[each[0]].nominal, model.rate_unit(each[0]))
        for each in _named(model.states, model, point.states)
    ]
    suffixes = () if actuators is None else ("actuator", "actuator_rate")[: actuators.order]
    moved = [
        Channel(f"{name}_{suffix}", each.unit if suffix == "actuator" else None, size=each.nominal)
        for suffix in suffixes
        for name, each in model.inputs.items()
    ]
    return (*X, *moved)


def controller_example(
    controller: ScheduledController,
    aircraft: HasModel,
    point: OperatingPoint,
    actuators: Actuators,
    origin: str,
) -> str:
    """The text of `EXAMPLE`, which needs `hfa_controller.h` and `.c`: a computer holds the inputs, y = [X; actuators].

    BadInputError as in `exported_loop`, and when the controller measures what these actuators do not have.
    """
    model, trim, (state, amount) = point.model, np.array(point.inputs), displaced(point.model)
    policy, u, scheduled = trimmed_policy(controller, aircraft, point), ca.SX.sym("u", len(trim)), model.schedule
    Y, now = _closed(aircraft, point, FlownLaw("held", Given(u)), Scenario(actuators=actuators))
    X, moved = Y[: len(point.states)], Y[len(point.states) :]
    x = ca.mtimes(ca.DM(NonlinearPlant(aircraft, point).chosen), X - ca.DM(np.array(point.states)))
    measured = policy.outputs.at(Seen(x, x, actuators.position(moved, trim), actuators.rates(moved)))
    place = list(model.states).index(scheduled)
    results = [ca.densify(now.rate), X[place], ca.densify(measured)]
    function = ca.Function("loop", [Y, u], results, {"cse": True})
    states, names = _states(point, actuators), commandable(controller)
    return filled(
        f"{EXAMPLE}.in",
        origin=comment_lines(origin),
        command=f"{COMMANDED:g} {signal_unit(model, names[0])} of {names[0]}" if names else "nothing",
        commanded=COMMANDED if names else 0.0,
        seconds=SECONDS,
        states=len(states),
        displaced=list(model.states).index(state),
        amount=amount,
        unit=model.unit(state),
        scheduled=scheduled,
        place=place,
        tables="\n".join(
            [
                c_table("static const char *const name", [f'"{each.name}"' for each in states]),
                c_table("static const double begin", [each.start for each in states]),
                c_table("static const double lowest", actuators.lowest - trim),
                c_table("static const double highest", actuators.highest - trim),
            ]
        ),
        function=c_function(function, "loop", ("y", "u"), ("rate", scheduled, "measured")),
    )
