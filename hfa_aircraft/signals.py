"""Signals of a model, and named tuples of their values."""

from __future__ import annotations

import math
from collections import namedtuple
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa_support.errors import refuse_unknown

#: Vectors of a model's equations in CasADi's order -> declarations of their components.
VECTORS = {"x": "states", "u": "inputs", "p": "parameters", "w": "disturbances"}


class Signal(NamedTuple):
    """Unit, magnitude and limits of a state, input, parameter, disturbance or output.

    The names of the fields are those of FMI 3 and casadi.DaeBuilder.

    unit: text, "1" for a dimensionless signal
    nominal: typical magnitude, > 0, which scales unknowns and residuals of different units
    min, max: domain of the equations, and limits of a trim
    start: value of a parameter, or initial value of a state or an input in a trim search
    rate: typical magnitude of a state's rate, by default the nominal in 1 s (`Model.rate_scale`)
    omitted_dynamics: note on dynamics between an input and the motion that the equations omit
    assumed: whether min and max are assumptions of a reader, which the aircraft's data do not state
    full: angle of what a lever without a unit moves, at the value 1 of the lever, deg; 0 if unknown

    >>> import hfa
    >>> hfa.Signal("ft/s", nominal=100.0, min=0.0).max
    inf
    """

    unit: str = "1"
    nominal: float = 1.0
    min: float = -math.inf
    max: float = math.inf
    start: float = 0.0
    rate: float | None = None
    omitted_dynamics: str = ""
    assumed: bool = False
    full: float = 0.0


#: Airspeeds that a trim may impose in place of the speed of an aircraft.
AIRSPEEDS = {
    "kcas": Signal("kt", 100.0, 0.0),
    "keas": Signal("kt", 100.0, 0.0),
    "ktas": Signal("kt", 100.0, 0.0),
    "mach": Signal("1", 0.5, 0.0),
}
#: Parameter of models in the standard atmosphere: deviation of the temperature from it, K.
ISA = "isa"

#: Field names -> class of named tuples.
_RECORDS: dict[tuple[str, ...], Any] = {}


def record(names: tuple[str, ...]) -> Any:
    """Return the class of named tuples with these field names.

    Each class is created only once.
    """
    if names not in _RECORDS:
        remember_record(namedtuple("Values", names))
    return _RECORDS[names]


def remember_record(kind: Any) -> None:
    """Register a class of named tuples as the one that `record` returns for its field names.

    The registered class is a subclass that also supports values["alpha"] and dict(values).
    """

    def item(values: Any, name: Any) -> Any:
        """Return a value by its name, or by an index as of any tuple."""
        if not isinstance(name, str):
            return kind.__getitem__(values, name)
        refuse_unknown("unknown name", name, kind._fields)
        return getattr(values, name)

    def reduced(values: Any) -> Any:
        return _unpickled, (kind._fields, tuple(values))

    members = {
        "__getitem__": item,
        "__reduce__": reduced,
        "keys": lambda _: kind._fields,
        "_ipython_key_completions_": lambda _: kind._fields,
        "items": lambda values: zip(kind._fields, values, strict=True),
        "__slots__": (),
    }
    _RECORDS[kind._fields] = type(kind.__name__, (kind,), members)


def _unpickled(names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    """Return the named tuple that pickle restores."""
    return record(names)(*values)


class StatesAndInputs:
    """Base class of results that have a `model`: names and units of its states and inputs."""

    if TYPE_CHECKING:

        @property
        def model(self) -> Any:
            """`Model` of the aircraft."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        return tuple(self.model.states)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Unit of each state."""
        return self.model.units(self.state_names)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(self.model.inputs)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input."""
        return self.model.units(self.input_names)
