"""Reading of plant files: matrices, names and units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.file_entries import found_in, words
from controller.game.names import PlantNames
from controller.game.zero_sum import LARGEST, Game, checked_matrix
from hfa_support.entry_points import PARTS, part
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened, shown

MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta")
#: Further entries of a plant in discrete time (time = "discrete").
DISCRETE_KEYS = ("time", "discount", "N")
#: Entries with names and units.
NAME_KEYS = ("states", "inputs", "state_units", "input_units")
#: Names of these entries in a `StateSpace` of python-control -> names in this project.
_OF_CONTROL = {"state_labels": "states", "input_labels": "inputs"}


@dataclass(frozen=True)
class Defaults:
    """Default values for entries that a plant file does not contain.

    values: "E", "Q", "R" or "delta" -> default; entries without a default are omitted
    words: the same keys -> source of the default, for a note: "as in the paper"
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)


class StoredGame(NamedTuple):
    """Game read from a plant file, with notes for the user.

    game: the game
    notes: texts on unused entries, on defaults that were used, and on ignored names
    provenance: entry -> text on the origin of the plant, as stored in the file
    discrete: discrete-time game with the matrices of `game` as its step, or None for a plant in
        continuous time
    has_time: True if the file declares continuous or discrete time
    stated: names of the entries A, B, E, Q, R and delta that the file contains
    """

    game: Game
    notes: tuple[str, ...]
    provenance: dict[str, str]
    discrete: Any = None
    has_time: bool = False
    stated: tuple[str, ...] = ()


def no_defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return no default values, for plants other than the paper's aircraft."""
    return Defaults()


def stored_game(
    path: str | Path,
    *,
    found: dict[str, Any] | None = None,
    defaults: Callable[[Mapping[str, Any], PlantNames], Defaults] = no_defaults,
    **changes: Any,
) -> StoredGame:
    """Return the game of the plant in a file with A, B, Q, R and optionally E and delta.

    - Q, R and delta are taken from `changes`, else from the file, else from the defaults.
    - Without any value, E is the identity and delta is inf (linear quadratic regulator).
    - In a file with the entry `disturbances`, E describes the wind and is not used.
    - If neither A nor B is at the top level, the entries of the only structure with both are read.
    - With time = "discrete", the result also contains the discrete-time game, and `defaults` is not
      used. The file may then also contain `discount` and the cross weights `N`.

    path: the plant file
    found: entries of the file, if `read_arrays` has already read them, or None
    defaults: function (entries, names) -> defaults for missing entries
    changes: Q, R or delta in place of the entry of the file; None keeps the entry

    Raises BadInputError, which names the file, if the file cannot be read, A or B is missing, Q or
    R has no value, or an entry is not valid.
    """
    contents = read_arrays(path) if found is None else found
    with prefix_errors(path):
        stored, notes = entries_of(contents, {"A", "B"})
        parts = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if "disturbances" in stored and "E" in parts:  # a file written by `hfa linearize`
            del parts["E"]
            notes.append("E describes the wind and is not used")
        for key in ("A", "B"):
            if key not in parts:
                beside = "give A and B in one file, or in A.csv and B.csv"
                raise BadInputError(f"there is no {key}; {beside}{found_in(stored)}")
            parts[key] = checked_matrix(key, parts[key], LARGEST)
        parts |= {key: value for key, value in changes.items() if value is not None}
        notes += _unused(stored)
        names = _names(stored, len(parts["A"]), parts["B"].shape[1], notes)
        names = names._replace(origin=str(path))
        if is_discrete(stored):
            defaults = no_defaults
        game = replace(_completed(parts, defaults(parts, names), notes), names=names)
        noted = tuple(f"{path}: {note}" for note in notes)
        return StoredGame(
            game,
            noted,
            _provenance(stored),
            _discrete(stored, game),
            has_time="time" in stored,
            stated=tuple(key for key in MODEL_KEYS if key in stored),
        )


def has_all(found: dict[str, Any], *names: str) -> bool:
    """Return whether a file contains all named entries at its top level or in one structure.

    found: name -> value of the entries of the file
    names: names of the required entries
    """
    structures = [found, *(value for value in found.values() if isinstance(value, dict))]
    return any(set(names) <= set(structure) for structure in structures)


def entries_of(found: dict[str, Any], needed: set[str]) -> tuple[dict[str, Any], list[str]]:
    """Return the entries of a plant file, and a list of notes for the user.

    The entries named as in python-control are returned under the names of this project.

    found: entries of the file, from `read_arrays`
    needed: required entries. If none of them is at the top level, all entries are read from the
        only structure that contains all required ones.

    Raises BadInputError if the entry `dt` of python-control is neither 0 nor None.
    """
    notes: list[str] = []
    if not needed & set(found):
        plants = [
            name
            for name, value in found.items()
            if isinstance(value, dict) and needed <= set(value)
        ]
        if len(plants) == 1:
            found = found[plants[0]]
            notes.append(f"{' and '.join(sorted(needed))} are read from the structure {plants[0]}")
    stored = {_OF_CONTROL.get(key, key): value for key, value in found.items()}
    # python-control stores 0 or None for continuous time.
    dt = np.asarray(stored.pop("dt", None), dtype=object)
    if np.any((dt != 0) & (dt != None)):  # noqa: E711  entry by entry
        text = shortened(str(dt.item() if dt.size == 1 else dt.tolist()))
        raise BadInputError(
            f'dt = {text} denotes discrete time; set dt = 0, or replace dt with time = "discrete"'
        )
    return stored, notes


