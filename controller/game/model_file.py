"""A user's plant, read from .json, .npz, .mat or .csv files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import (
    PlantNames,
    file_scales,
    found_in,
    read_arrays,
    words,
)
from controller.game.zero_sum import LARGEST, Game, checked_matrix
from hfa_model.printed_matrices import published_data
from hfa_model.vectors import LINEAR_STATES, LINEAR_UNITS
from hfa_support.errors import BadInputError, numbers_in, said_of, shortened

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
    found: dict[str, Any] | None = None,
) -> StoredGame:
    """The game of the plant in a file: keys A, B and optionally E (default identity), Q, R, delta.

    found: what `read_arrays` has read of it already.

    An argument counts before the file, the file before the settings of the paper (Section 5.1), whose Q and R
    fit six states and five inputs only; where the file names the aircraft's states in m/s, the same game in m/s.
    Suffixes: .json (rows as lists), .npz, .mat (up to MATLAB 7), .csv (A.csv).
    A structure with A and B is read where the file has neither at its top.
    Raises BadInputError, one line that names the file.
    """
    changes, found = {"Q": Q, "R": R, "delta": delta}, read_arrays(path) if found is None else found
    with said_of(path):
        stored, notes = entries_of(found, {"A", "B"})
        given = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if "disturbances" in stored:  # E is the wind's column in a file of `hfa linearize`, whose game is the paper's
            given.pop("E", None)
        given |= {key: value for key, value in changes.items() if value is not None}
        for key in ("A", "B"):
            if key not in given:
                beside = "a model file holds A and B (.csv, .npy: A.csv with B.csv beside it)"
                raise BadInputError(f"there is no {key}; {beside}{found_in(stored)}")
            given[key] = checked_matrix(key, given[key], LARGEST)
        (n, _), (rows, m) = given["A"].shape, given["B"].shape
        if rows == 1 != n:
            raise BadInputError(
                f"B is one row, 1 x {m}; with {n} states it must have {n} rows: give one input as a column"
            )
        unused = sorted(set(stored) - {*MODEL_KEYS, *_NAMES})
        if unused and not "".join(words(stored, "schema")[:1]).startswith("hfa."):
            notes.append(f"{shortened(', '.join(unused), 200)} not used; a model file holds {', '.join(MODEL_KEYS)}")
        missing = [key for key in MODEL_KEYS if key not in given]
        taken = ", ".join(f"{key} {'the identity' if key == 'E' else 'as in the paper'}" for key in missing)
        if missing:
            wind = "disturbances" in stored and "E" in missing
            absent = "its E is that of the wind and not used" if wind else f"there is no {', '.join(missing)}"
            notes.append(f"{absent}; taken: {taken}")
        names: dict[str, tuple[str, ...]] = {}
        for key, size in zip(_NAMES, (n, m, n, m), strict=True):
            named, is_unit = words(stored, key), key.endswith("units")
            if len(named) == size and (is_unit or len(set(named)) == size):
                names[key] = named
            elif key in stored:
                instead = "none is used" if is_unit else f"they are called {'xu'[key == 'inputs']}1 and so on"
                notes.append(f"{key} has not one {'unit' if is_unit else 'name'} for each; {instead}")
        given = _of_the_paper(names, n, m) | given
        for key, size, of in (("Q", n, "states"), ("R", m, "inputs")):
            if key not in given:
                count = len(published_data()["game"][f"{key}_diag"])
                said = f"the model has {size} {of} and the {key} of the paper is for {count}"
                raise BadInputError(f"{said}; give {key} in the file or as an argument")
        given["delta"] = one_number("delta", given["delta"])
        noted = tuple(f"{path}: {note}" for note in notes)
        return StoredGame(Game(**given), noted, names, _provenance(stored))


def has_all(found: dict[str, Any], *names: str) -> bool:
    """Whether a file, or a structure in it, has these entries."""
    return any(set(names) <= set(each) for each in (found, *found.values()) if isinstance(each, dict))


def entries_of(found: dict[str, Any], needed: set[str]) -> tuple[dict[str, Any], list[str]]:
    """The entries of a plant in continuous time, from the one structure that has the needed ones where the file itself
    has none of them, and what to know of it."""
    notes: list[str] = []
    if not needed & set(found):
        plants = [name for name, value in found.items() if isinstance(value, dict) and needed <= set(value)]
        if len(plants) == 1:
            found = found[plants[0]]
            notes.append(f"{' and '.join(sorted(needed))} are read from its structure {plants[0]}")
    stored = {_OF_CONTROL.get(key, key): value for key, value in found.items()}
    dt = np.asarray(stored.pop("dt", None), dtype=object)  # of python-control: 0 or None for continuous time
    if np.any((dt != 0) & (dt != None)):  # noqa: E711  entry by entry
        said = shortened(str(dt.item() if dt.size == 1 else dt.tolist()))
        raise BadInputError(f"dt is {said}, a model in discrete time; give x' = A x + B u, dt = 0")
    return stored, notes


def one_number(name: str, value: Any) -> float:
    """Of MATLAB a 1 x 1 matrix. BadInputError where it is not one number."""
    try:
        (number,) = np.ravel(numbers_in(name, value)).tolist()
    except ValueError as error:
        raise BadInputError(f"{name} must be one number") from error
    return float(number)


def _of_the_paper(names: dict[str, tuple[str, ...]], n: int, m: int) -> dict[str, Any]:
    """E, Q, R and delta of Section 5.1, as far as they fit; where the file names the aircraft's states in m/s, in m."""
    settings, scales = published_data()["game"], np.ones(n)
    if names.get("states") == LINEAR_STATES:
        scales = file_scales({"state_units": names.get("state_units", ())}, PlantNames(state_units=LINEAR_UNITS))
    found: dict[str, Any] = {"E": np.diag(scales), "delta": settings["delta"]}
    if n == len(settings["Q_diag"]):
        found["Q"] = np.diag(settings["Q_diag"] / scales**2)
    if m == len(settings["R_diag"]):
        found["R"] = np.diag(np.array(settings["R_diag"], dtype=float))
    return found


def _provenance(stored: dict[str, Any]) -> dict[str, str]:
    """Texts of the provenance block: of JSON and .mat a structure, of .npz entries `provenance.version` and so on."""
    block = stored.get("provenance", {})
    found = dict(block) if isinstance(block, dict) else {}
    found |= {key.removeprefix("provenance."): stored[key] for key in stored if key.startswith("provenance.")}
    texts = {name: words(found, name) for name in found}
    return {name: said[0] for name, said in texts.items() if len(said) == 1 and said[0]}
