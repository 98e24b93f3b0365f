"""A sweep in memory: trims and linear models over a grid of conditions, modes tracked, failures kept as rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_STATES, STATES
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from trim.linear.modes import modes_of, track_modes
from trim.point.condition import LEVEL_FLIGHT, TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.sweeps.points import TRIMMED, reasons_of, trim_points
from trim.sweeps.sweep_plan import SweepPlan
from trim.sweeps.sweep_result import Sweep

#: Of a sweep in memory.
MOST_POINTS = 1_000_000


def sweep(
    aircraft: Aircraft,
    grid: Mapping[str, Sequence[float] | np.ndarray],
    *,
    condition: TrimCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    full: bool = False,
    progress: Progress | None = None,
) -> Sweep:
    """Trim and linearize at every point of the product of the given values: a `SweepPlan` run in memory.

    grid: trim variable or parameter of the aircraft -> values that are held (rad, ft/s, ft). condition: what the other
    variables do, by default the paper's level flight with a dihedral angle of zero; the grid overrides it. start: where
    the search begins at each point. A point that has no trim becomes a row with its reason. progress is called with
    (points done, points in all). BadInputError when a name is unknown, a value lies outside its limits, or the grid is
    empty or has more than `MOST_POINTS` points.
    """
    plan = SweepPlan(grid, aircraft.parameters, aircraft.variant, condition=condition, start=start)
    return run_plan(plan, full=full, progress=progress)


def run_plan(plan: SweepPlan, *, full: bool = False, progress: Progress | None = None) -> Sweep:
    """Every point of a plan with a grid, in memory; full: all seven states."""
    if plan.samples or plan.count > MOST_POINTS:
        raise BadInputError(f"the sweep has {plan.count:,} points; a grid of at most {MOST_POINTS:,} fits in memory")
    values, variables = plan.values(0, plan.count), plan.variables
    points = trim_points(plan.aircraft, variables, values, plan.condition, start=plan.start, progress=progress)
    reasons = reasons_of(points, plan.aircraft, variables, values, plan.condition)
    trimmed = points.status == TRIMMED
    points.states[~trimmed], points.inputs[~trimmed] = np.nan, np.nan
    model_states = STATES if full else LINEAR_STATES
    rows = [STATES.index(name) for name in model_states]
    A, B = points.A[:, rows][:, :, rows], points.B[:, rows]
    eigenvalues = np.full((plan.count, len(rows)), np.nan, dtype=complex)
    mode_names: tuple[str, ...] = ()
    if trimmed.any():
        eigenvalues[trimmed] = track_modes(A[trimmed], model_states, _neighbours(plan.sizes, trimmed))
        first = int(np.argmax(trimmed))
        mode_names = _column_names(A[first], eigenvalues[first], model_states)
    return Sweep(plan, values, reasons, points.states, points.inputs, A, B, eigenvalues, model_states, mode_names)


def _neighbours(sizes: list[int], trimmed: np.ndarray) -> np.ndarray:
    """(M, 2) numbers, among the trimmed points, of those that follow one another along a line of the grid."""
    numbers, index = np.cumsum(trimmed) - 1, np.arange(trimmed.size).reshape(sizes)
    pairs = []
    for axis, size in enumerate(sizes):
        along = np.moveaxis(index, axis, -1).ravel()
        line = np.arange(trimmed.size) // size
        along, line = along[trimmed[along]], line[trimmed[along]]
        same = line[1:] == line[:-1]
        pairs.append(np.stack([along[:-1][same], along[1:][same]], axis=-1))
    return np.asarray(numbers[np.concatenate(pairs)])


def _column_names(A: np.ndarray, eigenvalues: np.ndarray, states: tuple[str, ...]) -> tuple[str, ...]:
    """The mode that each eigenvalue column belongs to, at the first trimmed point."""
    modes = modes_of(A, states)
    up = [complex(value.real, abs(value.imag)) for value in eigenvalues]
    return tuple(min(modes, key=lambda mode: abs(mode.eigenvalue - value)).name for value in up)
