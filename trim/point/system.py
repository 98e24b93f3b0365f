"""Equations of a trim at many points.

The residuals r and their Jacobian J are functions of the unknowns z and of constants c, which
differ between points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, column
from hfa_aircraft.model import Model
from hfa_support.matrices import LinearTable
from hfa_support.native.bound import RowFunction
from trim.point.condition import TrimCondition

#: Norm of the scaled residuals at which one more Newton step reaches rounding.
NEARLY = 1e-7
#: Newton steps in one evaluation of a single point, and of many points, which begin near their
#: solutions; largest number of unknowns for which this is used.
_STEPS, _STEPS_OF_MANY = 4, 2
FEW = 6
#: Unit of an angle -> 90 deg in this unit.
_QUARTER_TURN = {"rad": math.pi / 2, "deg": 90.0}


class Scaled(NamedTuple):
    """State, input or output with its nominal magnitude, `scale`."""

    name: str
    scale: float


class TrimEquation(NamedTuple):
    """Equation of a trim: (rate of a state, or output, minus its imposed value) / scale = 0.

    name: state or output
    is_rate: whether the equation is for the rate of the state
    imposed: name of the imposed value among the constants, or "" for the value 0
    scale: nominal magnitude
    """

    name: str
    is_rate: bool
    imposed: str
    scale: float


class Structure(NamedTuple):
    """Unknowns and equations of a trim, without the numbers that differ between points.

    layout: equations and names of the model
    given: names of the imposed values in the equations; all other imposed values are 0
    unknowns: all variables that are not imposed
    rows: the equations, first those of rates
    watched: states and outputs with limits that are neither imposed nor unknown
    zero: names of the parameters that are exactly 0 at all points
    """

    layout: Layout
    given: tuple[str, ...]
    unknowns: tuple[Scaled, ...]
    rows: tuple[TrimEquation, ...]
    watched: tuple[Scaled, ...]
    zero: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TrimEquations:
    """Equations r(z, c) = 0 of a trim as CasADi expressions in scaled units, and as functions of
    rows.

    layout: equations and names of the model
    unknowns: names of the k unknowns that affect an equation, in the order of z
    scales: (k,), scale of each unknown
    idle: names of the free variables that are in no equation; their values are in c
    rows: the e equations; those that the unknowns affect come first
    affected_count: m, number of equations that the unknowns affect
    constants: names of the values in c, which are followed by the parameters
    z: (k, 1), the unknowns divided by their scales
    c: the constants
    x, u, y: states, inputs, and watched states and outputs (`Structure.watched`)
    residual: r, (e, 1)
    jacobian: J, (m, k), derivatives of the equations that the unknowns affect
    square: True if Newton's method can solve for z: m = k, and the pattern of zeros in J does not
        make it singular
    """

    layout: Layout
    unknowns: tuple[str, ...]
    scales: np.ndarray
    idle: tuple[str, ...]
    rows: tuple[TrimEquation, ...]
    affected_count: int
    constants: tuple[str, ...]
    z: ca.SX
    c: ca.SX
    x: ca.SX
    u: ca.SX
    y: ca.SX
    residual: ca.SX
    jacobian: ca.SX
    square: bool

    @cached_property
    def residual_rows(self) -> RowFunction:
        """Function of rows (z, c) that returns r (m,) of the affected equations, and J (m, k)."""
        parts = [self.residual[: self.affected_count], ca.vec(self.jacobian.T)]
        return RowFunction(ca.Function("residual", [self.z, self.c], parts))

    @cached_property
    def point_rows(self) -> RowFunction:
        """Function of rows (z, c) that returns x, u, y, r and its derivatives (e, k).

        y are the watched states and outputs.
        """
        # zeros for the equations that no unknown affects, which come last
        unaffected = ca.SX(len(self.rows) - self.affected_count, len(self.unknowns))
        derivatives = ca.vertcat(self.jacobian, unaffected)
        parts = [self.x, self.u, self.y, self.residual, ca.vec(derivatives.T)]
        return RowFunction(ca.Function("point", [self.z, self.c], [*map(ca.densify, parts)]))

    @cached_property
    def linear_rows(self) -> RowFunction:
        """Function of rows (z, c) that returns (x, u, y), A and B row by row, and r.

        y are the watched states and outputs.
        """
        x, u = self.layout.symbols("x", "u")
        p = self.c[len(self.constants) :]
        f, _ = self.layout.expressions((x, u, p), ())
        derivatives = [ca.jacobian(f, x), ca.jacobian(f, u)]
        jacobians = ca.substitute(derivatives, [x, u], [self.x, self.u])
        A, B = (ca.vec(jacobian.T) for jacobian in jacobians)
        parts = map(ca.densify, (ca.vertcat(self.x, self.u, self.y), A, B, self.residual))
        return RowFunction(ca.Function("linear", [self.z, self.c], [*parts], {"cse": True}))


@lru_cache(maxsize=32)
def step_rows(equations: TrimEquations, steps: int) -> RowFunction:
    """Return a function of rows (z, c) that takes full Newton steps from the unknowns z.

    The function returns z after the steps, and 1 if z has converged, otherwise 0. A point has
    converged if |r| decreased or was at most `NEARLY` at each step, and |r| is at most `NEARLY`
    before the last step.

    equations: the equations r(z, c), which must be square
    steps: number of steps
    """
    affected = equations.residual[: equations.affected_count]
    after = equations.z - ca.solve(equations.jacobian, affected)
    arguments = [equations.z, equations.c]
    step = ca.Function("step", arguments, [after, ca.norm_2(affected)], {"cse": True})
    z, norm = step(*arguments)
    converges = ca.SX(1)
    for _ in range(steps - 1):
        norm_before = norm
        z, norm = step(z, equations.c)
        decreases = ca.logic_or(norm < norm_before, norm <= NEARLY)
        converges = ca.logic_and(converges, decreases)
    ends = [z, ca.logic_and(converges, norm <= NEARLY)]
    return RowFunction(ca.Function("steps", arguments, ends, {"cse": True}))


@lru_cache(maxsize=32)
def structure_of(
    model: Model,
    imposed: tuple[tuple[str, bool], ...],
    rates: tuple[tuple[str, bool], ...],
    limits: tuple[tuple[str, float, float], ...],
    varied: tuple[str, ...],
) -> Structure:
    """Return the unknowns and equations of a trim, without the numbers that differ between points.

    imposed: (variable or output, whether its value is not 0)
    rates: (state, whether its rate is not 0)
    limits: (name, lowest, highest), instead of the model's limits
    varied: variables, outputs, rates or parameters whose values differ between the points
    """
    held = {*dict(imposed), *varied}
    is_nonzero_rate = dict(rates)
    # all outputs, and the states that an output replaces as variables of a trim
    dependent = [name for name in (*model.states, *model.outputs) if name not in model.variables]

    rows = []
    for name in model.states:
        rate = f"{name}_dot"
        if name in is_nonzero_rate or rate in varied:
            scale = model.rate_scale(name)
            constant = rate if rate in varied or is_nonzero_rate[name] else ""
            rows.append(TrimEquation(name, is_rate=True, imposed=constant, scale=scale))
    for name in dependent:
        if name in held:
            scale = model.signals[name].nominal
            rows.append(TrimEquation(name, is_rate=False, imposed=name, scale=scale))

    # A value that is exactly 0 is no constant: variables whose effect it removes are then in no
    # equation.
    given = {*varied, *(row.imposed for row in rows)}
    given.update(name for name, is_nonzero in imposed if is_nonzero or name in model.outputs)

    free = [name for name in model.variables if name not in held]
    ends = model.limits | {name: (low, high) for name, low, high in limits}
    watched = [
        name for name in dependent if name not in held and ends[name] != (-math.inf, math.inf)
    ]
    return Structure(
        layout=model.layout,
        given=tuple(name for name in (*model.holdable, *model.rates) if name in given),
        unknowns=tuple(Scaled(name, model.signals[name].nominal) for name in free),
        rows=tuple(rows),
        watched=tuple(Scaled(name, model.signals[name].nominal) for name in watched),
        zero=tuple(name for name, p in model.parameters.items() if not (p.start or name in varied)),
    )


def _expressions(structure: Structure, variables: dict[str, ca.SX], p: ca.SX) -> list[ca.SX]:
    """Return states, inputs, watched signals and residuals r in scaled units, (e, 1), at the
    symbols of the variables of a trim, of its imposed values that are not 0, and of parameters.
    """
    layout = structure.layout
    # A parameter that is 0 at all points is the number 0, so that a variable whose effect it
    # switches off is in no equation.
    parameters = column(
        ca.SX(0) if name in structure.zero else symbol
        for name, symbol in zip(layout.names.parameters, ca.vertsplit(p), strict=True)
    )
    outputs = [row.name for row in structure.rows if not row.is_rate]
    watched = [signal.name for signal in structure.watched]
    x, u, f, signals = layout.in_variables(variables, parameters, (*outputs, *watched))
    rates = dict(zip(layout.names.states, ca.vertsplit(f), strict=True))
    signal_by_name = dict(zip((*outputs, *watched), ca.vertsplit(signals), strict=True))
    residuals = []
    for row in structure.rows:
        value = rates[row.name] if row.is_rate else signal_by_name[row.name]
        imposed = variables[row.imposed] if row.imposed else 0.0
        residuals.append((value - imposed) / row.scale)
    return [x, u, column(signal_by_name[name] for name in watched), column(residuals)]


@lru_cache(maxsize=16)
def equations(structure: Structure) -> TrimEquations:
    """Return the equations of a trim as CasADi expressions.

    The free variables that are in an equation become the unknowns z, divided by their scales.

    structure: unknowns and equations

    Raises BadInputError for a free variable that affects the equations only in steps.
    """
    (p,) = structure.layout.symbols("p")
    given = {name: ca.SX.sym(name) for name in structure.given}
    free = {unknown.name: ca.SX.sym(unknown.name) for unknown in structure.unknowns}
    x, u, y, residual = _expressions(structure, {**given, **free}, p)
    by_all = ca.jacobian(residual, column(free.values()))  # by all free variables
    structure.layout.refuse_steps(by_all, list(free))
    by_all = ca.sparsify(by_all)

    # Equations (rows) that a free variable affects, and free variables (columns) in an equation:
    has_entry = ca.DM(by_all.sparsity(), 1).full() != 0.0
    affected = np.flatnonzero(has_entry.any(axis=1)).tolist()
    unaffected = [row for row in range(len(structure.rows)) if row not in affected]
    active = np.flatnonzero(has_entry.any(axis=0)).tolist()
    jacobian = by_all[affected, active]
    unknowns = tuple(structure.unknowns[column].name for column in active)
    scales = np.array([structure.unknowns[column].scale for column in active])
    idle = tuple(name for name in free if name not in unknowns)

    # The unknowns become z times their scales, and the affected equations come first.
    z = ca.SX.sym("z", len(unknowns))
    sought = column(free[name] for name in unknowns)
    in_order = residual[[*affected, *unaffected]]
    parts = [x, u, y, in_order, ca.densify(jacobian) @ ca.diag(ca.DM(scales))]
    x, u, y, residual, jacobian_of_z = ca.substitute(parts, [sought], [z * ca.DM(scales)])
    return TrimEquations(
        layout=structure.layout,
        unknowns=unknowns,
        scales=scales,
        idle=idle,
        rows=tuple(structure.rows[row] for row in (*affected, *unaffected)),
        affected_count=len(affected),
        constants=(*structure.given, *idle),
        z=z,
        c=column((*given.values(), *(free[name] for name in idle), *ca.vertsplit(p))),
        x=x,
        u=u,
        y=ca.densify(y),
        residual=ca.densify(residual),
        jacobian=jacobian_of_z,
        square=0 < len(active) == len(affected) == ca.sprank(jacobian),
    )


class NewtonEnds(NamedTuple):
    """Ends of Newton's method from N initial points.

    z: (N, k), scaled unknowns
    converged: (N,), mask of the points at which the method has converged
    """

    z: np.ndarray
    converged: np.ndarray


class LinearizedPoints(NamedTuple):
    """Trims and linear models of N points.

    signals: (N, n + m + w), the n states, the m inputs, and the w watched signals
    A: (N, n, n), derivatives of the rates with respect to the states
    B: (N, n, m), derivatives of the rates with respect to the inputs
    residual: (N, e), residuals of the trim in scaled units
    """

    signals: np.ndarray
    A: np.ndarray
    B: np.ndarray
    residual: np.ndarray


class TrimSystem:
    """Equations of a trim condition at N points, each with its own constants.

    model, condition: model of the aircraft, and the condition with the values common to all points
    structure, equations: structure and functions of the equations
    declared: start values of the variables, which idle variables keep
    begin: initial values of the search
    scales: (k,), scale of each unknown
    start: (k,), initial scaled unknowns
    limits: limits of the unknowns, in the units of the model
    lowest, highest: (k,), limits of the unknowns in scaled units
    quarter_turn: (k,), 90 deg in scaled units for angles without limits or with assumed ones, and
        inf for other unknowns
    watched: limits of the watched states and outputs
    affected_count: number m of equations that the unknowns affect, which are the first m equations
    steps: number of Newton steps in `step_rows`
    """

    def __init__(
        self,
        model: Model,
        condition: TrimCondition,
        varied: Sequence[str] = (),
        begin: Mapping[str, float] | None = None,
    ) -> None:
        """Build the equations of a trim condition.

        varied: variables, outputs, rates and parameters that differ between points
        begin: initial values instead of the start values, which are those of the condition and of
            the model's declaration
        """
        self.model = model
        self.condition = condition
        self.declared = {**declared_start(model, condition.imposed), **condition.begin}
        self.begin = {**self.declared, **(begin or {})}
        # The equations are cached, and contain of an imposed value only whether it is 0.
        self.structure = structure_of(
            model,
            tuple((name, value != 0.0) for name, value in condition.imposed.items()),
            tuple((name, rate != 0.0) for name, rate in condition.rates.items()),
            tuple((name, *ends) for name, ends in condition.limits.items()),
            tuple(varied),
        )
        self.equations = equations(self.structure)
        self.scales = self.equations.scales
        self.start = self.scaled(self.begin)
        self.limits = condition.limits_on(self.equations.unknowns)
        self.lowest = self.limits.lowest / self.scales
        self.highest = self.limits.highest / self.scales
        # A trim beyond 90 deg of an angle whose limits are missing or assumed is returned only if
        # there is no other (`trim.point.solve.solution`).
        are_missing = np.isinf(self.limits.lowest) & np.isinf(self.limits.highest)
        quarter_turns = [
            _QUARTER_TURN.get(model.unit(name), math.inf) for name in self.limits.names
        ]
        are_weak = are_missing | self.limits.assumed
        self.quarter_turn = np.where(are_weak, quarter_turns, math.inf) / self.scales
        self.watched = condition.limits_on([signal.name for signal in self.structure.watched])
        self.affected_count = self.equations.affected_count
        # In a sweep with free states, the search begins near the solution (`points._starts`).
        self.steps = _STEPS_OF_MANY if varied and not self.only_inputs else _STEPS

    @property
    def only_inputs(self) -> bool:
        """True if all unknowns are inputs."""
        return set(self.equations.unknowns) <= set(self.model.inputs)

    def residuals(self, z: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return r (N, m) and J (N, m, k) of the equations that the unknowns affect.

        z: (N, k), scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        residual, jacobian = self.equations.residual_rows(z, c)
        return residual, jacobian.reshape(len(z), self.affected_count, z.shape[1])

    def linear(self, z: np.ndarray, c: np.ndarray) -> LinearizedPoints:
        """Return the trims and linear models of N points.

        z: (N, k), scaled unknowns
        c: (N, ..), constants that differ between the points
        """
        signals, A, B, residual = self.equations.linear_rows(z, c)
        n = len(self.model.states)
        m = len(self.model.inputs)
        return LinearizedPoints(signals, A.reshape(len(z), n, n), B.reshape(len(z), n, m), residual)

    def constants(
        self, count: int = 1, columns: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return the constants c of the equations at N points, (N, ..).

        count: N
        columns: name of a variable, output, rate or parameter -> its values (N,). All other
            constants have the values of the condition and the model.
        """
        columns = columns or {}
        names = self.equations.constants
        imposed = self.condition.imposed
        schedule = self.model.schedule  # the scheduling variable may itself have a column
        table = np.empty((count, len(names) + len(self.model.p)))
        for index, name in enumerate(names):
            if name in columns:
                table[:, index] = columns[name]
            elif name in self.equations.idle:
                table[:, index] = self.declared[name]
            elif name in self.model.rates:
                table[:, index] = self.condition.rates.get(name.removesuffix("_dot"), 0.0)
            elif isinstance(imposed.get(name), LinearTable):
                scheduled = columns.get(schedule, imposed.get(schedule, 0.0))
                table[:, index] = self.condition.values_at(name, scheduled)
            else:
                table[:, index] = imposed.get(name, 0.0)
        table[:, len(names) :] = parameters_at(self.model, count, columns)
        return table

    def scaled(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the scaled unknowns (k,) that belong to values of the variables.

        values: variable -> value, at least for all unknowns
        """
        return np.array([values[name] for name in self.equations.unknowns]) / self.scales


def parameters_at(model: Model, count: int, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the parameters of a model at N points, (N, number of parameters).

    count: N
    columns: name -> values (N,), which replace the model's value if the name is a parameter
    """
    table = np.tile(model.p, (count, 1))
    for place, name in enumerate(model.parameters):
        if name in columns:
            table[:, place] = columns[name]
    return table


def declared_start(model: Model, imposed: Mapping[str, Any]) -> dict[str, float]:
    """Return the initial values of a trim search, variable -> value.

    The initial value is the declared value, unless the model computes a value from the imposed
    values (`Trimming.begin`).

    imposed: name -> imposed value
    """
    values = {name: model.signals[name].start for name in model.variables}
    if model.trimming.begin is None:
        return values
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    computed = model.trimming.initial({**parameters, **imposed})
    return values | {name: float(computed[name]) for name in computed if name in values}
