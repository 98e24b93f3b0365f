"""Signals of a model, named tuples of their values, and states recognized by name and unit."""

from __future__ import annotations

import keyword
import math
import re
from collections import Counter, namedtuple
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, is_finite, pair_of, refuse_unknown, shortened, shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, numbered, shown_unit, shown_value
from hfa_support.units import STANDARD_GRAVITY, conversion_factor, stated_factor, units_like

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
    show: whether the short sheet of a trim prints the output

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
    show: bool = False


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

    Each class is created only once, so that values with equal names are of one class.
    """
    if names not in _RECORDS:
        remember_record(namedtuple("Values", names))
    return _RECORDS[names]


def remember_record(kind: Any) -> None:
    """Register a class of named tuples as the one that `record` returns for its field names.

    The registered class is a subclass that also supports values["alpha"] and dict(values).

    kind: class of named tuples
    """

    def item(values: Any, name: Any) -> Any:
        """Return a value by its name, or by an index as of any tuple."""
        if not isinstance(name, str):
            return kind.__getitem__(values, name)
        refuse_unknown("unknown name", name, kind._fields)
        return getattr(values, name)

    def reduced(values: Any) -> Any:
        """Return what pickle calls to restore the values: the class itself cannot be imported."""
        return _unpickled, (kind._fields, tuple(values))

    members = {
        "__getitem__": item,
        "__reduce__": reduced,
        "keys": lambda _: kind._fields,
        "items": lambda values: zip(kind._fields, values, strict=True),
        "__slots__": (),
    }
    _RECORDS[kind._fields] = type(kind.__name__, (kind,), members)


def _unpickled(names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    """Return the named tuple that pickle restores."""
    return record(names)(*values)


def declared_signals(model: str, groups: Mapping[str, Any]) -> dict[str, dict[str, Signal]]:
    """Return the signals of each kind as a dictionary. Raises BadInputError for an invalid one.

    model: name of the model, for messages
    groups: kind, such as "states" -> signals by name, or a named tuple of signals
    """
    declared: dict[str, dict[str, Signal]] = {}
    for kind, signals in groups.items():
        if hasattr(signals, "_asdict"):
            remember_record(type(signals))  # the equations receive values of this class
            signals = signals._asdict()
        if not isinstance(signals, Mapping):
            raise BadInputError(f"{model}: {kind} is {shown(signals)}; give {{name: Signal(unit)}}")
        for name, signal in signals.items():
            is_word = isinstance(name, str) and name.isidentifier() and name.isascii()
            if not is_word or name[0] == "_" or keyword.iskeyword(name):
                raise BadInputError(
                    f"{model}: {shown(name)} in {kind} is not an identifier; rename it"
                )
            if any(name in others for others in declared.values()):
                raise BadInputError(f"{model}: {name} is declared twice; rename one signal")
            _check_signal(f"{model}: {name}", signal)
        declared[kind] = dict(signals)
    return declared


def _check_signal(where: str, signal: Any) -> None:
    """Raise BadInputError for a signal with an invalid type, unit or number."""
    if not isinstance(signal, Signal):
        raise BadInputError(f"{where} is {shown(signal)}; give a Signal")
    if not isinstance(signal.unit, str):
        raise BadInputError(f"{where}: the unit is {shown(signal.unit)}; give the unit as text")
    if re.search(r"\blbs?\b", signal.unit):
        raise BadInputError(
            f"{where}: the unit is {signal.unit}; write lbf (a force), or slug (a mass)"
        )
    rate = signal.nominal if signal.rate is None else signal.rate
    numbers = (signal.nominal, rate, signal.start)
    if not all(map(is_finite, numbers)) or min(signal.nominal, rate) <= 0.0:
        raise BadInputError(
            f"{where}: nominal, rate, start are {shown(numbers)}; give finite numbers, nominal and "
            "rate positive"
        )
    if not all(isinstance(word, bool) for word in (signal.assumed, signal.show)):
        words = shown((signal.assumed, signal.show))
        raise BadInputError(f"{where}: assumed, show are {words}; give True or False")
    if not is_finite(signal.full) or signal.full < 0.0:
        raise BadInputError(f"{where}: full is {signal.full!r}; give an angle of at least 0 deg")
    lowest, highest = pair_of(f"{where}: min, max", (signal.min, signal.max))
    if not lowest <= highest:
        raise BadInputError(
            f"{where}: min {lowest:g} is above max {highest:g}; exchange the two limits"
        )


def factor_to(signal: Signal, text: str, unit: str) -> float:
    """Return the factor from a stated unit to the unit of a signal.

    An angle of what a lever moves is a share of its `Signal.full`.

    text: the value as stated, for the message
    unit: the stated unit

    Raises BadInputError, whose message completes a sentence that begins with the name of the
    signal, if the unit is another quantity's.
    """
    degrees = conversion_factor(unit, "deg")
    if signal.full and degrees is not None:  # a lever, which moves by `full` degrees at 1
        return degrees / signal.full
    declared = signal.unit
    if (factor := stated_factor(unit, declared)) is not None:
        return factor
    if declared == "1":
        is_limited = math.isfinite(signal.max - signal.min)
        ends = f" from {signal.min:g} to {signal.max:g}" if is_limited else ""
        advice = f"give a number without a unit{ends}"
    else:
        words = declared.replace("rad", "deg")  # angles are typed in degrees
        advice = f"give a finite number, in {words}"
        if others := ", ".join(other for other in units_like(declared) if other != words):
            advice += f", or with a unit: {others}"
    raise BadInputError(f"is {shortened(text)!r}; {advice}")


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


def signals_report(
    title: str,
    signals: Mapping[str, Mapping[str, Signal]],
    trim: Mapping[str, float],
    notes: Sequence[str],
) -> Report:
    """Return a report with a table for each kind of signal: names, units, limits and values.

    The value of a parameter is its `start`. The value of another signal is the one that a trim
    imposes by default, if any. Angles are in degrees in the text, and in the signals' units in the
    data.

    title: title of the report
    signals: kind, such as "states" -> name -> signal
    trim: signal -> value that a trim imposes by default
    notes: notes of the report
    """
    parts = []
    records: list[tuple[Any, ...]] = []
    for kind, declared in signals.items():
        rows = []
        for name, signal in declared.items():
            imposed = signal.start if kind == "parameters" else trim.get(name, math.nan)
            numbers = (signal.min, signal.max, imposed)
            shown = [
                shown_value(number, signal.unit) if math.isfinite(number) else ""
                for number in numbers
            ]
            rows.append((name, shown_unit(signal.unit), *shown))
            records.append((kind, name, signal.unit, *numbers))
        value = "value" if kind == "parameters" else "trim"
        if rows:
            parts.append(Table((kind, "unit", "lowest", "highest", value), rows))
    columns = ("kind", "name", "unit", "min", "max", "value")
    data = {row[1]: dict(zip(columns, row, strict=True)) for row in records}
    return Report(title, parts, notes, data, Table(columns, records))


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return name in a file -> name in the model, an identifier that no other name has."""
    found: dict[str, str] = {}
    seen: Counter[str] = Counter()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "variable"
        plain = f"v_{plain}" if plain[0].isdigit() else plain
        # If "a b" is a_b, "a.b" becomes a_b_, which is unique: no plain identifier ends with "_".
        found[name] = plain + "_" * seen[plain]
        seen[plain] += 1
    return found


