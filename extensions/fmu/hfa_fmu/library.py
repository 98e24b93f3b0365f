"""The library of an FMU: one instance of its model, called by FMI 2.0 or 3.0.

This file is also a program, which runs a library for the first time in a process of its own. It
imports only the standard library, so that this process starts quickly.
"""

from __future__ import annotations

import ctypes
import json
import sys
from array import array
from contextlib import suppress
from ctypes import CFUNCTYPE, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from math import isfinite
from threading import RLock
from typing import Any, NamedTuple

#: Status of a call, from FMI. A call with status 0 or 1 (warning) has results.
_STATUS = ("OK", "warning", "discard", "error", "fatal", "pending")
_OK, _WARNING, _ERROR, _FATAL = 0, 1, 3, 4
#: Largest number of iterations at an event.
_MOST_ITERATIONS = 100
#: Largest number of characters of a message of the FMU.
_LONGEST_MESSAGE = 120


class FmuError(Exception):
    """A call of an FMU failed. The text says which, and what the FMU says about it."""


class Parameter(NamedTuple):
    """A parameter of FMI's type `kind`, and whether that is a type of whole numbers."""

    name: str
    reference: int
    kind: str
    is_whole: bool
    start: float


class Interface(NamedTuple):
    """What the calls of an FMU require.

    library: path of its library
    version: 2 or 3
    resources: URI (FMI 2.0) or path (FMI 3.0) of its resources
    indicators: number of its event indicators
    states, rates, inputs, outputs: value references of the variables
    has_steps: whether the inputs change at events only
    """

    library: str
    version: int
    title: str
    token: str
    resources: str
    indicators: int
    states: list[int]
    rates: list[int]
    inputs: list[int]
    parameters: list[Parameter]
    outputs: list[int]
    has_steps: bool


