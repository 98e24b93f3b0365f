"""Recorded transitions of a plant: the layouts of their files, and what is read of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
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
from hfa_support.arrays.tables import read_source, sources
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
    for source in sources(data, "data"):
        for name, record in _records(*source, game.names):
            with prefix_errors(name):
                parts.append(_transitions(record, game))
            names += [f"{name}: {row}" for row in parts[-1].rows]
    begins, ends, follows, roundings, holds, notes, rows = zip(*parts, strict=True)
    if len({*zip(map(len, roundings), holds, strict=True)}) > 1:
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
    name, record = next(_records(*sources(data, "data")[0], UNNAMED))
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

    blocks: "x", "u", "d", "x_next" and "x_rate" as far as recorded -> columns
    marks: columns of times and ends of episodes
    entries: single numbers and words: "dt", "time"
    unused: names of what is not used
    """

    blocks: Mapping[str, Sequence[Column]]
    marks: Mapping[str, Column]
    entries: Mapping[str, Any]
    unused: Sequence[str]

    @property
    def names(self) -> PlantNames:
        """Names and units of the states and inputs."""
        x, u = (self.blocks[key] for key in "xu")
        names = [tuple(column.name for column in block) for block in (x, u)]
        units = [tuple(column.unit or "" for column in block) for block in (x, u)]
        return PlantNames(names[0], names[1], units[0], units[1])


def _records(name: str, source: Any, plant: PlantNames) -> Iterator[tuple[str, _Record]]:
    """Yield the name and the samples of a source (`learn`), or of each of its episodes (E, T, n) or
    groups, as of Minari.

    plant: names of the states and inputs, which are columns

    Raises BadInputError, which names the source, if it cannot be read.
    """
    groups: dict[str, Any] = {}
    with prefix_errors(name):
        columns, stored = read_source(source, name)
        entries = {_ALIASES.get(key, key): values for key, values in stored.items()}
        if np.ndim(entries.get("x", ())) == 3:
            groups = {f"episode {at + 1}": _episode(entries, at) for at in range(len(entries["x"]))}
        elif entries and all(isinstance(group, Mapping) for group in entries.values()):
            groups = entries
        else:
            yield name, _record(columns, entries, name, plant)
    for key, group in groups.items():
        yield from _records(f"{name}, {key}", group, plant)


def _episode(entries: Mapping[str, Any], place: int) -> dict[str, Any]:
    """Return the entries of one of several episodes: arrays (E, T, ...) have one of each."""
    return {
        key: values[place] if np.ndim(values) > 1 and np.size(values) > 1 else values
        for key, values in entries.items()
    }


def _record(
    columns: Sequence[Column], entries: Mapping[str, Any], where: str, plant: PlantNames
) -> _Record:
    """Return the samples of columns, or of x (N, n) and other matrices.

    where: the source, for messages
    """
    signals = {*plant.states, *plant.inputs}  # before words such as time
    named = matched(columns, _NO_SIGNALS | dict.fromkeys(signals, ""))
    if "x" in entries and not (signals and signals <= named.keys()):  # no state x of the plant
        blocks = _blocks_of_matrices(entries, where, plant)
    else:
        blocks = _blocks_among(named, plant)
    count, of_inputs = (len(blocks[key][0].cells) for key in "xu")
    marks = {name: named[name] for name in _NO_SIGNALS if name in named}
    if "dt" in marks and len(marks["dt"].cells) == 1:
        del marks["dt"]  # an entry
    for name, column in marks.items():
        if len(column.cells) == of_inputs < count:
            marks[name] = column._replace(cells=np.append(column.cells, np.nan))
    lengths = {len(column.cells) for column in chain(*blocks.values(), marks.values())}
    if lengths - {count, of_inputs}:
        raise BadInputError("the columns differ in length; give columns of one length")
    if "dt" in marks:
        entries = {**entries, "dt": np.unique(marks["dt"].numbers("s"))}  # one number
    used = {*_MATRICES, *_ALIASES, *_NO_SIGNALS, *NAME_KEYS, *NAME_ALIASES, "Ts"}
    used |= {column.name for column in chain(*blocks.values(), marks.values())}
    given = chain((column.name for column in columns), (Label.of(key).name for key in entries))
    unused = [name for name in dict.fromkeys(given) if name not in used]
    return _Record(blocks, marks, entries, unused)


