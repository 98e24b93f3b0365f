"""Loops for other tools, as data and as C: the aircraft alone, under a gain, or under a scheduled
controller behind actuators; linear models between the points of a sweep; the aircraft and the
controller as pairs of C files, each with a loop of 100 Hz as an example.

What a simulation works out, commands, measured outputs, updraft and held inputs, an exported loop
gets as arguments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.actuators import Actuators
from controller.flight.closed_loop import ClosedLoop, NonlinearPlant
from controller.flight.gusts import UPDRAFT
from controller.flight.policies import FlownLaw, Memoryless, Seen, Unvaried, gain_law
from controller.flight.scenario import Scenario
from controller.flight.signals import CommandSteps
from controller.servo.design import COMMAND_FILTER, signal_unit
from controller.servo.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from controller.servo.servo_policy import servo_law
from hfa_aircraft.model import Model, components
from hfa_support.native.c_code import c_function
from hfa_support.reporting.text import shown_value
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from trim.linear.varying import InterpolatedModel

#: Files of the aircraft and of a controller: header, source, the example that uses them.
AIRCRAFT_FILES = ("hfa_aircraft.h", "hfa_aircraft.c", "loop_100hz.c")
CONTROLLER_FILES = ("hfa_controller.h", "hfa_controller.c", "controller_100hz.c")
#: C has no empty arrays: the one number of a memory or of commands that a controller does not have.
_UNUSED = "unused"
#: What is commanded in the example, in the unit of the first command, and how long it is simulated,
#: s.
COMMANDED, SECONDS = 0.01, 20


class Given(Memoryless, Unvaried):
    """An argument in place of what a simulation works out: of a `ServoPolicy` the commands (value,
    their rate, end) or the measured outputs, of a loop the reference, the inputs or the updraft."""

    def __init__(
        self, value: ca.SX, slope: ca.SX | None = None, goal: ca.SX | None = None, names: Any = ()
    ) -> None:
        self.size, self.names = value.numel(), names
        self.at: Any = lambda *_: value
        self.rate: Any = lambda *_: slope
        self.end: Any = lambda *_: goal
        self.control = self.updraft = self.at


def commandable(controller: ScheduledController) -> tuple[str, ...]:
    """Outputs that the controller can be commanded."""
    value = COMMAND_SIGNALS[0]
    return tuple(name.removesuffix(value) for name in controller.commands if name.endswith(value))


def _commanded(
    controller: ScheduledController, aircraft: Model, point: OperatingPoint
) -> tuple[FlownLaw, ca.SX, ca.SX, ca.SX]:
    """The controller about a trim; symbols [r; r'] of its commands, their rates, what they are on
    their way to.

    r'' = ω² (goal - r) - 2 ζ ω r', the filter of `CommandSteps`. BadInputError when the controller
    was made for another aircraft or other angles."""
    names, (bandwidth, damping) = (
        commandable(controller),
        controller.command_filter or COMMAND_FILTER,
    )
    r, slope, goal = (ca.SX.sym(name, len(names)) for name in ("r", "slope", "goal"))
    law = servo_law(controller, CommandSteps((), np.zeros(0), np.zeros((0, 0))), aircraft, point)
    law = replace(law, policy=replace(law.policy, commands=Given(r, slope, goal, names)))  # type: ignore[type-var]
    rates = ca.vertcat(slope, bandwidth**2 * (goal - r) - 2 * damping * bandwidth * slope)
    return law, ca.vertcat(r, slope), rates, goal


def longest_step(controller: ScheduledController) -> float:
    """1 ms, or less where the fastest mode of the controller asks for it, s."""
    return 1.0 / max(float(np.abs(np.linalg.eigvals(controller.A)).max(initial=0.0)), 1e3)


class Channel(NamedTuple):
    """One number of a loop. unit: None where it depends on the controller. size: one scaled
    unit."""

    name: str
    unit: str | None
    start: float = 0.0
    size: float = 1.0
    rate_unit: str | None = None


@dataclass(frozen=True, eq=False)
class ExportedLoop:
    """y' = f(y, v), and the inputs u = g(y, v) of the aircraft where something sets them; absolute
    values.

    function: (y, v) -> (f, g), g empty where u are among v. flown: how many of the states, the
    first, are those of the aircraft. longest_step: s, that Runge-Kutta 4 may take."""

    function: ca.Function
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    flown: int
    longest_step: float = 1e-3


def exported_loop(
    aircraft: Model,
    point: OperatingPoint,
    gain: np.ndarray | None = None,
    controller: ScheduledController | None = None,
    actuators: Actuators | None = None,
) -> ExportedLoop:
    """X' = f(X, U, w), w the updraft of a model that has one, with what sets U: v, with a gain U =
    U0 - K (x - X0 - v), or the controller behind the actuators, with the command filter as states:
    v = what is commanded. Then v = [w; v].

    y = [X; actuators; controller; r; r']: actuators and commands as deviations from trim.
    BadInputError when the controller was made for another aircraft or other angles, or an actuator
    cannot hold the trim."""
    model, U0 = aircraft, np.array(point.inputs)
    w = ca.SX.sym("w", int(UPDRAFT in model.disturbances))
    air = [Channel(UPDRAFT, model.unit(UPDRAFT))] * w.numel()
    inputs = _channels(model, model.inputs, point.inputs)
    states = _channels(model, model.states, point.states, rates=True)
    for suffix in ("actuator", "actuator_rate")[: 0 if actuators is None else actuators.order]:
        for name, each in model.inputs.items():
            unit = each.unit if suffix == "actuator" else None
            states.append(Channel(f"{name}_{suffix}", unit, size=each.nominal))
    step, reference, filtered, rates, outputs = 1e-3, None, ca.SX(0, 1), ca.SX(0, 1), inputs
    if controller is not None:
        law, filtered, rates, v = _commanded(controller, aircraft, point)
        step, names = longest_step(controller), commandable(controller)
        units = {name: signal_unit(model, name) for name in names}
        told = [Channel(f"command_{name}", unit) for name, unit in units.items()]
        states += [Channel(f"controller_{name}", None) for name in controller.states]
        states += [Channel(f"command_{name}_filtered", unit) for name, unit in units.items()]
        states += [Channel(f"command_{name}_filtered_rate", None) for name in names]
    elif gain is not None:
        v, law = ca.SX.sym("reference", len(model.linear)), gain_law("gain", gain)
        told, reference = (
            [Channel(f"reference_{name}", model.unit(name)) for name in model.linear],
            Given(v),
        )
    else:
        v = ca.SX.sym("U", len(U0))
        told, outputs, law = inputs, [], FlownLaw("none", Given(v - ca.DM(U0)))
    blown: Any = Given(w) if w.numel() else None
    scenario = Scenario(gust=blown, reference=reference, actuators=actuators)
    loop = ClosedLoop(NonlinearPlant(aircraft, point), law, scenario)
    t, Y, _ = loop.symbols()
    offsets = np.zeros(Y.numel())
    offsets[: len(point.states)] = point.states
    now = loop.at(t, Y - ca.DM(offsets), ca.SX(ca.DM(loop.constants()(0))))
    U = ca.densify(now.inputs + ca.DM(U0)) if outputs else ca.DM(0, 1)
    arguments, results = (
        [ca.vertcat(Y, filtered), ca.vertcat(w, v)],
        [ca.densify(ca.vertcat(now.rate, rates)), U],
    )
    function = ca.Function("loop", arguments, results, {"cse": True})
    return ExportedLoop(
        function, tuple(states), tuple(outputs), (*air, *told), len(model.states), step
    )


def interpolated_loop(between: InterpolatedModel) -> ExportedLoop:
    """x' = A(s) (x - X0(s)) + B(s) (u - U0(s)) of the states of the sweep; v = [u; s], s the
    variables of the sweep as inputs `scheduled_NAME`, from the middle of the grid on."""
    sweep, model = between.sweep, between.sweep.model
    middle = {
        name: float(axis[0] + axis[-1]) / 2
        for name, axis in zip(sweep.variables, between.axes, strict=True)
    }
    trimmed, rows = between.at(**middle), [list(model.states).index(name) for name in model.linear]
    x, u, s = (
        ca.SX.sym(name, size)
        for name, size in (("x", len(rows)), ("u", len(model.inputs)), ("s", len(middle)))
    )
    X0, U0, A, B = between.to_casadi()(s)
    rate = ca.mtimes(A, x - X0[rows]) + ca.mtimes(B, u - U0)
    function = ca.Function("loop", [x, ca.vertcat(u, s)], [rate, ca.DM(0, 1)], {"cse": True})
    inputs = _channels(model, model.inputs, trimmed.inputs)
    inputs += [
        Channel(f"scheduled_{name}", model.unit(name), value) for name, value in middle.items()
    ]
    states = _channels(model, model.linear, trimmed.states[rows], rates=True)
    return ExportedLoop(function, tuple(states), (), tuple(inputs), len(states))


def _channels(
    model: Model, names: Iterable[str], values: Iterable[float], *, rates: bool = False
) -> list[Channel]:
    """Signals of the model at these values; rates: with the units of their rates."""
    found = []
    for name, value in zip(names, values, strict=True):
        rate_unit = model.rate_unit(name) if rates else None
        found.append(
            Channel(name, model.unit(name), float(value), model.signals[name].nominal, rate_unit)
        )
    return found


# C.


def c_model_texts(
    aircraft: Model, linear: LinearModel, gain: np.ndarray | None, origin: str
) -> dict[str, str]:
    """File -> its text: header and source and, with a gain K (m, k) of u = -K x, a loop of 100 Hz
    that uses them.

    linear: the model at a trim. origin: where it comes from, lines of text. BadInputError for what
    C cannot express."""
    model, point = aircraft, linear.point
    header, source, example = AIRCRAFT_FILES
    said = {"origin": comment_lines(origin), "title": comment_lines(model.title)}
    states, inputs = (
        (tuple(names), model.units(tuple(names))) for names in (model.states, model.inputs)
    )
    tables = {
        "const double hfa_x0": point.states,
        "const double hfa_u0": point.inputs,
        "const double hfa_A": linear.A,
        "const double hfa_B": linear.B,
        "const double hfa_K": np.zeros(linear.B.T.shape) if gain is None else gain,
        "const int hfa_linear_state": [list(model.states).index(name) for name in model.linear],
        **_words("state", *states),
        **_words("input", *inputs),
    }
    numbers = [(each.start, name, each.unit) for name, each in model.parameters.items()] or [
        (0.0, "none", "1")
    ]
    values = "\n".join(f"    {value!r}, /* {name}, {unit} */" for value, name, unit in numbers)
    texts = {
        header: _filled(
            header,
            **said,
            states=_positions(*states),
            inputs=_positions(*inputs),
            linear_states=", ".join(model.linear),
            linear_count=len(model.linear),
        ),
        source: _filled(
            source,
            **said,
            parameters=f"static const double parameters[{len(numbers)}] = {{\n{values}\n}};",
            tables=_tables(tables),
            function=c_function(_rates(model), "rates", ("x", "u", UPDRAFT, "p"), ("dx",)),
        ),
    }
    if gain is not None:
        state, amount = _displaced(model)
        texts[example] = _filled(
            example, state=state.upper(), amount=amount, unit=model.unit(state)
        )
    return texts


def _rates(model: Model) -> ca.Function:
    """(x, u, updraft, p) -> dx; a model without that disturbance does not depend on it."""
    x, u, p = model.layout.symbols("x", "u", "p")
    w = ca.SX.sym("w")
    air = [w if name == UPDRAFT else 0.0 for name in model.disturbances]
    f, _ = model.layout.expressions(tuple(map(components, (x, u, p))), (), air)
    return ca.Function("rates", [x, u, w, p], [f])


def c_controller_texts(
    controller: ScheduledController,
    aircraft: Model,
    point: OperatingPoint,
    origin: str,
    actuators: Actuators | None = None,
) -> dict[str, str]:
    """File -> its text: header, source and, behind actuators, an example. origin: where it comes
    from, lines of text.

    BadInputError when the controller was made for another aircraft or other angles, an actuator
    cannot hold the trim, or the controller measures what these actuators do not have."""
    model, names, longest = point.model, commandable(controller), longest_step(controller)
    scheduled = model.schedule
    (header, source, example), made = CONTROLLER_FILES, _commanded(controller, aircraft, point)
    arguments = (scheduled, "measured", "memory", "command", "lowest", "highest")
    memory = [
        *controller.states,
        *(f"{name}{end}" for end in COMMAND_SIGNALS[:2] for name in names),
    ] or [_UNUSED]
    measured = (
        controller.measurements,
        [signal_unit(model, name) for name in controller.measurements],
    )
    commands = (
        (list(names), [signal_unit(model, name) for name in names]) if names else ([_UNUSED], [""])
    )
    texts = {
        header: _filled(
            header,
            origin=comment_lines(origin),
            name=comment_lines(controller.name),
            lowest=shown_value(controller.places[0], model.unit(scheduled)),
            highest=model.describe(scheduled, controller.places[-1]),
            scheduled=scheduled,
            memory=_positions(memory, [""] * len(memory), "MEMORY_"),
            measured=_positions(*measured, "MEASURED_"),
            command=_positions(*commands, "COMMAND_"),
            inputs=len(point.inputs),
            longest=longest,
        ),
        source: _filled(
            source,
            origin=comment_lines(origin),
            tables=_tables(_words("measured", *measured) | _words("command", *commands)),
            scheduled=scheduled,
            function=c_function(
                _controller_function(point, *made), "controller", arguments, ("u", "rate")
            ),
            longest=repr(longest),
        ),
    }
    if actuators is not None:
        state, amount = _displaced(model)
        loop, trim = exported_loop(aircraft, point, actuators=actuators), np.array(point.inputs)
        tables = {
            "static const char *const name": [f'"{each.name}"' for each in loop.states],
            "static const double begin": [each.start for each in loop.states],
            "static const double lowest": actuators.lowest - trim,
            "static const double highest": actuators.highest - trim,
        }
        measuring = _measured_loop(made[0].policy, loop, actuators, point)
        texts[example] = _filled(
            example,
            origin=comment_lines(origin),
            command=f"{COMMANDED:g} {commands[1][0]} of {names[0]}" if names else "nothing",
            commanded=COMMANDED if names else 0.0,
            seconds=SECONDS,
            states=len(loop.states),
            displaced=list(model.states).index(state),
            amount=amount,
            unit=model.unit(state),
            scheduled=scheduled,
            place=list(model.states).index(scheduled),
            tables=_tables(tables),
            function=c_function(measuring, "loop", ("y", "u"), ("rate", scheduled, "measured")),
        )
    return texts


def _controller_function(
    point: OperatingPoint, law: FlownLaw, filtered: ca.SX, rates: ca.SX, goal: ca.SX
) -> ca.Function:
    """(place, measured, memory, command, lowest, highest) -> (u, memory'), u within the limits.

    place: value of the scheduling variable, absolute; the rest as deviations from trim. memory =
    [controller; r; r']. command: what r is on its way to."""
    policy: Any = law.policy
    model, nothing, t = point.model, ca.SX(0, 1), ca.SX.sym("t")
    own, place = ca.SX.sym("own", policy.memory_size), ca.SX.sym("place")
    measured = ca.SX.sym("measured", len(policy.controller.measurements))
    lowest, highest = (ca.SX.sym(name, len(model.inputs)) for name in ("lowest", "highest"))
    policy, states = replace(policy, outputs=Given(measured)), ca.SX(len(model.linear), 1)
    states[model.linear.index(model.schedule)] = place - policy.place
    seen = Seen(states, states, nothing, nothing)
    u = ca.fmin(ca.fmax(policy.control(t, seen, own, nothing), lowest), highest)
    rate = ca.vertcat(policy.memory_rate(t, seen, own, nothing, u), rates)
    arguments = [place, measured, ca.vertcat(own, filtered), goal, lowest, highest]
    return ca.Function("controller", arguments, [ca.densify(u), ca.densify(rate)], {"cse": True})


def _measured_loop(
    policy: Any, loop: ExportedLoop, actuators: Actuators, point: OperatingPoint
) -> ca.Function:
    """(y, u) -> (y', the scheduling variable, what the policy measures), y = [X; actuators], in
    still air; u as deviations from trim."""
    model, trim = point.model, np.array(point.inputs)
    y, u = ca.SX.sym("y", len(loop.states)), ca.SX.sym("u", len(trim))
    still = ca.SX(len(loop.inputs) - len(trim), 1)
    rate, _ = loop.function.call([y, ca.vertcat(still, u + ca.DM(trim))], True)
    X, moved, names = y[: loop.flown], y[loop.flown :], list(model.states)
    rows = [names.index(name) for name in model.linear]
    x = X[rows] - ca.DM(np.array(point.states)[rows])
    measured = policy.outputs.at(
        Seen(x, x, actuators.position(moved, trim), actuators.rates(moved))
    )
    results = [ca.densify(rate), X[names.index(model.schedule)], ca.densify(measured)]
    return ca.Function("loop", [y, u], results, {"cse": True})


def _displaced(model: Model) -> tuple[str, float]:
    """What an example starts off trim: 1 ft/s too fast, or the first state of the linear model by 1
    % of its size."""
    name = "speed" if "speed" in model.states else model.linear[0]
    return name, 1.0 if name == "speed" else model.states[name].nominal / 100


def _filled(file: str, **values: object) -> str:
    """The text of a file from its template in this package."""
    return files(__package__).joinpath(f"{file}.in").read_text("utf-8").format(**values)


def comment_lines(text: str) -> str:
    """Text for the inside of a comment of C."""
    return "\n   ".join(text.replace("*/", "* /").splitlines())


def _positions(names: Sequence[str], units: Iterable[str], prefix: str = "") -> str:
    """Lines of an enumeration, each with its unit where it has one."""
    return "\n".join(
        f"    HFA_{prefix}{name.upper()},{f' /* {unit} */' * bool(unit)}"
        for name, unit in zip(names, units, strict=True)
    )


def _words(kind: str, names: Sequence[str], units: Sequence[str]) -> dict[str, Any]:
    """Tables of names and of units."""
    both = {"name": names, "unit": units}
    return {
        f"const char *const hfa_{kind}_{what}": [f'"{word}"' for word in words]
        for what, words in both.items()
    }


def _tables(declared: dict[str, Any]) -> str:
    """Constant arrays of C, matrices row by row."""
    lines = []
    for name, values in declared.items():
        array = np.array(values)
        sizes = "".join(f"[{size}]" for size in array.shape)
        lines.append(f"{name}{sizes} = {braced(array.tolist())};")
    return "\n".join(lines)


def braced(values: Any) -> str:
    """Numbers, texts or lists of them as C writes them."""
    if not isinstance(values, list):
        return "HUGE_VAL" if values == np.inf else "-HUGE_VAL" if values == -np.inf else str(values)
    return f"{{{', '.join(map(braced, values))}}}"
