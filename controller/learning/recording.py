"""Recorded transitions of a plant: their generation, rank and Bellman residuals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.critic.training_run import Excitation
from controller.game.basis import Basis
from controller.game.linear_game import weights_of_sizes
from controller.game.zero_sum import Game
from hfa_aircraft.readers.matrices_file import (
    NAME_KEYS,
    FileScales,
    entries_found,
    file_scales,
    sample_time,
    words,
)
from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_support.arrays.tables import (
    Column,
    are_true,
    columns_of_entries,
    entries_of,
    is_text,
    matched,
    read_columns,
)
from hfa_support.errors import (
    BadInputError,
    numbers_in,
    prefix_errors,
    refuse_unless_whole,
    shortened,
)
from hfa_support.matrices import (
    LARGEST,
    balanced,
    checked_matrix,
    quadratic_forms,
    shape_text,
    spectral_abscissa,
    spectral_radius,
)
from hfa_support.units import conversion_factor

#: Singular values of the unit rows below this fraction of the largest count as 0. The weights can
#: have the rounding error of a sample, 1e-16, divided by this fraction: eight digits remain
#: correct.
RANK_TOLERANCE = 1e-8
#: Recorded samples for each weight by default.
SAMPLES_PER_WEIGHT = 4


class Stack(NamedTuple):
    """N_h samples of a plant without input: states z_j and their rates F_j = A z_j, (N_h, n)."""

    states: np.ndarray
    drifts: np.ndarray


class Transitions(NamedTuple):
    """N recorded transitions of a plant.

    begins: [x u d] of each transition, (N, s). There is no column of d if none was recorded
    rows: its row in the data, for messages, (N,)
    ends: of x' for a game in continuous time without `hold`, else x after the transition, (N, n)
    follows: whether a transition begins where the one before it ends, (N,)
    rounding: last digit of the recorded x, u and d, (s,)
    hold: time for which u and d are constant, s, of samples of a game in continuous time, or None
    notes: sentences on the data
    """

    begins: np.ndarray
    ends: np.ndarray
    follows: np.ndarray
    rounding: np.ndarray
    hold: float | None = None
    notes: tuple[str, ...] = ()
    rows: np.ndarray = np.empty(0, dtype=object)


def simulated(game: Game, seed: int) -> Transitions:
    """Return exact transitions from random states with random inputs and disturbances.

    [x u d] is drawn uniformly from a box, whose half-widths are those of `widths_of`.

    seed: seed of the random numbers
    """
    widths = widths_of(game)
    size = len(widths)
    # A quadratic form of [x u d] has s (s + 1) / 2 weights.
    count = SAMPLES_PER_WEIGHT * size * (size + 1) // 2
    begins = np.random.default_rng(seed).uniform(-widths, widths, (count, size))
    return Transitions(
        begins=begins,
        ends=begins @ plant_of(game, size).T,
        follows=np.zeros(count, dtype=bool),
        rounding=np.zeros(size),
    )


def plant_of(game: Game, columns: int) -> np.ndarray:
    """Return the first columns of [A B E]."""
    return np.hstack([game.A, game.B, game.E])[:, :columns]


def widths_of(game: Game) -> np.ndarray:
    """Return half-widths of random x and u, and of d for a finite delta, (s,).

    The half-widths of x are the `natural_spread`. No input or disturbance changes a state by more
    than its spread in one step, or in the time of the fastest mode, or costs more than all states.
    """
    columns, weights = game.B, np.diag(game.R)
    if np.isfinite(game.delta):
        columns = np.hstack([columns, game.E])
        weights = np.append(weights, np.full(game.E.shape[1], game.delta**2))
    spread = natural_spread(game)

    # Change in a step, or rate (1/s), of the state that an input of 1 moves most, in spreads.
    effects = np.abs(columns / spread[:, None]).max(axis=0)
    permitted = 1.0 if game.is_discrete else spectral_radius(game.A) or 1.0
    by_effect = permitted / np.where(effects > 0.0, effects, 1.0)

    cost_of_states = float(np.diag(game.Q) @ spread**2) or 1.0
    by_cost = np.sqrt(cost_of_states / weights)
    return np.append(spread, np.minimum(by_effect, by_cost))


def random_pool(game: Game, count: int, seed: int, half_widths: np.ndarray | None = None) -> Stack:
    """Return samples of a plant at random states, drawn uniformly from a box, without noise.

    game: the game, with A for the drifts A z
    count: number of states, at least 1
    seed: the same seed gives the same states
    half_widths: half-widths of the box, (n,); by default `natural_spread`

    Raises BadInputError if `half_widths` are not n positive numbers, if count or seed is out of
    range, or if the game is in discrete time.

    >>> import hfa
    >>> from controller import random_pool
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> random_pool(game, 100, seed=1).states.shape
    (100, 1)
    """
    game.refuse_steps("random_pool")
    refuse_unless_whole("count", count, 1)
    refuse_unless_whole("seed", seed, 0)
    n = len(game.A)
    widths = natural_spread(game) if half_widths is None else numbers_in("the box", half_widths)
    if widths.shape != (n,) or not np.all((widths > 0.0) & np.isfinite(widths)):
        raise BadInputError(f"the half-widths are {widths.tolist()}; give {n} positive numbers")
    states = np.random.default_rng(seed).uniform(-widths, widths, (count, n))
    return Stack(states, states @ game.A.T)


def natural_spread(game: Game) -> np.ndarray:
    """Return the standard deviation of each state under white-noise inputs and disturbances, (n,).

    The eigenvalues of the plant are shifted by -β. The variances are the diagonal of X with
        (A - βI) X + X (A - βI)' + B R⁻¹B' + EE'/δ² = 0,
        β = max(largest real part of the eigenvalues of A, 0) + 10 % of the spectral radius.
    A spectral radius of 0 is replaced by 1/s. For a state that no input or disturbance affects, the
    result is the scale of the state in the balancing of A. The result depends on the units of the
    states.
    """
    from scipy.linalg import solve_continuous_lyapunov

    A, units = balanced(game.A)
    shift = max(spectral_abscissa(A), 0.0) + 0.1 * (spectral_radius(A) or 1.0)
    noise = (game.S_control + game.S_disturbance / game.delta**2) / np.outer(units, units)
    covariance = solve_continuous_lyapunov(A - shift * np.eye(len(units)), -noise)
    variances = np.diag(covariance)
    return units * np.sqrt(np.where(variances > 0.0, variances, 1.0))


def root_mean_square(columns: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column of (N, k), (k,)."""
    return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))