class _Allocation(ctypes.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = [
        (name, c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")
    ]


class _EventInfo(ctypes.Structure):
    """fmi2EventInfo."""

    _fields_ = [
        *((name, c_int) for name in ("again", "terminate", "nominals", "states", "has_next")),
        ("next", c_double),
    ]


class Instance:
    """An instance of an FMU, of which f = (rates, outputs) is a function of v = (x, u, p) and time.

    The calls have fixed memory for their arguments, which makes them fast.
    """

    def __init__(self, interface: Interface) -> None:
        """Load the library. Raises OSError if that fails."""
        self._interface = interface
        self._library = ctypes.CDLL(interface.library)
        self._functions: dict[str, Any] = {}
        self._last_message = ""
        self._lock = RLock()
        self._component: c_void_p | None = None
        self._has_ended = False
        self._time = 0.0
        n, m = len(interface.states), len(interface.inputs)
        self._v = (c_double * (n + m + len(interface.parameters)))()
        self._f = (c_double * (n + len(interface.outputs)))()
        self._v_bytes, self._f_bytes = (
            memoryview(buffer).cast("B") for buffer in (self._v, self._f)
        )
        # Arguments of the calls that set the states and the inputs, and get the rates and outputs.
        self._x = self._v, c_size_t(n)
        self._rates = self._f, c_size_t(n)
        self._inputs = self._arguments_of_reals(interface.inputs, self._v, n)
        self._outputs = self._arguments_of_reals(interface.outputs, self._f, n)
        #: Places of the inputs and of the parameters in the bytes of v, 8 for each number.
        self._of_inputs, self._of_parameters = slice(8 * n, 8 * (n + m)), slice(8 * (n + m), None)
        #: Bytes of the inputs at the last event, and of the parameters of the instance.
        self._inputs_at_event = self._parameters_of_instance = b""
        #: Whether each event indicator of the instance is positive, or [] before it is known.
        self._signs: list[bool] = []
        self._callbacks: list[Any] = self._made_callbacks()
        is_two = interface.version == 2
        self._of_rates = "GetDerivatives" if is_two else "GetContinuousStateDerivatives"
        self._set_reals, self._get_reals = (
            f"{verb}{'Real' if is_two else 'Float64'}" for verb in ("Set", "Get")
        )

    def values(self, v: Any, time: float = 0.0) -> memoryview:
        """Return the bytes of f, which the next call overwrites. Raises FmuError if a call fails.

        v: bytes of doubles
        """
        with self._lock:
            self._set(v, time)
            self._call(self._of_rates, *self._rates)
            if self._interface.outputs:
                self._call(self._get_reals, *self._outputs)
            return self._f_bytes

    def renew(self) -> None:
        """Give up the instance, with what it remembers of its past."""
        with self._lock:
            if self._component is not None:
                self._end(_OK)

    def indicators(self, v: Any) -> list[float]:
        """Return the event indicators after the events. Raises FmuError if a call fails."""
        if not self._interface.indicators:
            return []
        with self._lock:
            self._set(v, 0.0)
            return self._indicators_now()

    def along(self, v: Any, direction: Any) -> list[float]:
        """Return the derivatives of f that the FMU gives, along a direction of (x, u).

        v: bytes of doubles
        direction: numbers

        Raises FmuError if a call fails.
        """
        interface = self._interface
        with self._lock:
            self._set(v, 0.0)
            # FMI's words: the known variables change along the seed, the unknown ones follow.
            references = (*interface.states, *interface.inputs)
            known = (c_uint * len(references))(*references)
            seed = (c_double * len(references))(*direction)
            unknown = (c_uint * len(self._f))(*interface.rates, *interface.outputs)
            found = (c_double * len(self._f))()
            knowns, unknowns = c_size_t(len(references)), c_size_t(len(self._f))
            vectors = [seed, found] if interface.version == 2 else [seed, knowns, found, unknowns]
            self._call("GetDirectionalDerivative", unknown, unknowns, known, knowns, *vectors)
            return list(found)

    def _arguments_of_reals(
        self, references: list[int], memory: Any, first: int
    ) -> tuple[Any, ...]:
        """Return the arguments of a call that sets or gets variables.

        memory, first: array of doubles, and the place of the first variable in it
        """
        # FMI 3.0 also takes the number of the values, which may be arrays.
        count = c_size_t(len(references))
        place = ctypes.byref(memory, first * ctypes.sizeof(c_double))
        c_references = (c_uint * len(references))(*references)
        return (c_references, count, place, *([count] if self._interface.version == 3 else []))

    def _set(self, v: Any, time: float) -> None:
        """Set time and all variables, with an event where an input changes at events only.

        Raises FmuError if v is not finite or a call fails.
        """
        self._v_bytes[:] = v
        if not isfinite(sum(self._v)):
            raise FmuError("an argument is not a finite number")
        # Most parameters can be set only while an instance is made.
        if self._v_bytes[self._of_parameters] != self._parameters_of_instance:
            self.renew()
        if self._component is None:
            try:
                self._begin()
            except FmuError:
                self.renew()
                raise

        if time != self._time:
            self._call("SetTime", c_double(time))
            self._time = time
        self._call("SetContinuousStates", *self._x)
        inputs = bytes(self._v_bytes[self._of_inputs])
        if inputs and not self._interface.has_steps:
            self._call(self._set_reals, *self._inputs)
        elif inputs != self._inputs_at_event:
            self._call("EnterEventMode")
            self._call(self._set_reals, *self._inputs)
            self._leave_event()
            self._inputs_at_event = inputs

        # The FMU may remember an event, here a new sign of an indicator: a new instance does not.
        if self._interface.indicators:
            if not self._signs:
                self._call("EnterEventMode")
                self._leave_event()
                self._signs = self._signs_now()
            elif self._signs_now() != self._signs:
                self.renew()
                self._set(v, time)

    def _begin(self) -> None:
        """Make the instance, and enter continuous-time mode."""
        if self._has_ended:
            raise FmuError("the FMU has ended with the status fatal")
        interface = self._interface
        title, token = interface.title.encode(), interface.token.encode()
        resources = interface.resources.encode()
        # Arguments 0 mean: for model exchange, not visible, and without a log.
        if interface.version == 2:
            make = self._function("Instantiate", c_void_p)
            made = make(title, 0, token, resources, ctypes.byref(self._callbacks[0]), 0, 0)
        else:
            make = self._function("InstantiateModelExchange", c_void_p)
            made = make(title, token, resources or None, 0, 0, None, self._callbacks[0])
        if not made:
            raise FmuError(f"the FMU makes no instance{self._reason()}")
        self._component = c_void_p(made)
        zero = c_double(0.0)
        experiment = (0, zero, zero, 0, zero)  # no tolerance, start at 0, no end
        if interface.version == 2:
            self._call("SetupExperiment", *experiment)
            self._call("EnterInitializationMode")
        else:
            self._call("EnterInitializationMode", *experiment)
        self._set_parameters()
        self._call("ExitInitializationMode")
        self._iterate_event()
        self._time, self._inputs_at_event, self._signs = 0.0, b"", []
        self._parameters_of_instance = bytes(self._v_bytes[self._of_parameters])

    def _set_parameters(self) -> None:
        """Set the parameters that differ from their start values."""
        interface = self._interface
        values = self._v[len(interface.states) + len(interface.inputs) :]
        for parameter, value in zip(interface.parameters, values, strict=True):
            name, reference, kind, is_whole, start = parameter
            if value == start:
                continue
            if is_whole and not value.is_integer():
                raise FmuError(f"the parameter {name} is {value:g}; hold it at a whole number")
            setter, c_type = _setter(interface.version, kind)
            one = c_size_t(1)
            memory = (c_type * 1)(int(value) if is_whole else value)
            more = [one] if interface.version == 3 else []  # FMI 3.0: number of the values
            self._call(setter, (c_uint * 1)(reference), one, memory, *more)

    def _leave_event(self) -> None:
        """End the event. Raises FmuError if it changes the states: rates are functions of v."""
        changes_states = self._iterate_event()
        n = len(self._interface.states)
        found = (c_double * n)()
        self._call("GetContinuousStates", found, c_size_t(n))
        # An FMU may return the states converted to other units and back. Such rounding errors are
        # no change: the states must differ, and the FMU must also report a change.
        if changes_states and found[:] != self._v[:n]:
            raise FmuError("an event of the FMU changes its states")

    def _iterate_event(self) -> bool:
        """Iterate an event, enter continuous-time mode, and return whether states changed."""
        changes = False
        for _ in range(_MOST_ITERATIONS):
            if self._interface.version == 2:
                info = _EventInfo()
                self._call("NewDiscreteStates", ctypes.byref(info))
                again, ends, changed = bool(info.again), bool(info.terminate), bool(info.states)
            else:
                # As the fields of `_EventInfo`: again, terminate, nominals, states, has_next, next.
                flags = [ctypes.c_bool() for _ in range(5)]
                results: list[Any] = [*flags, c_double()]
                self._call("UpdateDiscreteStates", *map(ctypes.byref, results))
                again, ends, _, changed, _ = (flag.value for flag in flags)
            changes |= changed
            if ends:
                self._end()
                raise FmuError(f"the FMU ends the simulation{self._reason()}")
            if not again:
                self._call("EnterContinuousTimeMode")
                return changes
        self._end()
        raise FmuError(f"an event of the FMU takes more than {_MOST_ITERATIONS} iterations")

    def _signs_now(self) -> list[bool]:
        """Return whether each event indicator is positive."""
        return [value > 0.0 for value in self._indicators_now()]

    def _indicators_now(self) -> list[float]:
        """Return the event indicators at the variables that are set."""
        found = (c_double * self._interface.indicators)()
        self._call("GetEventIndicators", found, c_size_t(len(found)))
        return found[:]

    def _call(self, name: str, *arguments: Any) -> None:
        """Call a function of the FMU. Raises FmuError unless its status is OK or warning."""
        function = self._functions.get(name) or self._function(name, c_int)
        status = function(self._component, *arguments)
        if status <= _WARNING:
            return
        said = _STATUS[status] if status < len(_STATUS) else str(status)
        # After a discarded Get or Set call, the state of the instance is still known.
        if status >= _ERROR or not name.startswith(("Get", "Set")):
            self._end(status)
        raise FmuError(f"fmi{self._interface.version}{name} returns {said}{self._reason()}")

    def _end(self, status: int = _ERROR) -> None:
        """Give up the instance, which has no known state after an error or within an event."""
        # After the status fatal, FMI permits no further call, not even one that frees memory.
        if status <= _ERROR:
            self._function("FreeInstance", None)(self._component)
        self._has_ended = status == _FATAL
        self._component = None

    def _function(self, name: str, result: Any) -> Any:
        """Return a function of the library by its name without fmi2 or fmi3.

        result: type of its result in ctypes
        """
        full_name = f"fmi{self._interface.version}{name}"
        try:
            function = getattr(self._library, full_name)
        except AttributeError:
            raise FmuError(f"its library has no function {full_name}") from None
        function.restype = result
        self._functions[name] = function
        return function

    def _reason(self) -> str:
        """Return the last message of the FMU in brackets, or "", and forget it."""
        said, self._last_message = " ".join(self._last_message.split()), ""
        return f" ({said[:_LONGEST_MESSAGE]})" if said else ""

    def _made_callbacks(self) -> list[Any]:
        """Return the callbacks of the constructor, and further objects to which they refer.

        The caller keeps all of them alive, which ctypes does not.
        """

        def say(message: bytes | None) -> None:
            """Keep a message as it is; FMI 2.0's fields for `printf` (%d) are not filled in."""
            self._last_message = (message or b"").decode(errors="replace")

        if self._interface.version == 3:
            kind: Any = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
            return [kind(lambda _, __, ___, message: say(message))]
        kind = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)
        log = kind(lambda _, __, ___, ____, message: say(message))
        memory = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
        addresses = [
            ctypes.cast(function, c_void_p) for function in (log, memory.calloc, memory.free)
        ]
        return [_Allocation(*addresses), log]  # the other two pointers are NULL


def _setter(version: int, kind: str) -> tuple[str, Any]:
    """Return the name of the function that sets a type of FMI, and the type of its values in C."""
    if version == 2:
        name = {"Float64": "Real", "Enumeration": "Integer"}.get(kind, kind)
        return f"Set{name}", c_double if name == "Real" else c_int
    name = "Int64" if kind == "Enumeration" else kind
    of_c = {"Float64": "double", "Float32": "float", "Boolean": "bool"}.get(name, name.lower())
    return f"Set{name}", getattr(ctypes, f"c_{of_c}")


def main() -> None:
    """Evaluate an FMU at its start values, to find whether its code ends the process or hangs."""
    interface, start = json.load(sys.stdin)
    # An error is no such fault: the calling process meets it again, and reports it.
    with suppress(FmuError, OSError):
        Instance(Interface(*interface)).values(array("d", start).tobytes())


if __name__ == "__main__":
    main()
