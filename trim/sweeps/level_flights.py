"""Many level flights at once: trim and exact Jacobians of every point in one compiled function.

The four equations of `level_flight` are nearly affine in its four unknowns, so a fixed number of Newton steps from
a fixed guess, unrolled into one expression, reaches rounding. The result is never trusted unseen: each
point carries its residual, and what did not converge goes to `trim.point.solve`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from hfa_model.dynamics import state_rates, symbols
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUTS, RATE_SCALES, STATES, Input, Quantity, State
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.native.bound import BoundFunction, cached_per_thread
from hfa_support.native.machine_code import machine_code
from hfa_support.native.vector_code import vector_code
from hfa_support.reporting.fields import Shown
from trim.point.condition import BALANCED, LIMITS, VARIABLES, level_flight
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import BALANCE

#: A level flight as numbers, in order.
CONDITION = ("dihedral", "speed", "altitude", "alpha", "gamma")
#: From this many points on, compiling the function to machine code pays.
COMPILE_FROM = 50_000
_UNKNOWNS = ("throttle", "aileron_outer", "elevator_center", "elevator_outer")
_EQUATIONS = ("speed", "alpha", "pitch_rate", "dihedral_rate")
START = (40.0, 0.0, 0.0, 0.0)
_NEWTON_STEPS = 3
_MORE_NEWTON_STEPS = 20
_N, _M, _P = len(STATES), len(INPUTS), len(Parameters._fields)
_SIZES = (_N, _M, _N * _N, _N * _M, _N)
_CHUNK = 250
_BALANCED_COLUMNS = [-_N + STATES.index(name) for name in BALANCED]
_BALANCED_SCALES = np.array([getattr(RATE_SCALES, name) for name in BALANCED])


@dataclass(frozen=True, repr=False)
class LevelFlights(Shown):
    """N points: states (N, 7), inputs (N, 5), A (N, 7, 7), B (N, 7, 5), scaled residuals (N, 6) of the balanced
    equations, and `trimmed` (N,): every residual within `BALANCE` and every unknown within its limits."""

    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    residuals: np.ndarray
    trimmed: np.ndarray

    @property
    def balanced(self) -> np.ndarray:
        """(N,) true where every residual is within `BALANCE`, whatever the limits say."""
        return _balanced(self.residuals)


def level_conditions(
    variables: tuple[str, ...], values: np.ndarray, condition: NamedCondition = LEVEL_FLIGHT
) -> np.ndarray:
    """Rows in the order of `CONDITION`: the given values, else what the condition has, else the paper; zero dihedral.

    Variables that belong to no condition, parameters of the aircraft, are left out. rad, ft/s, ft.
    """
    for name in variables:
        refuse_unknown("unknown variable", name, (*CONDITION, *Parameters._fields))
    paper, given = level_flight(0.0).imposed, dict(zip(variables, np.asarray(values).T, strict=True))
    nothing = np.zeros(len(values))

    def column(name: str, dihedral: np.ndarray) -> np.ndarray:
        if name in given:
            return given[name]
        return condition.value(name, dihedral) if name in condition.imposed else nothing + paper[name]

    dihedral = column("dihedral", nothing)
    return np.stack([column(name, dihedral) for name in CONDITION], axis=-1)


def are_level_flights(variables: tuple[str, ...], condition: NamedCondition) -> bool:
    """Whether every point is a level flight as `solve_level_flights` has it: its unknowns free, its constants zero."""
    varied = {name: 0.0 for name in variables if name in VARIABLES}
    if not set(varied) <= set(CONDITION):
        return False
    paper, asked = level_flight(0.0), condition.changed(hold=varied)
    imposed = {name: value for name, value in asked.imposed.items() if name not in CONDITION}
    return (
        set(asked.free) <= set(_UNKNOWNS)
        and all(set(values) == {paper.imposed.get(name)} for name, (_, values) in imposed.items())
        and condition.rates in (None, dict(paper.rates))
    )


def solve_level_flights(
    variant: Variant,
    parameters: np.ndarray | Parameters,
    conditions: np.ndarray,
    *,
    limits: Mapping[str, tuple[float, float]] | None = None,
    compile_code: bool | None = None,
    vector: bool = False,
) -> LevelFlights:
    """Trim and linearize N level flights.

    parameters: one set for all points, or (N, 18), one row a point in the order of `Parameters`.
    conditions: (N, 5) in the order of `CONDITION`, rad, ft/s, ft. limits: where not `LIMITS`. compile_code: run as
    machine code; by default from `COMPILE_FROM` points on. vector: that of the vector unit, several points at once;
    entries agree within 1e-13 of their size, not bit for bit. Points outside the model come out as not trimmed.
    """
    count, given = len(conditions), np.asarray(parameters, dtype=float)
    if np.shape(conditions) != (count, len(CONDITION)):
        raise BadInputError(f"conditions are {np.shape(conditions)}; they must be (N, {len(CONDITION)})")
    if given.shape not in ((_P,), (count, _P)):
        raise BadInputError(
            f"parameters are {given.shape}; they must be ({_P},), or one row for each of {count} points"
        )
    for name in limits or {}:
        refuse_unknown("unknown variable with limits", name, LIMITS)
    use_machine_code = count >= COMPILE_FROM if compile_code is None else compile_code
    constants = np.broadcast_to(given, (count, _P))
    fast = _vector_function(variant) if vector else None
    if fast is not None:
        flat = fast(conditions, constants)
    else:
        flat = _evaluate(variant, _NEWTON_STEPS, use_machine_code, conditions, constants)
    residuals = _residuals(flat)
    balanced = _balanced(residuals)
    if not balanced.all():
        # Far from the paper's flight the drag of large deflections bends the equations: more steps for those.
        rest = np.flatnonzero(~balanced)
        flat[rest] = _evaluate(variant, _MORE_NEWTON_STEPS, False, conditions[rest], constants[rest])
        residuals = _residuals(flat)
        balanced = _balanced(residuals)
    inputs_end, A_end, B_end = _N + _M, _N + _M + _N * _N, _N + _M + _N * _N + _N * _M
    return LevelFlights(
        states=flat[:, :_N],
        inputs=flat[:, _N:inputs_end],
        A=flat[:, inputs_end:A_end].reshape(count, _N, _N),
        B=flat[:, A_end:B_end].reshape(count, _N, _M),
        residuals=residuals,
        trimmed=balanced & _within_limits(flat[:, :inputs_end], {**LIMITS, **(limits or {})}),
    )


def unsolved(count: int) -> LevelFlights:
    """As many points of which nothing is known yet."""
    states, inputs, A, B, residuals = (
        np.full((count, *shape), np.nan) for shape in ((_N,), (_M,), (_N, _N), (_N, _M), (len(BALANCED),))
    )
    return LevelFlights(states, inputs, A, B, residuals, np.zeros(count, dtype=bool))


def _evaluate(
    variant: Variant, steps: int, use_machine_code: bool, conditions: np.ndarray, constants: np.ndarray
) -> np.ndarray:
    """One row of results a point, in chunks: a call costs a microsecond, which many points share."""
    count = len(conditions)
    chunk = 1 if count < _CHUNK else _CHUNK
    function = _function(variant, steps, chunk, use_machine_code)
    flat = np.empty((count, sum(_SIZES)))
    for start in range(0, count, chunk):
        size = min(chunk, count - start)
        # CasADi stores columns, one a point, which are the rows here. What is left of the last chunk is ignored.
        for memory, table in zip(function.inputs, (conditions, constants), strict=True):
            memory.reshape(chunk, -1)[:size] = table[start : start + size]
        function()
        flat[start : start + size] = function.results[0].reshape(chunk, -1)[:size]
    return flat


def _residuals(flat: np.ndarray) -> np.ndarray:
    return np.asarray(flat[:, _BALANCED_COLUMNS] / _BALANCED_SCALES)


def _balanced(residuals: np.ndarray) -> np.ndarray:
    return np.asarray((np.abs(residuals) <= BALANCE).all(axis=1))


def _within_limits(values: np.ndarray, limits: Mapping[str, tuple[float, float]]) -> np.ndarray:
    lowest, highest = np.array([limits[name] for name in STATES + INPUTS]).T
    return np.asarray(((values >= lowest) & (values <= highest)).all(axis=1))


@cached_per_thread(maxsize=None)
def _function(variant: Variant, steps: int, chunk: int, use_machine_code: bool) -> BoundFunction:
    function = _level_flight(variant, steps)
    if chunk > 1:
        function = function.map(chunk)
    return BoundFunction(machine_code(function) if use_machine_code else function)


@cache
def _vector_function(variant: Variant) -> Callable[..., np.ndarray] | None:
    return vector_code(_level_flight(variant, _NEWTON_STEPS))


def _level_flight(variant: Variant, steps: int) -> ca.Function:
    """(condition (5,), p) -> x, u, A, B (row by row), dX/dt as one column."""
    newton, at = newton_functions(variant)
    condition, p = ca.SX.sym("condition", len(CONDITION)), symbols()[2]
    solution = ca.SX(ca.DM(START))
    for _ in range(steps):
        solution = newton(condition, solution, p)
    return ca.Function("level_flight", [condition, p], [ca.cse(ca.vertcat(*at(condition, solution, p)))])


def newton_functions(variant: Variant) -> tuple[ca.Function, ca.Function]:
    """(condition (5,), v (4,), p) -> v after a Newton step, and -> x, u, A, B (row by row), dX/dt there.

    v: throttle, aileron_outer, elevator_center, elevator_outer; begin at `START`.
    """
    x, u, p = symbols()
    condition, unknowns = ca.SX.sym("condition", len(CONDITION)), ca.SX.sym("v", len(_UNKNOWNS))
    at = dict(zip(CONDITION, ca.vertsplit(condition), strict=True))
    pitch = at["alpha"] + at["gamma"]
    flight: State[Quantity] = State(at["speed"], at["alpha"], at["altitude"], pitch, 0.0, at["dihedral"], 0.0)
    state = ca.vertcat(*flight)
    balance = state_rates(state, _input(unknowns), p, variant)[[STATES.index(name) for name in _EQUATIONS]]
    after = unknowns - _eliminate(ca.jacobian(balance, unknowns), balance)
    f = state_rates(x, u, p, variant)
    flat = [f, ca.vec(ca.densify(ca.jacobian(f, x)).T), ca.vec(ca.densify(ca.jacobian(f, u)).T)]
    point = [state, _input(unknowns)]
    rate, A, B = ca.substitute(flat, [x, u], point)
    arguments = [condition, unknowns, p]
    return (
        ca.Function("newton", arguments, [ca.cse(after)]),
        ca.Function("at", arguments, ca.cse([*map(ca.densify, point), A, B, rate])),
    )


def _eliminate(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """matrix⁻¹ right by elimination without pivoting, a third of the operations of CasADi's symbolic QR.

    The unknowns stand in the order of the equations that they move most; where a pivot vanishes all the same, the
    result is not finite and the point goes to the robust solver.
    """
    n = matrix.shape[0]
    rows = [[matrix[i, j] for j in range(n)] + [right[i]] for i in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    solution: list[ca.SX] = []
    for k in reversed(range(n)):
        known = sum((a * b for a, b in zip(rows[k][k + 1 : n], solution, strict=True)), ca.SX(0))
        solution.insert(0, (rows[k][n] - known) / rows[k][k])
    return ca.vertcat(*solution)


def _input(unknowns: ca.SX) -> ca.SX:
    free = dict(zip(_UNKNOWNS, ca.vertsplit(unknowns), strict=True))
    control: Input[Quantity] = Input(aileron_center=0.0, **free)
    return ca.vertcat(*control)
