"""Recorded transitions of a plant: the layouts of their files, and what is read of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from controller.game.linear_game import weights_of_sizes
from controller.game.zero_sum import Game
from controller.learning.recording import Transitions
from hfa_aircraft.readers.matrices_file import (
    NAME_ALIASES,
    NAME_KEYS,
    entries_found,
    plant_names,
    sample_time,
    words,
)
from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_support.arrays.columns import Column, Label, matched
from hfa_support.arrays.tables import Read, read_source, sources
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened
from hfa_support.matrices import LARGEST, shape_text
from hfa_support.reporting.text import numbered

#: Matrix of the ends of transitions -> suffixes of their columns.
_SUFFIXES_OF_ENDS = {"x_next": ("_next",), "x_rate": ("_dot", "_rate")}
#: Flags of the last row of an episode, in libraries of reinforcement learning.
_LAST = (
    *("terminals", "terminal", "terminated", "terminations", "timeouts", "truncated"),
    *("truncations", "dones", "done"),
)
#: Columns that are no signals -> unit.
_NO_SIGNALS = {"time": "s", "dt": "s", **dict.fromkeys(("episode", *_LAST), "")}
#: Columns of such libraries that are not used.
_NO_INPUTS = ("reward", "rewards", "return", "infos", "index", "step")
#: Other names of matrices.
_ALIASES = {
    **dict.fromkeys(("observations", "observation", "obs", "X"), "x"),
    **dict.fromkeys(("actions", "action", "U"), "u"),
    **dict.fromkeys(("next_observations", "next_observation", "next_obs"), "x_next"),
    **dict.fromkeys(("x_dot", "xdot"), "x_rate"),
}
#: Entries that are matrices.
_MATRICES = ("x", "u", "d", *_SUFFIXES_OF_ENDS)


def transitions_in(data: Any, game: Game) -> Transitions:
    """Return the transitions of recorded data in the order and the units of a game (`learn`).

    Raises BadInputError, with the source and the row, for data that are no transitions of the game.
    """
    parts: list[Transitions] = []
    names: list[str] = []  # of rows
    for name, record in _records(data, game.names):
        with prefix_errors(name):
            parts.append(_transitions(record, game))
        names += [f"{name}: {row}" for row in parts[-1].rows]
    begins, ends, follows, roundings, holds, notes, rows = zip(*parts, strict=True)
    if len({(len(rounding), hold) for rounding, hold in zip(roundings, holds, strict=True)}) > 1:
        raise BadInputError(
            "the episodes differ in sample time or in disturbances; give equal ones"
        )
    return Transitions(
        np.concatenate(begins),
        np.concatenate(ends),
        np.concatenate(follows),
        np.min(roundings, axis=0),
        holds[0],
        tuple(dict.fromkeys(chain(*notes))),  # each once
        names if len(parts) > 1 else rows[0],
    )


def game_of_data(
    data: Any,
    sizes: Callable[[PlantNames], Mapping[str, float]] | None = None,
    **weights: Any,
) -> Game:
    """Return the game of recorded data without a plant: A and B are 0, names are those of the data.

    Rates are of continuous time, and so are samples whose entry `time` is "continuous".

    sizes: function of the names -> deviations of which Q and R are 1/size² (`weights_of_sizes`)
    weights: Q, R, and optionally delta and N
    """
    name, record = next(_records(data, UNNAMED))  # of the first source
    with prefix_errors(name):
        names, entries = record.names._replace(origin=name), record.entries
        n, m = len(names.states), len(names.inputs)
        is_continuous = "x_rate" in record.blocks or words(entries, "time") == ("continuous",)
        dt = None if is_continuous else sample_time(entries) or True  # True if it is not known
        if sizes is not None:
            weights |= weights_of_sizes(sizes(names), names.states, names.inputs)
        for matrix in ("Q", "R"):
            if matrix not in weights:
                raise BadInputError(
                    f"data without a plant require a cost; give {matrix} (--{matrix})"
                )
        return Game(np.zeros((n, n)), np.zeros((n, m)), names=names, dt=dt, **weights)


class _Record(NamedTuple):
    """Samples of one file, mapping or table.

    names: of its states and inputs, with the units to which they are converted
    blocks: "x", "u", "d", "x_next" and "x_rate" as far as recorded -> columns
    units: name of a column -> unit to which it is converted; "" if unknown
    marks: columns of times and ends of episodes
    entries: single numbers and words: "dt", "time"
    notes: sentences on what is not used or assumed
    """

    names: PlantNames
    blocks: dict[str, list[Column]]
    units: Mapping[str, str]
    marks: dict[str, Column]
    entries: Mapping[str, Any]
    notes: list[str]


def _records(data: Any, names: PlantNames) -> Iterator[tuple[str, _Record]]:
    """Yield the name and the samples of each source of data (`learn`).

    names: names of the states and inputs, which are columns. Without names, a state is a column
        beside one of its next value or rate, such as alpha beside alpha_next

    Raises BadInputError, which names the source, if it cannot be read.
    """
    for name, source in sources(data, "data"):
        with prefix_errors(name):
            yield from _records_in(read_source(source, name), name, names)


def _records_in(read: Read, name: str, names: PlantNames) -> Iterator[tuple[str, _Record]]:
    """Yield the name and the samples of a source, or of each of its groups, as of Minari."""
    groups = {key: group for key, group in read.entries.items() if isinstance(group, Mapping)}
    if groups and len(groups) == len(read.entries):
        for key, group in groups.items():
            of_group = f"{name}, {key}"
            yield from _records_in(read_source(group, of_group), of_group, names)
        return
    entries = {_ALIASES.get(key, key): values for key, values in read.entries.items()}
    signals = {*names.states, *names.inputs}
    is_named = signals and signals <= {column.name for column in read.columns}
    if "x" in entries and not is_named:  # no state x of the plant
        yield name, _of_matrices(entries, name, names)
    else:
        yield name, _of_columns(read.columns, names, entries, [])


def _of_matrices(entries: Mapping[str, Any], where: str, plant: PlantNames) -> _Record:
    """Return the samples of x (N, n) or (E, T, n) and of what is beside it.

    E episodes follow each other. A last row of x alone ends the last step.
    """
    if "u" not in entries:
        raise BadInputError(f"there is no u{entries_found(entries)}; add it")
    x = np.atleast_1d(entries["x"])
    shape = x.shape[: max(1, x.ndim - 1)]  # (N,) or (E, T)
    if len(shape) > 1:
        entries = {"episode": np.indices(shape)[0], **entries}
    blocks: dict[str, np.ndarray] = {}  # (*shape, width)
    for key, values in entries.items():
        array = np.asarray(values)
        if key in _MATRICES:
            array = np.atleast_1d(numbers_in(key, values))
        if key == "episode":  # names, or numbers
            array = np.unique(array, return_inverse=True)[1].reshape(array.shape)
        if array.ndim >= len(shape) and array.dtype.kind in "iufb":
            width = math.prod(array.shape[len(shape) :])
            blocks[key] = array.reshape(*array.shape[: len(shape)], width)
    names, notes = _names_of(entries, plant, blocks)
    of_states = [*zip(names.states, names.state_units, strict=True)]
    labels = {
        "x": of_states,
        "u": [*zip(names.inputs, names.input_units, strict=True)],
        "d": [(name, "") for name in numbered("d", blocks.get("d", blocks["x"]).shape[-1])],
        "x_next": [(f"{name}_next", unit) for name, unit in of_states],
        "x_rate": [(f"{name}_dot", unit and f"{unit}/s") for name, unit in of_states],
    }
    rows, columns = range(1, math.prod(shape) + 1), []
    for key, block in blocks.items():
        of_key = labels.get(key, [Label.of(key)])
        samples = np.full((*shape, len(of_key)), np.nan)
        if block.shape in (samples.shape, samples[..., 1:, :].shape):
            samples[..., : block.shape[-2], :] = block
            if block.size < samples.size and key in _LAST:
                samples[..., -2, :] = False  # x has the end of this step, too
            cells = samples.reshape(-1, len(of_key)).T
            columns += [
                Column(where, name, unit or None, each, rows)
                for (name, unit), each in zip(of_key, cells, strict=True)
            ]
        elif key in (*_MATRICES, *_NO_SIGNALS):
            raise BadInputError(
                f"{key} is {shape_text(block.shape)}; give {shape_text(samples.shape)}, a row for "
                "each sample"
            )
    return _of_columns(columns, plant if plant.states else names, entries, notes)


def _names_of(
    entries: Mapping[str, Any], plant: PlantNames, blocks: Mapping[str, np.ndarray]
) -> tuple[PlantNames, list[str]]:
    """Return the names and units of the columns of x and u, and notes.

    Other names than those of the plant are its own, in its order, with a note.
    """
    names, notes = plant_names(entries), []
    for key in NAME_KEYS[:2]:
        of_data, known = getattr(names, key), getattr(plant, key)
        if known and {*of_data} != {*known}:
            names = names._replace(**{key: known})
            if of_data:
                notes.append(f"{', '.join(of_data)} of the data, taken as {', '.join(known)}")
    n, m = len(names.states), len(names.inputs)
    return names.completed(n or blocks["x"].shape[-1], m or blocks["u"].shape[-1]), notes


def _of_columns(
    columns: Sequence[Column], names: PlantNames, entries: Mapping[str, Any], notes: list[str]
) -> _Record:
    """Return the samples of columns, by their names, such as alpha and alpha_next.

    They are in the units of the plant, if it has any, and otherwise in those of the columns.

    entries: what is beside the columns
    """
    signals = (*names.states, *names.inputs)  # before words such as time
    units = dict(zip(signals, (*names.state_units, *names.input_units), strict=False))
    named = matched(columns, _NO_SIGNALS | dict.fromkeys(signals, ""))
    states, inputs, disturbances = _signals_among(named, names)
    if not states or not inputs:
        missing = ", ".join(name for name in signals if name not in named)
        raise BadInputError(
            "the data have neither x and u nor columns of all states and inputs "
            f"(there is no {missing or 'alpha, alpha_next, elevator'}){entries_found(named)}; name "
            "the columns so, with units as in alpha [deg], or give a plant that names them"
        )
    units = {name: units.get(name) or named[name].unit or "" for name in (*states, *inputs)}
    of_signals = zip("xud", (states, inputs, disturbances), strict=True)
    blocks = {key: [named[name] for name in of_kind] for key, of_kind in of_signals if of_kind}
    names = PlantNames(
        tuple(states),
        tuple(inputs),
        tuple(units[name] for name in states),
        tuple(units[name] for name in inputs),
    )
    for key, suffixes in _SUFFIXES_OF_ENDS.items():
        ends = [_end_of(named, state, states, suffixes) for state in states]
        if {"", *states}.issuperset(ends):
            continue
        of_time = "/s" if key == "x_rate" else ""
        for state, end in zip(states, ends, strict=True):
            unit = f"{units[state]}{of_time}" if units[state] else ""
            if not end or (named[end].unit and not unit):
                label = f"{end or state + suffixes[-1]} [{unit}]".removesuffix(" []")
                raise BadInputError(f"there is no column {label}; add it, or remove the others")
            units[end] = unit
        blocks[key] = [named[end] for end in ends]
    marks = {name: column for name, column in named.items() if name in _NO_SIGNALS}
    used = [*chain(*blocks.values())]
    if len({len(column.cells) for column in (*used, *marks.values())}) > 1:
        raise BadInputError("the columns differ in length; give columns of one length")
    if "dt" in marks:
        entries = {**entries, "dt": np.unique(marks["dt"].numbers("s"))}  # one number
    seen = {*_MATRICES, *_NO_SIGNALS, *NAME_KEYS, *NAME_ALIASES, "Ts"}
    seen |= {column.name for column in used}
    unused = [name for name in named if name not in seen]
    seen |= {column.name for column in columns}
    unused += [key for key in entries if Label.of(key).name not in seen]
    assumed = [
        f"{each.name} in {units[each.name]}"
        for each in used
        if units.get(each.name) and not each.unit
    ]
    for what, listed in (
        ("without a unit, taken in that of the plant", assumed),
        ("not used, as no state or input of the plant", unused),
    ):
        if listed:
            notes.append(f"{what}: {shortened(', '.join(listed), 200)}")
    return _Record(names, blocks, units, marks, entries, notes)


def _end_of(
    columns: Collection[str], state: str, states: Sequence[str], suffixes: Sequence[str]
) -> str:
    """Return the column of the end of a state, or "". It may be a state: pitch_rate of pitch."""
    ends = [f"{state}{suffix}" for suffix in suffixes if f"{state}{suffix}" in columns]
    return min(ends, key=lambda end: end in states, default="")


def _signals_among(
    columns: Mapping[str, Column], names: PlantNames
) -> tuple[list[str], list[str], list[str]]:
    """Return the names of the states, inputs and disturbances among columns.

    The states are those of the plant, if the table has all of them, and otherwise the columns
    beside one of their next value or rate, such as alpha beside alpha_next. The inputs are those of
    the plant, if the table has all of them, and otherwise all other columns.
    """
    states: list[str] = []
    for suffixes in _SUFFIXES_OF_ENDS.values():
        states = states or [name for name in columns if _end_of(columns, name, (), suffixes)]
    if names.states and columns.keys() >= {*names.states}:
        states = list(names.states)
    disturbances = [name for name in columns if re.fullmatch(r"d\d*", name)]
    every = [suffix for suffixes in _SUFFIXES_OF_ENDS.values() for suffix in suffixes]
    ends = {f"{state}{suffix}" for suffix in every for state in states}
    no_inputs = {*states, *disturbances, *_NO_SIGNALS, *_NO_INPUTS, *ends}
    inputs = [name for name in columns if name not in no_inputs]
    if names.inputs and columns.keys() >= {*names.inputs}:
        inputs = list(names.inputs)
    return states, inputs, disturbances


def _transitions(record: _Record, game: Game) -> Transitions:
    """Return the transitions of samples in the units of a game."""
    blocks, notes, rows_of = record.blocks, record.notes, record.blocks["x"][0].rows
    end, *others = [key for key in _SUFFIXES_OF_ENDS if key in blocks] or [""]
    if others:
        raise BadInputError("the data have x_next and x_rate; remove one of them")
    if end == "x_rate" and game.is_discrete:
        raise BadInputError("x_rate is of continuous time, the game is discrete; give x_next")
    of_begins = [*blocks["x"], *blocks["u"], *blocks.get("d", ())]
    for matrix, count in zip("xu", game.B.shape, strict=True):
        if len(blocks[matrix]) != count:
            raise BadInputError(f"{matrix} has {len(blocks[matrix])} columns; give {count}")
    k = len(blocks.get("d", ()))
    if k and math.isfinite(game.delta) and k != game.E.shape[1]:
        notes.append(f"E of the game is replaced by {k} recorded disturbances")
    starts = _starts(record)
    rows = np.arange(len(starts))
    if not end:
        # The transition of a row ends at the next row, unless an episode begins there.
        rows = np.flatnonzero(~starts[1:])
        for row in np.flatnonzero(starts & np.append(starts[1:], True)).tolist():
            raise BadInputError(
                f"row {rows_of[row]} is an episode of one row, which has no next state; "
                "remove it, or give x_next"
            )
    begins = _numbers(of_begins, record.units, rows)
    ends = _numbers(blocks[end or "x"], record.units, rows if end else rows + 1)
    follows = np.zeros(len(rows), dtype=bool)
    if end != "x_rate":
        follows[1:] = (ends[:-1] == begins[1:, : len(game.A)]).all(axis=1)
    factors = [column.factor(record.units.get(column.name, "")) for column in of_begins]
    return Transitions(
        begins=begins,
        ends=ends,
        follows=follows,
        rounding=_last_digits(begins / factors) * factors,
        hold=None if end == "x_rate" else _time_of_hold(record, game, ~follows if end else starts),
        notes=tuple(notes),
        rows=[str(rows_of[row]) for row in rows.tolist()],
    )


def _numbers(block: Sequence[Column], units: Mapping[str, str], rows: np.ndarray) -> np.ndarray:
    """Return some rows of columns in their units."""
    chosen = []
    for column in block:
        numbers = column.numbers(units.get(column.name, ""))
        is_wrong = np.zeros(len(numbers), dtype=bool)
        is_wrong[rows] = ~(np.abs(numbers[rows]) <= LARGEST)
        column.refuse(is_wrong, "has no number; remove the row, and begin another episode there")
        chosen.append(numbers[rows])
    return np.column_stack(chosen)


def _starts(record: _Record) -> np.ndarray:
    """Return whether a row is the first of an episode, (N,)."""
    count = len(record.blocks["x"][0].cells)
    starts = np.arange(count) == 0
    if "episode" in record.marks:
        labels = np.asarray(record.marks["episode"].cells)
        starts[1:] |= labels[1:] != labels[:-1]
    for name in {*_LAST} & {*record.marks}:
        texts = np.char.lower(np.asarray(record.marks[name].cells)[:-1].astype(str))
        starts[1:] |= ~np.isin(texts, ("false", "0", "0.0", ""))
    return starts


def _time_of_hold(record: _Record, game: Game, starts: np.ndarray) -> float | None:
    """Return the time for which inputs are constant, s, or None for a game in discrete time.

    starts: whether a row does not follow the one before it, (N,)
    """
    # Only a float is a known sample time: True is an unknown one, None is no entry.
    step_in_file = sample_time(record.entries)
    dt, accuracy = step_in_file, 0.0
    if "time" in record.marks and not starts.all():  # some rows are not the first of an episode
        dt, accuracy = _step_of(record.marks["time"], starts)
    for whose, other in (("their dt", step_in_file), ("the game", game.dt)):
        if (
            isinstance(dt, float)
            and isinstance(other, float)
            and not math.isclose(dt, other, rel_tol=1e-6, abs_tol=accuracy)
        ):
            raise BadInputError(
                f"the sample time of the data is {dt:g} s, but that of {whose} is {other:g} s; "
                "give data of this sample time, or correct dt"
            )
    if game.is_discrete:
        return None
    if not isinstance(dt, float):
        raise BadInputError(
            "the sample time of the data is not known, for a game in continuous time; add dt "
            "(s), or time of successive samples, or x_rate in place of x_next"
        )
    return dt


def _step_of(time: Column, starts: np.ndarray) -> tuple[float, float]:
    """Return the step of the times of successive samples, s, and its accuracy.

    starts: whether a time is the first of an episode, (N,)
    """
    times = time.numbers("s")
    is_last = np.append(starts[1:], True)  # of an episode: its time may be missing
    time.refuse(np.isnan(times) & ~is_last, "has no number; give one, or remove the row")
    steps = np.where(starts[1:], np.nan, np.diff(times))
    mean = float(np.nanmean(steps))
    # A step between two times, each rounded to half a unit of its last digit, has an error of
    # this digit. Times such as 0, 1, 2 s, with a last digit of the size of the step, are exact
    # up to a few floating-point spacings.
    (rounding,) = _last_digits(times[np.isfinite(times), None])
    if 2.0 * rounding > mean:
        rounding = 8.0 * float(np.spacing(np.nanmax(np.abs(times))))
    far = np.abs(steps - np.nanmedian(steps))
    place = int(np.nanargmin(steps) if np.nanmin(steps) <= 0.0 else np.nanargmax(far))
    if steps[place] <= 0.0 or abs(steps[place] - mean) > rounding:
        raise BadInputError(
            f"the samples are not equally spaced: {steps[place]:g} s at row "
            f"{time.rows[place + 1]}, {mean:g} s on average; sort the rows, give episode, a "
            "number for each row, or x_next for each row, with dt"
        )
    return mean, rounding


def _last_digits(columns: np.ndarray) -> np.ndarray:
    """Return the unit of the last decimal of each column (N, k) of a printed record, (k,).

    It is 0.01 for 0.5, 1.25, and the floating-point precision for numbers that were not rounded.
    """
    precision = 4.0 * np.spacing(np.abs(columns).max(axis=0, initial=0.0))
    unit = precision
    for place in range(16, -1, -1):
        is_rounded = (np.abs(np.round(columns, place) - columns) <= precision).all(axis=0)
        unit = np.where(is_rounded, np.maximum(precision, 10.0**-place), unit)
    return unit
