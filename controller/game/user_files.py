"""Plants in users' files: their matrices, names and units."""

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
from hfa_support.errors import BadInputError, numbers_in, said_of, shortened, shown

MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta")
#: What a plant in discrete time (time = "discrete") may have beside them.
DISCRETE_KEYS = ("time", "discount", "N")
#: Keys of names and units, used where they are.
NAME_KEYS = ("states", "inputs", "state_units", "input_units")
#: How python-control calls them in a `StateSpace`.
_OF_CONTROL = {"state_labels": "states", "input_labels": "inputs"}


@dataclass(frozen=True)
class Defaults:
    """Defaults of a game for entries that its file does not have.

    values: of E, Q, R, delta, where there is a default
    words: by the same keys, for the note: "as in the paper"
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)


class StoredGame(NamedTuple):
    """The game of a file, with notes.

    notes: entries that were not used, defaults that were used
    provenance: origin of the plant in the file: entry -> text
    discrete: of a plant in discrete time the game with the step `game`, made by its package; else
        None
    has_time: whether the file states continuous or discrete
    stated: its entries A, B, E, Q, R and delta
    """

    game: Game
    notes: tuple[str, ...]
    provenance: dict[str, str]
    discrete: Any = None
    has_time: bool = False
    stated: tuple[str, ...] = ()


def no_defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return no defaults, for a plant of unknown kind."""
    return Defaults()


def stored_game(
    path: str | Path,
    *,
    found: dict[str, Any] | None = None,
    defaults: Callable[[Mapping[str, Any], PlantNames], Defaults] = no_defaults,
    **changes: Any,
) -> StoredGame:
    """The game of the plant in a file: keys A, B, Q, R and optionally E and delta.

    found: entries that `read_arrays` has read
    defaults: (parts, names) -> defaults for missing entries
    changes: of Q, R, delta, where they are not None

    An argument overrides the file, and the file overrides the defaults. Without any, E is the
    identity and delta is inf (no disturbance: the linear quadratic regulator). A structure with A
    and B is read where the file has neither at its top. With time = "discrete" it is a step of a
    game in discrete time, with `discount` and cross weights `N` where the file has them. Raises
    BadInputError, one line that names the file."""
    contents = read_arrays(path) if found is None else found
    with said_of(path):
        stored, notes = entries_of(contents, {"A", "B"})
        parts = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if "disturbances" in stored and "E" in parts:  # of `hfa linearize`
            del parts["E"]
            notes.append("its E is that of the wind and not used")
        for key in ("A", "B"):
            if key not in parts:
                beside = "a model file contains A and B (.csv, .npy: A.csv and B.csv in one folder)"
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
    """Return whether a file, or a structure in it, has these entries."""
    structures = [found, *(value for value in found.values() if isinstance(value, dict))]
    return any(set(names) <= set(structure) for structure in structures)