def is_discrete(stored: Mapping[str, Any]) -> bool:
    """Return whether the file of a plant contains time = "discrete".

    Raises BadInputError if `time` is neither "discrete" nor "continuous".
    """
    time = words(stored, "time")
    if time and time not in (("discrete",), ("continuous",)):
        raise BadInputError(f'time is {shortened(time[0])}; give "continuous" or "discrete"')
    return time == ("discrete",)


def _discrete(stored: Mapping[str, Any], game: Game) -> Any:
    """Return the discrete-time game of a plant file, or None for a plant in continuous time.

    stored: entries of the file, with `discount` and the cross weights `N` for discrete time
    game: game with the matrices of the file

    Raises BadInputError if the file of a continuous-time plant contains entries for discrete time,
    or if such an entry is not valid.
    """
    if not is_discrete(stored):
        for key in DISCRETE_KEYS:
            if key in stored and key != "time":
                raise BadInputError(
                    f'{key} requires a discrete-time plant; remove {key}, or add time = "discrete"'
                )
        return None
    discount = 1.0
    if "discount" in stored:
        discount = one_number("discount", stored["discount"])
    return part(PARTS, "game.steps", 'time = "discrete"')(game, discount, stored.get("N"))


def one_number(name: str, value: Any) -> float:
    """Return the single number in an entry of a plant file.

    name: name of the entry, for messages
    value: a number, a 1 x 1 matrix (MATLAB), or the text "inf" (JSON)

    Raises BadInputError for any other value.
    """
    if isinstance(value, str):
        if value.strip().lower() in ("inf", "infinity"):
            return math.inf
        raise BadInputError(f"{name} is {shown(value)}; give a number without quotes")
    numbers = numbers_in(name, value)
    if numbers.size != 1:
        raise BadInputError(f"{name} has {numbers.size} elements; give a single number")
    return float(numbers.item())


def _unused(stored: Mapping[str, Any]) -> list[str]:
    """Return a list with one note that names the unused entries of a plant file.

    The list is empty if all entries are used, or if this project wrote the file (`schema` begins
    with "hfa.").

    stored: entries of the file
    """
    schema = words(stored, "schema")
    if schema and schema[0].startswith("hfa."):
        return []
    used = {*MODEL_KEYS, *NAME_KEYS}
    if is_discrete(stored):
        used |= set(DISCRETE_KEYS)
    unused = sorted(set(stored) - used)
    if not unused:
        return []
    names = shortened(", ".join(unused), 200)
    return [f"unused: {names}; a model file contains {', '.join(MODEL_KEYS)}"]


def _names(stored: Mapping[str, Any], n: int, m: int, notes: list[str]) -> PlantNames:
    """Return the names and units of states and inputs in a plant file.

    An entry with a wrong number of strings, or with repeated names, is ignored. A note on the
    ignored entry is appended to `notes`.

    stored: entries of the file
    n: number of states
    m: number of inputs
    notes: list of notes for the user
    """
    names: dict[str, tuple[str, ...]] = {}
    for key, size in zip(NAME_KEYS, (n, m, n, m), strict=True):
        texts = words(stored, key)
        is_unit = key.endswith("units")
        if len(texts) == size and (is_unit or len(set(texts)) == size):
            names[key] = texts
        elif key in stored and is_unit:
            notes.append(f"{key} must list a unit for each {key[:-6]}; no units are used")
        elif key in stored:
            letter = "u" if key == "inputs" else "x"
            notes.append(f"{key} must list a different name for each; {letter}1, ... are used")
    states, inputs, state_units, input_units = (names.get(key, ()) for key in NAME_KEYS)
    return PlantNames(states, inputs, state_units, input_units)


def _completed(parts: dict[str, Any], defaults: Defaults, notes: list[str]) -> Game:
    """Return the game of a plant file, with defaults for the entries that are missing.

    A note that lists the missing entries and their defaults is appended to `notes`.

    parts: entries of the file, with A and B
    defaults: default values
    notes: list of notes for the user

    Raises BadInputError if Q or R is missing and has no default, or if an entry is not valid.
    """
    n, m = parts["B"].shape
    values = {"E": np.eye(n), "delta": math.inf, **defaults.values}
    described = {"E": "the identity", "delta": "inf (no disturbance)", **defaults.words}
    missing = [key for key in MODEL_KEYS if key not in parts]
    for key, size in (("Q", n), ("R", m)):
        if key in missing and key not in values:
            raise BadInputError(
                f"there is no {key}; give {key} ({size} x {size}) in the file or as an argument"
            )
    if missing:
        taken = ", ".join(f"{key} {described[key]}" for key in missing)
        notes.append(f"not given: {', '.join(missing)}; used: {taken}")
    complete = values | parts
    return Game(**complete | {"delta": one_number("delta", complete["delta"])})


def _provenance(stored: dict[str, Any]) -> dict[str, str]:
    """Return name -> text for the entries of a plant file that describe the origin of the plant.

    JSON and .mat files store the texts in the structure `provenance`. .npz files store the texts in
    entries such as `provenance.version`.
    """
    block = stored.get("provenance", {})
    entries = dict(block) if isinstance(block, dict) else {}
    for key in stored:
        if key.startswith("provenance."):
            entries[key.removeprefix("provenance.")] = stored[key]
    texts = {name: words(entries, name) for name in entries}
    return {name: text[0] for name, text in texts.items() if len(text) == 1 and text[0]}