def _blocks_of_matrices(
    entries: Mapping[str, Any], where: str, plant: PlantNames
) -> dict[str, list[Column]]:
    """Return the matrices x (N, n), u, ... as columns, in the order of the plant if the names are
    its own. A last row of x alone ends the last step.
    """
    matrices = {key: numbers_in(key, entries[key]) for key in _MATRICES if key in entries}
    if "u" not in matrices:
        raise BadInputError(f"there is no u{entries_found(entries)}; add it")
    matrices = {key: np.atleast_2d(matrix.T).T for key, matrix in matrices.items()}
    count = len(matrices["x"])
    rows = range(1, count + 1)
    names = plant_names(entries)
    states = names.states or plant.states or numbered("x", matrices["x"].shape[1])
    inputs = names.inputs or plant.inputs or numbered("u", matrices["u"].shape[1])
    names = names._replace(states=states, inputs=inputs).completed(len(states), len(inputs))
    shortest = count - {*_SUFFIXES_OF_ENDS}.isdisjoint(matrices)
    blocks: dict[str, list[Column]] = {}
    for key, matrix in matrices.items():
        suffix, per = _SUFFIXES_OF_ENDS.get(key, ("",))[0], "/s" if key == "x_rate" else ""
        ordered = plant.states
        units = dict(zip(states, names.state_units, strict=True))
        if key == "u":
            units, ordered = dict(zip(inputs, names.input_units, strict=True)), plant.inputs
        if key == "d":
            units, ordered = dict.fromkeys(numbered("d", matrix.shape[1]), ""), ()
        if matrix.shape not in [(length, len(units)) for length in (count, shortest)]:
            raise BadInputError(
                f"{key} is {shape_text(matrix.shape)}; give {shape_text((count, len(units)))}, a "
                "row for each sample"
            )
        columns = {
            name: Column(where, f"{name}{suffix}", (unit and f"{unit}{per}") or None, cells, rows)
            for (name, unit), cells in zip(units.items(), matrix.T, strict=True)
        }
        is_of_plant = columns.keys() == {*ordered}
        blocks[key] = [columns[name] for name in (ordered if is_of_plant else columns)]
    return blocks


def _blocks_among(named: Mapping[str, Column], plant: PlantNames) -> dict[str, list[Column]]:
    """Return columns by their names, such as alpha and alpha_next, as blocks.

    The states and inputs are those of the plant. If the table has none of them, the states are the
    columns beside one of their next value or rate, and the inputs are all other columns.
    """
    states, inputs = [*plant.states], [*plant.inputs]
    disturbances = [name for name in named if re.fullmatch(r"d\d*", name)]
    missing = [name for name in (*states, *inputs) if name not in named]
    if is_other := len(missing) == len(states) + len(inputs):
        every = [*_SUFFIXES_OF_ENDS.values()]
        states = next(filter(None, ([*_ends_among(named, named, each)] for each in every)), [])
        ends = chain(*(_ends_among(named, states, each).values() for each in every))
        no_inputs = {*states, *disturbances, *_NO_SIGNALS, *_NO_INPUTS, *ends}
        inputs = [name for name in named if name not in no_inputs]
    if (missing and not is_other) or not states or not inputs:
        raise BadInputError(
            "the data have neither x and u nor columns of all states and inputs (there is no "
            f"{', '.join(missing) or 'alpha, alpha_next, elevator'}){entries_found(named)}; name "
            "the columns so, with units as in alpha [deg], or give a plant that names them"
        )
    blocks = {"x": states, "u": inputs, "d": disturbances}
    for key, suffixes in _SUFFIXES_OF_ENDS.items():
        of_states = _ends_among(named, states, suffixes)
        if {*states}.issuperset(of_states.values()):
            continue
        for state in states:
            if state not in of_states:
                raise BadInputError(
                    f"there is no column {state}{suffixes[0]}; add it, or remove the others"
                )
        blocks[key] = [of_states[state] for state in states]
    return {key: [named[name] for name in block] for key, block in blocks.items() if block}


