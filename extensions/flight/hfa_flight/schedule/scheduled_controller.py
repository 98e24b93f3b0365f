"""Controllers scheduled on a measured variable of a model, and their files.

A .npz file can be read again. A .mat file is for other tools.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.units import in_si
from hfa_flight.actuators import Actuator
from hfa_flight.schedule.gain_schedule import GainSchedule, load_gain_schedule
from hfa_flight.schedule.signal_units import signal_unit
from hfa_support.arguments import checks_arguments
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, prefix_errors, refuse_unknown, shown
from hfa_support.linear_table import LinearTable
from hfa_support.provenance import parameter_hash
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.data_files import jsonable, save_data
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import ByValue
from hfa_support.reporting.text import Table, shown_value
from hfa_support.schema import NUMBER, POSITIVE, checked
from hfa_support.units import conversion

#: Endings of the names of command signals: the filtered command r, its rate, and the unfiltered
#: command.
COMMAND_SIGNALS = ("_command", "_command_rate", "_command_end")
#: Tolerance at the ends of the range of scheduling values, relative to their size.
_AT_THE_END = 1e-9
_SCHEMA = "hfa.controller/1"
#: Suffixes of controller files.
SUFFIXES = (".npz", ".mat")
_ARRAYS = ("breakpoints", "A", "B", "C", "D", "W", "trim_states", "trim_inputs", "command_filter")
_NAMES = ("states", "measurements", "commands", "inputs")
_TEXTS = ("name", "feedback", "dynamics", "parameters")


@checks_arguments
@dataclass(frozen=True, eq=False, repr=False)
class ScheduledController(ByValue, Reported):
    """Scheduled controller x' = A(η) x + B(η) y + W(η) (u_applied - u), u = C(η) x + D(η) y.

    The command is U0 + u, and x(0) = 0. η is the measured scheduling variable of `model`. Every
    matrix is linear in η between `breakpoints` and constant beyond the ends. y = [measured;
    commanded] are deviations from the trim X0, U0 in which the flight begins. u_applied is u,
    saturated at the limits if there are any.

    name: name of the design
    feedback: "state" or "output"
    breakpoints: (N,), values of η, radians for angles, increasing
    A: (N, n, n)
    B: (N, n, p)
    C: (N, m, n)
    D: (N, m, p)
    W: (N, n, m)
    states: names of x, (n,)
    measurements: names of measured states, outputs and parts of outputs, and INPUT_position and
      INPUT_rate for actuators
    commands: OUTPUT_command r, OUTPUT_command_rate r', and OUTPUT_command_end, the unfiltered
      command
    inputs: names of u, (m,); other inputs remain at U0
    trim_states: trims at the breakpoints, (N, number of states of the model)
    trim_inputs: trims at the breakpoints, (N, number of inputs of the model)
    dynamics: name of the model of the design, by default that of `model`
    parameters: hash of the parameter values of the design (`identity`), by default of `model`
    command_filter: bandwidth (rad/s) and damping of the controller's command filter, or ()
    about: "delta" and "actuators" of the design, "angles" with limit and checks at each breakpoint,
        "provenance"
    model: the model whose names are used

    Raises BadInputError if a shape, an order, a number or a name is wrong.
    """

    name: str
    feedback: str
    breakpoints: np.ndarray
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
    dynamics: str = ""
    parameters: str = ""
    command_filter: tuple[float, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict, compare=False)
    model: Model = field(kw_only=True, compare=False)

    def __post_init__(self) -> None:
        """Raise BadInputError if a shape, an order, a number or a name is wrong."""
        for name, of_model in (("dynamics", self.model.name), ("parameters", identity(self.model))):
            object.__setattr__(self, name, getattr(self, name) or of_model)
        where = f"controller {self.name}:"
        self._check_names(where)
        self._check_arrays(where)
        if not self.name.isprintable():
            raise BadInputError(
                f"the name of a controller is {shown(self.name)}; use printable characters"
            )
        for name in self.states:
            if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
                raise BadInputError(
                    f"{where} the name of a state is {shown(name)}; use letters, digits and _, "
                    "as in C"
                )
        if len({name.upper() for name in self.states}) < len(self.states):
            raise BadInputError(
                f"{where} two names of states are equal or differ only in capitals; rename one "
                "state"
            )

    def _check_names(self, where: str) -> None:
        """Raise BadInputError if the model lacks a measurement, a command or an input."""
        model = self.model
        moved = {f"{name}_{what}" for name in model.inputs for what in ("position", "rate")}
        followed = {f"{name}{end}" for name in model.measurable for end in COMMAND_SIGNALS}
        choices = {
            "measurement": (self.measurements, {*model.measurable} | moved),
            "command": (self.commands, followed),
            "input": (self.inputs, {*model.inputs}),
        }
        for what, (names, known) in choices.items():
            for name in names:
                refuse_unknown(f"{where} unknown {what}", name, sorted(known))

    def _check_arrays(self, where: str) -> None:
        """Raise BadInputError if a shape or an order is wrong, or a number is not finite."""
        count = len(self.breakpoints)
        n = len(self.states)
        m = len(self.inputs)
        p = len(self.measurements) + len(self.commands)
        shapes = {
            "breakpoints": (count,),
            "A": (count, n, n),
            "B": (count, n, p),
            "C": (count, m, n),
            "D": (count, m, p),
            "W": (count, n, m),
            "trim_states": (count, len(self.model.states)),
            "trim_inputs": (count, len(self.model.inputs)),
        }
        for name, shape in shapes.items():
            values = getattr(self, name)
            if np.shape(values) != shape:
                raise BadInputError(
                    f"{where} {name} has shape {np.shape(values)}; give shape {shape}"
                )
            if not np.all(np.isfinite(values)):
                raise BadInputError(
                    f"{where} {name} has an entry that is not finite; give finite numbers"
                )
        positive = all(0.0 < number < np.inf for number in self.command_filter)
        if len(self.command_filter) not in (0, 2) or not positive:
            raise BadInputError(
                f"{where} command_filter is invalid; give a positive bandwidth and a positive "
                "damping ratio, or an empty list"
            )
        if count < 1 or np.any(np.diff(self.breakpoints) <= 0.0):
            raise BadInputError(
                f"{where} {self.model.schedule}s is empty or does not increase; give at least "
                "one value, in increasing order"
            )

    def at(self, eta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return A, B, C and D at the scheduling value η."""
        A, B, C, D = (
            LinearTable(self.breakpoints, stack).at(eta)
            for stack in (self.A, self.B, self.C, self.D)
        )
        return A, B, C, D

    def gain_schedule(self) -> GainSchedule | None:
        """Return the gain schedule of a controller u = -K(η) x, or None for any other controller.

        Such a controller measures the states of the linear model and has no memory and no commands.
        """
        if self.states or self.commands or self.measurements != self.model.linear:
            return None
        gains = np.zeros((len(self.breakpoints), len(self.model.inputs), len(self.model.linear)))
        rows = self.model.input_places(self.inputs)
        gains[:, rows] = -self.D
        return GainSchedule(self.breakpoints, gains, self.model)

    def refuse_other(self, model: Model, lowest: float, highest: float) -> None:
        """Raise BadInputError if the controller was made for another model, or does not cover a
        range.

        lowest, highest: range of the scheduling variable
        """
        if model.name != self.dynamics:
            choose = ""
            if self.dynamics in model.about.variants:
                choose = f", or choose --dynamics {self.dynamics}"
            raise BadInputError(
                f"controller {self.name} was designed for {self.called}, but the aircraft is"
                f" {model.title}; design a controller for this aircraft{choose}"
            )
        if identity(model) != self.parameters:
            raise BadInputError(
                f"controller {self.name} was designed for an aircraft with other parameters"
                f" ({self.parameters}); design a controller for this aircraft"
            )
        first = float(self.breakpoints[0])
        last = float(self.breakpoints[-1])
        if min(lowest - first, last - highest) < -_AT_THE_END * max(1.0, abs(first), abs(last)):
            raise BadInputError(
                f"controller {self.name} covers {model.schedule} {self._between(first, last)}, but"
                f" {self._between(lowest, highest)} is requested; design a controller for these"
                " values"
            )

    def _between(self, first: float, last: float) -> str:
        """Return a range of the scheduling variable as text, such as "5 to 20 deg"."""
        schedule = self.model.schedule
        lowest = shown_value(first, self.model.unit(schedule))
        return f"{lowest} to {self.model.describe(schedule, last)}"

    @property
    def called(self) -> str:
        """Name of the model for which the controller was made, for messages."""
        if self.dynamics in self.model.about.variants:
            return f"{self.dynamics} dynamics"
        return self.dynamics

    def report(self) -> Report:
        """Return the report of the design: delta, signals, and the certificate at each scheduling
        value.
        """
        rows = self.about.get("angles", [])
        limit = "delta_min" if any("delta_min" in row for row in rows) else "gamma_min"
        by = self.model.schedule
        cells = []
        for row in rows:
            value = shown_value(row[by], self.model.unit(by))
            verdict = verdict_text(all(check["ok"] for check in row["checks"]))
            cells.append((value, f"{row.get(limit, np.nan):.6g}", verdict))
        table = Table((by, f"{limit} ({self.feedback} feedback)", "certificate"), cells)
        title = (
            f"Controller {self.name}: {self.feedback} feedback, {len(self.states)} states,"
            f" {self._where()}, {self.called}"
        )
        return Report(title, (self._summary(limit), table), data=self._data())

    def _where(self) -> str:
        """Return a text with the number of breakpoints and their range."""
        first = float(self.breakpoints[0])
        last = float(self.breakpoints[-1])
        if len(self.breakpoints) == 1:
            return f"at {self.model.describe(self.model.schedule, first)}"
        kind = "angles" if self.model.schedule_unit == "deg" else "places"
        return f"{len(self.breakpoints)} {kind} from {self._between(first, last)}"

    def _summary(self, limit: str) -> str:
        """Return one line on delta, measurements, inputs, commands and command filter."""
        parts = []
        if limit == "delta_min":
            delta = self.about.get("delta")
            parts.append(f"delta {'inf' if delta is None else format(delta, 'g')}")
        parts.append(f"measured: {', '.join(self.measurements)}")
        parts.append(f"inputs: {', '.join(self.inputs)}")
        if self.commands:
            parts.append(f"commands: {', '.join(self.commands)}")
        if self.command_filter:
            bandwidth, damping = self.command_filter
            parts.append(f"command filter: {bandwidth:g} rad/s, damping {damping:g}")
        return "; ".join(parts)

    def _data(self) -> dict[str, Any]:
        """Return the JSON data of the controller, with the units of its signals."""
        stored = _stored(self)
        signals = (*self.measurements, *self.commands)
        for kind, names in {"signal": signals, "state": self.states, "input": self.inputs}.items():
            stored[f"{kind}_units"] = [signal_unit(self.model, name) for name in names]
        for key in ("name", "trim_states", "trim_inputs"):
            del stored[key]
        return {
            "schema": "hfa.controller-design/1",
            **stored,
            "design": self.name,
            "schedule": self.model.schedule,
            "delta": self.about.get("delta", np.inf),
            "angles": list(self.about.get("angles", [])),
        }


