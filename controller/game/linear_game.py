"""Games on a linear model, with weights given as matrices or by signal name."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.held_game import held
from controller.game.zero_sum import Game
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.readers.matrices_file import (
    NAME_KEYS,
    doubts_of_time,
    entries_of,
    entries_of_row,
    is_discrete,
    numbers_of_shape,
    one_number,
    plant_matrices,
    plant_names,
    sample_time,
    words,
)
from hfa_aircraft.servos import positions_of_servos
from hfa_aircraft.signals import PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import (
    BadInputError,
    numbers_in,
    prefix_errors,
    refuse_unknown,
    refuse_unless_positive,
    shortened,
)
from hfa_support.matrices import in_order, labels_of
from hfa_support.reporting.text import with_unit
from trim.linear.linear_model import LinearModel, is_state_space

if TYPE_CHECKING:
    import control


#: Matrices with more entries are summarized.
_SHOWN = 40


def default_weight(
    matrix: str, model: Model, states: Sequence[str], inputs: Sequence[str]
) -> np.ndarray:
    """Return Q, R or N of the model, else the weights diag(1/nominal²) of flights, or N = 0.

    With diag(1/nominal²), the cost rate of a deviation of nominal size is 1.

    matrix: "Q", "R" or "N"
    states, inputs: linear states and inputs of the rows and columns

    Raises BadInputError, which names the model, if the matrix in the file has a wrong shape.
    """
    positions = positions_of_servos(model)  # whose commands have the weights
    # What is asked about, and what a plant file has weights of.
    of_states = states, [name for name in model.linear if name not in positions]
    of_inputs = inputs, list(model.inputs)
    sides = {"Q": (of_states, of_states), "R": (of_inputs, of_inputs), "N": (of_states, of_inputs)}
    (rows, rows_of_file), (columns, columns_of_file) = sides[matrix]
    stored = model.about.weights.get(matrix)
    if stored is None:
        if matrix == "N":
            return np.zeros((len(states), len(inputs)))
        sizes = {name: model.signals[name].nominal for name in rows}
        return np.diag([0.0 if name in positions else sizes[name] ** -2.0 for name in rows])
    if isinstance(stored, Mapping):
        declared = [stored.get(name, 0.0) for name in rows]
        units = [model.native_factor(name) for name in rows]
        return np.diag(declared / np.square(units))
    with prefix_errors(model.name):
        weight = numbers_in(matrix, stored)
        if weight.ndim == 1 and matrix != "N":
            weight = np.diag(weight)
        shape = len(rows_of_file), len(columns_of_file)
        weight = numbers_of_shape(matrix, {matrix: weight}, shape)
    # A plant file has the weights of states and inputs divided by their nominal values.
    of_rows = np.equal.outer(np.array(rows), np.array(rows_of_file)) / model.nominal(rows)[:, None]
    of_columns = np.equal.outer(np.array(columns_of_file), np.array(columns)) / model.nominal(
        columns
    )
    return np.asarray(of_rows @ weight @ of_columns)


def weights_of_flights(linear: LinearModel, Q: Any = None, R: Any = None) -> dict[str, Any]:
    """Return Q and R of the cost of flights, by default 1/nominal²; None for those of the model.

    Reports of flights print them.
    """
    model, given = linear.model, {"Q": Q, "R": R}
    for matrix, weight in given.items():
        if weight is None and matrix not in model.about.weights:
            given[matrix] = default_weight(matrix, model, linear.states, linear.inputs)
    return given


def weights_of_sizes(
    sizes: Mapping[str, float], states: Sequence[str], inputs: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return Q and R, name -> 1/size², of deviations that are as bad as one another.

    Source: Bryson and Ho, Applied Optimal Control, 1975, Section 5.2.

    Raises BadInputError for an unknown name, and a size that is not positive.
    """
    for name, size in sizes.items():
        refuse_unknown("sizes has an unknown name", name, (*states, *inputs))
        refuse_unless_positive(f"the size of {name}", size)
    weights = {name: 1.0 / size / size for name, size in sizes.items()}
    signals = {"Q": states, "R": inputs}
    return {
        matrix: {name: weights[name] for name in names if name in weights}
        for matrix, names in signals.items()
    }