def _ends_among(
    columns: Collection[str], states: Iterable[str], suffixes: Sequence[str]
) -> dict[str, str]:
    """Return state -> column of its end, which may be a state: pitch_rate of pitch."""
    ends = ((state, f"{state}{each}") for each in reversed(suffixes) for state in states)
    return {state: end for state, end in ends if end in columns}


def _transitions(record: _Record, game: Game) -> Transitions:
    """Return the transitions of samples in the units of a game."""
    blocks, rows_of, signals = record.blocks, record.blocks["x"][0].rows, game.names
    end, *others = [key for key in _SUFFIXES_OF_ENDS if key in blocks] or ["x"]
    if others:
        raise BadInputError("the data have x_next and x_rate; remove one of them")
    if end == "x_rate" and game.is_discrete:
        raise BadInputError("x_rate is of continuous time, the game is discrete; give x_next")
    notes = []
    for matrix, given, known in zip("xu", record.names, signals, strict=False):
        if len(given) != len(known):
            raise BadInputError(f"{matrix} has {len(given)} columns; give {len(known)}")
        if given != known:
            notes.append(f"{', '.join(given)} of the data, taken as {', '.join(known)}")
    of_d = blocks.get("d", ())
    if of_d and math.isfinite(game.delta):
        notes.append(f"E of the game is replaced by that of {len(of_d)} recorded disturbances")
    of_begins = [*blocks["x"], *blocks["u"], *of_d]
    of_game = [*signals.state_units, *signals.input_units, *[""] * len(of_d)]
    units = [unit or each.unit or "" for unit, each in zip(of_game, of_begins, strict=True)]
    of_time = "/s" if end == "x_rate" else ""
    units_of_ends = [unit and f"{unit}{of_time}" for unit in units[: len(game.A)]]
    assumed = {}
    for column, unit in zip((*of_begins, *blocks[end]), (*units, *units_of_ends), strict=True):
        if column.unit and not unit:
            raise BadInputError(f"{column.name} has a unit, but its state has none; add it")
        if unit and not column.unit:
            assumed[f"{column.name} in {unit}"] = unit
    for what, listed in (
        ("without a unit, taken in that of the plant", assumed),
        ("not used, as no state or input of the plant", record.unused),
    ):
        if listed:
            notes.append(f"{what}: {shortened(', '.join(listed), 200)}")
    starts = _starts(record)
    rows = np.arange(len(starts))
    after = rows
    if end == "x":
        # The transition of a row ends at the next row, unless an episode begins there.
        rows = np.flatnonzero(~starts[1:])
        after = rows + 1
        alone = starts & np.append(starts[1:], True)
        of_begins[0].refuse(
            alone, "has no next value, in an episode of one row; remove the row, or give x_next"
        )
    begins = _numbers(of_begins, units, rows)
    ends = _numbers(blocks[end], units_of_ends, after)
    follows = np.zeros(len(rows), dtype=bool)
    if end != "x_rate":
        follows[1:] = (ends[:-1] == begins[1:, : len(game.A)]).all(axis=1)
    factors = [column.factor(unit) for column, unit in zip(of_begins, units, strict=True)]
    is_apart = starts if end == "x" else ~follows
    return Transitions(
        begins=begins,
        ends=ends,
        follows=follows,
        rounding=_last_digits(begins / factors) * factors,
        hold=None if end == "x_rate" else _time_of_hold(record, game, is_apart),
        notes=tuple(notes),
        rows=[str(rows_of[row]) for row in rows.tolist()],
    )


def _numbers(block: Sequence[Column], units: Sequence[str], rows: np.ndarray) -> np.ndarray:
    """Return some rows of columns in their units."""
    chosen = []
    for column, unit in zip(block, units, strict=True):
        numbers = column.numbers(unit)
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
    starts[-1] &= len(record.blocks["u"][0].cells) == count  # else it only ends the last step
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
    # this digit. Times such as 0, 1, 2 s, with a last digit of the size of the step, are exact.
    (rounding,) = _last_digits(times[np.isfinite(times), None])
    if 2.0 * rounding > mean:
        rounding = 1e-9 * mean
    place = int(np.nanargmax(np.abs(steps - np.nanmedian(steps))))
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