class PlantNames(NamedTuple):
    """Names and units of a plant's states and inputs, () where unknown.

    states: n names
    inputs: m names
    state_units: n units, with "" for an unknown unit
    input_units: m units, with "" for an unknown unit
    origin: name of the plant in the title of a report
    disturbances: names of the columns of a game's E, where they are winds of the model
    """

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    state_units: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    origin: str = "the plant"
    disturbances: tuple[str, ...] = ()

    def completed(self, n: int, m: int) -> PlantNames:
        """Return names and units for n states and m inputs.

        Unknown states are named x1, x2, ..., unknown inputs u1, u2, ..., and unknown units are "".

        Raises BadInputError if the number of known names or units is not n for states or m for
        inputs, and for a name that two of them have.
        """
        completed: dict[str, Any] = {
            "states": numbered("x", n),
            "inputs": numbered("u", m),
            "state_units": ("",) * n,
            "input_units": ("",) * m,
        }
        for key, default in completed.items():
            known = tuple(getattr(self, key))
            if not any(known):
                continue
            if len(known) != len(default):
                raise BadInputError(
                    f"{key} has {len(known)} entries; give {len(default)} for this plant"
                )
            if "units" not in key and len({*known}) < len(known):
                raise BadInputError(f"{key} has a name twice ({', '.join(known)}); rename one")
            completed[key] = known
        return self._replace(**completed)