def sizes_text(game: Game) -> str:
    """Return the sizes of which Q and R are 1/size² as text: "speed 10 ft/s, alpha 5 deg"."""
    states, inputs, state_units, input_units, *_ = game.names
    weights = np.diag(game.weights).tolist()
    rows = zip(states + inputs, state_units + input_units, weights, strict=True)
    return ", ".join(f"{name} {with_unit(w**-0.5, unit, 0.0)}" for name, unit, w in rows if w)


def default_disturbance(model: Model, states: Sequence[str]) -> np.ndarray:
    """Return the default E, (n, k): a column for each state that the model names, or for all.

    A column is a unit in which the model declares the rate of the state.
    """
    named = model.about.weights.get("E", states)
    positions = positions_of_servos(model)
    disturbed = [
        place for place, name in enumerate(states) if name in named and name not in positions
    ]
    units = [model.rate_scale(name) / model.native.rate_scale(name) for name in states]
    return np.diag(units)[:, disturbed]


def weights_line(game: Game, whose: Mapping[str, str] | None = None) -> str:
    """Return Q, R and delta, N unless it is 0, and E as one line of text.

    The text is, for example, "Q diag(1, 2) (given), R diag(1) (default), delta inf (default), E
    identity".

    whose: "Q", "R", "delta" and "N" -> source of the weight; None if all weights are those of a
        given game
    """
    texts = {"Q": matrix_text(game.Q), "R": matrix_text(game.R), "delta": f"{game.delta:g}"}
    if game.N.any():
        texts["N"] = matrix_text(game.N)
    whose = whose or dict.fromkeys(texts, "of the game")
    weights = [f"{name} {text} ({whose[name]})" for name, text in texts.items()]
    return ", ".join([*weights, disturbance_text(game)])


def disturbance_text(game: Game) -> str:
    """Return the disturbance matrix of a game as text: "E gust" or "E [0; 1]"."""
    if np.array_equal(game.E, np.eye(len(game.A))):
        return "E identity (d acts on each state)"
    return f"E {', '.join(game.names.disturbances) or matrix_text(game.E)}"


def matrix_text(matrix: np.ndarray) -> str:
    """Return a weight matrix as one line of text: "diag(1, 2)" or "[1 0; 3 2]".

    If more than `_SHOWN` numbers would be listed, the text contains their count and range instead.
    """
    diagonal = np.diag(matrix)
    is_diagonal = len(matrix) == matrix.shape[1] and np.array_equal(matrix, np.diag(diagonal))
    shown = diagonal if is_diagonal else matrix
    if shown.size > _SHOWN:
        kind = "diag" if is_diagonal else "matrix"
        return f"{kind} of {shown.size} entries from {shown.min():g} to {shown.max():g}"
    if is_diagonal:
        return f"diag({', '.join(f'{entry:g}' for entry in diagonal)})"
    rows = [" ".join(f"{entry:g}" for entry in row) for row in matrix]
    return f"[{'; '.join(rows)}]"


