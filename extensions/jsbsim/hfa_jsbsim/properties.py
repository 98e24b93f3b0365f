"""JSBSim's properties by name. Their values are expressions, computed when first read."""

from __future__ import annotations

import keyword
import math
import re
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, count
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.rigid.tables import Interpolator
from hfa_jsbsim.catalog import of_component
from hfa_jsbsim.xml_file import Element, number_of
from hfa_support.errors import BadInputError, shortened

#: Ranks of notes, in the order in which they are printed. FORCE: what is left out moves a force, a
#: warning too. SETTING: what the user can set. MOTION: only the motion may differ.
FORCE, SETTING, MOTION = range(3)
#: Largest number of subjects that a note lists for one file.
_MOST_PER_FILE = 12


class Note(NamedTuple):
    """Note about an element of a file.

    statement: the statement
    subject: part of the file that the statement concerns, "" for the whole file
    where: file and line
    rank: FORCE, SETTING or MOTION, from the most to the least important
    """

    statement: str
    subject: str = ""
    where: str = ""
    rank: int = FORCE


def grouped(notes: Iterable[Note]) -> list[str]:
    """Return one line for each statement, with its subjects, files and lines.

    Notes of rank FORCE come first, then SETTING and MOTION.
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
_SLASHES = re.compile("//+")
#: Rounding of the solution of a loop, relative to 1 or its size.
_ROUNDING = 1e-12
#: Depth to which two conditions are compared.
_DEEP = 100
#: Properties of wheels, which are 0 in flight.
_ON_GROUND = re.compile(
    r"gear/unit(\[\d+\])?/"
    "(WOW|wheel-speed-fps|compression-ft|compression-velocity-fps|slip-angle-deg)"
)
#: JSBSim's properties that are 0 until a file or a pilot sets them.
_ZERO_UNTIL_SET = ("fcs/", "gear/tailhook", "gear/wing-fold")


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
    past: the value in the frame before, if the value depends on it, or None.
    present: that value in a steady flight, if it is known, or None.
    name: the property, for messages.
    is_on: function without arguments that returns whether the element is executed; None for always.
    readers: writers whose values depend on this one.
    """

    compute: Callable[[], Any]
    where: str
    order: int = AFTER_ALL
    component: Element | None = None
    is_of_file: bool = False
    value: Any = field(default=None)
    past: Unknown | None = None
    present: ca.SX | None = None
    name: str = ""
    is_on: Callable[[], Any] | None = None
    readers: set[Writer] = field(default_factory=set)


