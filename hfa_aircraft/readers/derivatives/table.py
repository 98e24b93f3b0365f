"""Reader of a table of derivatives with units, from a TOML or CSV file or from a dictionary."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from hfa_aircraft.about import Source
from hfa_aircraft.readers.derivatives.avl import (
    AVL,
    StabilityFile,
    read_stability_file,
    with_stability_file,
)
from hfa_aircraft.readers.derivatives.names import (
    ARGUMENTS,
    BY_MASS,
    CENTER,
    CENTERS,
    COEFFICIENTS,
    DIVIDED,
    GEOMETRY,
    INDUCED,
    LARGEST_LIFT,
    REQUIRED,
    TAIL_ARM,
    THRUST_BY_SPEED,
    THRUST_INPUT,
    UNDIVIDED,
    UNITS,
    WORDS,
    Derivative,
    DimensionalDerivative,
    Entry,
    derivative_of,
    dimensional_names,
    dimensional_of,
    number,
)
from hfa_aircraft.rigid.aircraft import FORCE, GRAVITY
from hfa_aircraft.rigid.atmosphere import ALTITUDES, air_at
from hfa_support.arrays.columns import columns_of_text, matched
from hfa_support.errors import BadInputError, advice, file_faults, shown, warn
from hfa_support.files import read_toml, regular_file, resolved
from hfa_support.units import FOOT, SYSTEMS

#: Text entries: name -> permitted values, or None if any text is permitted.
_TEXTS: dict[str, tuple[str, ...] | None] = {
    "name": None,
    "source": None,
    "units": SYSTEMS,
    "per": ("rad", "deg"),
    "axes": ("body", "stability"),
    "dimensional": DIVIDED,
    "checked": None,
    **dict.fromkeys(WORDS),
}
#: The table in messages, if it is a dictionary.
_DICTIONARY = "the table"
_RADIANS = {"rad": 1.0, "deg": math.pi / 180.0}


@dataclass(frozen=True)
class DerivativeTable:
    """The checked table of an aircraft, in the table's system of units, with angles in rad.

    name: name of the aircraft.
    system: system of units, "english" or "si".
    source: path and hash of the file.
    values: geometry, mass, reference condition and thrust line, name -> value.
    derivatives: name -> value, per rad for an angle.
    meanings: name of a derivative -> coefficient and argument.
    surfaces: control surface -> lowest and highest deflection, rad.
    thrust: lowest and highest thrust, lbf or N.
    axes: axes of the rolling and yawing moments and rates, "body" or "stability".
    notes: sentences for every report.
    center: center of gravity in the axes of a stability file and unit of length, or None.
    mach: Mach number of a stability file, or None.
    words: flap and gear in the words of the table, name -> text.
    checked: names of entries that are right, though no published aircraft has such values.
    """

    name: str
    system: str
    source: Source
    values: Mapping[str, float]
    derivatives: Mapping[str, float]
    meanings: Mapping[str, Derivative]
    surfaces: Mapping[str, tuple[float, float]]
    thrust: tuple[float, float]
    axes: str
    notes: tuple[str, ...] = ()
    center: tuple[tuple[float, ...], str] | None = None
    mach: float | None = None
    words: Mapping[str, str] = field(default_factory=dict)
    checked: tuple[str, ...] = ()

    def unit(self, name: str) -> str:
        """Return the unit of an entry that is not a derivative, in the table's system of units."""
        return _unit(name, self.system)


def read_table(path: str, stability_file: str = "") -> DerivativeTable:
    """Return the table of a TOML file, or of a CSV file with the columns name, value and unit.

    stability_file: file of AVL that completes the table, or "" for the one that the table names, if
        any

    Raises BadInputError if a file cannot be read or an entry is missing, unknown or invalid.
    """
    with file_faults(path):
        content = regular_file(path).read_bytes()
        is_csv = path.endswith(".csv")
        entries = _csv_entries(path, content) if is_csv else dict(_flat(read_toml(path), path))
    folder = Path(path).parent
    file = _stability_file(entries, path, folder, stability_file)
    if file is not None:
        content += file.content
    source = Source(path, hashlib.sha256(content).hexdigest())
    return _completed_table(entries, file, source, Path(path).stem)


