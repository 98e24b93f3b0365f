"""Texts, names and units in plant files and critic files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.control_systems import (
    LINEAR,
    LINEAR_WITH_OFFSETS,
    OutputRow,
    plant_about,
    plant_model,
)
from hfa_aircraft.model import Model
from hfa_aircraft.signals import PlantNames, Signal
from hfa_support.arrays.columns import Column
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import (
    BadInputError,
    advice,
    numbers_in,
    prefix_errors,
    refuse_unknown,
    shortened,
    shown,
)
from hfa_support.matrices import LARGEST, checked_matrix, shape_text

#: Entries with names and units.
NAME_KEYS = ("states", "inputs", "state_units", "input_units")
#: Other names of these entries, those of python-control and of tables -> names in this project.
NAME_ALIASES = {
    "state_labels": "states",
    "input_labels": "inputs",
    "state_names": "states",
    "input_names": "inputs",
}


def entries_found(stored: Mapping[str, Any]) -> str:
    """Return the end of an error message with the names of all entries of a file.

    The text is " (found: A, B)", or " (the file is empty)".

    stored: name -> value of the entries
    """
    if not stored:
        return " (the file is empty)"
    return f" (found: {shortened(', '.join(sorted(stored)), 200)})"


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Return the texts in one entry of a file, which may have a name of `NAME_ALIASES`.

    The result is () if the entry is missing or contains anything but text.

    stored: name -> value of the entries
    key: name of the entry

    Raises BadInputError for characters that cannot be printed.
    """
    if key not in stored:
        key = next((name for name, of in NAME_ALIASES.items() if of == key and name in stored), key)
    # As objects, because rows of JSON may differ in length.
    entries = np.ravel(np.asarray(stored.get(key, ()), dtype=object)).tolist()
    if not all(isinstance(entry, str) for entry in entries):
        return ()
    for entry in entries:
        if not entry.isprintable():
            raise BadInputError(
                f"{key} contains {shortened(ascii(entry))}, which cannot be printed; use plain text"
            )
    return tuple(entries)


class FileScales(NamedTuple):
    """Factors from the units of a plant to the units of a file.

    A state x and an input u in the plant's units are `states` x and `inputs` u in the file's units.

    states: (n,)
    inputs: (m,)
    """

    states: np.ndarray
    inputs: np.ndarray

    @property
    def gain(self) -> np.ndarray:
        """Factors (m, n) from a gain K of u = -K x in the file to this gain in the plant's units.

        K is diag(inputs)⁻¹ K_file diag(states).
        """
        return self.states / self.inputs[:, None]


def file_scales(stored: Mapping[str, Any], plant: PlantNames) -> FileScales:
    """Return the factors from the plant's units to those of a file: `state_units`, `input_units`.

    The factor is 1 if a unit is unknown in the file or in the plant.

    stored: name -> value of the entries of the file
    plant: names and units of the plant

    Raises BadInputError if the file does not contain a unit for each state or input, if a unit
    cannot be converted, or if the file lists the plant's states or inputs in another order.
    """
    for key in ("states", "inputs"):
        in_file, of_plant = words(stored, key), getattr(plant, key)
        if in_file == of_plant or len(in_file) != len(of_plant):
            continue
        # Unknown names are the author's own, for signals in the order of the plant.
        place_in_plant = {name.lower(): i for i, name in enumerate(of_plant)}
        places = [place_in_plant.get(name.lower(), i) for i, name in enumerate(in_file)]
        if places != list(range(len(of_plant))):
            raise BadInputError(
                f"the {key} are {shortened(', '.join(in_file), 200)} in the file, but in the "
                f"plant {shortened(', '.join(of_plant), 200)}; reorder the matrices or remove "
                "these names"
            )
    return FileScales(
        _scales_of("state", stored, plant.state_units),
        _scales_of("input", stored, plant.input_units),
    )


def _scales_of(signal: str, stored: Mapping[str, Any], of_plant: tuple[str, ...]) -> np.ndarray:
    """Return the factors from the plant's units of all states or inputs to those of a file.

    signal: "state" or "input"
    of_plant: units of the plant, "" for an unknown one
    """
    key = f"{signal}_units"
    units = words(stored, key) or ("",) * len(of_plant)
    if len(units) != len(of_plant):
        raise BadInputError(f"{key} lists {len(units)} units; give one for each {signal}")
    columns = [
        Column(key, f"{signal} {i}", unit or None, (), ()) for i, unit in enumerate(units, 1)
    ]
    factors = [column.factor(unit) for column, unit in zip(columns, of_plant, strict=True)]
    return 1.0 / np.array(factors)


