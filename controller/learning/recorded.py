"""Recorded transitions of a plant: the layouts of their files, and what is read of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from controller.game.linear_game import weights_of_sizes
from controller.game.zero_sum import Game
from controller.learning.recording import Transitions
from hfa_aircraft.readers.matrices_file import (
    NAME_KEYS,
    FileScales,
    entries_found,
    file_scales,
    sample_time,
    words,
)
from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_support.arrays.columns import Column, Label, matched
from hfa_support.arrays.tables import Read, read_source, sources
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened
from hfa_support.matrices import LARGEST, checked_matrix, shape_text

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
#: Entries that are read, beside columns.
_READ_ENTRIES = ("x", "u", "d", *_SUFFIXES_OF_ENDS, *_NO_SIGNALS, "Ts", "rows", *NAME_KEYS)


def transitions_in(data: Any, game: Game) -> Transitions:
    """Return the transitions of recorded data in the order and the units of a game (`learn`).

    Raises BadInputError, with the source and the row, for data that are no transitions of the game.
    """
    parts: list[Transitions] = []
    rows: list[str] = []
    for name, entries in _sources(data, game.names):
        with prefix_errors(name):
            parts.append(_Source(entries, game).transitions())
        rows += [f"{name}: {row}" for row in parts[-1].rows]
    if len({(part.begins.shape[1], part.hold) for part in parts}) > 1:
        raise BadInputError(
            "the episodes differ in sample time or in disturbances; give equal ones"
        )
    return Transitions(
        begins=np.concatenate([part.begins for part in parts]),
        ends=np.concatenate([part.ends for part in parts]),
        follows=np.concatenate([part.follows for part in parts]),
        rounding=np.min([part.rounding for part in parts], axis=0),
        hold=parts[0].hold,
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),  # each once
        rows=rows if len(parts) > 1 else parts[0].rows,
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
    name, entries = next(_sources(data, UNNAMED))  # of the first source
    with prefix_errors(name):
        if "u" not in entries:
            raise BadInputError(f"there is no u{entries_found(entries)}; add it")
        n, m = (np.shape(entries[key])[1] if np.ndim(entries[key]) > 1 else 1 for key in "xu")
        is_continuous = "x_rate" in entries or words(entries, "time") == ("continuous",)
        dt = None if is_continuous else sample_time(entries) or True  # True if it is not known
        names = PlantNames(origin=name, **{key: words(entries, key) for key in NAME_KEYS})
        if sizes is not None:
            names = names.completed(n, m)
            weights |= weights_of_sizes(sizes(names), names.states, names.inputs)
        for matrix in ("Q", "R"):
            if matrix not in weights:
                raise BadInputError(
                    f"data without a plant require a cost; give {matrix} (--{matrix})"
                )
        return Game(np.zeros((n, n)), np.zeros((n, m)), names=names, dt=dt, **weights)


def _sources(data: Any, names: PlantNames) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the matrices, entry -> value, of each source of data (`learn`).

    names: names of the states and inputs, which are columns. Without names, a state is a column
        beside one of its next value or rate, such as alpha beside alpha_next

    Raises BadInputError, which names the source, if it cannot be read.
    """
    for name, source in sources(data, "data"):
        with prefix_errors(name):
            yield from _matrices(read_source(source, name), name, names)


