"""A controller scheduled on the measured dihedral: the value that a design makes, a file keeps, a flight flies.

Files are .npz, which is read again, and .mat for other tools.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from controller.design.design import SHORT_PERIOD, signal_unit
from controller.game.array_file import read_arrays
from hfa_model.aircraft import Aircraft
from hfa_model.outputs import OUTPUTS
from hfa_model.provenance import parameter_hash
from hfa_model.vectors import INPUTS, STATES
from hfa_support.errors import BadInputError, shown
from hfa_support.jsonable import jsonable
from hfa_support.linear_table import LinearTable
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.data_files import save_data
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from hfa_support.schema import checked

#: What a controller may be told of a command r: its value, its rate, and the value that the filter goes to.
COMMAND_SIGNALS = ("_command", "_command_rate", "_command_end")
#: rad; angles of a file closer than this to the ends of its range are inside.
_AT_THE_END = 1e-9
SCHEMA, DESIGN_SCHEMA = "hfa.controller/1", "hfa.controller-design/1"
#: Formats that a controller is written in.
SUFFIXES = (".npz", ".mat")
_ARRAYS = ("dihedrals", "A", "B", "C", "D", "W", "trim_states", "trim_inputs", "command_filter")
_NAMES = ("states", "measurements", "commands", "inputs")
_TEXTS = ("name", "feedback", "dynamics", "parameters")


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledController(ByValue, Reported):
    """x' = A(η) x + B(η) y + W(η) (u_applied - u),   u = C(η) x + D(η) y,   U_command = U0 + u,   x(0) = 0.

    η is the measured dihedral, rad; every matrix is linear in it between `dihedrals` and constant beyond the ends.
    y = [measured; told]: `measurements` are states or outputs of the aircraft and, as INPUT_position and INPUT_rate,
    of its actuators, as deviations from their values at the trim X0, U0 in which the flight begins; `commands` are
    OUTPUT_command r (deviation from the same trim), OUTPUT_command_rate r', and OUTPUT_command_end, the value that
    the command filter is on its way to. The controller itself integrates measured minus commanded value. u: `inputs`,
    the others stay at U0. u_applied: u after the limits, equal to u where there are none.

    dihedrals: (N,), rad, increasing. A: (N, n, n). B: (N, n, p). C: (N, m, n). D: (N, m, p). W: (N, n, m).
    states: names of x. trim_states (N, 7), trim_inputs (N, 5): level trims at the angles. feedback: "state" or
    "output". dynamics, parameters: the variant and the `parameter_hash` of the aircraft. command_filter: bandwidth
    (rad/s) and damping of the filter that the controller knows, or (). about: the table of its design, provenance.
    BadInputError when a shape, an order or a name is wrong.
    """

    name: str
    feedback: str
    dihedrals: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    states: tuple[str, ...]
    measurements: tuple[str, ...]
    commands: tuple[str, ...]
    inputs: tuple[str, ...]
    trim_states: np.ndarray
    trim_inputs: np.ndarray
    dynamics: str
    parameters: str
    command_filter: tuple[float, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        """Check once what every flight relies on."""
        count, n = len(self.dihedrals), len(self.states)
        p, m = len(self.measurements) + len(self.commands), len(self.inputs)
        shapes = {"dihedrals": (count,), "A": (count, n, n), "B": (count, n, p), "C": (count, m, n)}
        shapes |= {"D": (count, m, p), "W": (count, n, m)}
        shapes |= {"trim_states": (count, len(STATES)), "trim_inputs": (count, len(INPUTS))}
        for name, shape in shapes.items():
            values = getattr(self, name)
            if np.shape(values) != shape:
                raise BadInputError(f"controller {self.name}: {name} is {np.shape(values)}; it must be {shape}")
            if not np.all(np.isfinite(values)):
                raise BadInputError(f"controller {self.name}: {name} has a number that is not finite")
        if len(self.command_filter) not in (0, 2) or not all(0.0 < each < np.inf for each in self.command_filter):
            raise BadInputError(
                f"controller {self.name}: command_filter must be a bandwidth and a damping, both positive, or empty"
            )
        if count < 1 or np.any(np.diff(self.dihedrals) <= 0.0):
            raise BadInputError(f"controller {self.name}: dihedrals must increase, from at least one on")
        outputs = (*STATES, *OUTPUTS, *(f"{name}{SHORT_PERIOD}" for name in OUTPUTS))
        moving = tuple(f"{name}_{what}" for name in INPUTS for what in ("position", "rate"))
        told = tuple(f"{name}{signal}" for name in outputs for signal in COMMAND_SIGNALS)
        for what, names, known in (
            ("measurement", self.measurements, (*outputs, *moving)),
            ("command", self.commands, told),
            ("input", self.inputs, INPUTS),
        ):
            for name in names:
                if name not in known:
                    raise BadInputError(f"controller {self.name}: unknown {what} {shown(name)}")
        if not self.name.isprintable():
            raise BadInputError(f"the name of a controller is {shown(self.name)}; give letters on one line")
        for name in self.states:
            if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
                raise BadInputError(
                    f"controller {self.name}: a state is called {shown(name)}; give letters, digits and _ as in C"
                )
        if len({name.upper() for name in self.states}) < n:
            raise BadInputError(f"controller {self.name}: two states have one name; give each its own")

    def at(self, dihedral: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D at η, rad."""
        A, B, C, D = (LinearTable(self.dihedrals, stack).at(dihedral) for stack in (self.A, self.B, self.C, self.D))
        return A, B, C, D

    def refuse_other(self, aircraft: Aircraft, lowest: float, highest: float) -> None:
        """BadInputError when it was made for another aircraft, or lowest to highest (rad) leaves its angles."""
        if aircraft.variant.name != self.dynamics:
            raise BadInputError(
                f"controller {self.name} was designed for {self.dynamics} dynamics, the aircraft has "
                f"{aircraft.variant.name}; design it for them, or choose --dynamics {self.dynamics}"
            )
        if parameter_hash(aircraft.parameters) != self.parameters:
            raise BadInputError(
                f"controller {self.name} was designed for an aircraft with other parameters ({self.parameters}); "
                "design it for this one"
            )
        first, last = float(self.dihedrals[0]), float(self.dihedrals[-1])
        if lowest < first - _AT_THE_END or highest > last + _AT_THE_END:
            raise BadInputError(
                f"controller {self.name} covers dihedral {math.degrees(first):g} to {math.degrees(last):g} deg; "
                f"{math.degrees(lowest):g} to {math.degrees(highest):g} deg is asked for: design it for these angles"
            )

    def report(self) -> Report:
        """The table of `about`: delta, delta_min or gamma_min of each angle, certificate."""
        try:
            return self._report(self.about.get("angles", ()), self.about.get("delta"))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise BadInputError(
                f"controller {self.name}: the table of its design is damaged ({shown(error)}); make it anew"
            ) from error

    def _report(self, angles: Sequence[dict[str, Any]], delta: float | None) -> Report:
        limit = "delta_min" if any("delta_min" in row for row in angles) else "gamma_min"
        rows = [
            (
                f"{in_degrees(row['dihedral']):g}",
                f"{row[limit]:.6g}",
                verdict_text(all(check["ok"] for check in row["checks"])),
            )
            for row in angles
        ]
        header = ("dihedral", limit, "certificate")
        told = [f"told: {', '.join(self.commands)}"] if self.commands else []
        if self.command_filter:
            told.append("of a command filter of {:g} rad/s, damping {:g}".format(*self.command_filter))
        first, last = (in_degrees(float(self.dihedrals[end])) for end in (0, -1))
        count = len(self.dihedrals)
        game = "" if limit == "gamma_min" else f"delta {'inf' if delta is None else format(delta, 'g')}; "
        where = f"{count} angles from {first:g} to {last:g} deg" if count > 1 else f"at {first:g} deg"
        return Report(
            f"Controller {self.name}: {self.feedback} feedback, {len(self.states)} states, "
            f"{where}, {self.dynamics} dynamics",
            (
                f"{game}measured: {', '.join(self.measurements)}; "
                f"moved: {', '.join(self.inputs)}" + "".join(f"; {each}" for each in told),
                Table(header, rows),
            ),
            data={
                "schema": DESIGN_SCHEMA,
                "design": self.name,
                "feedback": self.feedback,
                **{name: list(getattr(self, name)) for name in ("states", "measurements", "commands", "inputs")},
                "state_units": [signal_unit(name) for name in self.states],
                "signal_units": [signal_unit(name) for name in (*self.measurements, *self.commands)],
                "input_units": [signal_unit(name) for name in self.inputs],
                "dihedrals": self.dihedrals.tolist(),
                **{name: getattr(self, name).tolist() for name in "ABCDW"},
                "command_filter": list(self.command_filter),
                "dynamics": self.dynamics,
                "parameters": self.parameters,
                "delta": delta,
                "angles": list(angles),
            },
        )


