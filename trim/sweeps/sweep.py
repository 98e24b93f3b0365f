"""Computation of trims and linear models at many points, in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.rows import with_names
from trim.linear.nonsmooth import means_at_nonsmooth_points
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.problem import TrimProblem
from trim.point.solve import failure
from trim.point.system import parameters_at
from trim.sweeps.points import (
    BEYOND_LIMITS,
    CHUNK,
    TRIMMED,
    condition_at,
    model_at,
    trim_points,
)
from trim.sweeps.result import Sweep
from trim.sweeps.sweep_plan import SweepPlan

#: Largest number of points of a sweep in memory.
MOST_POINTS = 1_000_000


def run_points(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Return the results of a sweep for N of its points, name -> array, with A (N, k, k) and B
    (N, k, m) of the k linear states.

    The names are those of `Points` and of the variables, "values", and "nonsmooth_points", the
    number of notes at each point. Two are mappings from the number of a point: `failures` contains
    the reason for a missing trim, and `nonsmooth_notes` the notes on nonsmooth points.

    variables: names of the columns of values
    values: (N, number of variables)
    start: initial point of the search at each point, or None for the default
    progress: called with (finished points, all points), or None
    """
    points = trim_points(model, variables, values, condition, start=start, progress=progress)
    columns = dict(zip(variables, values.T, strict=True))
    parameters = parameters_at(model, len(values), columns)
    slopes = means_at_nonsmooth_points(
        model, points.states, points.inputs, parameters, points.A, points.B
    )
    linear = model.state_places(model.linear)
    points = points._replace(A=slopes.A[:, linear][:, :, linear], B=slopes.B[:, linear])
    nonsmooth_counts = np.zeros(len(values), dtype=int)
    for point, notes in slopes.notes.items():
        nonsmooth_counts[point] = len(notes)
    return {
        **points._asdict(),
        **columns,
        "values": values,
        "nonsmooth_points": nonsmooth_counts,
        "nonsmooth_notes": slopes.notes,
    }


def sweep(
    model: Model,
    grid: Mapping[str, Sequence[float] | np.ndarray] | None = None,
    *,
    condition: TrimCondition | None = None,
    start: OperatingPoint | None = None,
    listed: bool = False,
    at: Sequence[float] | np.ndarray | None = None,
    progress: Progress | None = None,
    **columns: Sequence[float] | np.ndarray,
) -> Sweep:
    """Return the trims and linear models at every combination of the given values.

    model: model of the aircraft
    grid: trim variable or parameter of the model -> imposed values (N,), in the units of the model;
        None if only `at` and `columns` are given
    condition: condition of all other variables; by default the trim that the model declares. The
        grid overrides the condition.
    start: initial point of the search at each point; by default the declared initial values
    listed: True if the grid is a list of points: its values are columns of equal length, with one
        row for each point
    at: values of the scheduling variable (N,), added to the grid; None for none
    progress: called with (finished points, all points), or None
    columns: further variables of the grid, as keyword arguments: speed=[60.0, 70.0]. They replace
        variables of the same name in `grid`.

    The result also contains the points without a trim, each with its reason.

    Raises BadInputError if a name is unknown, a value is outside its limits, the scheduling
    variable is also given by `at`, or the grid is empty or has more than `MOST_POINTS` points.

    >>> import hfa
    >>> hfa.sweep(hfa.aircraft(), {"dihedral": [0.1, 0.2], "speed": [66.0, 68.0]}).A.shape
    (4, 6, 6)
    """
    grid = {**(grid or {}), **columns}
    if at is not None:
        if model.schedule in grid:
            raise BadInputError(f"at and {model.schedule} are the same variable; give one of them")
        grid[model.schedule or "at"] = at
    plan = SweepPlan(grid, model, condition or usual_condition(model), start, listed)
    return run_plan(plan, progress)


def run_plan(plan: SweepPlan, progress: Progress | None = None) -> Sweep:
    """Return the results of a sweep, computed in memory.

    plan: variables and values of the sweep
    progress: called with (finished points, all points), or None

    Raises BadInputError for more than `MOST_POINTS` points.
    """
    if plan.count > MOST_POINTS:
        raise BadInputError(
            f"the sweep has {plan.count:,} points (maximum in memory {MOST_POINTS:,}); use "
            "larger steps"
        )
    model = plan.model
    n, m, k = len(model.states), len(model.inputs), len(model.linear)
    states, inputs = np.empty((plan.count, n)), np.empty((plan.count, m))
    A, B = np.empty((plan.count, k, k)), np.empty((plan.count, k, m))
    reasons: list[str] = []
    nonsmooth_points: dict[int, tuple[str, ...]] = {}
    one_by_one = 0
    for first in range(0, plan.count, CHUNK):
        chunk = slice(first, min(first + CHUNK, plan.count))
        task = plan.task(chunk.start, chunk.stop)
        rows = run_points(*task, _progress_of_chunk(progress, plan, first))
        # Points beyond the limits have states and inputs, but nan in A and B.
        is_trimmed = (rows["status"] == TRIMMED)[:, None]
        states[chunk] = np.where(is_trimmed, rows["states"], np.nan)
        inputs[chunk] = np.where(is_trimmed, rows["inputs"], np.nan)
        A[chunk] = rows["A"]
        B[chunk] = rows["B"]
        reasons += _reasons(plan, rows)
        of_chunk = rows["nonsmooth_notes"]
        nonsmooth_points |= {first + point: notes for point, notes in of_chunk.items()}
        one_by_one += int(rows["one_by_one"].sum())
    return Sweep(
        plan=plan,
        values=plan.values(0, plan.count),
        reasons=tuple(reasons),
        states=with_names(states, (), model.state_names),
        inputs=with_names(inputs, (), model.input_names),
        A=A,
        B=B,
        nonsmooth_points=nonsmooth_points,
        one_by_one=one_by_one,
    )


def _progress_of_chunk(progress: Progress | None, plan: SweepPlan, first: int) -> Progress | None:
    """Return the function with which a chunk from `first` on reports the progress of the sweep."""
    if progress is None:
        return None

    def report(done: float, total: float, what: str = "", /) -> None:
        """Report the finished points of the chunk as those of the sweep."""
        progress(first + done, plan.count, what)

    return report


def _reasons(plan: SweepPlan, rows: Mapping[str, Any]) -> list[str]:
    """Return the reason for a missing trim at each point of `run_points`, or "" for a trim."""
    reasons = [rows["failures"].get(i, "") for i in range(len(rows["values"]))]
    for i in np.flatnonzero(rows["status"] == BEYOND_LIMITS).tolist():
        values = rows["values"][i]
        # All unknowns of a point beyond limits are inputs, at which its equations balance.
        balancing = dict(zip(plan.model.inputs, rows["inputs"][i].tolist(), strict=True))
        try:
            model = model_at(plan.model, plan.variables, values)
            condition = condition_at(plan.condition, plan.variables, values)
            problem = TrimProblem(model, condition)
            reasons[i] = failure(problem, problem.system.scaled(balancing))
        except BadInputError as error:  # a listed value outside its limits
            reasons[i] = str(error)
    return reasons