def excitation(samples: np.ndarray) -> Excitation:
    """Return the rank and the condition of recorded samples.

    samples: ψ(z_j), (N_h, M), whose rows are divided by their lengths, unless these are 0
    """
    count, size = samples.shape
    lengths = np.linalg.norm(samples, axis=1, keepdims=True)
    rows = samples / np.where(lengths > 0.0, lengths, 1.0)
    values = np.linalg.svd(rows, compute_uv=False)
    values = np.pad(values, (0, size - len(values)))
    return Excitation(
        rank=int(np.sum(values > RANK_TOLERANCE * values[0])),
        size=size,
        samples=count,
        condition=float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf,
    )


class Learned(NamedTuple):
    """Weights (M,) of a value that a law learned, and further numbers of the law by name."""

    weights: np.ndarray
    diagnostics: Mapping[str, float] = {}


class Residual(NamedTuple):
    """Norm of the errors of a learner's equation at all samples, relative to two other norms.

    to_costs: to the norm of the costs
    to_terms: to the norm of the summed magnitudes of the terms of the equation
    """

    to_costs: float
    to_terms: float


def relative_residual(errors: np.ndarray, costs: np.ndarray, terms: np.ndarray) -> Residual:
    """Return the residual of errors, costs and terms at N samples, (N,) each."""
    norm, of_costs, of_terms = (float(np.linalg.norm(v)) for v in (errors, costs, terms))
    return Residual(norm / of_costs, norm / of_terms)


@dataclass(frozen=True, eq=False)
class Samples:
    """States z_j of a game in continuous time, recorded with their drifts F_j = A z_j.

    game: the game, without cross weights
    psi: basis ψ, with M weights
    states: z_j, (N_h, n)
    """

    game: Game
    psi: Basis
    states: np.ndarray

    @cached_property
    def drifts(self) -> np.ndarray:
        """F_j, (N_h, n)."""
        return self.states @ self.game.A.T

    @cached_property
    def gradient(self) -> np.ndarray:
        """∂ψ_j, (N_h, M, n)."""
        return self.psi.gradient(self.states)

    @cached_property
    def costs(self) -> np.ndarray:
        """State cost z_j'Q z_j, (N_h,)."""
        return quadratic_forms(self.states, self.game.Q)

    def residual(self, weights: np.ndarray) -> Residual:
        """Return the residual of the Hamilton-Jacobi-Isaacs equation for V = W'ψ, weights W (M,).

        The errors are e_j = ∇V'F_j + z_j'Q z_j - ¼ ∇V'S ∇V (paper Eq. 33 with the extremal
        policies).
        """
        with np.errstate(all="ignore"):
            slopes = np.einsum("jmi,m->ji", self.gradient, weights)  # ∇V, (N_h, n)
            products = slopes * self.drifts  # sum to ∇V'F
            of_policies = 0.25 * quadratic_forms(slopes, self.game.S)
            errors = products.sum(axis=1) + self.costs - of_policies
            terms = np.abs(products).sum(axis=1) + self.costs + np.abs(of_policies)
            return relative_residual(errors, self.costs, terms)


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
#: Entries of the matrices of transitions, all else is not used.
_READ_ENTRIES = ("x", "u", "d", *_SUFFIXES_OF_ENDS, *_NO_SIGNALS, "Ts", "rows", *NAME_KEYS)


