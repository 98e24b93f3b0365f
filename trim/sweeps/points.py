"""Trims and linear models of many points: Newton's method on all of them at once, in one compiled
function; what it cannot settle goes to `find_operating_point`. A point without a trim keeps its
status and the reason."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Layout, Model, components
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.native.bound import BoundFunction, cached_per_thread
from hfa_support.progress import Progress
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import BALANCE, OperatingPoint, Status
from trim.point.solve import find_operating_point

#: What became of a point.
STATUS = (Status.TRIMMED, Status.BEYOND_LIMITS, Status.NO_TRIM)
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))
#: From this many points on, compiling the functions to machine code pays, for any model: the time
#: to compile and the time that a point then saves both grow with the number of instructions.
#: Measured: 31,000 points of the HFA (1,820 instructions), 32,000 of the F-16 (19,341), 29,000 of
#: the Navion (688). No clock decides: machine code gives the same numbers to rounding only, and a
#: sweep has the same bits each time.
COMPILE_FROM = 30_000
#: Scaled residual before a step of Newton's method after which that step ends at rounding.
_NEARLY = 1e-7
_MOST_STEPS = 20
#: Of a Newton step that is halved until the residuals fall.
_LEAST_SHARE = 2.0**-10
#: Points a call of the compiled function, the most that there are.
_TOGETHER = (250, 16, 1)


class Points(NamedTuple):
    """N points of n states and m inputs. status: (N,) index into `STATUS`. states: (N, n), inputs:
    (N, m): where trimmed, or what balance would take where beyond limits. A: (N, n, n), B: (N, n,
    m); nan where not trimmed. failures: number of a point that `find_operating_point` could not
    trim -> why. Units: the model's."""

    status: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    failures: dict[int, str]


def trim_points(
    aircraft: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition | None = None,
    *,
    start: OperatingPoint | None = None,
    compile_code: bool | None = None,
    progress: Progress | None = None,
) -> Points:
    """Trim and linearize every row of `values`; a row without a trim keeps its status instead of
    raising.

    variables: one a column of values (N, k): what is imposed in place of the condition's values,
    rates too, or a parameter in place of the aircraft's. start: where the search begins at each
    point. compile_code: run as machine code; by default from `COMPILE_FROM` points on. progress is
    called with (points settled, points in all).

    Newton's method needs as many equations as unknowns; without that, point by point. That a point
    balances beyond its limits only is said where the inputs alone are free: other unknowns can have
    two solutions."""
    values = numbers_in("values", values)
    if values.ndim != 2 or values.shape[1] != len(variables):
        raise BadInputError(
            f"values are {values.shape}; they must be (N, {len(variables)}), a column a variable"
        )
    model = aircraft
    condition = usual_condition(model) if condition is None else condition
    for name in variables:
        model.refuse_unheld("cannot sweep", name, tuple(model.parameters))
    n, m, key = len(model.states), len(model.inputs), _key(model, variables, condition)
    watched = () if key is None else key[-1]
    seen = (*model.states, *model.inputs, *watched)
    ends = list(itertools.accumulate([n, m, len(watched), n * n, n * m]))
    if key is None or not len(values):
        flat = np.full((len(values), ends[-1] + 1), np.nan)
    else:
        flat = _newton(model, variables, values, condition, key, start, compile_code)
    balanced = (np.abs(flat[:, ends[-1] :]) <= BALANCE).all(axis=1)
    within = condition.limits_on(seen).within(flat[:, : len(seen)]).all(axis=1)
    status = np.where(balanced & within, TRIMMED, NO_TRIM).astype(np.int8)
    if set(condition.free) - set(variables) <= set(model.inputs):
        status[balanced & ~within] = BEYOND_LIMITS
    states, inputs, _, A, B, _ = np.split(flat, ends, axis=1)
    A, B = A.reshape(-1, n, n), B.reshape(-1, n, m)
    failures: dict[int, str] = {}
    slow = np.flatnonzero(status == NO_TRIM).tolist()
    for done, i in enumerate(slow, start=len(values) - len(slow) + 1):
        try:
            own = model_at(model, variables, values[i])
            point = find_operating_point(own, condition_at(condition, variables, values[i]), start)
            exact = own.at(point.states, point.inputs)
            status[i], states[i], inputs[i], A[i], B[i] = (
                TRIMMED,
                point.states,
                point.inputs,
                exact.A,
                exact.B,
            )
        except (BadInputError, NoSolutionError) as error:
            failures[i], states[i], inputs[i] = str(error), np.nan, np.nan
        if progress is not None:
            progress(done, len(values))
    A[status != TRIMMED], B[status != TRIMMED] = np.nan, np.nan
    return Points(status, states, inputs, A, B, failures)


