"""Trims and linear models of many points: Newton's method on all of them at once, in one compiled function; what it
cannot settle goes to `find_operating_point`. A point without a trim keeps its status and the reason."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.dynamics import state_rates, symbols
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUTS, RATE_SCALES, STATES
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in, refuse_unknown
from hfa_support.native.bound import BoundFunction, cached_per_thread
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress
from trim.linear.linear_model import linearize
from trim.point.condition import LEVEL_FLIGHT, LIMITS, SCALES, VARIABLES, TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, Status
from trim.point.solve import beyond_limits, find_operating_point

#: What can vary from point to point: what a trim imposes, and any parameter of the aircraft.
PLANNED = VARIABLES + Parameters._fields
#: What became of a point.
STATUS = (Status.TRIMMED, Status.BEYOND_LIMITS, Status.NO_TRIM)
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))
#: From this many points on, compiling the functions to machine code pays.
COMPILE_FROM = 50_000
_MOST_STEPS = 20
#: Points a call of the compiled function, the most that there are.
_TOGETHER = (250, 16, 1)
_N, _M, _P = len(STATES), len(INPUTS), len(Parameters._fields)
#: Columns of x, u, A and B (row by row), dX/dt.
_ENDS = np.cumsum([_N, _M, _N * _N, _N * _M, _N]).tolist()


class Points(NamedTuple):
    """N points. status: (N,) index into `STATUS`. limiting: (N,) index into STATES + INPUTS of the variable
    farthest beyond its limits, -1 when none. states: (N, 7), inputs: (N, 5): where trimmed, or what balance
    would take where beyond limits. A: (N, 7, 7), B: (N, 7, 5); nan where not trimmed. failures: number of a point
    that `find_operating_point` could not trim -> why. Units: rad, ft, s as in `vectors.py`, entries of A and B as in
    `entry_unit`.
    """

    status: np.ndarray
    limiting: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    failures: dict[int, str]


def trim_points(
    aircraft: Aircraft,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition = LEVEL_FLIGHT,
    *,
    start: OperatingPoint | None = None,
    compile_code: bool | None = None,
    progress: Progress | None = None,
) -> Points:
    """Trim and linearize every row of `values`; a row without a trim keeps its status instead of raising.

    variables: of `PLANNED`, one a column of values (N, k): what is imposed in place of the condition's values, or a
    parameter in place of the aircraft's. rad, ft/s, ft. start: where the search begins at each point. compile_code: run
    as machine code; by default from `COMPILE_FROM` points on. progress is called with (points settled, points in all).

    Newton's method needs as many equations as unknowns; without that, point by point. That a point balances beyond
    its limits only is said where the inputs alone are free: other unknowns can have two solutions.
    """
    values = numbers_in("values", values)
    if values.ndim != 2 or values.shape[1] != len(variables):
        raise BadInputError(f"values are {values.shape}; they must be (N, {len(variables)}), a column a variable")
    for name in variables:
        refuse_unknown("cannot sweep", name, PLANNED)
    constants = np.tile(np.array(aircraft.parameters, dtype=float), (len(values), 1))
    for column, name in enumerate(variables):
        if name in Parameters._fields:
            constants[:, Parameters._fields.index(name)] = values[:, column]
    flat, balanced = _newton(aircraft.variant, variables, values, constants, condition, start, compile_code)
    allowed = {**LIMITS, "gamma": (-np.inf, np.inf), **condition.limits}
    excess, width = _excess(flat, allowed)
    within = (excess <= 0.0).all(axis=1)
    status = np.where(balanced & within, TRIMMED, NO_TRIM).astype(np.int8)
    if set(condition.free) - set(variables) <= set(INPUTS):
        status[balanced & ~within] = BEYOND_LIMITS
    states, inputs, A, B, _ = np.split(flat, _ENDS[:-1], axis=1)
    A, B = A.reshape(-1, _N, _N), B.reshape(-1, _N, _M)
    failures: dict[int, str] = {}
    slow = np.flatnonzero(status == NO_TRIM).tolist()
    for done, i in enumerate(slow, start=len(values) - len(slow) + 1):
        try:
            own = Aircraft(Parameters(*constants[i].tolist()), aircraft.variant)
            point = find_operating_point(own, condition_at(condition, variables, values[i]), start)
            model = linearize(own, point, full=True)
            status[i], states[i], inputs[i], A[i], B[i] = TRIMMED, point.states, point.inputs, model.A, model.B
        except (BadInputError, NoSolutionError) as error:
            failures[i], states[i], inputs[i] = str(error), np.nan, np.nan
        if progress is not None:
            progress(done, len(values))
    limiting = np.full(len(values), -1, dtype=np.int8)
    beyond = status == BEYOND_LIMITS
    limiting[beyond] = (excess[beyond, : _N + _M] / width[: _N + _M]).argmax(axis=1)
    A[status != TRIMMED], B[status != TRIMMED] = np.nan, np.nan
    return Points(status, limiting, states, inputs, A, B, failures)


def reasons_of(
    points: Points, aircraft: Aircraft, variables: tuple[str, ...], values: np.ndarray, condition: TrimCondition
) -> tuple[str, ...]:
    """Why each point has no trim, "" where it has one."""

    def reason(i: int) -> str:
        if points.status[i] != BEYOND_LIMITS:
            return points.failures.get(i, "")
        changed = dict(zip(variables, values[i].tolist(), strict=True))
        own = Parameters(**{name: changed.get(name, each) for name, each in aircraft.parameters._asdict().items()})
        balancing = dict(zip(INPUTS, points.inputs[i].tolist(), strict=True))
        at = condition_at(condition, variables, values[i])
        return beyond_limits(Aircraft(own, aircraft.variant), at, balancing)

    return tuple(reason(i) for i in range(len(values)))


def condition_at(condition: TrimCondition, variables: tuple[str, ...], row: np.ndarray) -> TrimCondition:
    """The condition of one point; BadInputError where one of its values lies outside its limits."""
    hold = {name: value for name, value in zip(variables, row.tolist(), strict=True) if name in VARIABLES}
    return condition.at(hold.get("dihedral"), hold)


def is_square(variant: Variant, variables: tuple[str, ...], condition: TrimCondition) -> bool:
    """Whether the points have as many equations as unknowns, so that Newton's method settles many at once."""
    return _functions(variant, variables, condition) is not None