def _stability_file(
    entries: dict[str, Entry], where: str, folder: Path, given: str = ""
) -> StabilityFile | None:
    """Return the stability file of AVL that completes a table, or None. Its entry is removed."""
    # given: the file that the command line gives, or ""
    path = given
    if AVL in entries:
        entry = entries.pop(AVL)
        if not isinstance(entry.value, str):
            raise entry.error(f"{AVL} is {shown(entry.value)}; give the name of a stability file")
        path = str(folder / entry.value)
        if given and resolved(given) != resolved(path):
            raise BadInputError(f"{where} names {path}, not {given}; correct {AVL}")
    if not path:
        return None
    with file_faults(path):
        return read_stability_file(path)


def _completed_table(
    entries: dict[str, Entry], file: StabilityFile | None, source: Source, name: str
) -> DerivativeTable:
    """Return the checked table of entries, completed by a stability file if there is one."""
    if file is None:
        return _checked_table(entries, source, name)
    completed = with_stability_file(entries, file, source.text or _DICTIONARY)
    table = _checked_table(completed, source, name)
    sound = float(air_at(table.values.get("altitude", 0.0), table.system).sound)
    notes = file.notes(has_drag="CD_0" in entries, mach=table.values["speed"] / sound)
    if TAIL_ARM in entries:
        raise entries[TAIL_ARM].error(
            f"{TAIL_ARM} is not required: derivatives of AVL are moved exactly; remove {TAIL_ARM}"
        )
    return replace(
        table,
        notes=tuple(notes),
        center=(file.reference_point, entries["length"].value),  # point, and unit of length
        mach=file.value("Mach"),
    )


def table_of(values: Mapping[str, Any]) -> DerivativeTable:
    """Return the table of a dictionary of entries, which may be grouped in inner dictionaries.

    Raises BadInputError if an entry is missing, unknown or invalid.
    """
    entries = dict(_flat(values, _DICTIONARY))
    file = _stability_file(entries, _DICTIONARY, Path())
    return _completed_table(entries, file, Source(), "aircraft")


def _flat(values: Mapping[str, Any], where: str) -> Iterator[tuple[str, Entry]]:
    """Yield name and entry for each value of a dictionary and of its inner dictionaries."""
    # Inner dictionaries are the sections of a TOML file, which only group entries.
    seen: set[str] = set()
    for key, value in values.items():
        inner = value if isinstance(value, Mapping) else {key: value}
        place = f"{where}, [{key}]" if isinstance(value, Mapping) else where
        for name, content in inner.items():
            if not isinstance(name, str):
                raise BadInputError(f"{place}: {shown(name)} is not the name of an entry")
            if name in seen:
                raise BadInputError(f"{place}: {shown(name)} is given twice; remove one entry")
            seen.add(name)
            yield name, Entry(content, place)


def _csv_entries(path: str, content: bytes) -> dict[str, Entry]:
    """Return name -> entry of a CSV file with the columns name, value and, optionally, unit."""
    known = dict.fromkeys(("name", "value", "unit"), "")
    columns = matched(columns_of_text(path, content), known)
    if others := [name for name in columns if name not in known]:
        warn(f"{path}: not used, as neither name, value nor unit: {', '.join(others)}")
    if not columns.keys() >= {"name", "value"}:
        raise BadInputError(f"{path} has no columns name and value; begin with name,value,unit")
    names, values = columns["name"], columns["value"]
    units = columns["unit"].cells if "unit" in columns else [""] * len(names.cells)
    entries: dict[str, Entry] = {}
    for row, name, value, unit in zip(names.rows, names.cells, values.cells, units, strict=True):
        where = f"{path}, row {row}"
        if not value:
            raise BadInputError(f"{where}: {shown(name)} has no value; give one")
        if name in entries:
            raise BadInputError(f"{where}: {shown(name)} is given twice; remove one row")
        # The limits of an input are written low:high.
        ends = [f"{end.strip()} {unit}".strip() for end in value.split(":")]
        entries[name] = Entry(ends if len(ends) > 1 else ends[0], where)
    return entries