def identity(model: Model) -> str:
    """Return a hash of a model's parameter values, in declared units."""
    native = model.native
    return parameter_hash(native.layout.record("p", native.p.tolist()))


def in_units_of(controller: ScheduledController, model: Model) -> ScheduledController:
    """Return the controller converted to the units of a model, or unchanged if the units agree.

    With the factors f_x on the states, f_y on measurements and commands, and f_u on the inputs:
    A' = f_x A / f_x, B' = f_x B / f_y, C' = f_u C / f_x, D' = f_u D / f_y, W' = f_x W / f_u.
    """
    if (controller.model.source.native is None) == (model.source.native is None):
        return controller
    measured = (*controller.measurements, *controller.commands)
    y = _factors(controller.model, model, measured)
    x = _factors(controller.model, model, controller.states)
    u = _factors(controller.model, model, controller.inputs)
    by = model.schedule
    along = _factors(controller.model, model, (by,))[0]
    rows = [{**row, by: row[by] * along} for row in controller.about.get("angles", ())]
    return replace(
        controller,
        breakpoints=controller.breakpoints * along,
        A=controller.A * x[:, None] / x,
        B=controller.B * x[:, None] / y,
        C=controller.C * u[:, None] / x,
        D=controller.D * u[:, None] / y,
        W=controller.W * x[:, None] / u,
        trim_states=controller.trim_states * _factors(controller.model, model, model.states),
        trim_inputs=controller.trim_inputs * _factors(controller.model, model, model.inputs),
        about={**controller.about, "angles": rows},
        model=model,
    )


