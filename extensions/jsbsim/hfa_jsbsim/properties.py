"""JSBSim's properties by name. Their values are expressions, computed when first read."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.rigid.tables import Interpolator
from hfa_jsbsim.xml_file import Element, number_of
from hfa_support.errors import BadInputError, shortened

#: Ranks of notes, in the order in which they are printed. FORCE: a force may differ from JSBSim's.
#: MOTION: only the motion may differ. IDLE: nothing differs in flight.
FORCE = 0
MOTION = 1
IDLE = 2
#: Largest number of subjects that a note lists for one file.
_MOST_PER_FILE = 12


class Note(NamedTuple):
    """Note about an element of a file.

    statement: the statement
    subject: part of the file that the statement concerns, "" for the whole file
    where: file and line
    rank: FORCE, MOTION or IDLE, from the most to the least important
    """

    statement: str
    subject: str = ""
    where: str = ""
    rank: int = FORCE


def grouped(notes: Iterable[Note]) -> list[str]:
    """Return one line for each statement, with its subjects, files and lines.

    Notes of rank FORCE come first, then MOTION and IDLE.
    """
    by_statement: dict[tuple[int, str], list[Note]] = {}
    for note in sorted(notes, key=lambda note: note.rank):
        by_statement.setdefault((note.rank, note.statement), []).append(note)
    return [_line(statement, group) for (_, statement), group in by_statement.items()]


def _line(statement: str, notes: list[Note]) -> str:
    """Return a statement followed by its subjects with files and lines."""
    by_file: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        file, _, line = note.where.rpartition(":")
        by_file.setdefault(file, []).append(f"{line} {note.subject}".strip())
    files = []
    for file, subjects in by_file.items():
        texts = [text for text in subjects[:_MOST_PER_FILE] if text]
        if len(subjects) > _MOST_PER_FILE:
            texts.append(f"{len(subjects) - _MOST_PER_FILE} more")
        files.append(f"{file}: {', '.join(texts)}" if file else ", ".join(texts))
    listed = "; ".join(text for text in files if text)
    return f"{statement}: {listed}" if listed else statement


#: State of a steady flight, and times, s, at which its forces are compared.
_USUAL_STATE = {
    "speed": 300.0,
    "alpha": 0.05,
    "pitch": 0.05,
    "altitude": 5000.0,
    "throttle": 0.5,
    "gravity": 32.17,
    **{f"rpm{number}": 1500.0 for number in range(9)},
    **{f"engine{number}": 1.0 for number in range(9)},
    **{f"tank{number}": 100.0 for number in range(99)},
}
_TIMES = (0.37, 5.3, 61.7, 1234.5)


def depends_on_time(rates: ca.SX, time: ca.SX, symbols: Sequence[ca.SX]) -> bool:
    """Return whether time derivatives in a typical steady flight change with the simulation time.

    They are compared at times of different orders of magnitude.

    rates: time derivatives, expressions of `time` and `symbols`
    symbols: all other symbols in `rates`
    """
    function = ca.Function("rates", [time, ca.vertcat(*symbols)], [rates])
    usual = [_USUAL_STATE.get(symbol.name(), 0.0) for symbol in symbols]
    at_start = function(0.0, usual)
    return any(not ca.is_equal(function(later, usual), at_start) for later in _TIMES)


#: Names of the model that states of the control system may not have.
_TAKEN = {
    *("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch", "yaw"),
    *("altitude", "aileron", "elevator", "rudder", "throttle", "flap", "gear", "speedbrake"),
    *("spoiler", "pitch_trim", "roll_trim", "yaw_trim", "mixture", "advance", "gravity", "kcas"),
    *("mach", "gamma", "turn_rate", "load_factor", "lift_to_weight", "thrust", "weight"),
    *("updraft", "angle_of_attack", "feather"),
}
#: Order of evaluation of values that JSBSim sets before the control system, and of elements outside
#: it: before and after all components.
BEFORE_ALL = -1
AFTER_ALL = 1 << 30
#: Properties that depend on the total force. The control system must not depend on them.
_OF_ALL_FORCES = ("accelerations/", "forces/", "moments/")
_NAME = re.compile(r"/?[A-Za-z_][\w.-]*(\[\d+\])?(/[A-Za-z_][\w.-]*(\[\d+\])?)*")
#: Properties of wheels, which are 0 in flight.
_ON_GROUND = re.compile(
    r"gear/unit(\[\d+\])?/"
    "(WOW|wheel-speed-fps|compression-ft|compression-velocity-fps|slip-angle-deg)"
)


class LoopError(BadInputError):
    """Error: a value of the control system depends on its own past and has no steady-state value.

    cause: description of the loop
    where: file and line
    """

    def __init__(self, where: str, cause: str) -> None:
        super().__init__(f"{where}: {cause}")
        self.where = where
        self.cause = cause


@dataclass(eq=False)
class Writer:
    """What sets a property: an element of a file, or JSBSim itself.

    compute: function without arguments that returns the value.
    where: file and line.
    order: position in JSBSim's order of evaluation.
    component: the element, if it is a component of the control system.
    is_of_file: whether an element of a file sets the property, and not JSBSim itself.
    value: the value, or None before it is computed.
    """

    compute: Callable[[], Any]
    where: str
    order: int = AFTER_ALL
    component: Element | None = None
    is_of_file: bool = False
    value: Any = field(default=None)


@dataclass(eq=False)
class FilterState:
    """State of a dynamic component of the control system.

    symbol: the state
    component: element of the component
    writer: writer of the state's time derivative, or None before `set_rate`
    """

    symbol: ca.SX
    component: Element
    writer: Writer | None = None


class Constant(NamedTuple):
    """Property that nothing in the files sets.

    symbol, start: its symbol, and its value in the files, 0 if they give none
    where: file and line that reads or declares it
    """

    symbol: ca.SX
    start: float
    where: str


class LeftOut(NamedTuple):
    """Dynamics of a component of the control system that are omitted.

    what: description of the omitted part
    is_always: whether the part is omitted even if dynamic components have states
    """

    component: Element
    what: str
    is_always: bool


class Properties:
    """All properties of an aircraft.

    constants: property that nothing sets -> its symbol and value.
    frozen: those of them on which a loop depends, which keep their value.
    in_control: those of them that components of the control system read.
    notes: notes for the user.
    interpolate: interpolation of tables.
    reads_loops_as_zero: whether a value that depends on itself reads 0 for itself, instead of
        raising LoopError.
    has_filter_states: whether dynamic components have states.
    travels: (component, target) of each <kinematic> that takes time to move.
    names_read: names of the properties that were read.
    ranges: argument of a table -> lowest and highest breakpoint of its tables.
    filters: states of dynamic components.
    left_out: omitted dynamics of components, by file, line and name.
    writers: writers of each property, in the order in which they were added.
    """

    def __init__(self, has_filter_states: bool) -> None:
        self.has_filter_states = has_filter_states
        self.travels: list[tuple[Element, ca.SX]] = []
        self.filters: list[FilterState] = []
        self.names_read: set[str] = set()
        self.ranges: dict[str, tuple[float, float]] = {}
        self.left_out: dict[str, LeftOut] = {}
        self.constants: dict[str, Constant] = {}
        self.frozen: set[str] = set()
        self.in_control: set[str] = set()
        self.notes: list[Note] = []
        self.interpolate = Interpolator()
        self.writers: dict[str, list[Writer]] = {}
        self._initial: dict[str, Any] = {}
        # Place of the running writer in the order of evaluation: `read` prefers earlier writers.
        self._order = AFTER_ALL
        self._running: list[Writer] = []
        self.reads_loops_as_zero = False

    def define(self, name: str, value: Any) -> None:
        """Add a value of a property that components of the control system may override."""
        self.add_writer(name, Writer(lambda: value, "", BEFORE_ALL))

    def define_initial(self, name: str, value: float) -> None:
        """Set the value that a property has if nothing else sets it."""
        self._initial[canonical(name)] = value

    def define_constant(self, name: str, start: float, where: str) -> None:
        """Give a property a new symbol, which it has if nothing else sets it."""
        key = canonical(name)
        self.constants[key] = Constant(ca.SX.sym(key), start, where)
        self._initial[key] = self.constants[key].symbol

    def at_start(self, value: Any) -> float | None:
        """Return a value with all constants at their values in the files, or None if it varies."""
        constants = self.constants.values()
        symbols = ca.vertcat(*(constant.symbol for constant in constants))
        starts = ca.SX([constant.start for constant in constants])
        number = ca.substitute(ca.SX(value), symbols, starts)
        return float(number) if number.is_constant() else None

    def freeze(self, value: Any) -> None:
        """Keep the constants in a value at their values in the files."""
        self.frozen |= {
            name
            for name, constant in self.constants.items()
            if ca.depends_on(ca.SX(value), constant.symbol)
        }

    def add_writer(self, name: str, writer: Writer) -> None:
        """Add a writer of a property. The value is computed when the property is first read."""
        self.writers.setdefault(canonical(name), []).append(writer)

    def is_known(self, name: str) -> bool:
        """Return whether a property has an initial value or a writer."""
        return bool(self.writers.get(canonical(name))) or canonical(name) in self._initial

    def add_state(self, component: Element) -> ca.SX:
        """Add a state for a dynamic component and return its symbol."""
        taken = [state.symbol.name() for state in self.filters]
        own_name = component.attributes.get("name", "")
        symbol = ca.SX.sym(identifier(own_name, component.name, taken))
        self.filters.append(FilterState(symbol, component))
        return symbol

    def set_rate(self, symbol: ca.SX, compute: Callable[[], Any]) -> None:
        """Set the function that computes the time derivative of a state.

        The function is evaluated at the position of the current component in the order of
        evaluation.
        """
        state = next(state for state in self.filters if state.symbol is symbol)
        state.writer = Writer(compute, state.component.where, self._order, state.component)

    def leave_out(self, component: Element, what: str, is_always: bool = False) -> None:
        """Record for a note what is omitted; the arguments are those of `LeftOut`."""
        key = f"{component.where} {component.attributes.get('name', '')} {is_always}"
        self.left_out.setdefault(key, LeftOut(component, what, is_always))

    def replace(self, name: str, value: Any) -> None:
        """Set a property to a value and remove all its writers."""
        self.writers[canonical(name)] = [Writer(lambda: value, "", BEFORE_ALL)]

    def writer(self, name: str) -> Writer | None:
        """Return the last writer that was added for a property, or None if it has none."""
        writers = self.writers.get(canonical(name))
        return writers[-1] if writers else None

    def read(self, name: str, where: str) -> Any:
        """Return the value of a property.

        A component reads the value set by an earlier component, or else the last value of the
        previous pass. In steady state the two are equal.

        name: name of the property. It may begin with a minus sign
        where: file and line, for messages

        Raises LoopError if the value depends on itself or on all forces, and BadInputError for text
        that is not a name.
        """
        positive = name.removeprefix("-")
        has_sign = positive != name and positive[:1] != "-" and not positive[:1].isspace()
        if has_sign:
            return -self.read(positive, where)
        key = canonical(name)
        if not _NAME.fullmatch(key):
            fault = f"{where}: {shortened(name)!r} is neither a number nor a property name"
            raise BadInputError(f"{fault}; give a number or the name of a property")
        self.names_read.add(key)
        writers = self.writers.get(key)
        if not writers:
            return self._value_without_writer(key, where)
        before = [writer for writer in writers if writer.order < self._order]
        return self.value_of(before[-1] if before else writers[-1], key, where)

    def _value_without_writer(self, key: str, where: str) -> Any:
        """Return the initial value of a property that nothing sets, by default a new constant."""
        if key not in self._initial:
            if key.startswith(_OF_ALL_FORCES):  # such as accelerations/
                if not self.reads_loops_as_zero:
                    raise LoopError(where, f"the property {shortened(key)} depends on all forces")
            elif not _ON_GROUND.fullmatch(key):  # those of wheels are 0 in flight
                self.define_constant(key, 0.0, where)
        # A component reads the constant, itself or through functions.
        if key in self.constants and any(writer.component for writer in self._running):
            self.in_control.add(key)
        return self._initial.get(key, 0.0)

    def value_of(self, writer: Writer, name: str, where: str) -> Any:
        """Return the value that a writer gives to a property, computed only once.

        With `reads_loops_as_zero`, a value that depends on itself reads 0 for itself.

        name: name of the property, for messages
        where: file and line, for messages

        Raises LoopError if the value depends on itself through a component. Raises BadInputError if
        the value depends on itself through functions alone, or if functions are nested too deeply.
        """
        if writer in self._running:
            if self.reads_loops_as_zero:
                return 0.0
            loop = self._running[self._running.index(writer) :]  # from this writer to itself
            place = writer.where or where
            fault = f"{shortened(name)} depends on itself"
            if any(looping.component for looping in loop):
                raise LoopError(place, f"{fault}, with a delay of one frame")
            raise BadInputError(f"{place}: {fault}; break the loop of functions")
        if writer.value is None:
            order_of_reader = self._order
            self._order = writer.order  # by which `read` chooses what this writer reads
            self._running.append(writer)
            try:
                writer.value = writer.compute()
            except RecursionError as error:
                raise BadInputError(
                    f"{writer.where}: functions are nested too deeply; use fewer levels"
                ) from error
            finally:
                self._running.pop()
                self._order = order_of_reader
        return writer.value

    def read_or(self, name: str, default: Any, where: str) -> Any:
        """Return the value of a property, or the default if the files do not set it.

        The default is also returned, with a note, if the value depends on itself or on all forces.
        """
        self.names_read.add(canonical(name))
        if self.writer(name) is None:
            return self._initial.get(canonical(name), default)
        try:
            return self.read(name, where)
        except LoopError as error:
            self.notes.append(
                Note(f"{error.cause}; kept at the initial value", canonical(name), error.where)
            )
            self.replace(name, default)
            return default

    def read_centered(self, name: str, commands: ca.SX) -> Any:
        """Return the value of a property with all pilot commands at 0 and all integrators at 0.

        commands: symbols of the commands
        """
        every = [writer for writers in self.writers.values() for writer in writers]
        values = [writer.value for writer in every]
        self.reads_loops_as_zero = True  # integrals too
        try:
            value = ca.SX(self.read(name, ""))
        finally:  # the values that were computed with it are forgotten
            self.reads_loops_as_zero = False
            for writer, before in zip(every, values, strict=True):
                writer.value = before
        return ca.substitute(value, commands, ca.SX.zeros(commands.numel()))

    def value(self, text: str, element: Element) -> Any:
        """Return the number in a text, or the value of the property that it names.

        element: element that contains the text, for messages

        Raises BadInputError if the text is empty, has several lines or is an infinite number or
        NaN.
        """
        if not text or (len(element.lines) > 1 and element.name != "test"):
            fault = f"<{element.name}> has {len(element.lines)} lines"
            raise element.error(f"{fault}; give a number or a name")
        number = number_of(text)
        if number is None:
            return self.read(text, element.where)
        if not math.isfinite(number):
            raise element.error(f"<{element.name}> is {text}; give a finite number")
        return number


def canonical(name: str) -> str:
    """Return the name of a property without [0], outer spaces and a leading /fdm/jsbsim/.

    Another leading / is kept. Such a name is outside JSBSim's property tree.
    """
    return name.strip().replace("[0]", "").removeprefix("/fdm/jsbsim/")


def identifier(full_name: str, kind: str, taken: Collection[str]) -> str:
    """Return an unused name for a signal of the model: yaw_damper for "fcs/yaw damper".

    full_name: name of a component or property
    kind: noun that precedes a name that the model may not have
    taken: names in use
    """
    last = full_name.rsplit("/", 1)[-1]
    words = re.findall("[a-z0-9]+", last.lower())
    name = "_".join(words) or kind
    if name[0].isdigit() or keyword.iskeyword(name) or name in _TAKEN:
        name = f"{kind}_{name}"
    number = 2
    unique = name
    while unique in taken:
        unique = f"{name}_{number}"
        number += 1
    return unique


def lower_dashes(name: str) -> str:
    """Return a component's name in JSBSim's properties: pitch-trim-sum for "Pitch Trim Sum"."""
    return "-".join(name.lower().split(" "))


def is_constant(value: Any) -> bool:
    """Return whether a value is a number, or an expression without symbols."""
    return not isinstance(value, ca.SX) or value.is_constant()


def is_zero(value: Any) -> bool:
    """Return whether a value is the constant 0."""
    return is_constant(value) and float(value) == 0.0