def entries_of(contents: dict[str, Any], needed: set[str]) -> tuple[dict[str, Any], list[str]]:
    """Return the entries of a plant file, and a list of notes for the user.

    The entries of `NAME_ALIASES` are returned under the names of this project.

    contents: entries of the file, from `read_arrays`
    needed: required entries. If none of them is at the top level, all entries are read from the
        only structure that contains all required ones.

    Raises BadInputError if `dt` or `Ts` is no sample time (`sample_time`), for an entry `gamma`,
    which other tools use for delta and for the discount factor, and for matrices of COMPleib and a
    descriptor matrix of MATLAB.
    """
    notes: list[str] = []
    if not needed & set(contents):
        plants = [
            name
            for name, value in contents.items()
            if isinstance(value, dict) and needed <= set(value)
        ]
        if len(plants) == 1:
            contents = contents[plants[0]]
            notes.append(f"{' and '.join(sorted(needed))} are read from the structure {plants[0]}")
    stored = {NAME_ALIASES.get(key, key): value for key, value in contents.items()}
    dt = sample_time(stored)
    for key in ("dt", "Ts"):
        stored.pop(key, None)
    if dt is not None:
        stored["dt"] = dt
    for name in stored:
        if name.lower() == "gamma":
            known = ("delta", "discount") if is_discrete(stored) else ("delta",)
            raise BadInputError(f"unknown entry {name!r}{advice(name, known)}")
    _refuse_other_conventions(stored)
    return stored, notes


def entries_of_row(contents: dict[str, Any], row: str | None) -> dict[str, Any]:
    """Return the entries of one plant of a file, that of a row if the file has several.

    contents: entries of the file, from `read_arrays`
    row: name of a row of `hfa linearize --conditions`, or None

    Raises BadInputError if the row is missing, unknown or without a trim.
    """
    rows = dict(_models(contents))
    if not rows:
        if row is not None:
            raise BadInputError("the file has one plant, without rows; remove --row")
        return contents
    if row is None:
        names = shortened(", ".join(rows), 200)
        raise BadInputError(f"the file has the plants of {len(rows)} rows; add --row NAME: {names}")
    refuse_unknown("unknown row", row, tuple(rows))
    A, B = (np.asarray(rows[row].get(key, ()), dtype=float) for key in "AB")
    if not A.size or np.isnan(A).any():
        raise BadInputError(f"row {row} has no trim and no plant; choose another row")
    shared = {
        key: contents[key] for key in (*NAME_KEYS, "schema", "disturbances") if key in contents
    }
    return {**shared, "A": A, "B": B}