class Unknown(NamedTuple):
    """Value that this package cannot compute. An aircraft is refused if a force depends on it.

    symbol: the value
    error: the refusal: a LoopError for a value of the past
    readers: what first read it, from the last reader to the first
    """

    symbol: ca.SX
    error: BadInputError
    readers: tuple[Writer, ...]


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
    frozen: those of them that keep their value, because others need what is unknown.
    unknowns: values that this package cannot compute.
    in_control: those of them that components of the control system read.
    notes: notes for the user.
    interpolate: interpolation of tables.
    has_filter_states: whether dynamic components have states.
    commands: symbols of the pilot's commands, a column.
    travels: (component, target) of each <kinematic> that takes time to move.
    names_read: names of the properties that were read.
    ranges: argument of a table -> lowest and highest breakpoint of its tables.
    filters: states of dynamic components.
    left_out: omitted dynamics of components, by file, line and name.
    writers: writers of each property, in the order in which they were added.
    """

    def __init__(self, has_filter_states: bool, rights: Callable[[str], str]) -> None:
        """Begin without a property.

        rights: function (name) -> access rights of a property of JSBSim itself, as `catalog.access`
        """
        self.has_filter_states = has_filter_states
        self._rights = rights
        self.commands = ca.SX()
        self.unknowns: list[Unknown] = []
        self._looping: list[Writer] = []  # those that need their value of the past
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

    def is_read_only(self, name: str) -> bool:
        """Return whether JSBSim ignores to what components set a property."""
        return self._rights(canonical(name)) == "R"

    def _is_native(self, full_name: str) -> bool:
        """Return whether JSBSim computes a property that is not 0 until a file or pilot sets it."""
        is_zero_until_set = full_name.startswith(_ZERO_UNTIL_SET) and not of_component(full_name)
        return bool(self._rights(full_name)) and not is_zero_until_set

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

    def at_start(self, value: Any, names: Iterable[str] | None = None) -> ca.SX:
        """Return a value with constants at their values in the files.

        names: the constants; None for all
        """
        inside = symbols_of(value)
        starts = {
            each.symbol: each.start
            for name, each in self.constants.items()
            if key_of(each.symbol) in inside and (names is None or name in names)
        }
        if not starts:
            return ca.SX(value)
        return ca.substitute(ca.SX(value), ca.vertcat(*starts), ca.vertcat(*starts.values()))

    def unknown(self, error: BadInputError) -> ca.SX:
        """Return the symbol of a value that this package cannot compute.

        error: the refusal if a force depends on the value
        """
        self.unknowns.append(Unknown(ca.SX.sym("unknown"), error, (*self._running,)))
        return self.unknowns[-1].symbol

    def path_of(self, unknown: Unknown) -> str:
        """Return the names of the properties by which an unknown was reached, or ""."""
        values = ((writer.name, writer.value) for writer in unknown.readers)
        names = [
            shortened(name)
            for name, value in values
            if name and isinstance(value, ca.SX) and contains(self.in_files(value), unknown.symbol)
        ]
        return ", ".join(dict.fromkeys(reversed(names)))

    def in_files(self, value: Any) -> ca.SX:
        """Return a value for the properties as the files set them, with values of the past replaced
        by those of a steady flight.
        """
        value = self.at_start(value)
        inside = symbols_of(value)
        for symbol, present, _ in self.presents():
            if key_of(symbol) in inside:
                value = self.at_start(ca.substitute(value, symbol, present))
                inside = symbols_of(value)
        return value

    @property
    def _loops(self) -> dict[int, Unknown]:
        """Values of the past and those that depend on all forces, by the keys of their symbols."""
        return {
            key_of(each.symbol): each for each in self.unknowns if isinstance(each.error, LoopError)
        }

    def presents(self) -> Iterator[tuple[ca.SX, ca.SX, Writer]]:
        """Yield each value of the past that is known in a steady flight: symbol, value, writer."""
        for writer in self._looping:
            if writer.past is not None and writer.present is not None:
                yield writer.past.symbol, writer.present, writer

    def _steady(self, value: ca.SX, past: ca.SX, initial: Any) -> ca.SX | None:
        """Return the value of the past of a property in a steady flight, None if it is unknown.

        value: value of the property, a function of its past
        initial: its value before the first frame
        """
        if not contains(self.at_start(value), past):  # not needed: the present one
            return value
        if _is_kept(value, past):
            return ca.SX(initial)
        # A static loop, value = slope past + rest, if the frames approach its solution.
        slope = ca.jacobian(value, past)
        is_alone = len(self._loops.keys() & symbols_of(value)) == 1
        if not (slope.is_constant() and abs(float(slope)) < 1.0 and is_alone):
            return None
        solution = (ca.substitute(value, past, initial) - slope * initial) / (1.0 - slope)
        miss = ca.fabs(ca.substitute(value, past, solution) - solution)  # not 0 past a switch
        is_solved = miss <= _ROUNDING * (1.0 + ca.fabs(solution))
        return ca.if_else(is_solved, solution, math.nan) if not is_zero(is_solved) else None

    def loop_in(self, value: Any) -> LoopError | None:
        """Return the error of a loop on which a value depends, or None."""
        loops = self._loops
        if not loops or loops.keys().isdisjoint(symbols_of(value)):
            return None
        inside = symbols_of(self.in_files(value))
        errors: Iterator[Any] = (loop.error for key, loop in loops.items() if key in inside)
        return next(errors, None)

    def hide(self, value: ca.SX, unknown: Unknown) -> bool:
        """Freeze the constants whose values in the files remove an unknown from a value.

        Returns False if the value depends on the unknown with all of them.
        """
        value = ca.vertcat(*(row for row in ca.vertsplit(value) if contains(row, unknown.symbol)))
        inside = symbols_of(value)
        names = [name for name, each in self.constants.items() if key_of(each.symbol) in inside]
        needed: list[str] = []  # the last of the fewest first names that suffice with those found

        def is_hidden(count: int) -> bool:
            """Return whether the first names, with those found, remove the unknown."""
            return not contains(self.at_start(value, [*needed, *names[:count]]), unknown.symbol)

        if not is_hidden(len(names)):
            return False
        while not is_hidden(0):
            last = bisect_left(range(1, len(names)), True, key=is_hidden)
            needed, names = [*needed, names[last]], names[:last]
        self.frozen |= {*needed}
        return True

    def add_writer(self, name: str, writer: Writer) -> None:
        """Add a writer of a property. The value is computed when the property is first read."""
        self.writers.setdefault(canonical(name), []).append(writer)

    def initial(self, name: str) -> Any:
        """Return the value that a property has before anything sets it."""
        return self._initial.get(canonical(name), 0.0)

    def is_known(self, name: str) -> bool:
        """Return whether a property has an initial value or a writer."""
        return bool(self.writers.get(canonical(name))) or canonical(name) in self._initial

    def add_state(self, component: Element, value: Any = 0.0) -> ca.SX:
        """Return the symbol of the state of a dynamic component, added at the first call.

        value: value on which the rate of the state depends. In a loop, the state is unknown.
        """
        if error := self.loop_in(value):
            return self.unknown(error)
        for state in self.filters:
            if state.component is component:
                return state.symbol
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
        state = next((state for state in self.filters if state.symbol is symbol), None)
        if state is None:  # unknown
            return
        state.writer = Writer(compute, state.component.where, self._order, state.component)

    def leave_out(self, component: Element, what: str, is_always: bool = False) -> None:
        """Record for a note what is omitted; the arguments are those of `LeftOut`."""
        self.left_out.setdefault(_key(component, is_always), LeftOut(component, what, is_always))

    def take_up(self, component: Element) -> None:
        """Record that the dynamics of a component are states."""
        self.left_out.pop(_key(component, is_always=False), None)

    def replace(self, values: Mapping[str, Any]) -> None:
        """Set properties to values and remove their writers. What depends on them is forgotten."""
        for name, value in values.items():
            before = self.writers.pop(canonical(name), [])
            self.define(name, value)
            for writer in before:
                self._forget(writer)

    def _forget(self, writer: Writer) -> None:
        """Forget the value of a writer, and all that depend on it."""
        writer.value = writer.present = None
        if writer.component is not None:  # noted when it is read again
            for is_always in (False, True):
                self.left_out.pop(_key(writer.component, is_always), None)
        readers, writer.readers = writer.readers, set()
        for reader in readers:
            self._forget(reader)

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

        A value of the past, and one that depends on all forces, is unknown.

        Raises BadInputError for text that is not a name.
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
                cause = f"the property {shortened(key)} depends on all forces"
                self._initial[key] = self.unknown(LoopError(where, cause))
            elif _ON_GROUND.fullmatch(key):  # wheels: 0 in flight
                return 0.0
            elif self._is_native(key):
                fault = f"{shortened(key)} is a property that JSBSim computes internally"
                error = BadInputError(
                    f"{where}: {fault}, which is not supported; use another property"
                )
                self._initial[key] = self.unknown(error)
            else:
                self.define_constant(key, 0.0, where)
        # A component reads the constant, itself or through functions.
        if key in self.constants and any(writer.component for writer in self._running):
            self.in_control.add(key)
        return self._initial.get(key, 0.0)

    def value_of(self, writer: Writer, name: str, where: str) -> Any:
        """Return the value that a writer gives to a property, computed only once.

        In itself, a value is unknown, as that of the past.

        name: name of the property, for messages
        where: file and line, for messages

        Raises BadInputError if functions are nested too deeply.
        """
        writer.readers.update(self._running[-1:])
        if writer in self._running:
            if writer.past is not None:
                return writer.past.symbol
            loop = self._running[self._running.index(writer) :]  # from this writer to itself
            place = writer.where or where
            fault = f"{shortened(name)} depends on itself"
            error = BadInputError(f"{place}: {fault}; break the loop of functions")
            if any(looping.component for looping in loop):
                error = LoopError(place, f"{fault}, with a delay of one frame")
            self.unknown(error)
            writer.past, writer.name = self.unknowns[-1], name
            self._looping.append(writer)
            return writer.past.symbol
        if writer.value is None:
            order_of_reader = self._order
            self._order = writer.order  # by which `read` chooses what this writer reads
            self._running.append(writer)
            writer.name = writer.name or name
            try:
                writer.value = writer.compute()
            except RecursionError as error:
                raise BadInputError(
                    f"{writer.where}: functions are nested too deeply; use fewer levels"
                ) from error
            finally:
                self._running.pop()
                self._order = order_of_reader
            if writer.past is not None and isinstance(writer.value, ca.SX):
                initial = self.initial(writer.name)
                writer.present = self._steady(writer.value, writer.past.symbol, initial)
        return writer.value

    def read_or(self, name: str, default: Any, where: str) -> Any:
        """Return the value of a property, or the default if the files do not set it.

        A value in a loop is `centered`.
        """
        self.names_read.add(canonical(name))
        if self.writer(name) is None:
            return self._initial.get(canonical(name), default)
        value = self.read(name, where)
        loop = self.loop_in(value)
        return self.centered(name, loop) if loop else value

    def centered(self, name: str, loop: LoopError) -> ca.SX:
        """Set a property in a loop to its value in the first frame, with all pilot commands and
        integrators at 0, with a note, and return it.
        """
        firsts = {
            key_of(each.past.symbol): self.initial(each.name) for each in self._looping if each.past
        }
        loops = self._loops
        symbols = [self.commands, *(each.symbol for each in loops.values())]
        values = [ca.SX.zeros(self.commands.numel()), *(firsts.get(key, 0.0) for key in loops)]
        if not self.has_filter_states:
            symbols += [integral.symbol for integral in self.filters]
            values += [0.0] * len(self.filters)
        value = ca.substitute(ca.SX(self.read(name, "")), ca.vertcat(*symbols), ca.vertcat(*values))
        statement = "these have their values for centered controls"
        self.notes.append(
            Note(statement, f"{shortened(canonical(name))} ({loop.cause})", loop.where)
        )
        self.replace({name: value})
        return value

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


def _key(component: Element, is_always: bool) -> str:
    """Return the key of `LeftOut` of a component."""
    return f"{component.where} {component.attributes.get('name', '')} {is_always}"


def canonical(name: str) -> str:
    """Return the name of a property without [0], outer spaces and a leading /fdm/jsbsim/.

    Another leading / is kept. Such a name is outside JSBSim's property tree.
    """
    return _SLASHES.sub("/", name.strip().replace("[0]", "").removeprefix("/fdm/jsbsim/"))


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
    numbered = (f"{name}_{number}" for number in count(2))
    return next(each for each in chain([name], numbered) if each not in taken)


def lower_dashes(name: str) -> str:
    """Return a component's name in JSBSim's properties: pitch-trim-sum for "Pitch Trim Sum"."""
    return "-".join(name.lower().split(" "))


def key_of(symbol: ca.SX) -> int:
    """Return what identifies a symbol among those of `symbols_of`."""
    return int(symbol.element_hash())


def symbols_of(value: Any) -> set[int]:
    """Return the keys of the symbols in an expression."""
    return {key_of(symbol) for symbol in ca.symvar(ca.SX(value))}


def contains(value: Any, symbol: ca.SX) -> bool:
    """Return whether an expression contains a symbol."""
    return key_of(symbol) in symbols_of(value)


def _is_kept(value: ca.SX, past: ca.SX) -> bool:
    """Return whether a value is that of the past, or a switch chooses between it and others by
    conditions without it, so that the next frame keeps what the first one chooses.
    """
    if value.is_op(ca.OP_IF_ELSE_ZERO):
        return not contains(value.dep(0), past) and _is_kept(value.dep(1), past)
    if value.is_op(ca.OP_ADD):  # c ? a : b is (c ? a : 0) + (!c ? b : 0)
        parts = value.dep(0), value.dep(1)
        are_branches = all(part.is_op(ca.OP_IF_ELSE_ZERO) for part in parts)
        if not are_branches or not ca.is_equal(
            ca.logic_not(parts[0].dep(0)), parts[1].dep(0), _DEEP
        ):
            return False
        return all(_is_kept(part, past) for part in parts if contains(part, past))
    return bool(ca.is_equal(value, past))


def is_constant(value: Any) -> bool:
    """Return whether a value is a number, or an expression without symbols."""
    return not isinstance(value, ca.SX) or value.is_constant()


def is_zero(value: Any) -> bool:
    """Return whether a value is the constant 0."""
    return is_constant(value) and float(value) == 0.0