def _factors(before: Model, after: Model, names: Iterable[str]) -> np.ndarray:
    """Return the factors that convert named signals between the units of two models."""
    found = [conversion(signal_unit(before, name), signal_unit(after, name)) for name in names]
    return np.array([1.0 if factor is None else factor for factor in found])


def _key(model: Model) -> str:
    """Return the key under which files store the scheduling values of a controller."""
    return f"{model.schedule}s" if model.about.names_schedule else "places"


def _stored(controller: ScheduledController) -> dict[str, Any]:
    """Return the content of a controller file as a dictionary: arrays, names and strings."""
    content: dict[str, Any] = {key: getattr(controller, key) for key in _TEXTS}
    content |= {key: list(getattr(controller, key)) for key in _NAMES}
    for key in _ARRAYS:
        stored_key = _key(controller.model) if key == "breakpoints" else key
        content[stored_key] = np.array(getattr(controller, key), dtype=float)
    return content


@checks_arguments
def save_controller(path: str | Path, controller: ScheduledController) -> None:
    """Write a controller to a .npz or .mat file. If an error occurs, no file is written.

    Matrices at the N breakpoints are (N, rows, columns) in a .npz file and (rows, columns, N) in a
    .mat file. Names are arrays of text in a .npz file and cells in a .mat file. `about` is JSON
    text.

    Raises BadInputError if the suffix is not supported or the folder does not exist.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise BadInputError(
            f"{path}: the suffix {target.suffix!r} is unknown; use {' or '.join(SUFFIXES)}"
        )
    about = json.dumps(jsonable(controller.about))
    content = {"schema": _SCHEMA, "about": about, **_stored(controller)}
    if controller.model.source.native is not None:
        content["units"] = "si"
    save_data(target, content, Table((), ()))


@checks_arguments
def load_controller(path: str | Path, model: Model) -> ScheduledController:
    """Return the controller in a .npz file written by `save_controller`, in the units of a model.

    Raises BadInputError if the file is not a controller file, is damaged, or was made for another
    model.
    """
    if Path(path).suffix.lower() != ".npz":
        raise BadInputError(
            f"{path}: a controller is read from a .npz file; save the controller as .npz"
        )
    content = read_arrays(path)
    if not _is_controller(content):
        raise BadInputError(
            f"{path}: the file is not a controller file ({_SCHEMA}); create a controller file "
            "with `hfa design -o`"
        )
    try:
        with prefix_errors(path):
            made_with = model.native
            if str(content.get("units", "english")) == "si":
                made_with = in_si(made_with)
            return in_units_of(_controller_of(content, made_with), model)
    except BadInputError:
        raise
    except KeyError as error:
        raise BadInputError(
            f"{path}: {error.args[0]} is missing; create the file again with `hfa design -o`"
        ) from error
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise BadInputError(
            f"{path}: the content is damaged ({error}); create the file again with `hfa design -o`"
        ) from error


def load_controller_or_gains(path: Path, model: Model) -> ScheduledController | GainSchedule:
    """Return the controller or the gain schedule in a file.

    A controller u = -K(η) x of the states of the linear model is returned as a gain schedule.
    Raises BadInputError if the file contains neither, is damaged, or was made for another model.
    """
    if path.suffix.lower() == ".npz" and _is_controller(read_arrays(path)):
        controller = load_controller(path, model)
        return controller.gain_schedule() or controller
    return load_gain_schedule(path, model)


def _is_controller(content: Mapping[str, Any]) -> bool:
    """Return whether the content of a file was written by `save_controller`."""
    return str(content.get("schema", "")) == _SCHEMA


def _controller_of(content: Mapping[str, Any], model: Model) -> ScheduledController:
    """Return the controller that the arrays of a file represent."""
    texts: dict[str, Any] = {key: str(content[key]) for key in _TEXTS}
    if texts["dynamics"] not in (model.name, *model.about.variants):
        raise BadInputError(
            f"the controller was made for {texts['dynamics']}, not for {model.title}; design a"
            " controller for this aircraft"
        )
    names: dict[str, Any] = {key: tuple(map(str, content[key].ravel())) for key in _NAMES}
    arrays: dict[str, Any] = {}
    for key in _ARRAYS:
        stored_key = _key(model) if key == "breakpoints" else key
        arrays[key] = np.asarray(content[stored_key], dtype=float)
    arrays["command_filter"] = tuple(arrays["command_filter"].ravel().tolist())
    about = json.loads(str(content["about"]))
    about = {key: value for key, value in about.items() if value is not None}
    row = {
        f"{model.schedule}*": NUMBER,
        "delta_min": NUMBER,
        "gamma_min": NUMBER,
        "checks*": [{"ok*": None, ...: None}],
    }
    actuators = {str: {each.name: NUMBER for each in fields(Actuator)}}
    form = {"delta": POSITIVE, "angles": [row], "actuators": actuators, ...: None}
    about = checked("its content", about, form)
    return ScheduledController(**texts, **names, **arrays, about=about, model=model)
