"""A user's plant, read from .json, .npz, .mat or .csv files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import aircraft_scales, found_in, read_arrays, real_array, words
from controller.game.zero_sum import Game, matrix_of
from hfa_model.printed_matrices import published_data
from hfa_support.errors import BadInputError, said_of, shortened

MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta")
#: Keys of names and units, used where they are.
_NAMES = ("states", "inputs", "state_units", "input_units")
#: How python-control calls them in a `StateSpace`, and what else it has.
_OF_CONTROL = {"state_labels": "states", "input_labels": "inputs"}


class StoredGame(NamedTuple):
    """The game of a file, and what to know of it: entries that were not used, defaults that were taken.

    names: states, inputs and their units as the file has them, by key; a key without one name for each is left out.
    provenance: where the plant comes from, as the file says it: entry -> text.
    """

    game: Game
    notes: tuple[str, ...]
    names: dict[str, tuple[str, ...]]
    provenance: dict[str, str]


def load_game(path: str | Path, **changes: Any) -> Game:
    """The game of `stored_game`, whose notes become warnings."""
    found = stored_game(path, **changes)
    for note in found.notes:
        warnings.warn(note, stacklevel=2)
    return found.game


def stored_game(
    path: str | Path,
    *,
    Q: np.ndarray | None = None,
    R: np.ndarray | None = None,
    delta: float | None = None,
) -> StoredGame:
    """The game of the plant in a file: keys A, B and optionally E (default identity), Q, R, delta.

    An argument counts before the file, the file before the settings of the paper (Section 5.1), whose Q and R
    fit six states and five inputs only; where the file names the aircraft's states in m/s, the same game in m/s.
    Suffixes: .json (rows as lists), .npz, .mat (up to MATLAB 7), .csv (A.csv).
    A structure with A and B is read where the file has neither beside it.
    Raises BadInputError, one line that names the file.
    """
    found, inside = _plant_in(read_arrays(path))
    stored = {_OF_CONTROL.get(key, key): value for key, value in found.items()}
    _refuse_discrete(path, stored.pop("dt", None))
    given = {key: stored[key] for key in MODEL_KEYS if key in stored}
    if "disturbances" in stored:
        given.pop("E", None)  # the wind's column in a file of `hfa linearize`; the game of such a file is the paper's
    given |= {key: value for key, value in (("Q", Q), ("R", R), ("delta", delta)) if value is not None}
    for key in ("A", "B"):
        if key not in given:
            raise BadInputError(f"{path}: there is no {key}; a model file holds A and B{found_in(stored)}")
    notes = (f"{path}: A and B are read from its structure {inside}",) * bool(inside) + _notes(path, stored, given)
    with said_of(path):
        shape_A, shape_B = (matrix_of(key, given[key]).shape for key in ("A", "B"))
    if shape_B[0] == 1 != shape_A[0]:
        raise BadInputError(
            f"{path}: B is one row, 1 x {shape_B[1]}; with {shape_A[0]} states it must have {shape_A[0]} rows: give "
            "one input as a column"
        )
    settings = published_data()["game"]
    names = _names(stored, shape_A[0], shape_B[1])
    notes += tuple(
        f"{path}: {key} has not one {instead}"
        for key, instead in (
            ("states", "name for each; they are called x1 and so on"),
            ("inputs", "name for each; they are called u1 and so on"),
            ("state_units", "unit for each; none is used"),
            ("input_units", "unit for each; none is used"),
        )
        if key in stored and key not in names
    )
    scales = aircraft_scales(names, shape_A[0])
    given.setdefault("E", np.diag(scales))
    for key, size, of in (("Q", shape_A[0], "states"), ("R", shape_B[1], "inputs")):
        diagonal = settings[f"{key}_diag"]
        if key not in given and size != len(diagonal):
            raise BadInputError(
                f"{path}: the model has {size} {of} and the {key} of the paper is for {len(diagonal)}; "
                f"give {key} in the file or as an argument"
            )
        if key not in given:
            given[key] = np.diag(diagonal / scales**2 if key == "Q" else np.array(diagonal, dtype=float))
    given["delta"] = _scalar(path, "delta", given.get("delta", settings["delta"]))
    with said_of(path):
        return StoredGame(Game(**given), notes, names, _provenance(stored))


def _plant_in(stored: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """The entries of the plant, and the name of the structure that they are in; "" where they are not in one."""
    if "A" not in stored and "B" not in stored:
        plants = [name for name, value in stored.items() if isinstance(value, dict) and {"A", "B"} <= set(value)]
        if len(plants) == 1:
            return stored[plants[0]], plants[0]
    return stored, ""


def _provenance(stored: dict[str, Any]) -> dict[str, str]:
    """Texts of the provenance block: of JSON and .mat a structure, of .npz entries `provenance.version` and so on."""
    block = stored.get("provenance", {})
    found = dict(block) if isinstance(block, dict) else {}
    found |= {
        name.removeprefix("provenance."): value for name, value in stored.items() if name.startswith("provenance.")
    }
    texts = {name: words(found, name) for name in found}
    return {name: said[0] for name, said in texts.items() if len(said) == 1 and said[0]}


def _refuse_discrete(path: str | Path, dt: Any) -> None:
    """python-control's dt: 0 or None for continuous time."""
    found = np.asarray(dt, dtype=object)
    if dt is not None and np.any(found != 0):
        said = shortened(str(found.item() if found.size == 1 else dt))  # in a .mat file a number is a matrix
        raise BadInputError(f"{path}: dt is {said}, a model in discrete time; give x' = A x + B u, dt = 0")