UNNAMED = PlantNames()


# Recognition of states by their names and units.

_ANGLE = ("rad", "deg")
_RATE = ("rad/s", "deg/s")
_LENGTH = ("ft", "m", "km")
_SPEED = ("ft/s", "m/s", "kt", "kts", "knot", "km/h")
#: State -> names, in lower case, and units by which it is recognized.
_RECOGNIZED = {
    "alpha": (("alpha", "aoa", "angle_of_attack"), _ANGLE),
    "q": (("q", "pitch_rate"), _RATE),
    "speed": (("v", "vt", "va", "tas", "speed", "airspeed", "velocity"), _SPEED),
    **{component: ((component,), _SPEED) for component in "uvw"},
    "theta": (("theta", "pitch", "pitch_angle"), _ANGLE),
    "beta": (("beta", "sideslip"), _ANGLE),
    "p": (("p", "roll_rate"), _RATE),
    "r": (("r", "yaw_rate"), _RATE),
    "phi": (("phi", "roll", "bank", "roll_angle", "bank_angle"), _ANGLE),
    "altitude": (("altitude", "alt", "h", "height"), _LENGTH),
}
#: Usual word or symbol -> name of another variable in the models of this project.
_WORDS = {
    **dict.fromkeys(("n", "nz", "g", "g_load"), "load_factor"),
    **dict.fromkeys(("m", "mach_number", "ma"), "mach"),
    **dict.fromkeys(("fpa", "flight_path", "flight_path_angle", "climb"), "gamma"),
    **dict.fromkeys(("psi", "heading"), "yaw"),
    "psi_dot": "turn_rate",
    "omega": "turn_rate",
    **dict.fromkeys(("cas", "ias", "kias"), "kcas"),
    "eas": "keas",
}
#: Names of inputs and parameters that belong to one of several engines.
_ENGINE_NAME = r"(throttle|thrust|power|engine)_?(\d+|left|right)"
#: Role in a mode -> component of the velocity in body axes that stands for it.
_COMPONENTS = {"speed": "u", "beta": "v", "alpha": "w"}
#: Mode -> states that dominate it, and another mode whose states must exist.
_MODES = {
    "short period": (("alpha", "q"), "short period"),
    "phugoid": (("speed", "theta"), "short period"),
    "dutch roll": (("beta", "r"), "dutch roll"),
    "roll": (("p",), "dutch roll"),
    "spiral": (("phi",), "dutch roll"),
}


def recognized(states: Mapping[str, Signal]) -> dict[str, str]:
    """Return role -> name of each state recognized by name and unit.

    The roles are alpha, q, speed, theta, beta, p, r, phi, altitude, and u, v and w, components of
    the velocity in body axes: beside a w, "v" is no speed. A state of a part, such as the
    body_speed of an FMU, has the role if no state has the name itself and no other part has one.
    Only an aircraft has an altitude: other models may have a height, but no speed and alpha.
    """
    found: dict[str, str] = {}
    for role, (names, units) in _RECOGNIZED.items():
        with_unit = [name for name, signal in states.items() if signal.unit in units]
        named = [name for name in with_unit if name.lower() in names]
        ends = tuple(f"_{name}" for name in names if len(name) > 1)
        of_parts = [name for name in with_unit if name.lower().endswith(ends)]
        if named or len(of_parts) == 1:
            found[role] = (named or of_parts)[0]
    if "w" not in found:
        found.pop("v", None)
    elif found.get("speed") == found.get("v"):
        found.pop("speed", None)
    if not {"speed", "alpha"} <= {*found}:
        found.pop("altitude", None)
    return found