def newton_functions(
    variant: Variant, given: tuple[str, ...], free: tuple[str, ...], rates: tuple[tuple[str, float], ...]
) -> tuple[ca.Function, ca.Function] | None:
    """(given, v, p) -> v after a Newton step and the norm of the scaled residuals before it; and -> x, u, A, B
    (row by row), dX/dt at v. None unless as many equations as unknowns feel them, each unknown in one.

    given: what is imposed; a variable that is neither given nor free is 0. v: the values of `free`.
    """
    x, u, p = symbols()
    known, v = ca.SX.sym("given", len(given)), ca.SX.sym("v", len(free))
    values = dict.fromkeys(VARIABLES, ca.SX(0)) | dict(zip(given, ca.vertsplit(known), strict=True))
    values |= dict(zip(free, ca.vertsplit(v), strict=True))
    values["pitch"] = values["alpha"] + values["gamma"]
    state, control = (ca.vertcat(*(values[name] for name in names)) for names in (STATES, INPUTS))
    f, at = state_rates(x, u, p, variant), state_rates(state, control, p, variant)
    residual = ca.vertcat(*((at[STATES.index(name)] - rate) / getattr(RATE_SCALES, name) for name, rate in rates))
    jacobian = ca.jacobian(residual, v)
    moved = [i for i in range(len(rates)) if jacobian[i, :].nnz()]
    if len(moved) != len(free) or ca.sprank(jacobian[moved, :]) < len(free):
        return None
    after = v - ca.solve(jacobian[moved, :], residual[moved])
    flat = [f, *(ca.vec(ca.densify(ca.jacobian(f, by)).T) for by in (x, u))]
    rate, A, B = ca.substitute(flat, [x, u], [state, control])
    arguments = [known, v, p]
    return (
        ca.Function("newton", arguments, ca.cse([after, ca.sqrt(ca.sumsqr(ca.densify(residual)))])),
        ca.Function("at", arguments, ca.cse([*map(ca.densify, (state, control)), A, B, rate])),
    )


