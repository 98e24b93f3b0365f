"""Trims and linear models over a grid of conditions: warm-started, modes tracked, failures kept as rows."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.compiled import Aircraft
from hfa_model.errors import BadInputError, NoSolutionError
from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES
from trim.condition import level_flight
from trim.linearize import linearize
from trim.modes import modes_of
from trim.operating_point import OperatingPoint
from trim.solve import trim
from trim.tracking import track

#: What a sweep can vary: the arguments of `level_flight`.
SWEPT = ("dihedral", "speed", "altitude", "alpha")
MOST_POINTS = 1_000_000
SCHEMA = "hfa.sweep/1"
#: The paper calls its linear model applicable up to this dihedral angle (Section 5.1), rad.
PAPER_RANGE = float(np.radians(15.0))


@dataclass(frozen=True)
class Sweep:
    """N points in the order of the grid, the last variable running fastest.

    variables: names of what varies. values: (N, variables). reasons: "" where trimmed, else why not.
    states: (N, 7), inputs: (N, 5), A: (N, n, n), B: (N, n, 5), eigenvalues: (N, n), a column following one
    mode through the sweep; nan where the trim failed. mode_names: name of each column where the sweep begins.
    """

    variables: tuple[str, ...]
    values: np.ndarray
    reasons: tuple[str, ...]
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    eigenvalues: np.ndarray
    model_states: tuple[str, ...]
    mode_names: tuple[str, ...]
    dynamics: str

    @property
    def trimmed(self) -> np.ndarray:
        """(N,) true where a trim was found."""
        return np.array([reason == "" for reason in self.reasons])

    def to_dict(self) -> dict[str, Any]:
        """Names, units and arrays; complex eigenvalues as [real, imaginary]."""
        return {
            "schema": SCHEMA,
            "dynamics": self.dynamics,
            "variables": list(self.variables),
            "variable_units": [getattr(STATE_UNITS, name) for name in self.variables],
            "values": self.values,
            "reasons": list(self.reasons),
            "states": list(self.model_states),
            "state_units": [getattr(STATE_UNITS, name) for name in self.model_states],
            "inputs": list(INPUTS),
            "input_units": list(INPUT_UNITS),
            "operating_states": self.states,
            "operating_inputs": self.inputs,
            "A": self.A,
            "B": self.B,
            "mode_names": list(self.mode_names),
            "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=-1),
        }


def sweep(
    aircraft: Aircraft,
    grid: Mapping[str, Sequence[float] | np.ndarray],
    *,
    full: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Trim and linearize `level_flight` at every point of the product of the given values.

    grid: name out of `SWEPT` -> values (rad, ft/s, ft). What is not swept is the paper's. A point that has no
    trim becomes a row with its reason. progress is called with (points done, points in all).
    BadInputError when a name is unknown or the grid is empty or has more than `MOST_POINTS` points.
    """
    variables = tuple(grid)
    for name in variables:
        if name not in SWEPT:
            raise BadInputError(f"cannot sweep {name!r}; choose from {', '.join(SWEPT)}")
    axes = [np.asarray(grid[name], dtype=float) for name in variables]
    total = int(np.prod([axis.size for axis in axes], dtype=float)) if axes else 0
    if not 0 < total <= MOST_POINTS:
        raise BadInputError(f"the sweep has {total} points; give 1 to {MOST_POINTS}")
    rows: list[_Row] = [_failed("")] * total
    best: OperatingPoint | None = None
    shapes = None
    for done, index in enumerate(_snake([axis.size for axis in axes])):
        values = {name: float(axis[i]) for name, axis, i in zip(variables, axes, index, strict=True)}
        row, best, shapes = _solve(aircraft, values, full, best, shapes)
        rows[int(np.ravel_multi_index(index, [axis.size for axis in axes]))] = row
        if progress is not None:
            progress(done + 1, total)
    return _stack(aircraft, variables, axes, rows, full)


@dataclass(frozen=True)
class _Row:
    reason: str
    point: OperatingPoint | None = None
    A: np.ndarray | None = None
    B: np.ndarray | None = None
    eigenvalues: np.ndarray | None = None


def _failed(reason: str) -> _Row:
    return _Row(reason)


def _solve(
    aircraft: Aircraft, values: dict[str, float], full: bool, best: OperatingPoint | None, shapes: Any
) -> tuple[_Row, OperatingPoint | None, Any]:
    try:
        condition = level_flight(
            values.get("dihedral", 0.0),
            speed=values.get("speed"),
            altitude=values.get("altitude"),
            alpha=values.get("alpha"),
        )
        point = trim(aircraft, condition, start=best)
    except (BadInputError, NoSolutionError) as error:
        return _failed(str(error)), best, shapes
    model = linearize(aircraft, point, full=full)
    shapes = track(model.A, model.states, shapes)
    return _Row("", point, model.A, model.B, shapes[0]), point, shapes


def _snake(sizes: list[int]) -> Iterator[tuple[int, ...]]:
    """Indices of a grid along a path whose neighbours are neighbours: each axis turns back at its end."""
    direction = [1] * len(sizes)
    index = [0] * len(sizes)
    for _ in itertools.repeat(None, int(np.prod(sizes))):
        yield tuple(index)
        for axis in reversed(range(len(sizes))):
            if 0 <= index[axis] + direction[axis] < sizes[axis]:
                index[axis] += direction[axis]
                break
            direction[axis] = -direction[axis]


def _stack(
    aircraft: Aircraft, variables: tuple[str, ...], axes: list[np.ndarray], rows: list[_Row], full: bool
) -> Sweep:
    from hfa_model.vectors import LINEAR_STATES

    model_states = STATES if full else LINEAR_STATES
    n, m, count = len(model_states), len(INPUTS), len(rows)
    states, inputs = np.full((count, len(STATES)), np.nan), np.full((count, m), np.nan)
    A, B = np.full((count, n, n), np.nan), np.full((count, n, m), np.nan)
    eigenvalues = np.full((count, n), np.nan, dtype=complex)
    for i, row in enumerate(rows):
        if row.point is not None:
            states[i], inputs[i] = row.point.states, row.point.inputs
            A[i], B[i], eigenvalues[i] = row.A, row.B, row.eigenvalues
    first = next((row for row in rows if row.eigenvalues is not None), None)
    return Sweep(
        variables=variables,
        values=np.array(list(itertools.product(*axes))),
        reasons=tuple(row.reason for row in rows),
        states=states,
        inputs=inputs,
        A=A,
        B=B,
        eigenvalues=eigenvalues,
        model_states=model_states,
        mode_names=_column_names(first, model_states),
        dynamics=aircraft.variant.name,
    )


def _column_names(row: _Row | None, states: tuple[str, ...]) -> tuple[str, ...]:
    """The mode that each eigenvalue column belongs to, at the first trimmed point."""
    if row is None or row.A is None or row.eigenvalues is None:
        return ()
    modes = modes_of(row.A, states)
    names = []
    for value in row.eigenvalues:
        up = complex(value.real, abs(value.imag))
        names.append(min(modes, key=lambda mode: abs(mode.eigenvalue - up)).name)
    return tuple(names)
