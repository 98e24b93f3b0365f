"""Plants and critics in users' files: their matrices, names and units; critics once or over
time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.zero_sum import LARGEST, Game, checked_matrix
from hfa_model.printed_matrices import published_data
from hfa_model.vectors import LINEAR_STATES, LINEAR_UNITS
from hfa_support.errors import BadInputError, numbers_in, said_of, shortened
from hfa_support.reporting.unit_system import si_factor, si_unit

MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta")
#: Keys of names and units, used where they are.
_NAMES = ("states", "inputs", "state_units", "input_units")
#: How python-control calls them in a `StateSpace`.
_OF_CONTROL = {"state_labels": "states", "input_labels": "inputs"}
#: What a critic consists of -> dimensions of one.
_NDIM = {"W": 1, "P": 2, "K": 2}
#: Other names of an entry.
_ALSO = {"weights": "W", "gains": "K", "times": "time", "t": "time"}


# Names and units.


def found_in(stored: Mapping[str, Any]) -> str:
    """For a message: the names in a file."""
    return (
        f" (found: {shortened(', '.join(sorted(stored)), 200)})"
        if stored
        else " (the file is empty)"
    )


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """The texts of an entry; () where it holds anything else. BadInputError for what a terminal
    would obey."""
    said = np.ravel(
        np.asarray(stored.get(key, ()), dtype=object)
    ).tolist()  # of JSON: rows may differ in length
    if not all(isinstance(word, str) for word in said):
        return ()
    for word in said:
        if not word.isprintable():
            raise BadInputError(f"{key} has {shortened(ascii(word))}, which cannot be printed")
    return tuple(said)


class PlantNames(NamedTuple):
    """What a plant calls its states and inputs, and the units of the states; () where it does not
    say."""

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    state_units: tuple[str, ...] = ()


UNNAMED = PlantNames()


def file_scales(stored: Mapping[str, Any], plant: PlantNames) -> np.ndarray:
    """s with x_file = s x, (n,), from the entry `state_units`; ones where the file or the plant
    says no units.

    BadInputError for units that are neither the plant's nor their SI or English ones, and where
    `states` or `inputs` of the file are the plant's in another order."""
    for key in ("states", "inputs"):
        said, own = words(stored, key), getattr(plant, key)
        if said != own and sorted(said) == sorted(own):
            raise BadInputError(
                f"its {key} are in the order {shortened(', '.join(said), 200)}; those of the plant are "
                f"{shortened(', '.join(own), 200)}: reorder the matrices, or leave {key} out of the file"
            )
    scales, units = np.ones(len(plant.state_units)), words(stored, "state_units")
    if len(units) != len(scales):
        return scales
    for place, (unit, own) in enumerate(zip(units, plant.state_units, strict=True)):
        if si_unit(own) == unit != own:
            scales[place] = si_factor(own)
        elif si_unit(unit) == own != unit:
            scales[place] = 1.0 / si_factor(unit)
        elif "" not in (unit, own) and unit != own:
            raise BadInputError(
                f"state {place + 1} is in {shortened(unit)} and that of the plant in {own}; convert it, or leave "
                "state_units out of the file"
            )
    return scales


# Plants.


