"""Trims and linear models of many points: Newton's method on all of them at once, in one compiled function; what it
cannot settle goes to `find_operating_point`. A point without a trim keeps its status and the reason."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.model import Layout, Model, components
from hfa_support.native.bound import BoundFunction, cached_per_thread
from hfa_support.progress import Progress
from trim.point.condition import LEVEL_FLIGHT, TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, Status
from trim.point.solve import beyond_limits, find_operating_point

#: What became of a point.
STATUS = (Status.TRIMMED, Status.BEYOND_LIMITS, Status.NO_TRIM)
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))
#: From this many points on, compiling the functions to machine code pays, for any model: the time to compile and the
#: time that a point then saves both grow with the number of instructions. Measured: 31,000 points of the HFA (1,820
#: instructions), 32,000 of the F-16 (19,341), 29,000 of the Navion (688). No clock decides: machine code gives the
#: same numbers to rounding only, and a sweep has the same bits each time.
COMPILE_FROM = 30_000
#: Scaled residual before a step of Newton's method after which that step ends at rounding.
_NEARLY = 1e-7
_MOST_STEPS = 20
#: Of a Newton step that is halved until the residuals fall.
_LEAST_SHARE = 2.0**-10
#: Points a call of the compiled function, the most that there are.
_TOGETHER = (250, 16, 1)


class Points(NamedTuple):
    """N points of n states and m inputs. status: (N,) index into `STATUS`. limiting: (N,) index into states and inputs
    of the variable farthest beyond its limits, -1 when none. states: (N, n), inputs: (N, m): where trimmed, or what
    balance would take where beyond limits. A: (N, n, n), B: (N, n, m); nan where not trimmed. failures: number of a
    point that `find_operating_point` could not trim -> why. Units: the model's.
    """

    status: np.ndarray
    limiting: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    failures: dict[int, str]


def trim_points(
    aircraft: Aircraft | Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition = LEVEL_FLIGHT,
    *,
    start: OperatingPoint | None = None,
    compile_code: bool | None = None,
    progress: Progress | None = None,
) -> Points:
    """Trim and linearize every row of `values`; a row without a trim keeps its status instead of raising.

    variables: one a column of values (N, k): what is imposed in place of the condition's values, rates too, or a
    parameter in place of the aircraft's. start: where the search begins at each point. compile_code: run as machine
    code; by default from `COMPILE_FROM` points on. progress is called with (points settled, points in all).

    Newton's method needs as many equations as unknowns; without that, point by point. That a point balances beyond
    its limits only is said where the inputs alone are free: other unknowns can have two solutions.
    """
    values = numbers_in("values", values)
    if values.ndim != 2 or values.shape[1] != len(variables):
        raise BadInputError(f"values are {values.shape}; they must be (N, {len(variables)}), a column a variable")
    model = aircraft.model
    for name in variables:
        model.refuse_unheld("cannot sweep", name, tuple(model.parameters))
    constants = parameters_at(model, variables, values)
    n, m = len(model.states), len(model.inputs)
    flat, watched, balanced = _newton(model, variables, values, constants, condition, start, compile_code)
    excess, width = _excess(model, flat, watched, condition)
    within = (excess <= 0.0).all(axis=1)
    status = np.where(balanced & within, TRIMMED, NO_TRIM).astype(np.int8)
    if set(condition.free) - set(variables) <= set(model.inputs):
        status[balanced & ~within] = BEYOND_LIMITS
    states, inputs, A, B, _ = np.split(flat, _ends(model)[:-1], axis=1)
    A, B = A.reshape(-1, n, n), B.reshape(-1, n, m)
    failures: dict[int, str] = {}
    slow = np.flatnonzero(status == NO_TRIM).tolist()
    for done, i in enumerate(slow, start=len(values) - len(slow) + 1):
        try:
            own = _own(model, constants[i])
            point = find_operating_point(own, condition_at(condition, variables, values[i]), start)
            found = own.at(point.states, point.inputs)
            status[i], states[i], inputs[i], A[i], B[i] = TRIMMED, point.states, point.inputs, found.A, found.B
        except (BadInputError, NoSolutionError) as error:
            failures[i], states[i], inputs[i] = str(error), np.nan, np.nan
        if progress is not None:
            progress(done, len(values))
    limiting = np.full(len(values), -1, dtype=np.int8)
    beyond = status == BEYOND_LIMITS
    limiting[beyond] = (excess[beyond, : n + m] / width[: n + m]).argmax(axis=1)
    A[status != TRIMMED], B[status != TRIMMED] = np.nan, np.nan
    return Points(status, limiting, states, inputs, A, B, failures)


def parameters_at(model: Model, variables: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """The parameters of each point, (N, number of them): the model's, but for those that vary."""
    constants = np.tile(model.p, (len(values), 1))
    for column, name in enumerate(variables):
        if name in model.parameters:
            constants[:, list(model.parameters).index(name)] = values[:, column]
    return constants


