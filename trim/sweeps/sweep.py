"""Trims and linear models over a grid of conditions: modes tracked, failures kept as rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_STATES, STATES, Input
from hfa_support.errors import BadInputError, refuse_unknown, shown
from hfa_support.progress import Progress
from trim.linear.modes import modes_of, track_modes
from trim.point.condition import VARIABLES, TrimCondition
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import beyond_limits
from trim.sweeps.chunk import BEYOND_LIMITS, TRIMMED, Chunk, condition_at, run_chunk
from trim.sweeps.sweep_result import Sweep

MOST_POINTS = 1_000_000


def sweep(
    aircraft: Aircraft,
    grid: Mapping[str, Sequence[float] | np.ndarray],
    *,
    condition: TrimCondition | NamedCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    full: bool = False,
    progress: Progress | None = None,
) -> Sweep:
    """Trim and linearize at every point of the product of the given values.

    grid: trim variable -> values that are held (rad, ft/s, ft). condition: what the other variables do, by default the
    paper's level flight with a dihedral angle of zero; the grid overrides it. start: where the search begins at each
    point. A point that has no trim becomes a row with its reason. progress is called with (points done, points in
    all). BadInputError when a name is unknown, a value lies outside its limits, or the grid is empty or has more than
    `MOST_POINTS` points.
    """
    base = NamedCondition.of(condition) if isinstance(condition, TrimCondition) else condition
    axes = _axes(grid, base)
    variables, sizes = tuple(axes), [axis.size for axis in axes.values()]
    values = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1).reshape(-1, len(axes))
    chunk = run_chunk(
        variables, values, aircraft.parameters, aircraft.variant, condition=base, start=start, progress=progress
    )

    def beyond(index: int) -> str:
        balancing = Input(*chunk.inputs[index].tolist())._asdict()
        return beyond_limits(aircraft, condition_at(base, variables, values[index]), balancing)

    reasons = _reasons(chunk, beyond, progress)
    trimmed = chunk.status == TRIMMED
    for array in (chunk.states, chunk.inputs):
        array[~trimmed] = np.nan
    model_states = STATES if full else LINEAR_STATES
    rows = [STATES.index(name) for name in model_states]
    A, B = chunk.A[:, rows][:, :, rows], chunk.B[:, rows]
    path = _snake_path(sizes)
    path = path[trimmed[path]]
    eigenvalues = np.full((len(values), len(rows)), np.nan, dtype=complex)
    if path.size:
        eigenvalues[path] = track_modes(A[path], model_states)
    return Sweep(
        axes={name: tuple(axis.tolist()) for name, axis in axes.items()},
        values=values,
        reasons=reasons,
        states=chunk.states,
        inputs=chunk.inputs,
        A=A,
        B=B,
        eigenvalues=eigenvalues,
        model_states=model_states,
        mode_names=_column_names(A[path[0]], eigenvalues[path[0]], model_states) if path.size else (),
        dynamics=aircraft.variant.name,
        condition=base,
    )


def _axes(grid: Mapping[str, Sequence[float] | np.ndarray], condition: NamedCondition) -> dict[str, np.ndarray]:
    """The values of each variable, checked."""
    for name in grid:
        refuse_unknown("cannot sweep", name, VARIABLES)
    axes = {name: _axis(name, values) for name, values in grid.items()}
    total = math.prod(axis.size for axis in axes.values()) if axes else 0
    if not 0 < total <= MOST_POINTS:
        raise BadInputError(f"the sweep has {total} points; give 1 to {MOST_POINTS}")
    for corner in (np.argmin, np.argmax):
        condition_at(condition, tuple(axes), np.array([axis[corner(axis)] for axis in axes.values()]))
    return axes


def _axis(name: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    try:
        axis = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        axis = np.zeros(())
    if axis.ndim != 1:
        raise BadInputError(f"the values of {name} are {shown(values)}; give a list of numbers")
    return axis


def _reasons(chunk: Chunk, beyond: Callable[[int], str], progress: Progress | None) -> tuple[str, ...]:
    """Why each point has no trim, "" where it has one."""
    total, slow = len(chunk.status), np.flatnonzero(chunk.status == BEYOND_LIMITS).tolist()
    reasons = [chunk.failures.get(index, "") for index in range(total)]
    for done, index in enumerate(slow, start=total - len(slow) + 1):
        reasons[index] = beyond(index)
        if progress is not None:
            progress(done, total)
    return tuple(reasons)


def _snake_path(sizes: list[int]) -> np.ndarray:
    """Flat indices of a grid along a path whose neighbours are neighbours: the last axis turns back at its ends."""
    rows = np.arange(int(np.prod(sizes))).reshape(-1, sizes[-1])
    if len(sizes) > 1:
        # Order the rows the same way, axis by axis.
        rows = rows[_snake_path(sizes[:-1])]
        rows[1::2] = rows[1::2, ::-1]
    return rows.ravel()


def _column_names(A: np.ndarray, eigenvalues: np.ndarray, states: tuple[str, ...]) -> tuple[str, ...]:
    """The mode that each eigenvalue column belongs to, at the first trimmed point."""
    modes = modes_of(A, states)
    names = []
    for value in eigenvalues:
        up = complex(value.real, abs(value.imag))
        names.append(min(modes, key=lambda mode: abs(mode.eigenvalue - up)).name)
    return tuple(names)
