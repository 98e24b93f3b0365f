"""A controller scheduled on the measured scheduling variable of a model, the dihedral of the HFA:
the value that a design makes, a file keeps, a flight flies.

Files are .npz, which is read again, and .mat for other tools.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from controller.game.array_file import read_arrays
from controller.servo.design import signal_unit
from hfa_aircraft.model import Model
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError, said_of, shown
from hfa_support.jsonable import jsonable
from hfa_support.linear_table import LinearTable
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.data_files import save_data
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, shown_value
from hfa_support.schema import NUMBER, POSITIVE, checked

#: What a controller may be told of a command r: its value, its rate, and the value that the filter
#: goes to.
COMMAND_SIGNALS = ("_command", "_command_rate", "_command_end")
#: Values closer than this to the ends of the range, in units of the range and of its values, are
#: inside.
_AT_THE_END = 1e-9
SCHEMA, DESIGN_SCHEMA = "hfa.controller/1", "hfa.controller-design/1"
#: Formats that a controller is written in.
SUFFIXES = (".npz", ".mat")
_ARRAYS = ("places", "A", "B", "C", "D", "W", "trim_states", "trim_inputs", "command_filter")
_NAMES = ("states", "measurements", "commands", "inputs")
_TEXTS = ("name", "feedback", "dynamics", "parameters")


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledController(ByValue, Reported):
    """x' = A(η) x + B(η) y + W(η) (u_applied - u),   u = C(η) x + D(η) y,   U_command = U0 + u,
    x(0) = 0.

    η is the measured scheduling variable of `model`; every matrix is linear in it between `places`
    and constant beyond the ends. y = [measured; told]: `measurements` are states, outputs or parts
    of them and, as INPUT_position and INPUT_rate, those of the actuators, as deviations from their
    values at the trim X0, U0 in which the flight begins; `commands` are OUTPUT_command r (deviation
    from the same trim), OUTPUT_command_rate r', and OUTPUT_command_end, the value that the command
    filter is on its way to. The controller itself integrates measured minus commanded value. u:
    `inputs`, the others stay at U0. u_applied: u after the limits, equal to u where there are none.

    places: (N,), values of η, angles in rad, increasing. A: (N, n, n). B: (N, n, p). C: (N, m, n).
    D: (N, m, p). W: (N, n, m). states: names of x. trim_states, trim_inputs: (N, all of the
    model's), trims at the places. feedback: "state" or "output". dynamics, parameters: the model's
    name and the `parameter_hash` of its values. command_filter: bandwidth (rad/s) and damping of
    the filter that the controller knows, or (). about: the table of its design, provenance. model:
    whose names these are. BadInputError when a shape, an order or a name is wrong."""

    name: str
    feedback: str
    places: np.ndarray
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
    model: Model = field(kw_only=True, compare=False)

    def __post_init__(self) -> None:
        """Check once what every flight relies on."""
        count, n, where, model = (
            len(self.places),
            len(self.states),
            f"controller {self.name}:",
            self.model,
        )
        p, m = len(self.measurements) + len(self.commands), len(self.inputs)
        told = tuple(f"{name}{signal}" for name in model.measurable for signal in COMMAND_SIGNALS)
        moving = tuple(f"{name}_{what}" for name in model.inputs for what in ("position", "rate"))
        for what, names, known in (
            ("measurement", self.measurements, (*model.measurable, *moving)),
            ("command", self.commands, told),
            ("input", self.inputs, model.inputs),
        ):
            for name in names:
                if name not in known:
                    raise BadInputError(f"{where} unknown {what} {shown(name)}")
        shapes = {
            "places": (count,),
            "A": (count, n, n),
            "B": (count, n, p),
            "C": (count, m, n),
            "D": (count, m, p),
        }
        shapes |= {"W": (count, n, m), "trim_states": (count, len(model.states))}
        for name, shape in (shapes | {"trim_inputs": (count, len(model.inputs))}).items():
            values = getattr(self, name)
            if np.shape(values) != shape:
                raise BadInputError(f"{where} {name} is {np.shape(values)}; it must be {shape}")
            if not np.all(np.isfinite(values)):
                raise BadInputError(f"{where} {name} has a number that is not finite")
        if len(self.command_filter) not in (0, 2) or not all(
            0.0 < each < np.inf for each in self.command_filter
        ):
            raise BadInputError(
                f"{where} command_filter must be a bandwidth and a damping, both positive, or empty"
            )
        if count < 1 or np.any(np.diff(self.places) <= 0.0):
            raise BadInputError(f"{where} {model.schedule}s must increase, from at least one on")
        if not self.name.isprintable():
            raise BadInputError(
                f"the name of a controller is {shown(self.name)}; give letters on one line"
            )
        for name in self.states:
            if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
                raise BadInputError(
                    f"{where} a state is called {shown(name)}; give letters, digits and _ as in C"
                )
        if len({name.upper() for name in self.states}) < n:
            raise BadInputError(f"{where} two states have one name; give each its own")

    def at(self, place: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D at η."""
        A, B, C, D = (
            LinearTable(self.places, stack).at(place) for stack in (self.A, self.B, self.C, self.D)
        )
        return A, B, C, D

    def refuse_other(self, aircraft: Model, lowest: float, highest: float) -> None:
        """BadInputError when it was made for another aircraft, or lowest to highest leaves its
        places."""
        own, first, last = aircraft, float(self.places[0]), float(self.places[-1])
        if own.name != self.dynamics:
            choose = (
                f", or choose --dynamics {self.dynamics}" if self.dynamics in own.variants else ""
            )
            raise BadInputError(
                f"controller {self.name} was designed for {self.called}, the aircraft has {own.title}; "
                f"design it for them{choose}"
            )
        if identity(own) != self.parameters:
            raise BadInputError(
                f"controller {self.name} was designed for an aircraft with other parameters ({self.parameters}); "
                "design it for this one"
            )
        if min(lowest - first, last - highest) < -_AT_THE_END * max(1.0, abs(first), abs(last)):
            raise BadInputError(
                f"controller {self.name} covers {own.schedule} {self._between(first, last)}; "
                f"{self._between(lowest, highest)} is asked for: design it for these values"
            )

    def _between(self, first: float, last: float) -> str:
        """5 to 20 deg."""
        schedule = self.model.schedule
        return f"{shown_value(first, self.model.unit(schedule))} to {self.model.describe(schedule, last)}"

    @property
    def called(self) -> str:
        """The model that it was made for."""
        return (
            f"{self.dynamics} dynamics" if self.dynamics in self.model.variants else self.dynamics
        )

    def report(self) -> Report:
        """The table of `about`: delta, delta_min or gamma_min of each angle, certificate."""
        points, model, count = self.about.get("angles", []), self.model, len(self.places)
        limit = "delta_min" if any("delta_min" in row for row in points) else "gamma_min"
        by, unit, (first, last) = (
            model.schedule,
            model.unit(model.schedule),
            self.places[[0, -1]].tolist(),
        )
        rows = [
            (
                shown_value(row[by], unit),
                f"{row.get(limit, np.nan):.6g}",
                verdict_text(all(each["ok"] for each in row["checks"])),
            )
            for row in points
        ]
        delta = self.about.get("delta")
        said = (
            []
            if limit == "gamma_min"
            else [f"delta {'inf' if delta is None else format(delta, 'g')}"]
        )
        said += [f"measured: {', '.join(self.measurements)}", f"moved: {', '.join(self.inputs)}"]
        said += [f"told: {', '.join(self.commands)}"] if self.commands else []
        if self.command_filter:
            said.append(
                "of a command filter of {:g} rad/s, damping {:g}".format(*self.command_filter)
            )
        what = "angles" if model.schedule_unit == "deg" else "places"
        where = (
            f"{count} {what} from {self._between(first, last)}"
            if count > 1
            else f"at {model.describe(by, first)}"
        )
        shown_as = {
            "signal": (*self.measurements, *self.commands),
            "state": self.states,
            "input": self.inputs,
        }
        stored = {
            key: each
            for key, each in _stored(self).items()
            if key not in ("name", "trim_states", "trim_inputs")
        }
        return Report(
            f"Controller {self.name}: {self.feedback} feedback, {len(self.states)} states, {where}, {self.called}",
            ("; ".join(said), Table((by, limit, "certificate"), rows)),
            data={
                **jsonable(stored),
                **{
                    f"{kind}_units": [signal_unit(model, name) for name in names]
                    for kind, names in shown_as.items()
                },
                **{
                    "schema": DESIGN_SCHEMA,
                    "design": self.name,
                    "schedule": by,
                    "delta": delta,
                    "angles": list(points),
                },
            },
        )


def identity(model: Model) -> str:
    """The hash of a model's parameters."""
    return parameter_hash(model.layout.record("p", model.p.tolist()))


def _key(model: Model) -> str:
    """What files and data call the values of the scheduling variable."""
    return "dihedrals" if model.schedule == "dihedral" else "places"


def _stored(controller: ScheduledController) -> dict[str, Any]:
    """The arrays, names and texts of a controller by the keys that files and data have."""
    keys = {"places": _key(controller.model)}
    content: dict[str, Any] = {key: getattr(controller, key) for key in _TEXTS}
    content |= {key: list(getattr(controller, key)) for key in _NAMES}
    return content | {
        keys.get(key, key): np.array(getattr(controller, key), dtype=float) for key in _ARRAYS
    }


def save_controller(path: str | Path, controller: ScheduledController) -> None:
    """Write .npz, stacks (N, rows, columns) as in Python, or .mat, stacks (rows, columns, N); whole
    or not at all.

    Names are arrays of text (.mat: cells); `about` is JSON text. BadInputError for another suffix
    or folder."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise BadInputError(
            f"{path}: a controller is written as {' or '.join(SUFFIXES)}; choose one of them"
        )
    about = json.dumps(jsonable(controller.about))
    save_data(target, {"schema": SCHEMA, "about": about, **_stored(controller)}, Table((), ()))


def load_controller(path: str | Path, model: Model) -> ScheduledController:
    """The controller in a .npz file of `save_controller`, in the names of a model. BadInputError
    names the file and its fault."""
    if Path(path).suffix.lower() != ".npz":
        raise BadInputError(f"{path}: a controller is read from a .npz file; save it as one")
    content = read_arrays(path)
    if str(content.get("schema", "")) != SCHEMA:
        raise BadInputError(
            f"{path}: this is no controller file ({SCHEMA}); make one with hfa design -o"
        )
    row = {
        f"{model.schedule}*": NUMBER,
        "delta_min": NUMBER,
        "gamma_min": NUMBER,
        "checks*": [{"ok*": None, ...: None}],
    }
    try:
        with said_of(path):
            found: dict[str, Any] = {key: str(content[key]) for key in _TEXTS}
            found |= {key: tuple(map(str, content[key].ravel())) for key in _NAMES}
            if found["dynamics"] not in (model.name, *model.variants):
                raise BadInputError(
                    f"the controller was made for {found['dynamics']}, not for {model.title}"
                )
            content["places"] = content[_key(model)]
            found |= {key: np.asarray(content[key], dtype=float) for key in _ARRAYS} | {
                "model": model
            }
            found["command_filter"] = tuple(found["command_filter"].ravel().tolist())
            about = {
                key: value
                for key, value in json.loads(str(content["about"])).items()
                if value is not None
            }
            about = checked("its content", about, {"delta": POSITIVE, "angles": [row], ...: None})
            return ScheduledController(**found, about=about)
    except BadInputError:
        raise
    except KeyError as error:
        raise BadInputError(
            f"{path}: {error.args[0]} is missing; make the file anew with hfa design -o"
        ) from error
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise BadInputError(
            f"{path}: its content is damaged ({error}); make the file anew"
        ) from error