def _own(model: Model, constants: np.ndarray) -> Model:
    return model.with_parameters(**dict(zip(model.parameters, constants.tolist(), strict=True)))


def _ends(model: Model) -> list[int]:
    """Columns of x, u, A and B (row by row), dX/dt."""
    n, m = len(model.states), len(model.inputs)
    return list(itertools.accumulate([n, m, n * n, n * m, n]))


def reasons_of(
    status: np.ndarray,
    inputs: np.ndarray,
    failures: Mapping[int, str],
    aircraft: Aircraft | Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
) -> tuple[str, ...]:
    """Why each point has no trim, "" where it has one; status, inputs and failures as in `Points`."""
    model, reasons = aircraft.model, [failures.get(i, "") for i in range(len(values))]
    constants = parameters_at(model, variables, values)
    for i in np.flatnonzero(status == BEYOND_LIMITS).tolist():
        balancing = dict(zip(model.inputs, inputs[i].tolist(), strict=True))
        at = condition_at(condition, variables, values[i])
        reasons[i] = beyond_limits(_own(model, constants[i]), at, balancing)
    return tuple(reasons)


def condition_at(condition: TrimCondition, variables: tuple[str, ...], row: np.ndarray) -> TrimCondition:
    """The condition of one point; BadInputError where one of its values lies outside its limits."""
    known = (*condition.model.holdable, *condition.model.rates)
    hold = {name: value for name, value in zip(variables, row.tolist(), strict=True) if name in known}
    return condition.at(hold.get(condition.model.schedule), hold)


def is_square(model: Model, variables: tuple[str, ...], condition: TrimCondition) -> bool:
    """Whether the points have as many equations as unknowns, so that Newton's method settles many at once."""
    return _key(model, variables, condition) is not None