def matrices_in(data: Any, names: PlantNames) -> dict[str, dict[str, Any]]:
    """Return the matrices of each source of data, source -> entry -> value (`learn`).

    Columns by name become matrices, with names and units.

    data: file, mapping or table (`read_columns`), or a list of them
    names: names of the states and inputs, which are columns. Without names, a state is a column
        beside one of its next value or rate, such as alpha beside alpha_next

    Raises BadInputError, which names the source, if it cannot be read.
    """
    sources = data if isinstance(data, (list, tuple)) else [data]
    found: dict[str, dict[str, Any]] = {}
    for place, source in enumerate(sources, start=1):
        name = str(source) if isinstance(source, (str, Path)) else f"data {place}"
        with prefix_errors(name):
            found |= _matrices(source, name, names)
    if not found:
        raise BadInputError("data is an empty list; give at least one episode")
    return found


def _matrices(source: Any, name: str, names: PlantNames) -> dict[str, dict[str, Any]]:
    """Return the matrices of a source, or of each of its groups (episodes of Minari), by name."""
    if is_text(source):
        return {name: _of_columns(read_columns(source, name), names)}
    entries = entries_of(source, name)
    groups = {key: group for key, group in entries.items() if isinstance(group, Mapping)}
    if groups and len(groups) == len(entries):
        parts = (_matrices(group, f"{name}, {key}", names) for key, group in groups.items())
        return {key: part for each in parts for key, part in each.items()}
    of_matrices = {_ALIASES.get(key, key): values for key, values in entries.items()}
    if "x" in of_matrices:
        return {name: _flat(of_matrices)}
    return {name: _of_columns(columns_of_entries(entries, name), names)}


def _flat(entries: dict[str, Any]) -> dict[str, Any]:
    """Return entries of episodes of equal length, (E, T, n), as rows with their episode.

    A matrix that has a row less in each episode is completed by zeros, which are not used.
    """
    if np.ndim(entries["x"]) != 3:
        return entries
    count, length = np.shape(entries["x"])[:2]
    flat: dict[str, Any] = {"episode": np.repeat(np.arange(count), length)}
    for key, values in entries.items():
        shape = np.shape(values)
        if len(shape) > 1 and shape[:2] == (count, length - 1):
            values = np.concatenate([values, np.zeros((count, 1, *shape[2:]))], axis=1)
            shape = (count, length, *shape[2:])
        if len(shape) > 1 and shape[:2] == (count, length):
            values = np.reshape(values, (count * length, *shape[2:]))
        elif key == "time" and shape == (length,):
            values = np.tile(values, count)
        flat[key] = values
    return flat