def _checked_table(entries: dict[str, Entry], source: Source, name: str) -> DerivativeTable:
    """Return the table of the entries after checks of names, units, limits and required entries."""
    # Pairs of numbers are the limits of control surfaces, and of the thrust.
    pairs = {key: entry for key, entry in entries.items() if isinstance(entry.value, list | tuple)}
    # A flap with limits is a control surface, and not the text entry `flap` about its setting.
    no_texts = {*pairs} & {*WORDS}
    texts = {key: "" if key in no_texts else _text(key, entries) for key in _TEXTS}

    system = texts["units"] or "si"
    axes = texts["axes"] or "body"
    limits = {key: _limits(key, entry, system) for key, entry in pairs.items()}
    thrust = limits.pop(THRUST_INPUT, (0.0, math.inf))
    numbers = {key: entry for key, entry in entries.items() if key not in {*pairs, *_TEXTS}}
    by_kind = _numbers_of(numbers, limits, texts, system)
    values, derivatives = by_kind.values, by_kind.derivatives

    determined = {  # derivative of a coefficient -> dimensional derivative that states it
        derivative.coefficient.name: derivative.name for derivative in by_kind.dimensional
    }
    _refuse_missing(values, {*derivatives, *determined}, source.text or _DICTIONARY)
    _refuse_sizes(values, entries, system)
    if "mass" not in values:
        values["mass"] = values["weight"] / GRAVITY[system]
    _refuse_two_forms(entries, determined)
    # Dimensional derivatives require the mass and the sizes, which are checked above.
    _add_dimensional(by_kind, entries, texts["dimensional"], axes, system)
    for slope in (THRUST_BY_SPEED, "thrust_slope"):
        if slope in values or slope in derivatives:
            _refuse_no_drag(slope, entries, derivatives)

    return DerivativeTable(
        name=texts["name"] or name,
        system=system,
        source=source,
        values=values,
        derivatives=derivatives,
        meanings=by_kind.meanings,
        surfaces=limits,
        thrust=thrust,
        axes=axes,
        notes=tuple(_notes(values, derivatives)),
        words={key: texts[key] for key in WORDS if texts[key]},
        checked=_checked_names(texts["checked"], entries),
    )


def _checked_names(text: str, entries: Mapping[str, Entry]) -> tuple[str, ...]:
    """Return the names of entries in a text. Raises BadInputError for an unknown one."""
    names = tuple(text.replace(",", " ").split())
    for name in names:
        if name not in entries:
            raise entries["checked"].error(
                f"checked names {shown(name)}, which is no entry; remove it"
            )
    return names


class _Numbers(NamedTuple):
    """Numbers of a table, by what they are.

    values: size, mass, condition or thrust line -> value
    derivatives: derivative of a coefficient -> value, per rad
    meanings: derivative of a coefficient -> coefficient and argument
    dimensional: dimensional derivative -> value, per rad
    """

    values: dict[str, float]
    derivatives: dict[str, float]
    meanings: dict[str, Derivative]
    dimensional: dict[DimensionalDerivative, float]


def _numbers_of(
    entries: Mapping[str, Entry],
    surfaces: Mapping[str, Any],
    texts: Mapping[str, str],
    system: str,
) -> _Numbers:
    """Return the numbers in entries, in the table's system of units and per rad.

    surfaces: control surfaces, whose names derivatives contain
    texts: text entries, of which `per` is the unit of angles in derivatives without a unit
    """
    by_kind = _Numbers({}, {}, {}, {})
    per_angle = 1.0 / _RADIANS[texts["per"] or "rad"]
    for name, entry in entries.items():
        if name in UNITS:
            by_kind.values[name] = number(name, entry, _unit(name, system))
        elif meaning := derivative_of(name, surfaces):
            factor_without_unit = per_angle if meaning.is_by_angle else 1.0
            by_kind.derivatives[name] = number(name, entry, meaning.unit, factor_without_unit)
            by_kind.meanings[name] = meaning
        elif dimensional := dimensional_of(name, surfaces):
            factor_without_unit = per_angle if dimensional.coefficient.is_by_angle else 1.0
            if not texts["dimensional"]:
                raise entry.error(
                    f'{name} is a dimensional derivative; give dimensional = "{BY_MASS}" (and '
                    f'inertia), or dimensional = "{UNDIVIDED}"'
                )
            unit = dimensional.unit(system, texts["dimensional"])
            by_kind.dimensional[dimensional] = number(name, entry, unit, factor_without_unit)
        else:
            raise _unknown(name, entry, surfaces)
    return by_kind


