"""Solve a trim condition: scaled Newton on exact Jacobians, bounded least squares where that is not
enough, from several starts; the least effort where unknowns outnumber equations; or say why there
is no solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Layout, Model, record
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.linear_table import LinearTable
from hfa_support.native.bound import BoundFunction, cached_per_thread
from trim.point.condition import TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, Status

#: An entry of the scaled Jacobian up to which a variable does not move an equation.
_NOTHING = 1e-12
#: What the effects of other variables may leave of the effect of one that moves nothing else,
#: relative.
_DEPENDENT = 1e-9
#: Starting points that are tried beside the usual one, and how far they lie from it where there is
#: no limit, in scaled units.
STARTS, _FAR = 8, 10.0


class _Equations(NamedTuple):
    """(v, p) -> flat, whose parts are x, u, f, the outputs, and the derivatives of f (variables, n)
    and of the outputs by v, the variables of a trim. felt: 1 where an entry of f or of the outputs
    (row) can feel a variable (column) at all."""

    bound: BoundFunction
    parts: tuple[np.ndarray, ...]
    felt: np.ndarray


@cached_per_thread(maxsize=16)
def _equations(layout: Layout, outputs: tuple[str, ...]) -> _Equations:
    names = layout.variables
    v, (p,) = ca.SX.sym("v", len(names)), layout.symbols("p")
    parts = layout.in_variables(dict(zip(names, ca.vertsplit(v), strict=True)), p, outputs)
    jacobians = [ca.jacobian(each, v) for each in parts[2:]]
    layout.refuse_steps(jacobians[0], names)
    felt = np.vstack([ca.DM(ca.sparsify(each).sparsity(), 1).full() for each in jacobians])
    parts += map(ca.densify, jacobians)
    bound = BoundFunction(ca.Function("trim", [v, p], [ca.vertcat(*map(ca.vec, parts))]))
    split = np.split(bound.results[0], np.cumsum([each.numel() for each in parts])[:-1])
    split[4:] = [each.reshape(len(names), -1) for each in split[4:]]
    return _Equations(bound, tuple(split), felt)


class _Found(NamedTuple):
    """State, input, watched outputs; residuals (f - imposed) / scale, one an equation, and their
    derivatives by the scaled unknowns."""

    x: np.ndarray
    u: np.ndarray
    y: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


class TrimProblem:
    """f = imposed rates, y = imposed outputs of a model; unknowns and residuals in scaled units.

    begin: the values of the variables where the search begins. idle: variables that are not imposed
    and in no equation, which a trim leaves there. free: the unknowns; scales: one scaled unit of
    each; limits: their lowest and highest scaled values. equations: the states whose rates, then
    the outputs whose values are imposed, with one scaled unit of each (row_scales) and what is
    imposed (wanted); moved: which of them the unknowns can move. watched: imposed outputs, and what
    else has limits: states that an output replaces, limited outputs. held: the value of each
    variable that is imposed or idle, 0 of the unknowns. count: equations that the unknowns can
    move, and unknowns."""

    def __init__(self, model: Model, condition: TrimCondition, begin: Mapping[str, float]) -> None:
        self.model, self.condition, self.begin = model, condition, begin
        (rates, outputs), states, variables = (
            condition.equations,
            list(model.states),
            model.variables,
        )
        limited = {name for name, ends in model.limits.items() if not all(map(math.isinf, ends))}
        others = {*limited, *condition.limits} - {
            *variables,
            *condition.imposed,
            *model.disturbances,
        }
        self.watched = (*outputs, *(name for name in model.limits if name in others))
        self._functions = _equations(model.layout, self.watched)
        self._rows = [*map(states.index, rates), *range(len(states), len(states) + len(outputs))]
        felt = self._functions.felt[self._rows]
        known = dict(zip(variables, felt.max(axis=0), strict=True))
        self.idle = tuple(name for name in condition.free if not known[name])
        self.free = tuple(name for name in condition.free if known[name])
        self._columns = [variables.index(name) for name in self.free]
        self.scales = np.array([model.signals[name].nominal for name in self.free])
        self.equations = (*rates, *outputs)
        self.row_scales = np.array(
            [*map(model.rate_scale, rates), *(model.signals[y].nominal for y in outputs)]
        )
        imposed = [
            *(condition.rates[name] for name in rates),
            *(condition.imposed[y] for y in outputs),
        ]
        self.wanted = np.array(imposed)
        values = {name: begin[name] for name in self.idle} | dict(condition.imposed)
        self.held = np.array([values.get(name, 0.0) for name in variables])
        self.moved = np.asarray(felt[:, self._columns].any(axis=1))
        self.count = int(self.moved.sum()), len(self.free)
        ends = np.array([condition.limits_of(name) for name in self.free]).reshape(-1, 2)
        self.limits = ends[:, 0] / self.scales, ends[:, 1] / self.scales
        self._last: tuple[bytes, _Found] | None = None

    def at(self, unknowns: np.ndarray) -> _Found:
        """What is found at given unknowns (scaled). FloatingPointError where it is not finite."""
        key = unknowns.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        bound, (x, u, f, y, by_f, by_y), _ = self._functions
        bound.inputs[0][:] = self.held
        bound.inputs[0][self._columns] = unknowns * self.scales
        bound.inputs[1][:] = self.model.p
        bound()
        if self.model.check is not None:
            self.model.check(record(tuple(self.model.states))(*x.tolist()))
        if not np.isfinite(bound.results[0]).all():
            at = dict(zip(self.model.variables, bound.inputs[0].tolist(), strict=True))
            raise FloatingPointError(self.model.not_finite(f, at, list(self.model.states)))
        value, slopes = (
            np.concatenate([f, y])[self._rows],
            np.hstack([by_f, by_y])[self._columns][:, self._rows].T,
        )
        scaled = slopes * self.scales / self.row_scales[:, None]
        found = _Found(
            x.copy(), u.copy(), y.copy(), (value - self.wanted) / self.row_scales, scaled
        )
        self._last = key, found
        return found

    def clip(self, unknowns: np.ndarray) -> np.ndarray:
        """The nearest unknowns within the limits."""
        return np.clip(unknowns, *self.limits)

    def solved(self, unknowns: np.ndarray) -> bool:
        """Balanced, and within the limits (a rounding error beyond a limit is within it)."""
        within = self.condition.limits_on(self.free).within(unknowns * self.scales)
        return bool(within.all()) and self.balanced(unknowns) and not self.beyond(unknowns)

    def balanced(self, unknowns: np.ndarray) -> bool:
        """Every residual within `BALANCE`, whatever the limits say."""
        return bool(np.abs(self.at(unknowns).residual).max() <= BALANCE)

    def beyond(self, unknowns: np.ndarray) -> list[str]:
        """The watched states and outputs that lie beyond their limits, in words; `clip` keeps
        them."""
        outputs = len(self.condition.equations[1])
        limits = self.condition.limits_on(self.watched[outputs:])
        return limits.broken(self.at(unknowns).y[outputs:])

    def unknowns_at(self, values: Mapping[str, float]) -> np.ndarray:
        """The unknowns among the values of all variables."""
        return np.array([values[name] for name in self.free]) / self.scales

    def starts(self, guess: np.ndarray) -> Iterator[np.ndarray]:
        """Of `STARTS` points between the limits, spread evenly, those where the Jacobian is another
        than at the guess: where it is the same everywhere one solution is all there can be. None
        where equations outnumber unknowns.

        k α modulo 1 with α_j = φ^-j, φ^(d+1) = φ + 1 (Roberts' generalized golden ratio): no point
        depends on chance."""
        equations, unknowns = self.count
        lowest, highest = (
            np.where(np.isfinite(end), end, guess + far)
            for end, far in zip(self.limits, (-_FAR, _FAR), strict=True)
        )
        golden = max(np.roots([1.0, *[0.0] * (unknowns - 1), -1.0, -1.0]).real) ** -np.arange(
            1.0, unknowns + 1
        )
        here = self.at(guess).jacobian
        for number in range(1, STARTS + 1) if equations <= unknowns else ():
            start = lowest + (highest - lowest) * ((0.5 + number * golden) % 1.0)
            try:
                other = self.at(start).jacobian
            except (BadInputError, FloatingPointError):
                continue  # outside the model
            if not np.allclose(other, here, rtol=1e-9, atol=1e-12):
                yield start

    def point(self, unknowns: np.ndarray, status: Status, started: int = 0) -> OperatingPoint:
        """The operating point at these unknowns."""
        found, model = self.at(unknowns), self.model
        state, control = (
            record(tuple(names))(*each.tolist())
            for names, each in zip((model.states, model.inputs), found[:2], strict=True)
        )
        residuals = dict(
            zip(self.equations, (found.residual * self.row_scales).tolist(), strict=True)
        )
        return OperatingPoint(state, control, residuals, status, model, started)

    def failure(self, found: np.ndarray) -> str:
        """One line on the best unknowns found: which equations do not balance within the limits, by
        how much, which limits bind, and, where the equations balance beyond them, what that would
        take."""
        unknowns = self.clip(found)
        scaled, point = self.at(unknowns).residual, self.point(unknowns, Status.FAILED)
        off = [
            f"{name} by {scaled[i] * self.row_scales[i]:.3g} {point.equation_unit(name)}"
            for i, name in sorted(enumerate(self.equations), key=lambda item: -abs(scaled[item[0]]))
            if abs(scaled[i]) > BALANCE
        ]
        if not off:
            return f"no trim within limits: {'; '.join(self.beyond(unknowns))}"
        can_balance = self.balanced(found)
        binding = self._binding(unknowns, found if can_balance else unknowns)
        why = f"limits that bind: {'; '.join(binding)}" if binding else "no limit binds"
        equations, count = (0, 0) if can_balance else self.count
        if equations > count:
            why += f"; {equations} equations for {count} unknowns, set more free"
        effects = np.abs(self.at(unknowns).jacobian).max(axis=0)
        if idle := [
            *self.idle,
            *(name for name, most in zip(self.free, effects, strict=True) if most <= _NOTHING),
        ]:
            why += f"; {' and '.join(idle)} moves none of them, set something else free"
        elif not can_balance and (alike := self._alike(unknowns)):
            why += f"; {'; '.join(alike)}; set something else free"
        what = "equations" if self.condition.equations[1] else "rates"
        return f"no trim: these {what} do not balance: {', '.join(off)} ({why})"

    def _alike(self, unknowns: np.ndarray) -> list[str]:
        """Which free variables move the equations as others do, where fewer directions are left
        than equations: a column of the Jacobian that is a sum of multiples of those before it adds
        nothing."""
        jacobian, found, kept = self.at(unknowns).jacobian, list[str](), list[int]()
        for column, name in enumerate(self.free):
            before, here = jacobian[:, kept], jacobian[:, column]
            shares = np.linalg.lstsq(before, here)[0]
            if np.linalg.norm(here - before @ shares) > _DEPENDENT * np.linalg.norm(here):
                kept.append(column)
                continue
            parts = np.linalg.norm(before, axis=0) * np.abs(shares)
            others = [self.free[kept[i]] for i in np.flatnonzero(parts > _DEPENDENT * parts.max())]
            found.append(
                f"{name} moves them only as {' and '.join(others)} {'does' if len(others) == 1 else 'do'}"
            )
        return found if len(kept) < self.count[0] else []

    def _binding(self, unknowns: np.ndarray, wanted: np.ndarray) -> list[str]:
        """The limits that the unknowns lie at, and the wanted values."""
        binding, describe = [], self.model.describe
        for i, name in enumerate(self.free):
            for ends, word in zip(self.limits, ("lowest", "highest"), strict=True):
                limit, slack, scale = ends[i], 1e-6 * (1 + abs(ends[i])), self.scales[i]
                if np.isfinite(limit) and abs(unknowns[i] - limit) <= slack:
                    would = f", would have to be {describe(name, wanted[i] * scale)}"
                    more = would if abs(wanted[i] - limit) > slack else ""
                    binding.append(f"{name} at its {word}, {describe(name, limit * scale)}{more}")
        return binding


_MAX_NEWTON_STEPS = 50
_MAX_HALVINGS = 20


_Search = Callable[[TrimProblem, np.ndarray], np.ndarray]


class TrimError(NoSolutionError):
    """No trim: the message names what does not balance, the limits that bind and what balance would
    take beyond them; `attempt` is the best point within the limits."""

    def __init__(self, message: str, attempt: OperatingPoint) -> None:
        super().__init__(message)
        self.attempt = attempt

    def __reduce__(self) -> tuple[type[TrimError], tuple[str, OperatingPoint]]:
        return TrimError, (str(self), self.attempt)


def find_operating_point(
    aircraft: Model, condition: TrimCondition, start: OperatingPoint | None = None
) -> OperatingPoint:
    """Solve f(X, U) = imposed rates, y(X, U) = imposed outputs of any model for the free variables,
    every residual within `BALANCE` of its scale.

    As many equations as unknowns: Newton's method with step halving. More unknowns than equations:
    the point of least control effort Σ (u / scale)², a local minimum near the start. When Newton
    leaves the limits, or with more equations than unknowns: least squares within the limits.
    Failing that, the same from `STARTS` other points between the limits; `started` of the result is
    then the number of the point that led there.

    start: a neighbouring point to begin from (warm start); else where the declaration begins.
    Raises TrimError when the equations cannot be balanced within the limits, BadInputError when the
    condition is not well posed or its numbers, with the aircraft's, overflow. Source: Stevens,
    Lewis, Johnson, Aircraft Control and Simulation, Section 3.6."""
    model = aircraft
    problem = trim_problem(model, condition, start)
    try:
        with np.errstate(over="raise"):
            return _solution(problem, problem.clip(problem.unknowns_at(problem.begin)))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            f"the equations overflow or divide by zero at this condition with these parameters; "
            f"take values nearer to an aircraft's ({error})"
        ) from error


def other_trims(
    aircraft: Model, condition: TrimCondition, point: OperatingPoint
) -> list[OperatingPoint]:
    """Further solutions of the same condition, as many equations as unknowns, that Newton's method
    finds from where the declaration begins and from `STARTS` points between the limits: the back
    side of the power curve beside the front side. They may not be all."""
    problem = trim_problem(aircraft, condition, point)
    known, found = [problem.unknowns_at(point.values)], []
    equations, unknowns = problem.count
    starts = [*problem.starts(known[0])] if equations == unknowns else []
    if starts:
        starts.append(
            problem.unknowns_at({name: each.start for name, each in problem.model.signals.items()})
        )
    for start in starts:
        end = _solved_from(problem, start, _newton)
        if end is not None and min(float(np.abs(end - each).max()) for each in known) > 1e-6:
            known.append(end)
            found.append(problem.point(end, Status.TRIMMED))
    return found


def trim_problem(
    model: Model, condition: TrimCondition, start: OperatingPoint | None
) -> TrimProblem:
    """The equations and unknowns of a condition, begun at a point or where condition and
    declaration begin."""
    if not condition.free:
        raise BadInputError(
            "nothing is free; set at least one of " + ", ".join(model.variables) + " free"
        )
    if condition.model.variables != model.variables:
        raise BadInputError(
            f"the condition is one of {condition.model.name}, the aircraft is {model.name}"
        )
    if any(isinstance(value, LinearTable) for value in condition.imposed.values()):
        condition = condition.at()
    signals = model.signals
    usual = {name: signals[name].start for name in model.variables} | dict(condition.begin)
    problem = TrimProblem(model, condition, usual if start is None else start.values)
    if not problem.free:
        raise BadInputError(
            f"{' and '.join(problem.idle)} moves no equation; set something else free"
        )
    return problem


def beyond_limits(model: Model, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """What `find_operating_point` says of a condition that balances beyond the limits only, at
    these free variables."""
    problem = TrimProblem(model, condition, balancing)
    return problem.failure(problem.unknowns_at(balancing))


def _solution(problem: TrimProblem, guess: np.ndarray) -> OperatingPoint:
    problem.at(guess)  # where the equations have no value there, that is the answer
    equations, unknowns = problem.count
    search = _least_effort if unknowns > equations else _newton
    found = _found_from(problem, guess, search)
    best, tried = problem.clip(found), 0
    if problem.solved(best):
        return problem.point(best, Status.TRIMMED)
    # Beyond the limits the inputs alone, in which equations are nearly affine, balance them at one
    # point.
    if not (problem.balanced(found) and set(problem.free) <= set(problem.model.inputs)):
        for tried, start in enumerate(problem.starts(guess), start=1):
            if (other := _solved_from(problem, start, search)) is not None:
                return problem.point(other, Status.TRIMMED, tried)
    more = f"; {tried} other starts failed too" if tried else ""
    raise TrimError(problem.failure(found) + more, problem.point(best, Status.FAILED))


def _solved_from(problem: TrimProblem, start: np.ndarray, search: _Search) -> np.ndarray | None:
    """The solution that a search leads to; None where it leads to none, or out of the model."""
    try:
        found = search(problem, start)
        return found if problem.solved(found) else None
    except (BadInputError, FloatingPointError, np.linalg.LinAlgError):
        return None


def _found_from(problem: TrimProblem, guess: np.ndarray, search: _Search) -> np.ndarray:
    """The solution that a search leads to, failing that the one that it leads to from the least
    squares within the limits, failing that these or what balances beyond the limits."""
    if (best := _solved_from(problem, guess, search)) is not None:
        return best
    nearest = _bounded_least_squares(problem, guess)
    if search is _newton:
        beyond = _newton(problem, nearest)
        return beyond if problem.balanced(beyond) else nearest
    nearest = _polished(problem, nearest)
    best = _solved_from(problem, nearest, search) if problem.solved(nearest) else None
    return nearest if best is None else best


def _polished(problem: TrimProblem, unknowns: np.ndarray) -> np.ndarray:
    """Newton's method with what lies at a limit staying there."""
    unknowns, slack = problem.clip(unknowns), 1e-6 * (1 + np.abs(unknowns))
    lowest, highest = problem.limits
    low, high = unknowns <= lowest + slack, unknowns >= highest - slack
    unknowns = np.where(low, lowest, np.where(high, highest, unknowns))
    return _newton(problem, unknowns, np.flatnonzero(~(low | high)))


def _newton(
    problem: TrimProblem, unknowns: np.ndarray, moving: np.ndarray | None = None
) -> np.ndarray:
    """Newton steps (least-norm where the Jacobian is not square), halved until the residual falls;
    to rounding.

    moving: which unknowns may move; all of them unless given.
    """
    columns = np.arange(len(unknowns)) if moving is None else moving
    for _ in range(_MAX_NEWTON_STEPS if len(columns) else 0):
        _, _, _, residual, jacobian = problem.at(unknowns)
        norm, step = float(np.linalg.norm(residual)), np.zeros(len(unknowns))
        step[columns] = _step(jacobian[:, columns], residual)
        better = None
        if norm > 0.0 and np.isfinite(step).all():
            better = _halved(problem, unknowns, step, norm)
        if better is None:
            break
        unknowns = better
    return unknowns


def _step(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    felt = jacobian.any(axis=1)
    if np.count_nonzero(felt) == jacobian.shape[1]:
        try:
            step = np.linalg.solve(jacobian[felt], -residual[felt])
            if np.abs(step).max() < 1e6:
                return step
        except np.linalg.LinAlgError:
            pass
    return np.asarray(np.linalg.lstsq(jacobian, -residual, rcond=1e-12)[0])


def _halved(
    problem: TrimProblem, unknowns: np.ndarray, step: np.ndarray, norm: float
) -> np.ndarray | None:
    """Where the longest of step, step/2, ... that lowers the residual leads; None when none does. A
    balance is not improved by a shorter step than Newton's."""
    for halving in range(_MAX_HALVINGS if norm > BALANCE else 1):
        candidate = unknowns + step / 2**halving
        try:
            if np.linalg.norm(problem.at(candidate).residual) < norm:
                return candidate
        except (BadInputError, FloatingPointError):
            continue  # outside the model: a shorter step stays inside
    return None


def _bounded_least_squares(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    from scipy.optimize import least_squares

    def residual(unknowns: np.ndarray) -> np.ndarray:
        try:
            return problem.at(unknowns).residual
        except (BadInputError, FloatingPointError):  # outside the model
            return np.full(len(problem.equations), np.inf)

    lowest, highest = problem.limits
    inside = np.clip(guess, lowest + 1e-9, highest - 1e-9)
    tight: Any = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "bounds": (lowest, highest)}
    return np.asarray(
        least_squares(residual, inside, jac=lambda z: problem.at(z).jacobian, **tight).x
    )


_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-10,
    "bound_relax_factor": 0.0,
    "max_iter": 200,
}


@lru_cache(maxsize=16)
def _effort_program(
    layout: Layout, free: tuple[str, ...], rates: tuple[str, ...], watched: tuple[str, ...]
) -> ca.Function:
    """min Σ z_i² over the inputs among the unknowns z, with g = the rates and the watched outputs,
    scaled.

    p: the values of all variables, the parameters, the scales of z and of g.
    """
    names, states = layout.variables, layout.names[0]
    z, given, (p,) = ca.SX.sym("z", len(free)), ca.SX.sym("given", len(names)), layout.symbols("p")
    scales, sizes = ca.SX.sym("scales", len(free)), ca.SX.sym("sizes", len(rates) + len(watched))
    values = dict(zip(names, ca.vertsplit(given), strict=True))
    values |= dict(zip(free, ca.vertsplit(z * scales), strict=True))
    _, _, f, y = layout.in_variables(values, p, watched)
    g = ca.vertcat(*(f[states.index(name)] for name in rates), y) / sizes
    effort = ca.sumsqr(
        ca.vertcat(ca.SX(0, 1), *(z[i] for i, name in enumerate(free) if name in layout.names[1]))
    )
    program = {"x": z, "p": ca.vertcat(given, p, scales, sizes), "f": effort, "g": g}
    return ca.nlpsol("effort", "ipopt", program, {"print_time": False, "ipopt": _IPOPT})


def _least_effort(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """min Σ (u_i / scale_i)² over the free inputs, subject to the equations, within the limits
    (IPOPT, exact derivatives); then Newton's method on the equations."""
    model, condition = problem.model, problem.condition
    rates, outputs = condition.equations
    others = problem.watched[len(outputs) :]
    program = _effort_program(model.layout, problem.free, rates, problem.watched)
    sizes = np.concatenate([problem.row_scales, [model.signals[name].nominal for name in others]])
    # Equations that the unknowns cannot move (q = 0 gives θ' = 0) would make the constraints
    # dependent.
    moved, limits = (
        problem.moved,
        np.array([condition.limits_of(name) for name in others]).reshape(-1, 2).T,
    )
    wanted = [np.where(moved, problem.wanted, side * np.inf) for side in (-1, 1)]
    low, high = (np.concatenate(ends) / sizes for ends in zip(wanted, limits, strict=True))
    p = np.concatenate([problem.held, model.p, problem.scales, sizes])
    lowest, highest = problem.limits
    found = program(x0=guess, p=p, lbx=lowest, ubx=highest, lbg=low, ubg=high)["x"]
    return _polished(problem, np.array(found).ravel())