def model_at(model: Model, variables: tuple[str, ...], row: np.ndarray) -> Model:
    """The model with the parameters of one point."""
    values = zip(variables, row.tolist(), strict=True)
    return model.with_parameters(
        **{name: value for name, value in values if name in model.parameters}
    )


def condition_at(
    condition: TrimCondition, variables: tuple[str, ...], row: np.ndarray
) -> TrimCondition:
    """The condition of one point; BadInputError where one of its values lies outside its limits."""
    known = (*condition.model.holdable, *condition.model.rates)
    hold = {
        name: value for name, value in zip(variables, row.tolist(), strict=True) if name in known
    }
    return condition.at(hold.get(condition.model.schedule), hold)


def parameters_at(model: Model, variables: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """The parameters of each point, (N, number of them): the model's, but for those that vary."""
    constants = np.tile(model.p, (len(values), 1))
    for column, name in enumerate(variables):
        if name in model.parameters:
            constants[:, list(model.parameters).index(name)] = values[:, column]
    return constants


def is_square(model: Model, variables: tuple[str, ...], condition: TrimCondition) -> bool:
    """Whether the points have as many equations as unknowns, so that Newton's method settles many
    at once."""
    return _key(model, variables, condition) is not None


@lru_cache(maxsize=16)
def newton_functions(
    layout: Layout,
    given: tuple[str, ...],
    free: tuple[str, ...],
    rates: tuple[tuple[str, float, float], ...],
    outputs: tuple[tuple[str, float], ...] = (),
    watched: tuple[str, ...] = (),
) -> tuple[ca.Function, ca.Function] | None:
    """(given, v, p) -> v after a Newton step and the norm of the scaled residuals before it; and ->
    x, u, the watched outputs, A, B (row by row) and the scaled residuals at v, one below the other.
    None unless as many equations as unknowns feel them, each of these unknowns in one.

    given: imposed values, rates too; a variable that is neither given nor free is 0. v: the values
    of `free`; what is in no equation stays. rates: (state, rate unless given, scale); outputs:
    (imposed output, scale)."""
    known, v, (x, u, p) = (
        ca.SX.sym("given", len(given)),
        ca.SX.sym("v", len(free)),
        layout.symbols("x", "u", "p"),
    )
    values = dict.fromkeys(layout.variables, ca.SX(0)) | dict(
        zip(given, ca.vertsplit(known), strict=True)
    )
    values |= dict(zip(free, ca.vertsplit(v), strict=True))
    names = [name for name, _ in outputs]
    state, control, at, y = layout.in_variables(values, p, (*names, *watched))
    index = layout.names[0].index
    residual = ca.vertcat(
        *(
            (at[index(name)] - values.get(f"{name}_dot", rate)) / scale
            for name, rate, scale in rates
        ),
        *((y[i] - values[name]) / scale for i, (name, scale) in enumerate(outputs)),
    )
    jacobian = ca.jacobian(residual, v)
    moved = [i for i in range(residual.numel()) if jacobian[i, :].nnz()]
    moving = [j for j in range(len(free)) if jacobian[:, j].nnz()]
    if not moving or len(moved) != len(moving) or ca.sprank(jacobian[moved, moving]) < len(moving):
        return None
    after = ca.SX(v)
    after[moving] = v[moving] - ca.solve(jacobian[moved, moving], residual[moved])
    f, _ = layout.expressions(list(map(components, (x, u, p))), ())
    A, B = ca.substitute([ca.jacobian(f, by) for by in (x, u)], [x, u], [state, control])
    flat = ca.vertcat(
        state,
        control,
        *components(y)[len(names) :],
        *(ca.vec(ca.densify(each).T) for each in (A, B)),
        residual,
    )
    arguments = [known, v, p]
    return (
        ca.Function("newton", arguments, ca.cse([after, ca.sqrt(ca.sumsqr(ca.densify(residual)))])),
        ca.Function("at", arguments, [ca.cse(ca.densify(flat))]),
    )


def _key(model: Model, variables: tuple[str, ...], condition: TrimCondition) -> Any:
    """What `newton_functions` takes; None where it makes no functions."""
    varied = [name for name in variables if name not in model.parameters]
    held = {*condition.imposed, *varied}
    # An imposed 0 that does not vary is no symbol: the functions become smaller.
    zero = {
        name
        for name in held.intersection(model.variables).difference(varied)
        if condition.imposed[name] == 0.0
    }
    given = tuple(name for name in (*model.holdable, *model.rates) if name in held - zero)
    free = tuple(name for name in condition.free if name not in varied)
    steady = {**condition.rates, **{name: 0.0 for name in model.states if f"{name}_dot" in varied}}
    rates = tuple((name, rate, model.rate_scale(name)) for name, rate in steady.items())
    imposed = [name for name in given if name not in (*model.variables, *model.rates)]
    outputs = tuple((name, model.signals[name].nominal) for name in imposed)
    limits = {**model.limits, **condition.limits}
    watched = tuple(
        name for name in model.outputs if name not in held and any(map(math.isfinite, limits[name]))
    )
    key = model.layout, given, free, rates, outputs, watched
    return key if free and newton_functions(*key) is not None else None


@cached_per_thread(maxsize=16)
def _compiled(key: Any, together: int, use_machine_code: bool) -> list[BoundFunction]:
    """The functions of `newton_functions` for as many points a call, bound to memory."""
    many = [
        function.map(together) if together > 1 else function
        for function in newton_functions(*key) or ()
    ]
    if use_machine_code:
        from hfa_support.native.machine_code import machine_code

        many = list(map(machine_code, many))
    return list(map(BoundFunction, many))


def _newton(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    key: Any,
    start: OperatingPoint | None,
    compile_code: bool | None,
) -> np.ndarray:
    """Of each point what the second function of `newton_functions` returns, in a row."""
    free, count = key[2], len(values)
    together = next(size for size in _TOGETHER if size <= count)
    functions = _compiled(
        key, together, count >= COMPILE_FROM if compile_code is None else compile_code
    )
    begin = condition.begin if start is None else start.values
    first = np.array([begin.get(name, model.signals[name].start) for name in free])
    guess = np.tile(first, (count, 1))
    # Inputs alone have one solution. With states free there may be others: all points begin at
    # solutions of the same coarse grid (a fiftieth of the nominal values), the model's, so that no
    # row depends on its neighbours.
    if variables and not set(free) <= set(model.inputs):
        known = {**model.rates, **model.signals}
        size = np.array([0.02 * known[name].nominal for name in variables])
        places, cell = np.unique(np.round(values / size), axis=0, return_inverse=True)
        near, unknowns = _settle(
            model, variables, condition, key, functions, places * size, guess[: len(places)]
        )
        balanced = (np.abs(near[:, -len(key[3] + key[4]) :]) <= BALANCE).all(axis=1)
        guess = np.where(balanced[:, None], unknowns, first)[cell.ravel()]
    return _settle(model, variables, condition, key, functions, values, guess)[0]


def _settle(
    model: Model,
    variables: tuple[str, ...],
    condition: TrimCondition,
    key: Any,
    functions: list[BoundFunction],
    values: np.ndarray,
    guess: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What `_newton` returns and the unknowns, from a guess of the unknowns of each point."""
    given, (step, at), by, count = key[1], functions, model.schedule, len(values)
    columns = dict(zip(variables, values.T, strict=True))
    place = columns.get(by, np.full(count, condition.imposed.get(by, 0.0)))
    columns |= {name: condition.values_at(name, place) for name in given if name not in columns}
    imposed = (
        np.stack([columns[name] for name in given], axis=-1) if given else np.zeros((count, 0))
    )
    tables = imposed, guess, parameters_at(model, variables, values)
    together = step.results[0].size // guess.shape[1]
    rows = at.results[0].reshape(together, -1)
    v = step.inputs[1].reshape(together, -1)
    flat, unknowns = np.empty((count, rows.shape[1])), np.empty_like(guess)
    for first in range(0, count, together):
        here = min(together, count - first)
        for memory, table in zip(step.inputs, tables, strict=True):
            memory.reshape(together, -1)[:here] = table[first : first + here]
        _halving(step, v)
        unknowns[first : first + here] = v[:here]
        for target, source in zip(at.inputs, step.inputs, strict=True):
            target[:] = source
        at()
        flat[first : first + here] = rows[:here]
    return flat, unknowns


def _halving(step: BoundFunction, v: np.ndarray) -> None:
    """Newton's method on the unknowns v, a row a point: each step is halved until the residual
    falls. One step more than `_NEARLY` asks for ends at rounding."""
    after, residual = (result.reshape(len(v), -1) for result in step.results)
    step()
    base, best, share = v.copy(), residual.copy(), np.ones((len(v), 1))
    v[:] = after
    for _ in range(2 * _MOST_STEPS):
        searching = (best > _NEARLY) & (share > _LEAST_SHARE)
        if not searching.any():
            break
        step()
        better = searching & (residual < best)
        for target, source in ((base, v), (best, residual), (v, after)):
            np.copyto(target, source, where=better)
        share[better] = 1.0
        halved = searching & ~better
        if halved.any():
            share[halved] /= 2.0
            np.copyto(v, (base + v) / 2.0, where=halved)
