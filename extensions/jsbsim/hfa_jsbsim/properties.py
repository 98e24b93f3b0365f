"""Values of JSBSim's properties by name, as expressions: each is worked out when it is first
read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from hfa_aircraft.tables import Interpolator
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import BadInputError, shortened

#: The order of what reads and writes outside the control system: after all of it.
AFTER_ALL = 1 << 30
#: Properties that follow from the sum of forces, on which the control system may not depend.
_OF_ALL_FORCES = ("accelerations/", "forces/", "moments/")


class LoopError(BadInputError):
    """A value of the control system that depends on its own past: it has no static value."""


@dataclass(eq=False)
class Writer:
    """One of those that set a property.

    compute: gives the value.
    where: file and line.
    order: its number in the control system, whose components run one after the other.
    component: its element, if it is a component.
    """

    compute: Callable[[], Any]
    where: str
    order: int = AFTER_ALL
    component: Element | None = None
    value: Any = field(default=None)


class Properties:
    """All properties of an aircraft.

    unset: what is read although nothing sets it, name -> where it is first read; it is 0, as in
    JSBSim.
    notes: what a user should know of these values.
    interpolate: gives values of tables.
    centered: whether integrators that the pilot reaches are 0, in place of a LoopError.
    """

    def __init__(self) -> None:
        self.unset: dict[str, str] = {}
        self.notes: list[str] = []
        self.interpolate = Interpolator()
        self._writers: dict[str, list[Writer]] = {}
        self._initial: dict[str, Any] = {}
        self._order = AFTER_ALL
        self._running: list[Writer] = []
        self.centered = False

    def define(self, name: str, value: Any) -> None:
        """Set a property that components of the control system may set again."""
        self._writers.setdefault(plain(name), []).append(Writer(lambda: value, "", order=-1))

    def define_initial(self, name: str, value: float) -> None:
        """The value of a property that nothing else sets."""
        self._initial[plain(name)] = value

    def compute(self, name: str, writer: Writer) -> None:
        """Let a property be worked out when it is read."""
        self._writers.setdefault(plain(name), []).append(writer)

    def replace(self, name: str, value: Any) -> None:
        """Set a property, whatever else sets it."""
        self._writers[plain(name)] = [Writer(lambda: value, "", order=-1)]

    def writer(self, name: str) -> Writer | None:
        """Who sets a property last."""
        writers = self._writers.get(plain(name))
        return writers[-1] if writers else None

    def names(self) -> tuple[str, ...]:
        """All properties that something sets."""
        return tuple(self._writers)

    def read(self, name: str, where: str) -> Any:
        """The value of a property, which a sign may precede.

        A component reads what components before it have set in this pass, else what is set last, in
        the pass before: in a steady state the two agree. LoopError where the value depends on
        itself.
        """
        if name.startswith("-"):
            return -self.read(name[1:], where)
        key = plain(name)
        writers = self._writers.get(key)
        if not writers:
            if key not in self._initial:
                if key.startswith(_OF_ALL_FORCES) and "-gear-" not in key and not self.centered:
                    raise LoopError(f"{where}: {shortened(key)} follows from all forces")
                self.unset.setdefault(key, where)
            return self._initial.get(key, 0.0)
        before = [writer for writer in writers if writer.order < self._order]
        return self.value_of(before[-1] if before else writers[-1], key, where)

    def value_of(self, writer: Writer, name: str, where: str) -> Any:
        """What a writer sets, worked out once."""
        if writer in self._running:
            if self.centered:
                return 0.0
            loop = self._running[self._running.index(writer) :]
            fault = f"{writer.where or where}: {shortened(name)} depends on itself"
            if any(looping.component for looping in loop):
                raise LoopError(f"{fault}, a frame before")
            raise BadInputError(f"{fault}; break the loop of functions")
        if writer.value is None:
            order = self._order
            self._order = writer.order
            self._running.append(writer)
            try:
                writer.value = writer.compute()
            except RecursionError as error:
                raise BadInputError(f"{writer.where}: too many functions in each other") from error
            finally:
                self._running.pop()
                self._order = order
        return writer.value

    def read_or(self, name: str, default: Any, where: str) -> Any:
        """What a system sets; the default where none does, or where that depends on its past: then
        every reader gets the default."""
        if self.writer(name) is None:
            return default
        try:
            return self.read(name, where)
        except LoopError as error:
            self.notes.append(f"{error}; {plain(name)} is left as it begins")
            self.replace(name, default)
            return default

    def read_centered(self, name: str, commands: ca.SX) -> Any:
        """The value of a property with the stick in its middle and integrators at 0."""
        every = [writer for writers in self._writers.values() for writer in writers]
        values = [writer.value for writer in every]
        self.centered = True
        try:
            value = ca.SX(self.read(name, ""))
        finally:
            self.centered = False
            for writer, before in zip(every, values, strict=True):
                writer.value = before
        return ca.substitute(value, commands, ca.SX.zeros(commands.numel()))

    def value(self, text: str, element: Element) -> Any:
        """A number, or the value of the property that a text names."""
        try:
            return float(text)
        except ValueError:
            return self.read(text, element.where)


def plain(name: str) -> str:
    """The name of a property without what may be left out: [0] and the name of JSBSim's tree."""
    return name.strip().replace("[0]", "").removeprefix("/fdm/jsbsim/").lstrip("/")


def lower_dashes(name: str) -> str:
    """The property that a name with blanks stands for: "Pitch Trim Sum" is pitch-trim-sum."""
    return "-".join(name.lower().split(" "))


def is_constant(value: Any) -> bool:
    """Whether a value is a number whatever the symbols are."""
    return not isinstance(value, ca.SX) or value.is_constant()
