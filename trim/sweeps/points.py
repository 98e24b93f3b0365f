"""Trims and linear models of many points.

Newton's method solves all points together. For the remaining points, Newton's method is repeated
from solved neighbors. `trim` solves the points that still remain. A point without a
trim keeps its status and the reason.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.progress import Progress
from trim.point.condition import OTHER_UNITS, TrimCondition, release, usual_condition
from trim.point.halving import newton, newton_step
from trim.point.operating_point import OperatingPoint
from trim.point.problem import keepable
from trim.point.solve import trim
from trim.point.status import BALANCE, Status
from trim.point.system import NewtonEnds, TrimSystem

#: Possible statuses of a point.
STATUS = (Status.TRIMMED, Status.BEYOND_LIMITS, Status.NO_TRIM)
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))
#: Number of points whose results are computed together: about 100 MB of memory.
CHUNK = 25_000
#: Width of the cells at whose centers the search for points with free states begins, in nominal
#: values: for a single variable, and for several variables, which have many more cells.
_FINE_CELL = 0.01
_CELL = 0.03
#: Largest accepted change of a scaled unknown over a cell.
_STEEPEST = 0.2
#: Step for the slopes of initial values, as a fraction of a cell. It needs no accuracy: the
#: residuals judge the solutions.
_SLOPE_STEP = 1e-5
#: Largest number of rounds that begin at solved neighbors.
_ROUNDS = 100


class Points(NamedTuple):
    """Trims and linear models at N points with n states and m inputs, in the units of the model.

    status: (N,), index into `STATUS`
    states: (N, n); for BEYOND_LIMITS, values with which the equations balance; nan for NO_TRIM
    inputs: (N, m); for BEYOND_LIMITS, values with which the equations balance; nan for NO_TRIM
    A: (N, n, n), nan if not trimmed
    B: (N, n, m), nan if not trimmed
    failures: number of a point without a trim -> reason from `trim`
    one_by_one: (N,), True if the point needed `trim`
    """

    status: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    failures: dict[int, str]
    one_by_one: np.ndarray


def trim_points(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition | None = None,
    *,
    start: OperatingPoint | None = None,
    progress: Progress | None = None,
) -> Points:
    """Return the trims and linear models at N points, one for each row of `values`.

    Without as many equations as unknowns, the points are solved one by one. The status of a point
    without a trim is BEYOND_LIMITS if a solution beyond the limits is known and all unknowns are
    inputs, otherwise NO_TRIM.

    model: model of the aircraft
    variables: one name for each column of values: variables or rates, imposed instead of the
        condition's values, or parameters
    values: (N, number of variables)
    condition: by default the trim that the model declares
    start: initial point of the search at each point, or None for the default
    progress: called with (finished points, all points), or None

    Raises BadInputError for values of a wrong shape, and for an unknown name.
    """
    values = numbers_in("values", values)
    if values.ndim != 2 or values.shape[1] != len(variables):
        raise BadInputError(
            f"values have shape {values.shape}; give (N, {len(variables)}), a column for each "
            "variable"
        )
    if condition is None:
        condition = usual_condition(model)
    if bool(condition.model.source.native) != bool(model.source.native):  # one was converted to SI
        raise BadInputError(OTHER_UNITS)

    given_variables, given_values = variables, values
    model, variables, values, condition = _with_true_speed(model, variables, values, condition)
    for name in variables:
        model.refuse_unheld("cannot sweep", name, tuple(model.parameters))
    begin = None if start is None else start.values
    system = TrimSystem(model, condition.freed_for(variables), variables, begin)
    kept = _kept_values(system, variables, values)
    if kept:
        with_kept = release(condition, hold=kept).freed_for(variables)
        system = TrimSystem(model, with_kept, variables, begin)

    points = _solved_together(system, variables, values)
    within = condition.limits_on(given_variables).within(given_values).all(axis=1)
    refused = ~within & (points.status == TRIMMED)  # `trim` says which value is beyond its limit
    points.status[refused] = NO_TRIM
    points.one_by_one[refused] = True

    slow = np.flatnonzero(points.one_by_one).tolist()
    for done, i in enumerate(slow, start=len(values) - len(slow) + 1):
        _solve_alone(model, condition, points, i, variables, values[i], start)
        if progress is not None:
            progress(done, len(values))

    _leave_out_without_slopes(system, points)
    untrimmed = points.status != TRIMMED
    points.A[untrimmed] = np.nan
    points.B[untrimmed] = np.nan
    return points


def _leave_out_without_slopes(system: TrimSystem, points: Points) -> None:
    """Store that there is no trim, and why, at each trim at which a derivative is not a number."""
    model = system.model
    finite = np.isfinite(points.A).all(axis=(1, 2)) & np.isfinite(points.B).all(axis=(1, 2))
    for i in np.flatnonzero((points.status == TRIMMED) & ~finite).tolist():
        names = (*model.states, *model.inputs)
        values = dict(zip(names, (*points.states[i], *points.inputs[i]), strict=True))
        finite_rates = np.zeros(len(model.states))  # the message is then about a derivative
        points.failures[i] = model.message_of_not_finite(finite_rates, values)
        points.status[i] = NO_TRIM


def _kept_values(
    system: TrimSystem, variables: tuple[str, ...], values: np.ndarray
) -> dict[str, float]:
    """Return the states that trims keep at their start values, state -> value.

    They are those of one trim: at the first, the middle or the last point, the first that has one.
    """
    count = len(values)
    tried = (0, count // 2, count - 1) if count and keepable(system, system.condition) else ()
    for row in values[[*dict.fromkeys(tried)]]:
        try:
            model = model_at(system.model, variables, row)
            point = trim(model, condition_at(system.condition, variables, row))
        except (BadInputError, NoSolutionError):
            continue
        kept = () if point.found_by is None else point.found_by.kept
        return {name: point.values[name] for name in kept}
    return {}


def _with_true_speed(
    model: Model, variables: tuple[str, ...], values: np.ndarray, condition: TrimCondition
) -> tuple[Model, tuple[str, ...], np.ndarray, TrimCondition]:
    """Return the arguments with the speed in place of an imposed airspeed, such as kcas, or without
    an altitude with an output in its place.
    """
    condition = condition.freed_for(variables)
    columns = dict(zip(variables, values.T, strict=True))
    given = {**condition.imposed, **columns}
    if model.airspeeds.keys().isdisjoint(given):
        return model, variables, values, condition
    from hfa_aircraft.rigid.atmosphere import with_airspeed, with_speed

    model = with_airspeed(model, given)  # with an airspeed as output if no altitude is imposed
    condition = replace(condition, model=model)
    resolved = with_speed(model, given)
    added = set(resolved).difference(given)  # name of the speed or output
    if not added:
        return model, variables, values, condition
    columns = {name: column for name, column in columns.items() if name in resolved}
    for name in added:
        columns[name] = np.broadcast_to(resolved[name], len(values))
    imposed = {name: value for name, value in condition.imposed.items() if name in resolved}
    table = np.column_stack(list(columns.values()))
    return model, tuple(columns), table, replace(condition, imposed=imposed)


def model_at(model: Model, variables: tuple[str, ...], row: np.ndarray) -> Model:
    """Return the model with the parameters of one point.

    variables: names of the values
    row: values at the point; those of variables that are not parameters are ignored
    """
    values = zip(variables, row.tolist(), strict=True)
    return model.with_parameters(
        **{name: value for name, value in values if name in model.parameters}
    )


def condition_at(
    condition: TrimCondition, variables: tuple[str, ...], row: np.ndarray
) -> TrimCondition:
    """Return the trim condition of one point.

    condition: condition common to all points
    variables: names of the values
    row: values at the point, which are imposed; those of parameters are ignored

    Raises BadInputError for a value outside its limits.
    """
    imposable = (*condition.model.holdable, *condition.model.rates)
    hold = {
        name: value
        for name, value in zip(variables, row.tolist(), strict=True)
        if name in imposable
    }
    return condition.freed_for(hold).at(hold.get(condition.model.schedule), hold)


def _solved_together(system: TrimSystem, variables: tuple[str, ...], values: np.ndarray) -> Points:
    """Return the trims and linear models that Newton's method finds for all points together."""
    # - TRIMMED: the equations balance within the limits.
    # - BEYOND_LIMITS: the equations balance only beyond the limits, and all unknowns are inputs.
    # - NO_TRIM, marked in `one_by_one`: all other points, and every point if the system is not
    #   square.
    model = system.model
    n, m, count = len(model.states), len(model.inputs), len(values)
    if not system.equations.square or not count:
        status = np.full(count, NO_TRIM, dtype=np.int8)
        shapes = ((n,), (m,), (n, n), (n, m))
        x, u, A, B = (np.full((count, *shape), np.nan) for shape in shapes)
        return Points(status, x, u, A, B, failures={}, one_by_one=status == NO_TRIM)

    c = _constants(system, variables, values)
    z = _starts(system, variables, values)
    ends = newton(system, z, c)
    if not ends.converged.all():
        _solve_from_neighbors(system, values, c, ends)

    found = system.linear(ends.z, c)
    names = (*model.states, *model.inputs, *system.watched.names)
    within = system.condition.limits_on(names).within(found.signals).all(axis=1)
    within_of_unknowns = system.limits.within(ends.z * system.scales)  # also of a free output
    within &= (within_of_unknowns & (np.abs(ends.z) <= system.quarter_turn)).all(axis=1)
    balanced = (np.abs(found.residual) <= BALANCE).all(axis=1)
    status = np.where(balanced & within, TRIMMED, NO_TRIM)
    if system.only_inputs:
        status[balanced & ~within] = BEYOND_LIMITS
    return Points(
        status=status.astype(np.int8),
        states=found.signals[:, :n],
        inputs=found.signals[:, n : n + m],
        A=found.A,
        B=found.B,
        failures={},
        one_by_one=status == NO_TRIM,
    )