def game(
    linear: LinearModel | control.StateSpace,
    *,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    E: ArrayLike | None = None,
    N: ArrayLike | None = None,
    delta: float | None = None,
    sizes: Mapping[str, float] | None = None,
    rate: float | None = None,
    delay: float = 0.0,
) -> Game:
    """Return the game J = ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt on a linear model.

    The plant is z' = A z + B u + E d. The game keeps the names and units of the model. The defaults
    are those of the commands: of the paper's flexible aircraft, the Q, R, delta and E of the paper.

    linear: the linear model, or a `StateSpace` in continuous time
    Q: (n, n), or its diagonal, (n,), or state -> weight, with 0 for all other states
    R: (m, m), or its diagonal, (m,), or input -> weight, for every input. The defaults of Q and R
        are those of the paper's aircraft, or in the file of a linear plant
    delta: > 0; inf for LQR, without a disturbance; by default 200 for the paper's aircraft, for
        others inf
    E: (n, k), disturbance matrix; by default the identity. E=linear.E is the matrix of the model's
        winds.
    N: (n, m), cross weights; by default 0, without Q or R those in the file of a linear plant
    sizes: state or input -> deviation, in place of Q and R: deviations that are as bad as one
        another, with the weights 1/size² (Bryson's rule). A state without a size has no weight;
        each input has one
    rate, delay: samples a second, and s: the game in discrete time at which a policy flies
        (`controller.game.held_game`), whose states are z and the commands under way

    Rows and columns of tables of pandas are put into the order of the states and inputs.

    Raises BadInputError if a name is unknown or the weight of an input is missing, and as `Game`
    does.

    >>> import hfa, numpy as np
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> hfa.game(linear, Q={"speed": 0.01}, R=np.ones(5)).Q.diagonal().tolist()
    [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    if is_state_space(linear):
        linear = LinearModel.of(linear)
    if sizes is not None:
        if Q is not None or R is not None:
            raise BadInputError("sizes define Q and R; give sizes, or Q and R")
        weights = weights_of_sizes(sizes, linear.states, linear.inputs)
        Q, R = weights["Q"], weights["R"]
    names = names_of_linear(linear)
    # An E that is the matrix of the winds has their names.
    if E is not None and linear.disturbances and np.array_equal(E, linear.E):
        names = names._replace(disturbances=linear.disturbances)
    for matrix, given in (("Q", Q), ("R", R)):
        if given is None and matrix not in linear.model.about.weights:
            raise BadInputError(
                f"there is no {matrix} of {linear.model.title}; give --Q and --R, or --sizes "
                "NAME=SIZE,... (Python: Q=, R= or sizes=), the deviations that are as bad as one "
                f"another, of {shortened(', '.join((*linear.states, *linear.inputs)), 200)}"
            )
    default = partial(
        default_weight, model=linear.model, states=linear.states, inputs=linear.inputs
    )
    # Cross weights belong to Q and R: without either, they are those of the model, else 0.
    if N is None and (Q is None or R is None):
        N = default("N")
    continuous = Game(
        A=linear.A,
        B=linear.B,
        E=default_disturbance(linear.model, linear.states)
        if E is None
        else in_order("E", E, linear.states, ()),
        Q=default("Q") if Q is None else _weights("Q", Q, linear.states),
        R=default("R") if R is None else _weights("R", R, linear.inputs),
        delta=float(linear.model.about.weights.get("delta", math.inf)) if delta is None else delta,
        N=in_order("N", N, linear.states, linear.inputs),
        names=names,
        half_widths=widths_within_limits(linear),
    )
    return held(continuous, rate, delay)


def _weights(matrix: str, given: Any, names: tuple[str, ...]) -> Any:
    """Return Q or R in the order of the names, or name -> weight."""
    if len(labels_of(given)) == 1:  # a series of pandas with the weight of each name
        return dict(given)
    return in_order(matrix, given, names, names)


def widths_within_limits(linear: LinearModel) -> np.ndarray | None:
    """Return the half-widths (n,) of the largest box of states within their limits about the trim.

    The result is None if a state has no limits, or the trim is at or beyond a limit.
    """
    limits = Limits.of(linear.model, linear.states)
    trim = linear.point.states._asdict()
    at_trim = np.array([trim[name] for name in linear.states], dtype=float)
    half_widths = np.minimum(at_trim - limits.lowest, limits.highest - at_trim)
    if not np.all(np.isfinite(half_widths) & (half_widths > 0.0)):
        return None
    return half_widths


def names_of_linear(linear: LinearModel) -> PlantNames:
    """Return the names and units of a linear model's states and inputs.

    The `origin` of the result names the model and its flight condition.
    """
    origin = f"{linear.model.title} {linear.point.at_scheduled}".rstrip()
    units = linear.model.units
    names = linear.states, linear.inputs, units(linear.states), units(linear.inputs)
    return PlantNames(*names, origin)


MODEL_KEYS = ("A", "B", "E", "Q", "R", "delta", "N")
#: Further entries of a plant in discrete time (time = "discrete").
DISCRETE_KEYS = ("time", "dt", "discount")


class Defaults(NamedTuple):
    """Default values for entries that a plant file does not contain.

    values: "E", "Q", "R" or "delta" -> default; entries without a default are omitted
    words: the same keys -> source of the default, for a note: "as in the paper"
    """

    values: Mapping[str, Any] = MappingProxyType({})
    words: Mapping[str, str] = MappingProxyType({})


class StoredGame(NamedTuple):
    """Game read from a plant file, with notes for the user.

    game: the game
    notes: texts on unused entries, on defaults that were used, and on ignored names
    declared: names of the entries A, B, E, Q, R, delta and N that the file contains
    """

    game: Game
    notes: tuple[str, ...]
    declared: tuple[str, ...] = ()


def stored_game(
    path: str | Path,
    *,
    defaults: Callable[[Mapping[str, Any], PlantNames], Defaults],
    sizes: Callable[[PlantNames], Mapping[str, float]] | None = None,
    row: str | None = None,
    **changes: Any,
) -> StoredGame:
    """Return the game of the plant in a file with A, B, Q, R and optionally E, delta and N.

    - Q, R, delta and N are taken from `changes`, else from the file, else from the defaults.
    - Without any value, E is the identity, delta is inf (linear quadratic regulator) and N is 0.
    - In a file with the entry `disturbances`, E describes the wind and is not used.
    - If neither A nor B is at the top level, the entries of the only structure with both are read.
    - With time = "discrete", or the sample time dt, the game is in discrete time. The file may then
      also contain `discount`.

    path: the plant file
    defaults: function (entries, names) -> defaults for missing entries
    sizes: function of the names -> deviations of which Q and R are 1/size² (`weights_of_sizes`)
    row: name of a row, of a file with the linear models of several conditions
    changes: Q, R, delta or N in place of the entry of the file; None keeps the entry

    Raises BadInputError, which names the file, if the file cannot be read, A or B is missing, Q or
    R has no value, or an entry is not valid.
    """
    contents = read_arrays(path)
    with prefix_errors(path):
        stored, notes = entries_of(entries_of_row(contents, row), {"A", "B"})
        parts = {key: stored[key] for key in MODEL_KEYS if key in stored}
        if "disturbances" in stored and "E" in parts:  # a file written by `hfa linearize`
            del parts["E"]
            notes.append("E describes the wind and is not used")
        parts["A"], parts["B"] = A, B = plant_matrices(stored)
        parts |= {key: value for key, value in changes.items() if value is not None}
        used = (*MODEL_KEYS, *NAME_KEYS, *(DISCRETE_KEYS if is_discrete(stored) else ()))
        notes += unused(stored, used, f"a model file contains {', '.join(MODEL_KEYS)}")
        notes += doubts_of_time(stored, A)
        names = plant_names(stored)._replace(origin=str(path))
        if sizes is not None:
            named = names.completed(*B.shape)
            parts |= weights_of_sizes(sizes(named), named.states, named.inputs)
        parts |= _time(stored)
        game = _completed(parts | {"names": names}, defaults(parts, names), notes)
        noted = tuple(f"{path}: {note}" for note in notes)
        return StoredGame(game, noted, tuple(key for key in MODEL_KEYS if key in stored))


def _time(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries dt and discount of a game in discrete time, {} in continuous time."""
    time: dict[str, Any] = {}
    if is_discrete(stored):
        time["dt"] = sample_time(stored) or True  # True if it is unknown
    if "discount" in stored:
        time["discount"] = one_number("discount", stored["discount"])
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