def first_guess(free: tuple[str, ...], begin: Mapping[str, float]) -> list[float]:
    """Where Newton's method begins: the same at every point, so that no row depends on its neighbours."""
    return [begin.get(name, SCALES[name] if name in ("throttle", "speed") else 0.0) for name in free]


def _functions(variant: Variant, variables: tuple[str, ...], condition: TrimCondition) -> Any:
    """Key of `_compiled`: variant, given, free, rates; None where it makes no functions."""
    varied = [name for name in variables if name in VARIABLES]
    zero = [name for name, value in condition.imposed.items() if value == 0.0]
    given = tuple(name for name in VARIABLES if name in varied or name not in (*zero, *condition.free))
    free = tuple(name for name in condition.free if name not in varied)
    key = variant, given, free, tuple(condition.rates.items())
    return key if free and _pair(*key) is not None else None


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
        found.append(BoundFunction(machine_code(many) if use_machine_code else many))
    return found[0], found[1]


def _newton(
    variant: Variant,
    variables: tuple[str, ...],
    values: np.ndarray,
    constants: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    compile_code: bool | None,
) -> tuple[np.ndarray, np.ndarray]:
    """A row x, u, A, B, dX/dt a point, nan without as many equations as unknowns; and which points balance."""
    count = len(values)
    flat = np.full((count, _ENDS[-1]), np.nan)
    key = _functions(variant, variables, condition)
    if key is None or not count:
        return flat, np.zeros(count, dtype=bool)
    _, given, free, rates = key
    columns = dict(zip(variables, values.T, strict=True))
    dihedral = columns.get("dihedral", np.full(count, condition.imposed.get("dihedral", 0.0)))
    columns |= {name: condition.values_at(name, dihedral) for name in given if name not in columns}
    if "dihedral" in columns:
        columns["dihedral"] = dihedral
    imposed = np.stack([columns[name] for name in given], axis=-1)
    guess = first_guess(free, condition.begin if start is None else start.values)
    together = next(size for size in _TOGETHER if size <= count)
    step, at = _compiled(key, together, count >= COMPILE_FROM if compile_code is None else compile_code)
    after, residual = (result.reshape(together, -1) for result in step.results)
    for first in range(0, count, together):
        rows = slice(first, min(first + together, count))
        tables = imposed[rows], np.array(guess), constants[rows]
        for memory, table in zip(step.inputs, tables, strict=True):
            memory.reshape(together, -1)[: rows.stop - first] = table
        v, searching = step.inputs[1].reshape(together, -1), np.ones(together, dtype=bool)
        for _ in range(_MOST_STEPS):
            step()
            v[searching] = after[searching]
            searching &= residual[:, 0] > BALANCE  # one step more than balance asks for: to rounding; nan ends it
            if not searching[: rows.stop - first].any():
                break
        for target, source in zip(at.inputs, step.inputs, strict=True):
            target[:] = source
        at()
        flat[rows] = at.results[0].reshape(together, -1)[: rows.stop - first]
    off = [(flat[:, _ENDS[3] + STATES.index(name)] - rate) / getattr(RATE_SCALES, name) for name, rate in rates]
    return flat, np.asarray((np.abs(off) <= BALANCE).all(axis=0))


def _excess(flat: np.ndarray, allowed: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """How far x, u and γ lie beyond their limits, negative within, (N, 13); and the width of the limits, (13,)."""
    gamma = flat[:, STATES.index("pitch")] - flat[:, STATES.index("alpha")]
    values = np.hstack([flat[:, : _N + _M], gamma[:, None]])
    limits = np.array([allowed[name] for name in (*STATES, *INPUTS, "gamma")])
    width = np.where(np.isfinite(limits).all(axis=1), limits[:, 1] - limits[:, 0], 1.0)
    return np.maximum(limits[:, 0] - values, values - limits[:, 1]), width