def save_controller(path: str | Path, controller: ScheduledController) -> None:
    """Write .npz, stacks (N, rows, columns) as in Python, or .mat, stacks (rows, columns, N); whole or not at all.

    Names are arrays of text (.mat: cells); `about` is JSON text. BadInputError for another suffix or folder.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise BadInputError(f"{path}: a controller is written as {' or '.join(SUFFIXES)}; choose one of them")
    content: dict[str, Any] = {"schema": SCHEMA, "about": json.dumps(jsonable(controller.about))}
    content |= {key: getattr(controller, key) for key in _TEXTS}
    content |= {key: np.array(getattr(controller, key), dtype=float) for key in _ARRAYS}
    names = {key: list(getattr(controller, key)) for key in _NAMES}
    if target.suffix.lower() == ".mat":
        content |= names
    else:
        content |= {key: np.array(value, dtype=np.str_) for key, value in names.items()}
    save_data(target, content, Table((), ()))


def load_controller(path: str | Path) -> ScheduledController:
    """The controller in a .npz file of `save_controller`. BadInputError names the file and its fault."""
    if Path(path).suffix.lower() != ".npz":
        raise BadInputError(f"{path}: a controller is read from a .npz file; save it as one")
    content = read_arrays(path)
    if str(content.get("schema", "")) != SCHEMA:
        raise BadInputError(f"{path}: this is no controller file ({SCHEMA}); make one with hfa design -o")
    try:
        found: dict[str, Any] = {key: str(content[key]) for key in _TEXTS}
        found |= {key: tuple(map(str, content[key].ravel())) for key in _NAMES}
        found |= {key: np.asarray(content[key], dtype=float) for key in _ARRAYS}
        found["command_filter"] = tuple(found["command_filter"].ravel().tolist())
        return ScheduledController(
            **found, about=checked("its content", json.loads(str(content["about"])), {...: None}, "about")
        )
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except KeyError as error:
        raise BadInputError(f"{path}: {error.args[0]} is missing; make the file anew with hfa design -o") from error
    except (ValueError, TypeError, RecursionError) as error:
        raise BadInputError(f"{path}: its content is damaged ({error}); make the file anew") from error