def _starts(system: TrimSystem, variables: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """Return the initial scaled unknowns of each point, (N, k)."""
    # - `system.start` for every point, if all unknowns are inputs or no variable is given
    # - otherwise a Taylor polynomial about the solution z_c at the center c of the point's cell,
    #   z(c + d) = z_c + s d + b d², quadratic for a single variable, linear for several
    # The cells divide the space of the variables and are fixed for a model. The result for a point
    # therefore does not depend on the other points. A term that changes an unknown by `_STEEPEST`
    # or more over a cell is omitted, because the search could converge to another solution.
    if system.only_inputs or not variables:
        return np.tile(system.start, (len(values), 1))
    is_single = len(variables) == 1
    width = _FINE_CELL if is_single else _CELL
    widths = width * system.model.nominal(variables)
    places = values / widths
    centers, cell_of_point = _cells_of(places)
    starts = _declared_starts(system, variables, centers * widths)
    solved, is_solved = newton(system, starts, _constants(system, variables, centers * widths))
    solved[~is_solved] = starts[~is_solved]
    cells = _Cells(system, variables, centers, widths, solved, is_solved)
    z = solved[cell_of_point]
    d = places - centers[cell_of_point]
    for column, direction in enumerate(np.eye(len(variables))):
        slopes = cells.slopes(direction)
        z += cells.gentle(slopes)[cell_of_point] * d[:, [column]]
        if is_single:
            curvatures = cells.curvatures(direction, slopes)
            z += cells.gentle(curvatures)[cell_of_point] * d**2
    return z


class _Cells(NamedTuple):
    """Cells of the space of v variables, with the solution of k scaled unknowns at each center."""

    system: TrimSystem
    variables: tuple[str, ...]
    centers: np.ndarray  # (cells, v), in widths of a cell
    widths: np.ndarray  # of a cell in each variable, (v,)
    z: np.ndarray  # scaled unknowns at the centers, (cells, k)
    is_solved: np.ndarray  # (cells,), True if z solves the equations

    def slopes(self, direction: np.ndarray) -> np.ndarray:
        """Return s of z(c + d) = z_c + s d + b d², (cells, k), with d in widths of a cell."""
        # One Newton step from z_c at d = h, a small step, gives z_c + s h.
        return self._newton_step(_SLOPE_STEP * direction, self.z) / _SLOPE_STEP

    def curvatures(self, direction: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Return b of z(c + d) = z_c + s d + b d², (cells, k), with d in widths of a cell."""
        # One Newton step at d = 1/2 from z_c + s/2 changes z by b/4.
        return 4.0 * self._newton_step(direction / 2.0, self.z + slopes / 2.0)

    def gentle(self, changes: np.ndarray) -> np.ndarray:
        """Return changes over a cell (cells, k), 0 where they are steep or unknown."""
        is_gentle = self.is_solved & (np.abs(changes).max(axis=1) < _STEEPEST)
        return np.where(is_gentle[:, None], changes, 0.0)

    def _newton_step(self, distance: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the Newton step from z (cells, k) at a distance from the centers."""
        values = (self.centers + distance) * self.widths
        residual, jacobian = self.system.residuals(
            z, _constants(self.system, self.variables, values)
        )
        return newton_step(jacobian, residual)


def _cells_of(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the centers (cells, v) of the cells of points, and the cell of each point, (N,).

    places: values of the variables at the points, in widths of a cell, (N, v)
    """
    nearest = np.round(places)
    # Consecutive points mostly share a cell: only the first point of each such run is looked up.
    begins_run = np.ones(len(nearest), dtype=bool)
    begins_run[1:] = (nearest[1:] != nearest[:-1]).any(axis=1)
    cells, cell_of_run = np.unique(nearest[begins_run], axis=0, return_inverse=True)
    run_of_point = np.cumsum(begins_run) - 1
    return cells, cell_of_run.ravel()[run_of_point]


def _declared_starts(
    system: TrimSystem, variables: tuple[str, ...], values: np.ndarray
) -> np.ndarray:
    """Return the declared or computed (`Trimming.initial`) scaled unknowns at N points, (N, k)."""
    starts = np.tile(system.start, (len(values), 1))
    columns = dict(zip(variables, values.T, strict=True))
    computed = system.model.trimming.initial({**system.condition.imposed, **columns})
    for column, name in enumerate(system.equations.unknowns):
        if name in computed:
            starts[:, column] = computed[name] / system.scales[column]
    return starts


def _constants(system: TrimSystem, variables: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """Return the constants c of the equations at N points, (N, ..)."""
    return system.constants(len(values), dict(zip(variables, values.T, strict=True)))


def _solve_from_neighbors(
    system: TrimSystem, values: np.ndarray, c: np.ndarray, ends: NewtonEnds
) -> None:
    """Repeat Newton's method at points that have not converged from their nearest converged ones.

    The solutions are stored in `ends`.
    """
    from scipy.spatial import cKDTree

    spread = np.ptp(values, axis=0)
    places = (values - values.min(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    tried_from = np.full(len(values), -1)  # the last neighbor from which each point was searched
    for _ in range(_ROUNDS):
        solved = np.flatnonzero(ends.converged)
        waiting = np.flatnonzero(~ends.converged)
        if not solved.size or not waiting.size:
            return
        _, index = cKDTree(places[solved]).query(places[waiting])
        neighbor = solved[index]
        is_new = neighbor != tried_from[waiting]
        waiting, neighbor = waiting[is_new], neighbor[is_new]
        if not waiting.size:
            return
        tried_from[waiting] = neighbor
        z, converged = newton(system, ends.z[neighbor], c[waiting])
        ends.z[waiting[converged]] = z[converged]
        ends.converged[waiting[converged]] = True


def _solve_alone(
    model: Model,
    condition: TrimCondition,
    points: Points,
    i: int,
    variables: tuple[str, ...],
    row: np.ndarray,
    start: OperatingPoint | None,
) -> None:
    """Trim point i by `trim`, and store the trim, or the reason why there is none, in `points`."""
    try:
        model = model_at(model, variables, row)
        point = trim(model, condition_at(condition, variables, row), start)
        linear = model.at(point.states, point.inputs)
    except (BadInputError, NoSolutionError) as error:
        points.failures[i] = str(error)
        points.states[i] = np.nan
        points.inputs[i] = np.nan
        return
    points.status[i] = TRIMMED
    points.states[i] = point.states
    points.inputs[i] = point.inputs
    points.A[i] = linear.A
    points.B[i] = linear.B