def _of_columns(columns: Sequence[Column], names: PlantNames) -> dict[str, Any]:
    """Return the matrices of a table, by the names of its columns, such as alpha and alpha_next.

    The units of the states and inputs are entries; an end has the unit of its state.
    """
    if len({len(column.cells) for column in columns}) > 1:
        raise BadInputError("the columns differ in length; give x and u, or columns of one length")
    of_plant = dict.fromkeys((*names.states, *names.inputs), "")  # before words such as time
    found, others = matched(columns, _NO_SIGNALS | of_plant)
    named = found | {column.name: column for column in others if column.name not in found}
    if len(named) < len(columns):
        raise BadInputError("two columns have the same name; rename one of them")
    states, inputs, disturbances = _signals_among(named, names)
    if not states or not inputs:
        expected = ", ".join((*names.states, *names.inputs)) or "alpha, alpha_next, elevator"
        raise BadInputError(
            f"the data have neither x and u nor columns of all states and inputs ({expected})"
            f"{entries_found(named)}; name the columns so, with units as in alpha [deg], or "
            "give a plant that names them"
        )
    blocks = {"x": states, "u": inputs, "d": disturbances}  # matrix -> names of its columns
    matrices: dict[str, Any] = {
        key: np.column_stack([_finite(named[name], named[name].unit) for name in block])
        for key, block in blocks.items()
        if block
    }
    used = {"", *states, *inputs, *disturbances}
    for key, suffixes in _SUFFIXES_OF_ENDS.items():
        ends = [_end_of(named, state, states, suffixes) for state in states]
        if used.issuperset(ends):
            continue  # no column but states and ""
        of_time = "/s" if key == "x_rate" else ""
        block = []
        for state, end in zip(states, ends, strict=True):
            unit = f"{named[state].unit}{of_time}" if named[state].unit else ""
            stated = named[end].unit if end else None
            if stated is None or (stated != unit and not conversion_factor(stated, unit)):
                name = end or f"{state}{suffixes[-1]}"
                label = f"{name} [{unit}]" if unit else name
                raise BadInputError(f"there is no column {label}; add it, or remove the others")
            block.append(_finite(named[end], unit))
        matrices[key] = np.column_stack(block)
        used.update(ends)
    for kind, signals in (("state", states), ("input", inputs)):
        matrices[f"{kind}s"] = signals
        matrices[f"{kind}_units"] = [named[name].unit for name in signals]
    for name, column in named.items():
        if name in used:
            continue
        matrices[name] = column.cells
        if name in ("time", "dt"):
            matrices[name] = _finite(column, "s")
    if "dt" in matrices:
        matrices["dt"] = np.unique(matrices["dt"])  # one number
    return matrices | {"rows": columns[0].rows}


def _finite(column: Column, unit: str) -> np.ndarray:
    """Return the numbers of a column. Raises BadInputError, with the row, if a cell is empty."""
    values = column.numbers(unit)
    for place in np.flatnonzero(np.isnan(values)).tolist():
        raise BadInputError(
            f"{column.where}, row {column.rows[place]}: {column.name} has no number; remove the "
            "row, and begin another episode there"
        )
    return values


def _end_of(
    columns: Collection[str], state: str, states: Sequence[str], suffixes: Sequence[str]
) -> str:
    """Return the column of the end of a state, or "". It may be a state: pitch_rate of pitch."""
    ends = [f"{state}{suffix}" for suffix in suffixes if f"{state}{suffix}" in columns]
    return min(ends, key=lambda end: end in states, default="")


def _signals_among(columns: Mapping[str, Column], names: PlantNames) -> tuple[list[str], ...]:
    """Return the names of the states, inputs and disturbances among the columns of a table.

    The states are those of the plant, if the table has all of them, and otherwise the columns
    beside one of their next value or rate, such as alpha beside alpha_next. The inputs are those of
    the plant, if the table has all of them, and otherwise all other columns of numbers.
    """
    states: list[str] = []
    suffixes: tuple[str, ...] = ()
    for suffixes in _SUFFIXES_OF_ENDS.values():
        states = [name for name in columns if _end_of(columns, name, (), suffixes)]
        if states:
            break
    if names.states and columns.keys() >= {*names.states}:
        states = list(names.states)
    disturbances = [name for name in columns if re.fullmatch(r"d\d*", name)]
    every = (suffix for each in _SUFFIXES_OF_ENDS.values() for suffix in each)
    ends = {f"{state}{suffix}" for suffix in every for state in states}
    no_inputs = {*states, *disturbances, *_NO_SIGNALS, *_NO_INPUTS, *ends}
    inputs = [name for name in columns if name not in no_inputs and columns[name].is_numeric]
    if names.inputs and columns.keys() >= {*names.inputs}:
        inputs = list(names.inputs)
    return states, inputs, disturbances


def transitions_in(data: Any, game: Game) -> Transitions:
    """Return the transitions of recorded data in the order and the units of a game (`learn`).

    Raises BadInputError, with the source and the row, for data that are no transitions of the game.
    """
    parts = []
    for name, entries in matrices_in(data, game.names).items():
        with prefix_errors(name):
            parts.append(_Source(entries, game).transitions())
    if len({(part.begins.shape[1], part.hold) for part in parts}) > 1:
        raise BadInputError(
            "the episodes differ in sample time or in disturbances; give equal ones"
        )
    rows = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("begins", "ends", "follows", "rows")
    }
    return Transitions(
        **rows,
        rounding=np.min([part.rounding for part in parts], axis=0),
        hold=parts[0].hold,
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),  # each once
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
    name, entries = next(iter(matrices_in(data, UNNAMED).items()))  # of the first source
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