def entries_of(found: dict[str, Any], needed: set[str]) -> tuple[dict[str, Any], list[str]]:
    """The entries of a plant by the names of this project, and notes on them.

    found: the arrays that `read_arrays` has read
    needed: entries that the plant must have; where the file has none of them, but one structure in
        it has all, the entries are those of the structure

    Raises BadInputError where python-control's `dt` says discrete time.
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
            notes.append(f"{' and '.join(sorted(needed))} are read from its structure {plants[0]}")
    stored = {_OF_CONTROL.get(key, key): value for key, value in found.items()}
    # Of python-control: 0 or None for continuous time.
    dt = np.asarray(stored.pop("dt", None), dtype=object)
    if np.any((dt != 0) & (dt != None)):  # noqa: E711  entry by entry
        text = shortened(str(dt.item() if dt.size == 1 else dt.tolist()))
        raise BadInputError(
            f"dt is {text}, a model in discrete time; give x' = A x + B u, dt = 0, or time ="
            ' "discrete" without dt'
        )
    return stored, notes


def is_discrete(stored: Mapping[str, Any]) -> bool:
    """Return whether a plant declares time = "discrete". Raises BadInputError for another word."""
    time = words(stored, "time")
    if time and time not in (("discrete",), ("continuous",)):
        raise BadInputError(f'time is {shortened(time[0])}; it must be "continuous" or "discrete"')
    return time == ("discrete",)


def _discrete(stored: Mapping[str, Any], game: Game) -> Any:
    """The game in discrete time whose step this is; None in continuous time."""
    if not is_discrete(stored):
        for key in DISCRETE_KEYS:
            if key in stored and key != "time":
                raise BadInputError(
                    f'{key} belongs to discrete time; did you mean time = "discrete"?'
                )
        return None
    discount = 1.0
    if "discount" in stored:
        discount = one_number("discount", stored["discount"])
    return part(PARTS, "game.steps", 'time = "discrete"')(game, discount, stored.get("N"))


def one_number(name: str, value: Any) -> float:
    """An entry of a file that must be one number.

    value: a number, a 1 x 1 matrix (MATLAB), or the text "inf" (JSON)

    Raises BadInputError where it is anything else.
    """
    if isinstance(value, str):
        if value.strip().lower() in ("inf", "infinity"):
            return math.inf
        raise BadInputError(f"{name} is {shown(value)}; give a number without quotes")
    numbers = numbers_in(name, value)
    if numbers.size != 1:
        raise BadInputError(f"{name} has {numbers.size} numbers; give one")
    return float(numbers.item())


def _unused(stored: Mapping[str, Any]) -> list[str]:
    """Return a note that names the unused entries; [] without any.

    Files of this project, whose `schema` begins with "hfa.", have further entries and get no note.
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
    return [f"{names} not used; a model file contains {', '.join(MODEL_KEYS)}"]


def _names(stored: Mapping[str, Any], n: int, m: int, notes: list[str]) -> PlantNames:
    """Names and units that a file has one for each of; the others are noted."""
    names: dict[str, tuple[str, ...]] = {}
    for key, size in zip(NAME_KEYS, (n, m, n, m), strict=True):
        texts = words(stored, key)
        is_unit = key.endswith("units")
        if len(texts) == size and (is_unit or len(set(texts)) == size):
            names[key] = texts
        elif key in stored and is_unit:
            notes.append(f"{key} needs one unit for each; none is used")
        elif key in stored:
            letter = "u" if key == "inputs" else "x"
            notes.append(f"{key} has not one name for each; they are called {letter}1 and so on")
    states, inputs, state_units, input_units = (names.get(key, ()) for key in NAME_KEYS)
    return PlantNames(states, inputs, state_units, input_units)


def _completed(parts: dict[str, Any], defaults: Defaults, notes: list[str]) -> Game:
    """The game with its defaults, which are noted."""
    n, m = parts["B"].shape
    values = {"E": np.eye(n), "delta": math.inf, **defaults.values}
    described = {"E": "the identity", "delta": "inf (no disturbance)", **defaults.words}
    missing = [key for key in MODEL_KEYS if key not in parts]
    for key, size, what in (("Q", n, "states"), ("R", m, "inputs")):
        if key in missing and key not in values:
            raise BadInputError(
                f"there is no {key}; give {key} of the {size} {what} in the file or as an argument"
            )
    if missing:
        taken = ", ".join(f"{key} {described[key]}" for key in missing)
        notes.append(f"there is no {', '.join(missing)}; used: {taken}")
    complete = values | parts
    return Game(**complete | {"delta": one_number("delta", complete["delta"])})


def _provenance(stored: dict[str, Any]) -> dict[str, str]:
    """Texts of the provenance block: of JSON and .mat a structure, of .npz entries
    `provenance.version` and so on."""
    block = stored.get("provenance", {})
    entries = dict(block) if isinstance(block, dict) else {}
    for key in stored:
        if key.startswith("provenance."):
            entries[key.removeprefix("provenance.")] = stored[key]
    texts = {name: words(entries, name) for name in entries}
    return {name: text[0] for name, text in texts.items() if len(text) == 1 and text[0]}