def _add_dimensional(
    by_kind: _Numbers, entries: Mapping[str, Entry], divided: str, axes: str, system: str
) -> None:
    """Add the derivatives of coefficients that the dimensional derivatives determine."""
    steady = {name: by_kind.derivatives.get(name, 0.0) for name in ("CL_0", "CD_0", "Cm_0")}
    for derivative, value in by_kind.dimensional.items():
        name, coefficient = derivative.name, derivative.coefficient
        if axes == "body" and derivative.is_about_stability_axes and by_kind.values.get("alpha"):
            raise entries[name].error(
                f'{name} is about stability axes; give axes = "stability", or alpha = 0'
            )
        by_kind.meanings[coefficient.name] = coefficient
        by_kind.derivatives[coefficient.name] = derivative.value(
            value, divided, by_kind.values, steady, axes, system
        )


def _refuse_no_drag(
    name: str, entries: Mapping[str, Entry], derivatives: Mapping[str, float]
) -> None:
    """Raise BadInputError if the drag at the reference condition is not positive."""
    # An entry for the change of the thrust with the speed is relative to the thrust of level
    # flight, which balances this drag.
    drag = derivatives["CD_0"] + derivatives.get(INDUCED, 0.0) * derivatives["CL_0"] ** 2
    if drag <= 0.0:
        raise entries[name].error(
            f"{name} is the change of the thrust that balances the drag, whose coefficient is "
            f"{drag:.4g}; correct CD_0"
        )


def _notes(values: Mapping[str, float], derivatives: Mapping[str, float]) -> Iterator[str]:
    """Yield a note if derivatives of the tail stay unchanged when the center of gravity moves."""
    by_tail = [name for name in ("Cm_q", "Cm_alphadot") if derivatives.get(name)]
    if CENTER in values and TAIL_ARM not in values and by_tail:
        yield (
            f"{' and '.join(by_tail)} about {CENTER} {values[CENTER]:g} stay at another {CENTER}; "
            f"give {TAIL_ARM} in the table, and they change with the arm of the tail"
        )


def _refuse_two_forms(entries: Mapping[str, Entry], determined: Mapping[str, str]) -> None:
    """Raise BadInputError if two entries state the same derivative."""
    # determined: derivative of a coefficient -> dimensional derivative that determines it
    same_effect = [*determined.items(), (THRUST_BY_SPEED, "thrust_slope")]
    for coefficient in COEFFICIENTS:
        by_speed, by_mach = f"{coefficient}_u", f"{coefficient}_mach"
        same_effect.append((by_speed, by_mach))
        if by_speed in determined:
            same_effect.append((by_mach, determined[by_speed]))
    for name, other in same_effect:
        if name in entries and other in entries:
            raise entries[name].error(f"{name} and {other} state the same effect; remove one")


def _text(name: str, entries: Mapping[str, Entry]) -> str:
    """Return the text of an entry, or "" if the table does not contain it."""
    if name not in entries:
        return ""
    entry = entries[name]
    allowed = _TEXTS[name]
    if not isinstance(entry.value, str):
        raise entry.error(f"{name} is {shown(entry.value)}; give text")
    if allowed is not None and entry.value not in allowed:
        known = " or ".join(allowed)
        raise entry.error(f"{name} is {shown(entry.value)}; use {known}")
    return entry.value