def newton_functions(
    layout: Layout,
    given: tuple[str, ...],
    free: tuple[str, ...],
    rates: tuple[tuple[str, float, float], ...],
    outputs: tuple[tuple[str, float], ...] = (),
    watched: tuple[str, ...] = (),
) -> tuple[ca.Function, ca.Function] | None:
    """(given, v, p) -> v after a Newton step and the norm of the scaled residuals before it; and -> x, u, A, B
    (row by row), dX/dt, the imposed and the watched outputs at v. None unless as many equations as unknowns feel them,
    each of these unknowns in one.

    given: imposed values, rates too; a variable that is neither given nor free is 0. v: the values of `free`; what is
    in no equation stays. rates: (state, rate unless given, scale); outputs: (imposed output, scale).
    """
    known, v, (x, u, p) = ca.SX.sym("given", len(given)), ca.SX.sym("v", len(free)), layout.symbols("x", "u", "p")
    values = dict.fromkeys(layout.variables, ca.SX(0)) | dict(zip(given, ca.vertsplit(known), strict=True))
    values |= dict(zip(free, ca.vertsplit(v), strict=True))
    names = [name for name, _ in outputs]
    state, control, at, y = layout.in_variables(values, p, (*names, *watched))
    index = layout.names[0].index
    residual = ca.vertcat(
        *((at[index(name)] - values.get(f"{name}_dot", rate)) / scale for name, rate, scale in rates),
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
    flat = [f, *(ca.vec(ca.densify(ca.jacobian(f, by)).T) for by in (x, u))]
    rate, A, B = ca.substitute(flat, [x, u], [state, control])
    arguments = [known, v, p]
    return (
        ca.Function("newton", arguments, ca.cse([after, ca.sqrt(ca.sumsqr(ca.densify(residual)))])),
        ca.Function("at", arguments, ca.cse([*map(ca.densify, (state, control)), A, B, rate, *[y] * bool(y.numel())])),
    )


def first_guess(model: Model, free: tuple[str, ...], begin: Mapping[str, float]) -> list[float]:
    """Where Newton's method begins."""
    return [begin.get(name, model.signals[name].start) for name in free]


def _key(model: Model, variables: tuple[str, ...], condition: TrimCondition) -> Any:
    """Key of `_compiled`: layout, given, free, rates, imposed outputs, watched; None where it makes no functions."""
    varied = [name for name in variables if name not in model.parameters]
    held = dict.fromkeys([*condition.imposed, *varied])
    nonzero = [name for name in held if name in varied or condition.imposed.get(name) != 0.0]
    given = tuple(name for name in model.holdable if name in nonzero or (name in held and name in model.outputs))
    given += tuple(name for name in model.rates if name in varied)
    free = tuple(name for name in condition.free if name not in varied)
    steady = {**condition.rates, **{name: 0.0 for name in model.states if f"{name}_dot" in varied}}
    rates = tuple((name, rate, model.rate_scale(name)) for name, rate in steady.items())
    outputs = tuple(
        (name, model.signals[name].nominal) for name in given if name not in (*model.variables, *model.rates)
    )
    key = model.layout, given, free, rates, outputs, _watched(model, condition, [*held])
    return key if free and _pair(*key) is not None else None


def _watched(model: Model, condition: TrimCondition, held: Sequence[str]) -> tuple[str, ...]:
    """What has limits and is neither a state, an input nor held."""
    limits = {**model.limits, **condition.limits}
    return tuple(name for name in model.outputs if name not in held and any(map(math.isfinite, limits[name])))


@lru_cache(maxsize=16)
def _pair(*key: Any) -> tuple[ca.Function, ca.Function] | None:
    return newton_functions(*key)


@cached_per_thread(maxsize=16)
def _compiled(key: Any, together: int, use_machine_code: bool) -> tuple[BoundFunction, BoundFunction]:
    """The functions of `newton_functions` for as many points a call, bound to memory."""
    found = []
    for function in _pair(*key) or ():
        flat = ca.vertcat(*function.call(function.sx_in())) if function.name() == "at" else None
        one = function if flat is None else ca.Function("at", function.sx_in(), [flat])
        many = one.map(together) if together > 1 else one
        if use_machine_code:
            from hfa_support.native.machine_code import machine_code

            many = machine_code(many)
        found.append(BoundFunction(many))
    return found[0], found[1]


def _newton(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    constants: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    compile_code: bool | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A row x, u, A, B, dX/dt a point, nan without as many equations as unknowns; the watched outputs; and which points
    balance."""
    count = len(values)
    key = _key(model, variables, condition)
    if key is None or not count:
        return np.full((count, _ends(model)[-1]), np.nan), np.zeros((count, 0)), np.zeros(count, dtype=bool)
    free = key[2]
    together = next(size for size in _TOGETHER if size <= count)
    functions = _compiled(key, together, count >= COMPILE_FROM if compile_code is None else compile_code)
    settle = partial(_settle, model, variables, condition, key, functions)
    guess = np.tile(first_guess(model, free, condition.begin if start is None else start.values), (count, 1))
    # Whole steps lead to the one solution there then is; with states free there may be others, which they may reach.
    whole_steps = set(free) <= set(model.inputs)
    if variables and not whole_steps:
        places, cell = _cells(model, variables, values)
        *_, balanced, near = settle(places, parameters_at(model, variables, places), guess[: len(places)], whole_steps)
        guess = np.where(balanced[cell, None], near[cell], guess)
    return settle(values, constants, guess, whole_steps)[:3]


def _settle(
    model: Model,
    variables: tuple[str, ...],
    condition: TrimCondition,
    key: Any,
    functions: tuple[BoundFunction, BoundFunction],
    values: np.ndarray,
    constants: np.ndarray,
    guess: np.ndarray,
    whole_steps: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What `_newton` returns and the unknowns, from a guess of the unknowns of each point."""
    (_, given, _, rates, outputs, watched), (step, at) = key, functions
    count, end = len(values), _ends(model)[-1]
    flat, unknowns = np.full((count, end + len(outputs) + len(watched)), np.nan), np.empty_like(guess)
    columns, by = dict(zip(variables, values.T, strict=True)), model.schedule
    place = columns.get(by, np.full(count, condition.imposed.get(by, 0.0)))
    columns |= {name: condition.values_at(name, place) for name in given if name not in columns}
    imposed = np.stack([columns[name] for name in given], axis=-1) if given else np.zeros((count, 0))
    after = step.results[0].reshape(-1, guess.shape[1])
    together = len(after)
    residual = step.results[1].reshape(together, -1)
    for first in range(0, count, together):
        rows = slice(first, min(first + together, count))
        tables = imposed[rows], guess[rows], constants[rows]
        for memory, table in zip(step.inputs, tables, strict=True):
            memory.reshape(together, -1)[: rows.stop - first] = table
        v, searching = step.inputs[1].reshape(together, -1), np.ones(together, dtype=bool)
        for _ in range(_MOST_STEPS if whole_steps else 0):
            step()
            v[searching] = after[searching]
            searching &= residual[:, 0] > BALANCE  # one step more than balance asks for: to rounding; nan ends it
            if not searching[: rows.stop - first].any():
                break
        lost = ~(residual[:, 0] <= BALANCE) if whole_steps else searching
        lost[rows.stop - first :] = False
        if lost.any():
            v[lost] = guess[rows][lost[: rows.stop - first]]
            _halving(step, v, lost)
        unknowns[rows] = v[: rows.stop - first]
        for target, source in zip(at.inputs, step.inputs, strict=True):
            target[:] = source
        at()
        flat[rows] = at.results[0].reshape(together, -1)[: rows.stop - first]
    begin, index = _ends(model)[3], list(model.states).index
    off = [(flat[:, begin + index(name)] - columns.get(f"{name}_dot", rate)) / scale for name, rate, scale in rates]
    off += [(flat[:, end + i] - columns[name]) / scale for i, (name, scale) in enumerate(outputs)]
    balanced = np.asarray((np.abs(off) <= BALANCE).all(axis=0))
    return flat[:, :end], flat[:, end + len(outputs) :], balanced, unknowns


def _cells(model: Model, variables: tuple[str, ...], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places of a coarse grid (a fiftieth of the nominal values) next to the points, and each point's place in
    them. The grid is the model's, so that no row depends on its neighbours."""
    known = {**model.rates, **model.signals}
    size = np.array([0.02 * known[name].nominal for name in variables])
    places, cell = np.unique(np.round(values / size), axis=0, return_inverse=True)
    return places * size, cell.ravel()


def _halving(step: BoundFunction, v: np.ndarray, searching: np.ndarray) -> None:
    """Newton's method again for the points that are lost, each step halved until the residual falls."""
    after, residual = (result.reshape(len(v), -1) for result in step.results)
    base, move, share, best = v.copy(), np.zeros_like(v), np.ones((len(v), 1)), np.full(len(v), np.inf)
    for _ in range(2 * _MOST_STEPS):
        step()
        better = searching & (residual[:, 0] < best)
        base[better], best[better], share[better] = v[better], residual[better, 0], 1.0
        move[better] = after[better] - v[better]
        v[better] = after[better]
        searching = searching & (best > _NEARLY) & (share[:, 0] > _LEAST_SHARE)
        halved = searching & ~better
        share[halved] /= 2.0
        v[halved] = (base + share * move)[halved]
        if not searching.any():
            break


def _excess(
    model: Model, flat: np.ndarray, watched: np.ndarray, condition: TrimCondition
) -> tuple[np.ndarray, np.ndarray]:
    """How far x, u and the watched outputs lie beyond their limits, negative within, (N, k); and the width of the
    limits, (k,)."""
    names = (*model.states, *model.inputs)
    values = np.hstack([flat[:, : len(names)], watched])
    seen = _watched(model, condition, [*condition.imposed])[: watched.shape[1]]
    limits = np.array([condition.limits_of(name) for name in (*names, *seen)])
    width = np.where(np.isfinite(limits).all(axis=1), limits[:, 1] - limits[:, 0], 1.0)
    return np.maximum(limits[:, 0] - values, values - limits[:, 1]), width
