"""The equations of a trim: residuals r and their Jacobian J at many points, as functions of the
unknowns z and of what differs from point to point, c."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, components
from hfa_aircraft.model import Model
from hfa_support.linear_table import LinearTable
from hfa_support.native.bound import RowFunction, cached_per_thread
from trim.limits import Limits
from trim.point.condition import TrimCondition
from trim.point.machine import compiled_trim

#: Steps of Newton's method that one evaluation takes, and with how many unknowns at most.
FULL_STEPS = 4
FEW = 6


class Structure(NamedTuple):
    """What the equations of a trim are made of; numbers that may differ between points are not in
    it.

    layout: equations and names of the model
    given: variables, outputs and rates whose values the points give; other imposed ones are 0
    free: (variable, its scale), all variables that are not imposed
    rates: (state whose rate is imposed, scale of the rate)
    outputs: (imposed output, its scale)
    watched: (state or output, its scale) that has limits and is neither imposed nor unknown
    """

    layout: Layout
    given: tuple[str, ...]
    free: tuple[tuple[str, float], ...]
    rates: tuple[tuple[str, float], ...]
    outputs: tuple[tuple[str, float], ...]
    watched: tuple[tuple[str, float], ...]


class Equations(NamedTuple):
    """r(z, c) = 0 as CasADi expressions, in scaled units.

    z: (k, 1), the unknowns divided by their scales
    c: the values of `constants`, then the parameters
    x, u, y: states, inputs and watched outputs
    residual: (e, 1); the equations that the unknowns can move come first
    jacobian: (m, k) of those
    names: the e equations, states for their rates and outputs
    unknowns: the k free variables that move an equation
    idle: free variables that are in no equation; c gives their values
    constants: names of the values in c
    square: whether Newton's method can solve for z: m = k, and no row or column depends on others
    by its zeros alone
    """

    z: ca.SX
    c: ca.SX
    x: ca.SX
    u: ca.SX
    y: ca.SX
    residual: ca.SX
    jacobian: ca.SX
    names: tuple[str, ...]
    unknowns: tuple[str, ...]
    idle: tuple[str, ...]
    constants: tuple[str, ...]
    square: bool


def structure_of(model: Model, condition: TrimCondition, varied: Sequence[str] = ()) -> Structure:
    """The structure of a condition where these variables, outputs or rates have other values at
    each point."""
    imposed = {name for name, value in condition.imposed.items() if value != 0.0}
    imposed |= {name for name in condition.imposed if name in model.outputs}
    imposed |= {f"{name}_dot" for name, rate in condition.rates.items() if rate != 0.0}
    imposed |= set(varied)
    states_in_balance = [
        name for name in model.states if name in condition.rates or f"{name}_dot" in varied
    ]
    held = {*condition.imposed, *varied}
    outputs = [name for name in model.outputs if name in held and name not in model.variables]
    free = [name for name in model.variables if name not in held]
    limited = {name for name, ends in model.limits.items() if any(map(math.isfinite, ends))}
    limited |= set(condition.limits)
    watched = [
        name
        for name in (*model.states, *model.outputs)
        if name in limited and name not in held and name not in model.variables
    ]
    return Structure(
        model.layout,
        tuple(name for name in (*model.holdable, *model.rates) if name in imposed),
        tuple((name, model.signals[name].nominal) for name in free),
        tuple((name, model.rate_scale(name)) for name in states_in_balance),
        tuple((name, model.signals[name].nominal) for name in outputs),
        tuple((name, model.signals[name].nominal) for name in watched),
    )


@lru_cache(maxsize=16)
def equations(structure: Structure) -> Equations:
    """The expressions of a structure. BadInputError for a free variable that acts in steps only."""
    layout = structure.layout
    names = [name for name, _ in structure.free]
    (p,) = layout.symbols("p")
    symbols = ca.SX.sym("given", len(structure.given))
    free = ca.SX.sym("free", len(names))
    values = dict.fromkeys(layout.variables, ca.SX(0))
    values |= dict(zip(structure.given, components(symbols), strict=True))
    values |= dict(zip(names, components(free), strict=True))
    outputs = [name for name, _ in structure.outputs]
    watched = [name for name, _ in structure.watched]
    x, u, f, y = layout.in_variables(values, p, (*outputs, *watched))

    rows = []
    for name, scale in structure.rates:
        rate = f[layout.names[0].index(name)]
        rows.append((rate - values.get(f"{name}_dot", 0.0)) / scale)
    for i, (name, scale) in enumerate(structure.outputs):
        rows.append((y[i] - values[name]) / scale)
    residual = ca.vertcat(*rows)
    jacobian = ca.jacobian(residual, free)
    layout.refuse_steps(jacobian, names)
    jacobian = ca.sparsify(jacobian)
    moved = [i for i in range(residual.numel()) if jacobian[i, :].nnz()]
    still = [i for i in range(residual.numel()) if not jacobian[i, :].nnz()]
    moving = [j for j in range(len(names)) if jacobian[:, j].nnz()]
    idle = [j for j in range(len(names)) if not jacobian[:, j].nnz()]
    square = bool(moving) and len(moved) == len(moving)
    square = square and ca.sprank(jacobian[moved, moving]) == len(moving)

    idle_symbols = [free[j] for j in idle]
    scales = ca.DM([structure.free[j][1] for j in moving])
    z = ca.SX.sym("z", len(moving))
    jacobian = ca.densify(jacobian[moved, moving]) @ ca.diag(scales)
    y = ca.vertcat(ca.SX(0, 1), *components(y)[len(outputs) :])
    parts = [x, u, y, residual[[*moved, *still]], jacobian]
    x, u, y, residual, jacobian = ca.substitute(parts, [free[moving]], [z * scales])
    every = [*(name for name, _ in structure.rates), *outputs]
    return Equations(
        z,
        ca.vertcat(ca.SX(0, 1), *components(symbols), *idle_symbols, *components(p)),
        x,
        u,
        ca.densify(y),
        ca.densify(residual),
        jacobian,
        tuple(every[i] for i in (*moved, *still)),
        tuple(names[j] for j in moving),
        tuple(names[j] for j in idle),
        (*structure.given, *(names[j] for j in idle)),
        square,
    )


@lru_cache(maxsize=16)
def residual_function(structure: Structure) -> ca.Function:
    """(z, c) -> r (e,) and J (m, k) row by row."""
    e = equations(structure)
    return ca.Function("residual", [e.z, e.c], ca.cse([e.residual, ca.vec(e.jacobian.T)]))


@lru_cache(maxsize=16)
def steps_function(structure: Structure) -> ca.Function:
    """(z, c) -> z after `FULL_STEPS` steps of Newton's method, and |r| before each of them."""
    e = equations(structure)
    moved = e.residual[: e.jacobian.shape[0]]
    after = e.z - ca.solve(e.jacobian, moved)
    step = ca.Function("step", [e.z, e.c], [after, ca.norm_2(moved)], {"cse": True})
    z = e.z
    norms = []
    for _ in range(FULL_STEPS):
        z, norm = step(z, e.c)
        norms.append(norm)
    return ca.Function("steps", [e.z, e.c], [z, ca.vertcat(*norms)], {"cse": True})