def _limits(name: str, entry: Entry, system: str) -> tuple[float, float]:
    """Return the lowest and highest value of an input: rad of a surface, lbf or N of the thrust."""
    unit = FORCE[system] if name == THRUST_INPUT else "rad"
    is_number = name in UNITS or derivative_of(name, ())
    if not name.isidentifier() or is_number or len(entry.value) != 2:
        raise entry.error(
            f"{shown(name)} is {shown(entry.value)}; give a single value, or the lower and upper"
            " limit of an input"
        )
    low, high = (number(name, Entry(value, entry.where), unit) for value in entry.value)
    if low >= high:
        raise entry.error(
            f"{name}: the lower limit is not less than the upper limit; correct the limits"
        )
    return low, high


def _unit(name: str, system: str) -> str:
    """Return the unit of an entry that is not a derivative, in a system of units."""
    return UNITS[name][SYSTEMS.index(system)]


def _unknown(name: str, entry: Entry, surfaces: Mapping[str, Any]) -> BadInputError:
    """Return the error for an unknown entry, or for an entry without the two limits it requires."""
    arguments = (*ARGUMENTS, *surfaces)
    derivatives = (
        f"{coefficient}_{argument}" for coefficient in COEFFICIENTS for argument in arguments
    )
    others = (THRUST_BY_SPEED, *dimensional_names(surfaces), AVL)
    known = (*UNITS, *_TEXTS, *surfaces, *derivatives, INDUCED, THRUST_INPUT, *others)
    if name in known:
        return entry.error(f"{name} has a single value; give the lower and the upper limit")
    if near := advice(name, known):
        return entry.error(f"unknown entry {shown(name)}{near}")
    coefficient, _, argument = name.partition("_")
    if coefficient in COEFFICIENTS and argument.isidentifier():
        return entry.error(
            f"{name}: {argument} has no limits and is therefore not a control surface; give "
            f'{argument} = ["-25 deg", "25 deg"], or remove the entry'
        )
    return entry.error(
        f"unknown entry {shown(name)}; use {', '.join(UNITS)}, {', '.join(_TEXTS)}, derivatives"
        " such as CL_alpha, or limits of an input"
    )


def _refuse_missing(values: Mapping[str, float], derivatives: Collection[str], where: str) -> None:
    """Raise BadInputError with the names of all required entries that are missing."""
    missing = [name for name in REQUIRED if name not in values and name not in derivatives]
    if "mass" not in values and "weight" not in values:
        missing.append("mass")
    if missing:
        raise BadInputError(f"{where}: missing entries: {', '.join(missing)}; add these entries")


def _refuse_sizes(values: Mapping[str, float], entries: Mapping[str, Entry], system: str) -> None:
    """Raise BadInputError for impossible or conflicting data of an aircraft."""
    positive = ("mass", "weight", "Ixx", "Iyy", "Izz", "speed", LARGEST_LIFT, TAIL_ARM)
    for name in (*GEOMETRY, *positive):
        if name in values and values[name] <= 0.0:
            raise entries[name].error(f"{name} is {values[name]:g}; give a positive number")
    foremost, rearmost = CENTERS
    if not foremost <= values.get(CENTER, 0.0) <= rearmost:
        raise entries[CENTER].error(
            f"{CENTER} is {values[CENTER]:g} chords; give {foremost:g} to {rearmost:g}, such as "
            "0.25 for 25 % of the mean chord"
        )
    if TAIL_ARM in values and CENTER not in values:
        raise entries[TAIL_ARM].error(
            f"{TAIL_ARM} is the distance of the tail behind {CENTER}; add {CENTER}"
        )
    if {"mass", "weight"} <= set(values):
        raise entries["weight"].error("both mass and weight are given; remove mass or weight")
    if values["Ixx"] * values["Izz"] <= values.get("Ixz", 0.0) ** 2:
        raise entries["Ixz"].error(
            "Ixx Izz must exceed Ixz^2 for a rigid body; correct Ixx, Izz or Ixz"
        )
    foot = 1.0 if system == "english" else FOOT
    low, high = (foot * end for end in ALTITUDES)
    if not low <= values.get("altitude", 0.0) <= high:
        unit = _unit("altitude", system)
        raise entries["altitude"].error(
            f"altitude is {values['altitude']:g} {unit}; give {low:g} to {high:g} {unit}"
        )