def _names(stored: dict[str, Any], states: int, inputs: int) -> dict[str, tuple[str, ...]]:
    sizes = {"states": states, "state_units": states, "inputs": inputs, "input_units": inputs}
    found = {key: words(stored, key) for key in sizes}
    once = {key: said if key.endswith("units") else tuple(dict.fromkeys(said)) for key, said in found.items()}
    return {key: said for key, said in once.items() if len(found[key]) == len(said) == sizes[key]}


def _notes(path: str | Path, stored: dict[str, Any], given: dict[str, Any]) -> tuple[str, ...]:
    """Which entries were not used, unless this project wrote them, and which defaults were taken."""
    notes = []
    unused = sorted(set(stored) - {*MODEL_KEYS, *_NAMES})
    if unused and not "".join(words(stored, "schema")[:1]).startswith("hfa."):
        named = shortened(", ".join(name if name.isprintable() else repr(name) for name in unused), 200)
        notes.append(f"{path}: {named} not used; a model file holds {', '.join(MODEL_KEYS)}")
    missing = [key for key in MODEL_KEYS if key not in given]
    if "disturbances" in stored and "E" in missing:
        notes.append(f"{path}: its E is that of the wind and not used; taken: {_defaults(missing)}")
    elif missing:
        notes.append(f"{path}: there is no {', '.join(missing)}; taken: {_defaults(missing)}")
    return tuple(notes)


def _defaults(missing: list[str]) -> str:
    return ", ".join(f"{key} {'the identity' if key == 'E' else 'as in the paper'}" for key in missing)


def parse_diagonal(name: str, text: str) -> np.ndarray:
    """diag(a, b, ...) from "a,b,...", (n, n): how Q and R are given on the command line.

    Raises BadInputError when an entry is not a number.
    """
    entries = []
    for position, entry in enumerate(text.split(","), start=1):
        try:
            entries.append(float(entry))
        except ValueError as error:
            raise BadInputError(
                f"{name}: entry {position} is {entry.strip()!r}; give the diagonal as numbers, as in 1,0.5,2"
            ) from error
    return np.diag(entries)


def _scalar(path: str | Path, name: str, value: Any) -> float:
    """One number, also from the 1 x 1 matrix as which MATLAB stores it; infinity is allowed."""
    try:
        (number,) = np.ravel(real_array(name, value))
    except ValueError as error:
        raise BadInputError(f"{path}: {name} must be one number") from error
    return float(number)