def _models(contents: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and matrices of each row of a file with the plants of several conditions."""
    models, names = contents.get("models"), contents.get("names")
    if isinstance(models, list):
        for model in models:
            if isinstance(model, Mapping) and "name" in model:
                yield str(np.ravel(model["name"])[0]), dict(model)
    elif names is not None and np.ndim(contents.get("A", 0)) == 3:
        matrices = zip(np.ravel(names), contents["A"], contents["B"], strict=True)
        for name, A, B in matrices:
            yield str(name), {"A": A, "B": B}


def _refuse_other_conventions(stored: Mapping[str, Any]) -> None:
    """Raise BadInputError for B1, B2, C1, D12 of COMPleib and a descriptor matrix of MATLAB."""
    # Files that this program wrote have the entry `schema`.
    if "schema" in stored:
        return
    generalized = [key for key in ("B1", "B2", "C1", "C2", "D11", "D12", "D21") if key in stored]
    if generalized:
        raise BadInputError(
            f"{', '.join(generalized)} are of another convention (COMPleib); give instead B (its "
            "B, or B2), E = B1, Q = C1' C1, N = C1' D12 and R = D12' D12"
        )
    if {"C", "D", "E"} <= set(stored) and "delta" not in stored:
        raise BadInputError(
            "E beside C and D may be MATLAB's descriptor matrix of E x' = A x + B u, but here is "
            "that of the disturbance; for a descriptor, give inv(E) A and inv(E) B without E, "
            "otherwise add delta"
        )


def sample_time(stored: Mapping[str, Any]) -> float | None:
    """Return the sample time in the entry `dt` of a file, or in `Ts`, as in MATLAB, s.

    The result is True if it is unknown, for which MATLAB stores -1, and None in continuous time,
    for which python-control stores 0 or None, and MATLAB 0.

    Raises BadInputError for any other entry, and if `dt` and `Ts` differ.
    """
    times = {_seconds(key, stored[key]) for key in ("dt", "Ts") if key in stored}
    if len(times) > 1:
        raise BadInputError("dt and Ts are different sample times; remove one of them")
    return next(iter(times), None)


def _seconds(key: str, value: Any) -> float | bool | None:
    """Return the sample time in `dt` or `Ts`, s, True if unknown, or None in continuous time."""
    entry = np.asarray(value, dtype=object)
    dt = entry.item() if entry.size == 1 else entry.tolist()
    if dt is None or isinstance(dt, bool):
        return True if dt else None
    seconds = one_number(key, dt)
    if key == "Ts" and seconds == -1.0:
        return True
    if not 0.0 <= seconds < math.inf:
        raise BadInputError(f"{key} is {seconds:g}; give the sample time in s, a positive number")
    return seconds or None


def is_discrete(stored: Mapping[str, Any]) -> bool:
    """Return whether the file of a plant contains time = "discrete", or a sample time dt or Ts.

    dt = 0 is continuous time, as in python-control.

    Raises BadInputError if `time` is neither "discrete" nor "continuous".
    """
    time = words(stored, "time")
    if time and time not in (("discrete",), ("continuous",)):
        raise BadInputError(f'time is {shortened(time[0])}; give "continuous" or "discrete"')
    has_dt = sample_time(stored) is not None
    if time == ("continuous",) and has_dt:
        raise BadInputError('dt denotes discrete time, but time is "continuous"; remove dt or time')
    return time == ("discrete",) or has_dt


def doubts_of_time(stored: Mapping[str, Any], A: np.ndarray) -> tuple[str, ...]:
    """Return a question if the file states no time, and each mode of x' = A x would grow, but none
    of x⁺ = A x, as of a sampled plant.

    stored: entries of the file
    A: (n, n)
    """
    eigenvalues = np.linalg.eigvals(A)
    is_like_samples = (eigenvalues.real > 0.0).all() and (np.abs(eigenvalues) <= 1.0).all()
    if not is_like_samples or {"time", "dt"} & set(stored):
        return ()
    return ('every mode of x\' = A x grows, but none of x⁺ = A x: did you mean time = "discrete"?',)


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


def plant_matrices(stored: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices A (n, n) and B (n, m) in a plant file.

    stored: entries of the file

    Raises BadInputError if A or B is missing or not a matrix of numbers, or if the shapes disagree.
    """
    for key in ("A", "B"):
        if key not in stored:
            beside = "give A and B in one file, or in A.csv and B.csv"
            raise BadInputError(f"there is no {key}; {beside}{entries_found(stored)}")
    A = checked_matrix("A", stored["A"], LARGEST)
    B = checked_matrix("B", stored["B"], LARGEST)
    n = len(A)
    if not A.size or not B.size:
        raise BadInputError("A or B is empty; give at least one state and one input")
    if A.shape != (n, n):
        raise BadInputError(f"A is {shape_text(A.shape)}; give a square matrix")
    if len(B) != n:
        wanted = shape_text((n, B.shape[1]))
        raise BadInputError(f"B is {shape_text(B.shape)}; give {wanted}, to match A and B")
    return A, B


def plant_names(stored: Mapping[str, Any]) -> PlantNames:
    """Return the names and units of states and inputs in a file, () where it has none."""
    found: dict[str, Any] = {key: words(stored, key) for key in NAME_KEYS}
    return PlantNames(**found)


#: Schema of a file with a linear model that this program wrote.
WRITTEN = "hfa.linear-model/1"


def written_plant(
    stored: Mapping[str, Any],
    name: str,
    names: PlantNames,
    outputs: tuple[str, ...],
    A: np.ndarray,
    B: np.ndarray,
) -> Model:
    """Return the plant of a file of schema `WRITTEN`, with its offsets, outputs and disturbances.

    stored: name -> value of the entries of the file
    name: name of the model
    names: names of the states and inputs
    outputs: names of the rows of C

    Raises BadInputError for an entry of another shape, and without a unit for each name.
    """
    n, m, k = len(names.states), len(names.inputs), len(outputs)
    disturbances = words(stored, "disturbances")
    unit_texts = words(stored, "output_units") or ("1",) * k
    signals = _signals_at(outputs, unit_texts, numbers_of_shape("output_offsets", stored, (k,)))
    rows = [
        numbers_of_shape(key, stored, (k, size))
        for key, size in (("C", n), ("D", m), ("F", len(disturbances)))
    ]
    # The first note marks a linear plant. The file of one contains this note among its warnings.
    warnings = words(stored, "warnings")
    linear_note = LINEAR if LINEAR in warnings else LINEAR_WITH_OFFSETS
    X0 = numbers_of_shape("state_offsets", stored, (n,))
    U0 = numbers_of_shape("input_offsets", stored, (m,))
    still = np.zeros(len(disturbances))
    return plant_about(
        name,
        states=_signals_at(names.states, words(stored, "state_units"), X0),
        inputs=_signals_at(names.inputs, words(stored, "input_units"), U0),
        disturbances=_signals_at(disturbances, words(stored, "disturbance_units"), still),
        matrices=(A, B, numbers_of_shape("E", stored, (n, len(disturbances)))),
        outputs=dict(zip(outputs, map(OutputRow, signals.values(), *rows), strict=True)),
        notes=tuple(dict.fromkeys((linear_note, *warnings))),
    )


def numbers_of_shape(name: str, stored: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of a file as numbers of this shape, zeros if the file does not have it."""
    if name not in stored:
        return np.zeros(shape)
    array = numbers_in(name, stored[name])
    if array.shape not in (shape, (1, *shape)):  # a .mat file has vectors as rows
        raise BadInputError(f"{name} is {shape_text(array.shape)}; give {shape_text(shape)}")
    return array.reshape(shape)


def _signals_at(
    names: tuple[str, ...], units: tuple[str, ...], offsets: np.ndarray
) -> dict[str, Signal]:
    """Return name -> signal that starts at its offset; there must be a unit for each name."""
    if len(units) != len(names):
        raise BadInputError(f"there are {len(units)} units for {len(names)} names")
    entries = zip(names, units, offsets.tolist(), strict=True)
    return {name: Signal(unit, start=offset) for name, unit, offset in entries}


def linear_plant(path: str) -> Model:
    """Return the model x' = A x + B u of a plant in a file, with its trim at the origin.

    A file without B has a plant without inputs, x' = A x. Q, R and N become `about.weights`. What
    `hfa linearize -o` wrote has its offsets, outputs and disturbances too.

    path: file with A, and optionally B, Q, R, N, and names and units of states and inputs

    Raises BadInputError if the file contains no such plant or the plant is in discrete time.
    """
    contents = read_arrays(path)
    with prefix_errors(path):
        if rows := dict(_models(contents)):
            raise BadInputError(
                f"the file has the plants of {len(rows)} rows; give a file with one plant, or to "
                "hfa solve and verify --model FILE --row NAME"
            )
        stored, _ = entries_of(contents, {"A", "B"})
        if is_discrete(stored):
            raise BadInputError(
                "the plant is in discrete time, which is not supported; give A "
                "and B of x' = A x + B u"
            )
        if "A" in stored and "B" not in stored:
            # `plant_matrices` requires B. Any matrix with n rows serves: no column of it is kept.
            A, any_B = plant_matrices({**stored, "B": stored["A"]})
            B = any_B[:, :0]
        else:
            A, B = plant_matrices(stored)
        n, m = B.shape
        names = plant_names(stored).completed(n, m)
        if words(stored, "schema") == (WRITTEN,):
            return written_plant(stored, path, names, words(stored, "outputs"), A, B)
    model = plant_model(path, names, A, B)
    doubts = doubts_of_time(stored, A)
    weights: dict[str, Any] = {name: stored[name] for name in ("Q", "R", "N") if name in stored}
    unused = ["E"] if "E" in stored and "disturbances" not in stored else []
    if "delta" in stored and one_number("delta", stored["delta"]) < math.inf:
        unused.insert(0, "delta")
    notes_on_model = (*model.about.notes, *doubts)
    if unused:
        verb = "are" if len(unused) > 1 else "is"
        notes_on_model += (
            f"{' and '.join(unused)} of the file {verb} not used; --model uses what the file has",
        )
    return replace(model, about=replace(model.about, weights=weights, notes=notes_on_model))
