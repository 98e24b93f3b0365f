"""Reading of plant files: matrices, names and units."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.weights import weights_of_sizes
from controller.game.zero_sum import Game
from hfa_aircraft.readers.matrices_file import (
    NAME_KEYS,
    entries_of,
    is_discrete,
    one_number,
    plant_matrices,
    plant_names,
    words,
)
from hfa_aircraft.signals import PlantNames
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, prefix_errors, shortened

MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta", "N")
#: Further entries of a plant in discrete time (time = "discrete").
DISCRETE_KEYS = ("time", "dt", "discount")


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
    has_time: True if the file declares continuous or discrete time
    stated: names of the entries A, B, E, Q, R, delta and N that the file contains
    """

    game: Game
    notes: tuple[str, ...]
    provenance: dict[str, str]
    has_time: bool = False
    stated: tuple[str, ...] = ()


def no_defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return no default values, for plants other than the paper's aircraft."""
    return Defaults()


def stored_game(
    path: str | Path,
    *,
    defaults: Callable[[Mapping[str, Any], PlantNames], Defaults] = no_defaults,
    sizes: Callable[[PlantNames], Mapping[str, float]] | None = None,
    **changes: Any,
) -> StoredGame:
    """Return the game of the plant in a file with A, B, Q, R and optionally E, delta and N.

    - Q, R, delta and N are taken from `changes`, else from the file, else from the defaults.
    - Without any value, E is the identity, delta is inf (linear quadratic regulator) and N is 0.
    - In a file with the entry `disturbances`, E describes the wind and is not used.
    - If neither A nor B is at the top level, the entries of the only structure with both are read.
    - With time = "discrete", or the sample time dt, the game is in discrete time, and `defaults` is
      not used. The file may then also contain `discount`.

    path: the plant file
    defaults: function (entries, names) -> defaults for missing entries
    sizes: function of the names -> deviations of which Q and R are 1/size² (`weights_of_sizes`)
    changes: Q, R, delta or N in place of the entry of the file; None keeps the entry

    Raises BadInputError, which names the file, if the file cannot be read, A or B is missing, Q or
    R has no value, or an entry is not valid.
    """
    contents = read_arrays(path)
    with prefix_errors(path):
        stored, notes = entries_of(contents, {"A", "B"})
        parts = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if "disturbances" in stored and "E" in parts:  # a file written by `hfa linearize`
            del parts["E"]
            notes.append("E describes the wind and is not used")
        parts["A"], parts["B"] = A, B = plant_matrices(stored)
        parts |= {key: value for key, value in changes.items() if value is not None}
        used = (*MODEL_KEYS, *NAME_KEYS, *(DISCRETE_KEYS if is_discrete(stored) else ()))
        notes += unused(stored, used, f"a model file contains {', '.join(MODEL_KEYS)}")
        names = plant_names(stored, len(A), B.shape[1], notes)
        names = names._replace(origin=str(path))
        if sizes is not None:
            named = names.completed(*B.shape)
            parts |= weights_of_sizes(sizes(named), named.states, named.inputs)
        if is_discrete(stored):
            defaults = no_defaults
        parts |= _time(stored)
        game = _completed(parts | {"names": names}, defaults(parts, names), notes)
        noted = tuple(f"{path}: {note}" for note in notes)
        return StoredGame(
            game,
            noted,
            _provenance(stored),
            has_time="time" in stored or "dt" in stored,
            stated=tuple(key for key in MODEL_KEYS if key in stored),
        )


def _time(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries dt and discount of a game in discrete time, {} in continuous time."""
    if not is_discrete(stored):
        if "discount" in stored:
            raise BadInputError(
                'discount requires a discrete-time plant; remove it, or add time = "discrete"'
            )
        return {}
    time: dict[str, Any] = {"dt": True}  # discrete time with an unknown sample time
    if stored.get("dt", True) is not True:
        time["dt"] = one_number("dt", stored["dt"])
    if "discount" in stored:
        time["discount"] = one_number("discount", stored["discount"])
    if not time["dt"]:
        raise BadInputError('dt is 0, but time is "discrete"; give the sample time in s')
    return time


def unused(stored: Mapping[str, Any], used: Iterable[str], rule: str) -> list[str]:
    """Return a list with one note that names the entries of a file that are not used.

    rule: what the file contains
    """
    schema = words(stored, "schema")
    if schema and schema[0].startswith("hfa."):  # written by hfa: no entry is misspelled
        return []
    names = shortened(", ".join(sorted(set(stored).difference(used))), 200)
    return [f"unused: {names}; {rule}"] if names else []


def _completed(parts: dict[str, Any], defaults: Defaults, notes: list[str]) -> Game:
    """Return the game of a plant file, with defaults for the entries that are missing."""
    n, m = parts["B"].shape
    values = {"E": np.eye(n), "delta": math.inf, **defaults.values}
    described = {"E": "the identity", "delta": "inf (no disturbance)", **defaults.words}
    missing = [key for key in MODEL_KEYS if key not in parts and key != "N"]
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

    They are in a table `provenance` (TOML, JSON) or have keys `provenance.NAME` (flat files).
    Entries that are not one text are left out.
    """
    table = stored.get("provenance", {})
    entries = dict(table) if isinstance(table, dict) else {}
    for key in stored:
        if key.startswith("provenance."):
            entries[key.removeprefix("provenance.")] = stored[key]
    origin = {}
    for name in entries:
        texts = words(entries, name)
        if len(texts) == 1 and texts[0]:
            origin[name] = texts[0]
    return origin