class StoredGame(NamedTuple):
    """The game of a file, and what to know of it: entries that were not used, defaults that were
    taken.

    names: states, inputs and their units as the file has them, by key; a key without one name for
    each is left out. provenance: where the plant comes from, as the file says it: entry -> text.
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
    path: str | Path, *, found: dict[str, Any] | None = None, **changes: Any
) -> StoredGame:
    """The game of the plant in a file: keys A, B and optionally E (default identity), Q, R, delta.

    changes: Q, R, delta, where they are not None. found: what `read_arrays` has read of it already.

    An argument counts before the file, the file before the settings of the paper (Section 5.1),
    whose Q and R fit six states and five inputs only; where the file names the aircraft's states in
    m/s, the same game in m/s. A structure with A and B is read where the file has neither at its
    top. Raises BadInputError, one line that names the file."""
    found = read_arrays(path) if found is None else found
    with said_of(path):
        stored, notes = entries_of(found, {"A", "B"})
        given = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if (
            "disturbances" in stored
        ):  # E is the wind's column in a file of `hfa linearize`, whose game is the paper's
            given.pop("E", None)
        given |= {key: value for key, value in changes.items() if value is not None}
        for key in ("A", "B"):
            if key not in given:
                beside = "a model file holds A and B (.csv, .npy: A.csv with B.csv beside it)"
                raise BadInputError(f"there is no {key}; {beside}{found_in(stored)}")
            given[key] = checked_matrix(key, given[key], LARGEST)
        unused = sorted(set(stored) - {*MODEL_KEYS, *_NAMES})
        if unused and not "".join(words(stored, "schema")[:1]).startswith("hfa."):
            notes.append(
                f"{shortened(', '.join(unused), 200)} not used; a model file holds {', '.join(MODEL_KEYS)}"
            )
        missing = [key for key in MODEL_KEYS if key not in given]
        taken = ", ".join(
            f"{key} {'the identity' if key == 'E' else 'as in the paper'}" for key in missing
        )
        if missing:
            wind = "disturbances" in stored and "E" in missing
            absent = (
                "its E is that of the wind and not used"
                if wind
                else f"there is no {', '.join(missing)}"
            )
            notes.append(f"{absent}; taken: {taken}")
        names: dict[str, tuple[str, ...]] = {}
        n, m = len(given["A"]), given["B"].shape[1]
        for key, size in zip(_NAMES, (n, m, n, m), strict=True):
            named, is_unit = words(stored, key), key.endswith("units")
            if len(named) == size and (is_unit or len(set(named)) == size):
                names[key] = named
            elif key in stored:
                instead = (
                    "none is used"
                    if is_unit
                    else f"they are called {'xu'[key == 'inputs']}1 and so on"
                )
                notes.append(
                    f"{key} has not one {'unit' if is_unit else 'name'} for each; {instead}"
                )
        noted = tuple(f"{path}: {note}" for note in notes)
        return StoredGame(_completed(given, names), noted, names, _provenance(stored))


def has_all(found: dict[str, Any], *names: str) -> bool:
    """Whether a file, or a structure in it, has these entries."""
    return any(
        set(names) <= set(each) for each in (found, *found.values()) if isinstance(each, dict)
    )


def entries_of(found: dict[str, Any], needed: set[str]) -> tuple[dict[str, Any], list[str]]:
    """The entries of a plant in continuous time, from the one structure that has the needed ones
    where the file itself has none of them, and what to know of it."""
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
    dt = np.asarray(
        stored.pop("dt", None), dtype=object
    )  # of python-control: 0 or None for continuous time
    if np.any((dt != 0) & (dt != None)):  # noqa: E711  entry by entry
        said = shortened(str(dt.item() if dt.size == 1 else dt.tolist()))
        raise BadInputError(f"dt is {said}, a model in discrete time; give x' = A x + B u, dt = 0")
    return stored, notes


def one_number(name: str, value: Any) -> float:
    """Of MATLAB a 1 x 1 matrix. BadInputError where it is not one number."""
    found = numbers_in(name, value)
    if found.size != 1:
        raise BadInputError(f"{name} has {found.size} numbers; give one")
    return float(found.item())


def _completed(given: dict[str, Any], names: dict[str, tuple[str, ...]]) -> Game:
    """The game with what is missing from Section 5.1; where the file names the aircraft's states in
    m/s, in m."""
    settings, scales = published_data()["game"], np.ones(len(given["A"]))
    if names.get("states") == LINEAR_STATES:
        scales = file_scales(
            {"state_units": names.get("state_units", ())}, PlantNames(state_units=LINEAR_UNITS)
        )
    usual: dict[str, Any] = {"E": np.diag(scales), "delta": settings["delta"]}
    for key, of, units in (("Q", "states", scales), ("R", "inputs", np.ones(given["B"].shape[1]))):
        diagonal = np.array(settings[f"{key}_diag"], dtype=float)
        if key not in given:
            if len(diagonal) != len(units):
                said = f"the model has {len(units)} {of} and the {key} of the paper is for {len(diagonal)}"
                raise BadInputError(f"{said}; give {key} in the file or as an argument")
            usual[key] = np.diag(diagonal / units**2)
    found = usual | given
    return Game(**found | {"delta": one_number("delta", found["delta"])})


def _provenance(stored: dict[str, Any]) -> dict[str, str]:
    """Texts of the provenance block: of JSON and .mat a structure, of .npz entries
    `provenance.version` and so on."""
    block = stored.get("provenance", {})
    found = dict(block) if isinstance(block, dict) else {}
    found |= {
        key.removeprefix("provenance."): stored[key]
        for key in stored
        if key.startswith("provenance.")
    }
    texts = {name: words(found, name) for name in found}
    return {name: said[0] for name, said in texts.items() if len(said) == 1 and said[0]}