def engines_among(names: Iterable[str]) -> list[str]:
    """Return the names of inputs or parameters that belong to one of several engines."""
    return [name for name in names if re.fullmatch(_ENGINE_NAME, name)]


def airspeed_output(outputs: Mapping[str, Signal]) -> str:
    """Return the output that is the true airspeed by its name and unit, or ""."""
    names, units = _RECOGNIZED["speed"]
    return next(
        (name for name in outputs if name.lower() in names and outputs[name].unit in units), ""
    )


def usual_begin(states: Mapping[str, Signal]) -> Callable[..., dict[str, Any]] | None:
    """Return the default `Trimming.begin`: bank and body rates of coordinated turns; None for a
    model without them in rad.
    """
    found = recognized(states)
    names = tuple(found.get(role, "") for role in ("speed", "phi", "q", "r"))
    units = [states[name].unit if name else "" for name in names]
    gravity = conversion_factor("m/s^2", f"{units[0]}/s")
    if gravity is None or units[1:] != ["rad", "rad/s", "rad/s"]:
        return None
    return partial(_coordinated, names, gravity * STANDARD_GRAVITY)


def _coordinated(
    names: Sequence[str], gravity: float, imposed: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the bank and body rates of a turn, tan φ = V ω / g, or at a load factor n of one to
    the right, cos φ = 1/n; {} without an imposed speed and turn. The numbers may be arrays.
    """
    speed, bank, *rates = names
    if speed not in imposed or imposed.keys().isdisjoint(("turn_rate", "load_factor")):
        return {}
    if "turn_rate" in imposed:
        rate_of_turn = imposed["turn_rate"]
        angle = np.arctan(imposed[speed] * rate_of_turn / gravity)
    else:
        angle = np.arccos(1.0 / np.maximum(imposed["load_factor"], 1.0))
        rate_of_turn = gravity * np.tan(angle) / imposed[speed]
    body_rates = (rate_of_turn * np.sin(angle), rate_of_turn * np.cos(angle))
    return {bank: angle, **dict(zip(rates, body_rates, strict=True))}


def usual_modes(states: Mapping[str, Signal]) -> dict[str, tuple[str, ...]]:
    """Return the default modes of an aircraft, name of the mode -> states that dominate it.

    The modes are short period (alpha, q), phugoid (speed, theta), Dutch roll (beta, r), roll (p)
    and spiral (phi). In body axes u, v and w stand for speed, beta and alpha. A mode is omitted if
    one of its states is not recognized by name and unit.

    The phugoid also requires the states of the short period. A model that is not an aircraft may
    also have a speed and an angle. Roll and spiral also require the states of the Dutch roll.
    """
    found = recognized(states)
    found = {role: found[part] for role, part in _COMPONENTS.items() if part in found} | found
    modes: dict[str, tuple[str, ...]] = {}
    for mode, (roles, other_mode) in _MODES.items():
        other_roles, _ = _MODES[other_mode]
        if all(role in found for role in (*roles, *other_roles)):
            modes[mode] = tuple(found[role] for role in roles)
    return modes


def meant_by(word: str, states: Mapping[str, Signal]) -> str:
    """Return the variable that a usual word or symbol names: roll of "phi", or ""."""
    plain = word.lower()
    for role, state in recognized(states).items():
        if plain in _RECOGNIZED[role][0]:  # the names, which the units follow
            return state
    return _WORDS.get(plain, "")
