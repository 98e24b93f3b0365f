"""A scheduled controller as a pair of C files: what a flight computer runs between its sensors and its servos.

What a simulation works out, commands, measured outputs, updraft and held inputs, an exported controller is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.design.design import signal_unit
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from controller.export.c_model import c_positions, c_table, comment_lines
from controller.policy.commands import COMMAND_FILTER, CommandSteps
from controller.policy.policies import Memoryless, Seen, Unvaried
from controller.policy.servo_policy import ServoPolicy, servo_law
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.native.c_code import c_function
from trim.point.operating_point import OperatingPoint

HEADER, SOURCE = "hfa_controller.h", "hfa_controller.c"
#: C has no empty arrays: the one number of a memory or of commands that a controller does not have.
_UNUSED = "unused"


class GivenCommands(NamedTuple):
    """r, r' and the value that r is on its way to, (k,) each, as arguments; the `commands` of a `ServoPolicy`."""

    names: tuple[str, ...]
    value: ca.SX
    slope: ca.SX
    goal: ca.SX

    def at(self, t: Any) -> ca.SX:
        """The value r, (k,)."""
        return self.value

    def rate(self, t: Any) -> ca.SX:
        """Its rate, (k,)."""
        return self.slope

    def end(self, t: Any) -> ca.SX:
        """What r is on its way to."""
        return self.goal


class GivenOutputs(NamedTuple):
    """y - Y0, (k,), as an argument; the `outputs` of a `ServoPolicy`."""

    values: ca.SX

    def at(self, seen: Seen) -> ca.SX:
        """y - Y0."""
        return self.values


class GivenInputs(Memoryless, Unvaried):
    """u, (5,), as an argument; the policy of a loop whose inputs are held from outside."""

    def __init__(self, values: ca.SX) -> None:
        self._values = values

    def control(self, *_: object) -> ca.SX:
        """The argument u."""
        return self._values


class GivenUpdraft(Memoryless, Unvaried):
    """w, ft/s, as an argument; the gust of a loop."""

    def __init__(self, value: ca.SX) -> None:
        self._value = value

    def updraft(self, t: Any, memory: Any, p: Any) -> ca.SX:
        """The argument w."""
        return self._value


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
    sizes = {"measured": len(made.measurements), "memory": len(made.states) + 2 * len(names)}
    dihedral, command = ca.SX.sym("dihedral"), ca.SX.sym("command", len(names))
    lowest, highest = (ca.SX.sym(name, len(INPUTS)) for name in ("lowest", "highest"))
    measured, memory = (ca.SX.sym(name, size) for name, size in sizes.items())
    own, r, slope = ca.vertsplit(memory, [0, *np.cumsum([len(made.states), len(names), len(names)]).tolist()])
    told = replace(policy, commands=GivenCommands(names, r, slope, command), outputs=GivenOutputs(measured))
    states = ca.SX(len(LINEAR_STATES), 1)
    states[LINEAR_STATES.index("dihedral")] = dihedral - policy.dihedral
    nothing = ca.SX(0, 1)
    seen, t = Seen(states, states, nothing, nothing), ca.SX.sym("t")
    u = ca.fmin(ca.fmax(told.control(t, seen, own, nothing), lowest), highest)
    rate = ca.vertcat(told.memory_rate(t, seen, own, nothing, u), filter_rates(made, r, slope, command))
    arguments = [dihedral, measured, memory, command, lowest, highest]
    return ca.Function("controller", arguments, [ca.densify(u), ca.densify(rate)], {"cse": True})


def trimmed_policy(controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint) -> ServoPolicy:
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
    controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint, origin: str
) -> dict[str, str]:
    """File -> its text: header and source. origin: where it comes from, lines of text.

    BadInputError as in `trimmed_policy`.
    """
    made, names = controller, commandable(controller)
    policy, longest = trimmed_policy(controller, aircraft, point), longest_step(controller)
    arguments = ("dihedral", "measured", "memory", "command", "lowest", "highest")
    memory = [*made.states, *(f"{name}{signal}" for signal in COMMAND_SIGNALS[:2] for name in names)] or [_UNUSED]
    names_and_units: dict[str, tuple[Sequence[str], Sequence[str]]] = {
        "measured": (made.measurements, [signal_unit(name) for name in made.measurements]),
        "command": (names, [signal_unit(name) for name in names]) if names else ([_UNUSED], [""]),
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
            lowest=float(np.degrees(made.dihedrals[0])),
            highest=float(np.degrees(made.dihedrals[-1])),
            memory=c_positions(memory, [""] * len(memory), "MEMORY_"),
            measured=c_positions(*names_and_units["measured"], "MEASURED_"),
            command=c_positions(*names_and_units["command"], "COMMAND_"),
            inputs=len(INPUTS),
            longest=longest,
        ),
        SOURCE: filled(
            "hfa_controller.c.in",
            origin=comment_lines(origin),
            tables="\n".join(tables),
            function=c_function(controller_function(policy), "controller", arguments, ("u", "rate")),
            longest=repr(longest),
        ),
    }


def filled(template: str, **values: object) -> str:
    """The text of a template of this package."""
    return files(__package__).joinpath(template).read_text("utf-8").format(**values)