@lru_cache(maxsize=16)
def point_function(structure: Structure) -> ca.Function:
    """(z, c) -> x, u and the watched outputs y in one column."""
    e = equations(structure)
    return ca.Function("point", [e.z, e.c], [ca.cse(ca.densify(ca.vertcat(e.x, e.u, e.y)))])


@lru_cache(maxsize=16)
def linear_function(structure: Structure) -> ca.Function:
    """(z, c) -> x, u, y, A and B row by row, and r, in one column."""
    e = equations(structure)
    layout = structure.layout
    x, u = layout.symbols("x", "u")
    p = e.c[len(e.constants) :]
    f, _ = layout.expressions([components(x), components(u), components(p)], ())
    jacobians = ca.substitute([ca.jacobian(f, x), ca.jacobian(f, u)], [x, u], [e.x, e.u])
    A, B = (ca.vec(ca.densify(jacobian).T) for jacobian in jacobians)
    flat = ca.vertcat(e.x, e.u, e.y, A, B, e.residual)
    return ca.Function("linear", [e.z, e.c], [ca.cse(ca.densify(flat))])


@cached_per_thread(maxsize=16)
def _rows_of(function: ca.Function) -> RowFunction:
    return RowFunction(function)


class TrimSystem:
    """The equations of a condition at N points, of which each may give its own values.

    model, condition: whose equations these are; what the points do not give is the condition's
    structure, equations: what they consist of
    begin: values of the variables where a search begins; idle variables stay there
    scales: (k,), one scaled unit of each unknown
    start: (k,), the scaled unknowns where a search begins
    limits: of the unknowns, in the units of the model
    lowest, highest: (k,), the same in scaled units
    watched: limits of the states and outputs that are watched
    row_scales: (e,), one scaled unit of each equation
    moved: number of equations that the unknowns can move, the first ones
    machine: the same as machine code, where that was asked for and a compiler works
    """

    def __init__(
        self,
        model: Model,
        condition: TrimCondition,
        varied: Sequence[str] = (),
        begin: Mapping[str, float] | None = None,
        compile_code: bool = False,
    ) -> None:
        """varied: variables, outputs, rates and parameters that differ between points; begin: where
        condition and declaration begin unless given."""
        if begin is None:
            begin = declared_start(model, condition.imposed) | dict(condition.begin)
        self.model = model
        self.condition = condition
        self.begin = begin
        self.structure = structure_of(model, condition, varied)
        self.equations = equations(self.structure)
        self.scales = np.array([model.signals[name].nominal for name in self.equations.unknowns])
        self.start = self.unknowns(begin)
        self.limits = condition.limits_on(self.equations.unknowns)
        self.lowest = self.limits.lowest / self.scales
        self.highest = self.limits.highest / self.scales
        self.watched = condition.limits_on([name for name, _ in self.structure.watched])
        scales = dict(self.structure.rates) | dict(self.structure.outputs)
        self.row_scales = np.array([scales[name] for name in self.equations.names])
        self.moved = self.equations.jacobian.shape[0]
        self._functions = threading.local()
        self.machine = None
        if compile_code and self.equations.square:
            self.machine = compiled_trim(
                residual_function(self.structure), linear_function(self.structure)
            )

    @property
    def only_inputs(self) -> bool:
        """Whether all unknowns are inputs: the equations are then nearly affine, with one
        solution."""
        return set(self.equations.unknowns) <= set(self.model.inputs)

    @cached_property
    def point_limits(self) -> Limits:
        """The limits of states, inputs and watched states and outputs."""
        names = (*self.model.states, *self.model.inputs, *self.watched.names)
        return self.condition.limits_on(names)

    def residuals(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (N, e) and J (N, m, k) at the unknowns z (N, k) and the constants c (N, ..)."""
        residual, jacobian = self._rows(residual_function)(z, c)
        return residual, jacobian.reshape(len(z), self.moved, z.shape[1])

    def full_steps(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z (N, k) after `FULL_STEPS` steps of Newton's method, none of them halved, and |r| before
        each (N, FULL_STEPS)."""
        after, norms = self._rows(steps_function)(z, c)
        return after, norms

    def points(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N, n), inputs (N, m) and watched outputs (N, w)."""
        (flat,) = self._rows(point_function)(z, c)
        states = len(self.model.states)
        inputs = states + len(self.model.inputs)
        return flat[:, :states], flat[:, states:inputs], flat[:, inputs:]

    def linear(
        self, z: np.ndarray, c: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """x, u and watched outputs (N, n + m + w), A (N, n, n), B (N, n, m) and r (N, e)."""
        if self.machine is not None:
            flat = self.machine.linear(z, c)
        else:
            (flat,) = self._rows(linear_function)(z, c)
        n = len(self.model.states)
        m = len(self.model.inputs)
        end = n + m + len(self.structure.watched)
        A = flat[:, end : end + n * n].reshape(-1, n, n)
        B = flat[:, end + n * n : end + n * (n + m)].reshape(-1, n, m)
        return flat[:, :end], A, B, flat[:, end + n * (n + m) :]

    def constants(
        self, count: int = 1, columns: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """The values that the equations take as constant, a row for each of N points.

        count: N
        columns: name of a variable, output, rate or parameter -> its values (N,); the others
            have those of the condition and the model
        """
        columns = columns or {}
        table = np.empty((count, len(self._row)))
        table[:] = self._row
        for index, name in self._tables:
            scheduled = self.model.schedule
            at = columns.get(scheduled, self.condition.imposed.get(scheduled, 0.0))
            table[:, index] = self.condition.values_at(name, at)
        for name, values in columns.items():
            if name in self._index:
                table[:, self._index[name]] = values
        return table

    def _rows(self, make: Callable[[Structure], ca.Function]) -> RowFunction:
        """One of the functions above, bound to memory of this thread."""
        functions: dict[Any, RowFunction] = self._functions.__dict__
        if make not in functions:
            functions[make] = _rows_of(make(self.structure))
        return functions[make]

    @cached_property
    def _index(self) -> dict[str, int]:
        """Name of a constant or parameter -> its column in the table of constants."""
        names = (*self.equations.constants, *self.model.parameters)
        return {name: index for index, name in enumerate(names)}

    @cached_property
    def _tables(self) -> list[tuple[int, str]]:
        """The constants that change with the scheduling variable: column, name."""
        imposed = self.condition.imposed
        return [
            (index, name)
            for name, index in self._index.items()
            if isinstance(imposed.get(name), LinearTable)
        ]

    @cached_property
    def _row(self) -> np.ndarray:
        """The constants of a point that gives no values of its own; 0 for tables."""
        row = []
        for name in self.equations.constants:
            value = self.condition.imposed.get(name, 0.0)
            if name in self.equations.idle:
                value = self.begin[name]
            elif name in self.model.rates:
                value = self.condition.rates.get(name.removesuffix("_dot"), 0.0)
            row.append(0.0 if isinstance(value, LinearTable) else value)
        return np.array([*row, *self.model.p.tolist()])

    def unknowns(self, values: Mapping[str, float]) -> np.ndarray:
        """(k,), the scaled unknowns among the values of all variables."""
        return np.array([values[name] for name in self.equations.unknowns]) / self.scales


def declared_start(model: Model, imposed: Mapping[str, Any]) -> dict[str, float]:
    """Where the declaration of a model begins the search for each variable: at the values that it
    declares, or at those that belong to what is imposed."""
    values = {name: model.signals[name].start for name in model.variables}
    if model.begin is not None:
        held = {name: signal.start for name, signal in model.parameters.items()}
        begun = model.begin({**held, **imposed})
        values |= {name: float(begun[name]) for name in begun if name in values}
    return values