class _Source:
    """Matrices of one file, mapping or table, and the game whose transitions they are.

    entries: "x", "u", "d", "x_next", "x_rate", "time", "dt", "episode", names and units
    notes: sentences on what is not used or assumed
    """

    def __init__(self, entries: Mapping[str, Any], game: Game) -> None:
        self.entries = entries
        self.game = game
        self.notes: list[str] = []
        if unused := [name for name in entries if name not in _READ_ENTRIES]:
            self.notes.append(f"not used: {shortened(', '.join(unused), 200)}")

    def transitions(self) -> Transitions:
        """Return the transitions in the units of the game."""
        end, *others = [key for key in _SUFFIXES_OF_ENDS if key in self.entries] or [""]
        if others:
            raise BadInputError("the data have x_next and x_rate; remove one of them")
        if end == "x_rate" and self.game.is_discrete:
            raise BadInputError("x_rate is of continuous time, the game is discrete; give x_next")
        names = self.game.names
        n, m = len(names.states), len(names.inputs)
        blocks = [self._matrix("x", n), self._matrix("u", m)]
        if "d" in self.entries:
            blocks.append(self._matrix("d", 0))
            k = blocks[-1].shape[1]
            if math.isfinite(self.game.delta) and k != self.game.E.shape[1]:
                self.notes.append(f"E of the game is replaced by {k} recorded disturbances")

        x = blocks[0]
        count = len(x)
        starts = self._starts(count)
        if end:
            rows, after, permitted = np.arange(count), self._matrix(end, n), {count}
        else:
            # The transition of a row ends at the next row, unless an episode begins there. The last
            # row only ends one, so that u and d may lack it.
            rows, after, permitted = np.flatnonzero(~starts[1:]), x[1:], {count, count - 1}
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
        factors[: n + m] /= np.concatenate(self._scales())
        return Transitions(
            begins=begins * factors,
            ends=ends * factors[:n],
            follows=follows,
            rounding=_last_digits(begins) * factors,
            hold=None if end == "x_rate" else self._time_of_hold(~follows if end else starts),
            notes=tuple(self.notes),
            rows=np.asarray(self.entries.get("rows", np.arange(count) + 1))[rows],
        )

    def _matrix(self, key: str, columns: int) -> np.ndarray:
        """Return an entry as a matrix of finite numbers, (N, columns); 0 stands for any width."""
        if key not in self.entries:
            raise BadInputError(f"there is no {key}{entries_found(self.entries)}; add it")
        values = checked_matrix(key, self.entries[key], LARGEST, None)
        if values.ndim < 2:
            values = values.reshape(-1, 1)
        if values.ndim > 2 or not values.size or columns not in (0, values.shape[1]):
            raise BadInputError(
                f"{key} is {shape_text(values.shape)}; give a row for each sample, with"
                f" {columns or 'its'} columns"
            )
        return values

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
                starts[1:] |= are_true(labels)[: count - 1]
        return starts

    def _time_of_hold(self, starts: np.ndarray) -> float | None:
        """Return the time for which inputs are constant, s, or None for a game in discrete time.

        starts: whether a row does not follow the one before it, (N,)
        """
        # Only a float is a known sample time: True is an unknown one, None is no entry.
        stated = sample_time(self.entries)
        dt, accuracy = stated, 0.0
        # The entry time contains the times of the rows, or a word such as "continuous".
        if "time" in self.entries and not words(self.entries, "time"):
            times = np.ravel(numbers_in("time", self.entries["time"]))
            if len(times) != len(starts):
                raise BadInputError(f"time has {len(times)} entries, x has {len(starts)} rows")
            if not starts.all():  # some rows are not the first of an episode
                dt, accuracy = _step_of(times, starts)
        for whose, other in (("their dt", stated), ("the game", self.game.dt)):
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


def _step_of(times: np.ndarray, starts: np.ndarray) -> tuple[float, float]:
    """Return the step of the times of successive samples, s, and its accuracy.

    starts: whether a time is the first of an episode, (N,)
    """
    steps = np.where(starts[1:], np.nan, np.diff(times))
    mean = float(np.nanmean(steps))
    # A step between two times, each rounded to half a unit of its last digit, has an error of this
    # digit. Times such as 0, 1, 2 s, with a last digit of the size of the step, are exact up to a
    # few floating-point spacings.
    (rounding,) = _last_digits(times[:, None])
    if 2.0 * rounding > mean:
        rounding = 8.0 * float(np.spacing(np.abs(times).max()))
    place = np.nanargmax(np.abs(steps - np.nanmedian(steps)))
    if abs(steps[place] - mean) > rounding:
        raise BadInputError(  # the step ends at the row place + 2, counted from 1
            f"the samples are not equally spaced: {steps[place]:g} s at row {place + 2}, {mean:g} "
            "s on average; sort the rows, give episode, a number for each row, or x_next for each "
            "row, with dt"
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