def _matrices(read: Read, name: str, names: PlantNames) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the matrices of a source, or of each of its groups, as of Minari."""
    groups = {key: group for key, group in read.entries.items() if isinstance(group, Mapping)}
    if groups and len(groups) == len(read.entries):
        for key, group in groups.items():
            of_group = f"{name}, {key}"
            yield from _matrices(read_source(group, of_group), of_group, names)
        return
    entries = {_ALIASES.get(key, key): values for key, values in read.entries.items()}
    if "x" not in entries:
        yield name, _of_columns(read.columns, names)
        return
    time = matched(read.columns, {"time": "s"}).get("time")
    if time is not None:
        entries = {key: each for key, each in entries.items() if Label.of(key).name != time.name}
        entries["time"] = time.numbers("s")
    yield from _episodes(entries, name)


def _episodes(entries: dict[str, Any], name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the matrices of each episode of x (E, T, n), or all as rows if their ends are known."""
    shape = np.shape(entries["x"])[:2]
    if np.ndim(entries["x"]) != 3:
        yield name, entries
    elif {*_SUFFIXES_OF_ENDS} & {*entries}:
        yield (
            name,
            {
                key: np.reshape(values, (-1, *np.shape(values)[2:]))
                if np.shape(values)[:2] == shape
                else values
                for key, values in entries.items()
            },
        )
    else:
        for episode in range(shape[0]):
            yield (
                f"{name}, episode {episode + 1}",
                {
                    key: values[episode]
                    if np.ndim(values) > 1 and len(values) == shape[0]
                    else values
                    for key, values in entries.items()
                },
            )


def _of_columns(columns: Sequence[Column], names: PlantNames) -> dict[str, Any]:
    """Return the matrices of a table, by the names of its columns, such as alpha and alpha_next.

    They are in the units of the plant, if it has any, and otherwise in those of the columns.
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
    blocks = {  # matrix -> its columns, each with its unit
        "x": [(named[state], units[state]) for state in states],
        "u": [(named[name], units[name]) for name in inputs],
        "d": [(named[name], "") for name in disturbances],
    }
    for key, suffixes in _SUFFIXES_OF_ENDS.items():
        ends = [_end_of(named, state, states, suffixes) for state in states]
        if {"", *states}.issuperset(ends):
            continue
        of_time = "/s" if key == "x_rate" else ""
        block = blocks[key] = []
        for state, end in zip(states, ends, strict=True):
            unit = f"{units[state]}{of_time}" if units[state] else ""
            if not end or (named[end].unit and not unit):
                label = f"{end or state + suffixes[-1]} [{unit}]".removesuffix(" []")
                raise BadInputError(f"there is no column {label}; add it, or remove the others")
            block.append((named[end], unit))
    if len({len(column.cells) for block in blocks.values() for column, _ in block}) > 1:
        raise BadInputError("the columns differ in length; give x and u, or columns of one length")
    matrices: dict[str, Any] = {
        key: np.column_stack([column.numbers(unit) for column, unit in block])
        for key, block in blocks.items()
        if block
    }
    for kind, of_kind in (("state", states), ("input", inputs)):
        matrices[f"{kind}s"] = of_kind
        matrices[f"{kind}_units"] = [units[name] for name in of_kind]
    used = {column.name for block in blocks.values() for column, _ in block}
    for name, column in named.items():
        if column.name not in used:
            matrices[name] = column.numbers("s") if name in ("time", "dt") else column.cells
    if "dt" in matrices:
        matrices["dt"] = np.unique(matrices["dt"])  # one number
    return matrices | {"rows": columns[0].rows}


def _end_of(
    columns: Collection[str], state: str, states: Sequence[str], suffixes: Sequence[str]
) -> str:
    """Return the column of the end of a state, or "". It may be a state: pitch_rate of pitch."""
    ends = [f"{state}{suffix}" for suffix in suffixes if f"{state}{suffix}" in columns]
    return min(ends, key=lambda end: end in states, default="")


class _Signals(NamedTuple):
    """Names of the states, inputs and disturbances among the columns of a table."""

    states: list[str]
    inputs: list[str]
    disturbances: list[str]


def _signals_among(columns: Mapping[str, Column], names: PlantNames) -> _Signals:
    """Return which columns are states, inputs and disturbances.

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
    return _Signals(states, inputs, disturbances)


class _Source:
    """Matrices of one file, mapping or table, and the game whose transitions they are.

    entries: "x", "u", "d", "x_next", "x_rate", "time", "dt", "episode", names and units
    rows: name of each row of x, for messages
    notes: sentences on what is not used or assumed
    """

    def __init__(self, entries: Mapping[str, Any], game: Game) -> None:
        self.entries = entries
        self.game = game
        self.rows: Sequence[Any] = entries.get("rows", ())
        self.notes: list[str] = []
        if unused := [name for name in entries if name not in _READ_ENTRIES]:
            named = shortened(", ".join(unused), 200)
            self.notes.append(f"not used, as no state or input of the plant: {named}")

    def transitions(self) -> Transitions:
        """Return the transitions in the units of the game."""
        end, *others = [key for key in _SUFFIXES_OF_ENDS if key in self.entries] or [""]
        if others:
            raise BadInputError("the data have x_next and x_rate; remove one of them")
        if end == "x_rate" and self.game.is_discrete:
            raise BadInputError("x_rate is of continuous time, the game is discrete; give x_next")
        scales = np.concatenate(self._scales())
        names = self.game.names
        n, m = len(names.states), len(names.inputs)
        blocks = [self._matrix("x", n, names.states), self._matrix("u", m, names.inputs)]
        if "d" in self.entries:
            blocks.append(self._matrix("d", 0))
            k = blocks[-1].shape[1]
            if math.isfinite(self.game.delta) and k != self.game.E.shape[1]:
                self.notes.append(f"E of the game is replaced by {k} recorded disturbances")

        x = blocks[0]
        count = len(x)
        self.rows = self.rows or range(1, count + 1)
        starts = self._starts(count)
        if end:
            rows, after = np.arange(count), self._matrix(end, n, names.states)
            permitted = {count}
        else:
            # The transition of a row ends at the next row, unless an episode begins there. The last
            # row only ends one, so that u and d may lack it.
            rows, after, permitted = np.flatnonzero(~starts[1:]), x[1:], {count, count - 1}
            for row in np.flatnonzero(starts & np.append(starts[1:], True)).tolist():
                raise BadInputError(
                    f"row {self.rows[row]} is an episode of one row, which has no next state; "
                    "remove it, or give x_next"
                )
        for block in (*blocks, after):
            if len(block) not in permitted:
                raise BadInputError(
                    f"x has {count} rows, another matrix {len(block)}; give a row of each for each "
                    "sample"
                )

        begins, ends = np.hstack([block[rows] for block in blocks]), after[rows]
        follows = np.zeros(len(rows), dtype=bool)
        if end != "x_rate":
            follows[1:] = (ends[:-1] == begins[1:, :n]).all(axis=1)
        factors = np.ones(begins.shape[1])  # to the units of the game; d has none
        factors[: n + m] /= scales
        return Transitions(
            begins=begins * factors,
            ends=ends * factors[:n],
            follows=follows,
            rounding=_last_digits(begins) * factors,
            hold=None if end == "x_rate" else self._time_of_hold(~follows if end else starts),
            notes=tuple(self.notes),
            rows=[str(self.rows[row]) for row in rows.tolist()],
        )

    def _matrix(self, key: str, columns: int, names: Sequence[str] = ()) -> np.ndarray:
        """Return an entry as a matrix of finite numbers, (N, columns); 0 stands for any width."""
        if key not in self.entries:
            raise BadInputError(f"there is no {key}{entries_found(self.entries)}; add it")
        values = numbers_in(key, self.entries[key])
        if values.ndim < 2:
            values = values.reshape(-1, 1)
        if values.ndim > 2 or not values.size or columns not in (0, values.shape[1]):
            raise BadInputError(
                f"{key} is {shape_text(values.shape)}; give a row for each sample, with"
                f" {columns or 'its'} columns"
            )
        for row, place in np.argwhere(~np.isfinite(values)).tolist():
            raise BadInputError(
                f"row {self.rows[row] if self.rows else row + 1}: "
                f"{names[place] if names else f'column {place + 1}'} of {key} has no number; "
                "remove the row, and begin another episode there"
            )
        return checked_matrix(key, values, LARGEST)

    def _scales(self) -> FileScales:
        """Return the factors from the game's units to those of the data.

        Signals with other names or without units are taken for the game's, with a note.
        """
        for matrix, signal in (("x", "state"), ("u", "input")):
            names = getattr(self.game.names, f"{signal}s")
            units = getattr(self.game.names, f"{signal}_units")
            of_data = words(self.entries, f"{signal}s")
            if of_data not in ((), names):
                self.notes.append(f"{', '.join(of_data)} of the data, taken as {', '.join(names)}")
            if any(units) and not any(words(self.entries, f"{signal}_units")):
                self.notes.append(f"{matrix} without units, taken in {', '.join(units)}")
        return file_scales(self.entries, self.game.names)

    def _starts(self, count: int) -> np.ndarray:
        """Return whether a row is the first of an episode, (N,)."""
        starts = np.arange(count) == 0
        for name in ("episode", *_LAST):
            if name not in self.entries:
                continue
            labels = np.ravel(self.entries[name])
            if len(labels) not in (count, count - 1) or (name == "episode" and len(labels) < count):
                raise BadInputError(
                    f"{name} has {len(labels)} entries, x has {count} rows; give one for each"
                )
            if name == "episode":
                starts[1:] |= labels[1:] != labels[:-1]
            else:
                # With one row more, x has the end of the last step too, which its flag follows.
                texts = np.char.lower(labels[: len(labels) - 1].astype(str))
                starts[1 : len(labels)] |= ~np.isin(texts, ("false", "0", "0.0", ""))
        return starts

    def _time_of_hold(self, starts: np.ndarray) -> float | None:
        """Return the time for which inputs are constant, s, or None for a game in discrete time.

        starts: whether a row does not follow the one before it, (N,)
        """
        # Only a float is a known sample time: True is an unknown one, None is no entry.
        step_in_file = sample_time(self.entries)
        dt, accuracy = step_in_file, 0.0
        # The entry time contains the times of the rows, or a word such as "continuous".
        if "time" in self.entries and not words(self.entries, "time"):
            times = np.ravel(numbers_in("time", self.entries["time"]))
            if len(times) != len(starts):
                raise BadInputError(f"time has {len(times)} entries, x has {len(starts)} rows")
            if not starts.all():  # some rows are not the first of an episode
                dt, accuracy = self._step_of(times, starts)
        for whose, other in (("their dt", step_in_file), ("the game", self.game.dt)):
            if (
                isinstance(dt, float)
                and isinstance(other, float)
                and not math.isclose(dt, other, rel_tol=1e-6, abs_tol=accuracy)
            ):
                raise BadInputError(
                    f"the sample time of the data is {dt:g} s, but that of {whose} is {other:g} s; "
                    "give data of this sample time, or correct dt"
                )
        if self.game.is_discrete:
            return None
        if not isinstance(dt, float):
            raise BadInputError(
                "the sample time of the data is not known, for a game in continuous time; add dt "
                "(s), or time of successive samples, or x_rate in place of x_next"
            )
        return dt

    def _step_of(self, times: np.ndarray, starts: np.ndarray) -> tuple[float, float]:
        """Return the step of the times of successive samples, s, and its accuracy.

        starts: whether a time is the first of an episode, (N,)
        """
        steps = np.where(starts[1:], np.nan, np.diff(times))
        mean = float(np.nanmean(steps))
        # A step between two times, each rounded to half a unit of its last digit, has an error of
        # this digit. Times such as 0, 1, 2 s, with a last digit of the size of the step, are exact
        # up to a few floating-point spacings.
        (rounding,) = _last_digits(times[:, None])
        if 2.0 * rounding > mean:
            rounding = 8.0 * float(np.spacing(np.abs(times).max()))
        far = np.abs(steps - np.nanmedian(steps))
        place = int(np.nanargmin(steps) if np.nanmin(steps) <= 0.0 else np.nanargmax(far))
        if steps[place] <= 0.0 or abs(steps[place] - mean) > rounding:
            raise BadInputError(
                f"the samples are not equally spaced: {steps[place]:g} s at row "
                f"{self.rows[place + 1]}, {mean:g} s on average; sort the rows, give episode, a "
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
