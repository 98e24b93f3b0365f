"""Solve a trim condition: scaled Newton on exact Jacobians, bounded least squares where that is not enough; or say why
there is no solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.model import Layout, Model, record
from hfa_support.native.bound import BoundFunction, cached_per_thread
from trim.point.condition import TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, Status

#: An entry of the scaled Jacobian up to which a variable does not move an equation.
_NOTHING = 1e-12
#: What the effects of other variables may leave of the effect of one that moves nothing else, relative.
_DEPENDENT = 1e-9


@cached_per_thread(maxsize=16)
def _bound(layout: Layout, outputs: tuple[str, ...]) -> BoundFunction:
    """(v, p) -> x, u, f, the outputs, and the derivatives of f and of the outputs by v, the variables of a trim."""
    names = layout.variables
    v, (p,) = ca.SX.sym("v", len(names)), layout.symbols("p")
    parts = layout.in_variables(dict(zip(names, ca.vertsplit(v), strict=True)), p, outputs)
    parts += [ca.densify(ca.jacobian(each, v)) for each in parts[2:]]
    return BoundFunction(ca.Function("trim", [v, p], parts))


@dataclass(frozen=True)
class TrimProblem:
    """f = imposed rates, y = imposed outputs of a model; unknowns and residuals in scaled units."""

    model: Model
    condition: TrimCondition

    @cached_property
    def scales(self) -> np.ndarray:
        """One scaled unit of each unknown."""
        return np.array([self.model.signals[name].nominal for name in self.condition.free])

    @cached_property
    def equations(self) -> tuple[str, ...]:
        """The states whose rates, then the outputs whose values are imposed."""
        rates, outputs = self.condition.equations
        return (*rates, *outputs)

    @cached_property
    def _row_scales(self) -> np.ndarray:
        model, (rates, outputs) = self.model, self.condition.equations
        return np.array([*map(model.rate_scale, rates), *(model.signals[name].nominal for name in outputs)])

    @cached_property
    def _wanted(self) -> np.ndarray:
        (rates, outputs), condition = self.condition.equations, self.condition
        return np.array([*((condition.rates or {})[name] for name in rates), *(condition.imposed[y] for y in outputs)])

    @cached_property
    def watched(self) -> tuple[str, ...]:
        """Imposed outputs, and what else has limits: states that an output replaces, limited outputs."""
        limited = (name for name, ends in self.model.limits.items() if np.isfinite(ends).any())
        others = {*limited, *self.condition.limits} - {*self.model.variables, *self.condition.imposed}
        others -= set(self.model.disturbances)
        return (*self.condition.equations[1], *(name for name in self.model.limits if name in others))

    def _evaluate(self, unknowns: np.ndarray) -> tuple[np.ndarray, ...]:
        """x, u, f, watched outputs and the derivatives of both by the variables."""
        bound = _bound(self.model.layout, self.watched)
        free = dict(zip(self.condition.free, (unknowns * self.scales).tolist(), strict=True))
        values = {**self.condition.imposed, **free}
        bound.inputs[0][:] = [values[name] for name in self.model.variables]
        bound.inputs[1][:] = self.model.p
        bound()
        found = bound.results
        if self.model.check is not None:
            self.model.check(record(tuple(self.model.states))(*found[0].tolist()))
        if not all(np.isfinite(each).all() for each in found):
            at = {name: values[name] for name in self.model.variables}
            raise FloatingPointError(self.model.not_finite(found[2], at, list(self.model.states)))
        return found

    def vectors(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and input at given unknowns (scaled)."""
        x, u = self._evaluate(unknowns)[:2]
        return x.copy(), u.copy()

    def linearization(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scaled residual and its Jacobian with respect to the scaled unknowns."""
        _, _, f, y, by_f, by_y = self._evaluate(unknowns)
        (rates, outputs), variables = self.condition.equations, self.model.variables
        rows = [list(self.model.states).index(name) for name in rates]
        columns = [variables.index(name) for name in self.condition.free]
        value = np.concatenate([f[rows], y[: len(outputs)]])
        by = [each.reshape(len(variables), -1).T for each in (by_f, by_y)]
        slopes = np.vstack([by[0][rows], by[1][: len(outputs)]])[:, columns]
        return (value - self._wanted) / self._row_scales, slopes * self.scales / self._row_scales[:, None]

    def residual(self, unknowns: np.ndarray) -> np.ndarray:
        """(f - imposed) / scale, one entry an equation."""
        return self.linearization(unknowns)[0]

    def count(self, guess: np.ndarray) -> tuple[int, int]:
        """Equations that the unknowns can move, and unknowns."""
        jacobian = self.linearization(guess)[1]
        return int(np.count_nonzero(np.abs(jacobian).max(axis=1) > _NOTHING)), len(self.condition.free)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest scaled unknowns."""
        pairs = np.array([self.condition.limits_of(name) for name in self.condition.free])
        return pairs[:, 0] / self.scales, pairs[:, 1] / self.scales

    def clip(self, unknowns: np.ndarray) -> np.ndarray:
        """The nearest unknowns within the limits."""
        return np.clip(unknowns, *self.limits())

    def inside(self, unknowns: np.ndarray) -> np.ndarray:
        """Which unknowns lie clear of their limits."""
        lowest, highest = self.limits()
        slack = 1e-6 * (1 + np.abs(unknowns))
        return (unknowns > lowest + slack) & (unknowns < highest - slack)

    def solved(self, unknowns: np.ndarray) -> bool:
        """Balanced, and within the limits (a rounding error beyond a limit is within it)."""
        slack = 1e-12 * (1 + np.abs(unknowns))
        lowest, highest = self.limits()
        if not (np.all(unknowns >= lowest - slack) and np.all(unknowns <= highest + slack)):
            return False
        return self.balanced(unknowns) and not self.beyond(unknowns)

    def balanced(self, unknowns: np.ndarray) -> bool:
        """Every residual within `BALANCE`, whatever the limits say."""
        return bool(np.abs(self.residual(unknowns)).max() <= BALANCE)

    @cached_property
    def bounded(self) -> list[tuple[int, float, float]]:
        """Which watched quantities have limits: index, sign and limit in value = sign (limit - y) >= 0."""
        ends = [(i, *self.condition.limits_of(name)) for i, name in enumerate(self.watched)]
        ends = [each for each in ends if self.watched[each[0]] not in self.condition.imposed]
        pairs = [(i, side, limit) for i, low, high in ends for side, limit in ((-1.0, low), (1.0, high))]
        return [each for each in pairs if np.isfinite(each[2])]

    def slack(self, unknowns: np.ndarray) -> np.ndarray:
        """How far the watched quantities lie within their limits, scaled."""
        y = self._evaluate(unknowns)[3]
        scales = [self.model.signals[self.watched[i]].nominal for i, _, _ in self.bounded]
        return np.array([side * (limit - y[i]) for i, side, limit in self.bounded]) / scales

    def beyond(self, unknowns: np.ndarray) -> list[str]:
        """The watched states and outputs that lie beyond their limits, in words; what is found is within by `clip`."""
        say, found = self.model.describe, []
        for name, value in zip(self.watched, self._evaluate(unknowns)[3].tolist(), strict=True):
            lowest, highest = self.condition.limits_of(name)
            slack = 1e-8 * self.model.signals[name].nominal
            if name not in self.condition.imposed and not lowest - slack <= value <= highest + slack:
                between = f"{say(name, lowest)} and {say(name, highest)}"
                found.append(f"{name} would have to be {say(name, value)}, it must lie between {between}")
        return found

    def first_guess(self, start: OperatingPoint | None) -> np.ndarray:
        """The warm start, or where the condition or the declaration begins."""
        signals = self.model.signals
        usual = {name: signals[name].start for name in self.model.variables} | dict(self.condition.begin)
        return self.unknowns_at(usual if start is None else start.values)

    def unknowns_at(self, values: Mapping[str, float]) -> np.ndarray:
        """The unknowns among the values of all variables."""
        return np.array([values[name] for name in self.condition.free]) / self.scales

    def point(self, unknowns: np.ndarray, status: Status) -> OperatingPoint:
        """The operating point at these unknowns."""
        found, model = self.vectors(unknowns), self.model
        state, control = (
            record(tuple(names))(*each.tolist())
            for names, each in zip((model.states, model.inputs), found, strict=True)
        )
        residuals = dict(zip(self.equations, (self.residual(unknowns) * self._row_scales).tolist(), strict=True))
        return OperatingPoint(state, control, residuals, model.name, status, model)

    def failure(self, found: np.ndarray) -> str:
        """One line on the best unknowns found: which equations do not balance within the limits, by how much, which
        limits bind, and, where the equations balance beyond them, what that would take."""
        unknowns = self.clip(found)
        scaled, point = self.residual(unknowns), self.point(unknowns, Status.FAILED)
        off = [
            f"{name} by {scaled[i] * self._row_scales[i]:.3g} {point.equation_unit(name)}"
            for i, name in sorted(enumerate(self.equations), key=lambda item: -abs(scaled[item[0]]))
            if abs(scaled[i]) > BALANCE
        ]
        if not off:
            return f"no trim within limits: {'; '.join(self.beyond(unknowns))}"
        can_balance = self.balanced(found)
        binding = self._binding(unknowns, found if can_balance else unknowns)
        why = f"limits that bind: {'; '.join(binding)}" if binding else "no limit binds"
        equations, count = (0, 0) if can_balance else self.count(unknowns)
        if equations > count:
            why += f"; {equations} equations for {count} unknowns, set more free"
        if idle := self._idle(unknowns):
            why += f"; {' and '.join(idle)} moves none of them, set something else free"
        elif not can_balance and (alike := self._alike(unknowns)):
            why += f"; {'; '.join(alike)}; set something else free"
        what = "equations" if self.condition.equations[1] else "rates"
        return f"no trim: these {what} do not balance: {', '.join(off)} ({why})"

    def _idle(self, unknowns: np.ndarray) -> list[str]:
        """The free variables that no equation feels: their columns of the Jacobian are 0."""
        felt = np.abs(self.linearization(unknowns)[1]).max(axis=0)
        return [name for name, most in zip(self.condition.free, felt, strict=True) if most <= _NOTHING]

    def _alike(self, unknowns: np.ndarray) -> list[str]:
        """Which free variables move the equations as others do, where fewer directions are left than equations.

        Column by column of the Jacobian: one that is a sum of multiples of those before it adds nothing.
        """
        jacobian = self.linearization(unknowns)[1]
        found: list[str] = []
        kept: list[int] = []
        for column, name in enumerate(self.condition.free):
            before, here = jacobian.take(kept, axis=1), jacobian[:, column]
            shares = np.linalg.lstsq(before, here)[0]
            if np.linalg.norm(here - before @ shares) > _DEPENDENT * np.linalg.norm(here):
                kept.append(column)
                continue
            parts = np.linalg.norm(before, axis=0) * np.abs(shares)
            others = [self.condition.free[kept[i]] for i in np.flatnonzero(parts > _DEPENDENT * parts.max())]
            together = " does" if len(others) == 1 else " do together"
            found.append(f"{name} moves them only as {' and '.join(others)}{together}")
        return found if len(kept) < self.count(unknowns)[0] else []

    def _binding(self, unknowns: np.ndarray, wanted: np.ndarray) -> list[str]:
        """The limits that the unknowns lie at, and what is wanted instead."""
        binding, describe = [], self.model.describe
        for name, scale, value, other, *limits in zip(
            self.condition.free, self.scales, unknowns, wanted, *self.limits(), strict=True
        ):
            for limit, word in zip(limits, ("lowest", "highest"), strict=True):
                slack = 1e-6 * (1 + abs(limit))
                if np.isfinite(limit) and abs(value - limit) <= slack:
                    instead = (
                        f", would have to be {describe(name, other * scale)}" if abs(other - limit) > slack else ""
                    )
                    binding.append(f"{name} at its {word}, {describe(name, limit * scale)}{instead}")
        return binding


_MAX_NEWTON_STEPS = 50
_MAX_HALVINGS = 20
#: Steps to the least effort: to its last digits, and those that are tried before it is known that there is a balance.
_MOST_STEPS, _FEW_STEPS = 500, 100


class TrimError(NoSolutionError):
    """No trim: the message names what does not balance, the limits that bind and what balance would take beyond them;
    `attempt` is the best point within the limits."""

    def __init__(self, message: str, attempt: OperatingPoint) -> None:
        super().__init__(message)
        self.attempt = attempt

    def __reduce__(self) -> tuple[type[TrimError], tuple[str, OperatingPoint]]:
        return TrimError, (str(self), self.attempt)


def find_operating_point(
    aircraft: Aircraft | Model, condition: TrimCondition, start: OperatingPoint | None = None
) -> OperatingPoint:
    """Solve f(X, U) = imposed rates, y(X, U) = imposed outputs of any model for the free variables, every residual
    within `BALANCE` of its scale.

    As many equations as unknowns: Newton's method with step halving. More unknowns than equations: the point
    of least control effort Σ (u / scale)², a local minimum near the start. When Newton leaves the limits, or
    with more equations than unknowns: least squares within the limits.

    start: a neighbouring point to begin from (warm start); else where the declaration begins. Raises TrimError when the
    equations cannot be balanced within the limits, BadInputError when the condition is not well posed or its
    numbers, with the aircraft's, overflow.
    Source: Stevens, Lewis, Johnson, Aircraft Control and Simulation, Section 3.6.
    """
    model = aircraft.model
    if not condition.free:
        raise BadInputError("nothing is free; set at least one of " + ", ".join(model.variables) + " free")
    if condition.model.variables != model.variables:
        raise BadInputError(f"the condition is one of {condition.model.name}, the aircraft is {model.name}")
    condition = condition.at() if condition.tables else condition
    problem = TrimProblem(model, condition)
    try:
        with np.errstate(over="raise"):
            return _solution(problem, problem.clip(problem.first_guess(start)))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            f"the equations overflow or divide by zero at this condition with these parameters; "
            f"take values nearer to an aircraft's ({error})"
        ) from error


def beyond_limits(model: Model, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """What `find_operating_point` says of a condition that balances beyond the limits only, at these free variables."""
    problem = TrimProblem(model, condition)
    return problem.failure(problem.unknowns_at(balancing))


def _solution(problem: TrimProblem, guess: np.ndarray) -> OperatingPoint:
    equations, unknowns = problem.count(guess)
    search = _least_effort_search if unknowns > equations else _square_search
    found = search(problem, guess)
    best = problem.clip(found)
    if not problem.solved(best):
        raise TrimError(problem.failure(found), problem.point(best, Status.FAILED))
    return problem.point(best, Status.TRIMMED)


def _square_search(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """Newton's solution, or the least-squares one within the limits when Newton leaves them or finds none."""
    best = _newton(problem, guess)
    return best if problem.solved(best) else _newton(problem, _bounded_least_squares(problem, guess))


def _least_effort_search(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """The solution of least effort; failing that, the point within the limits that comes nearest to balance."""
    best, settled = _least_effort(problem, guess, _FEW_STEPS)
    if settled and problem.solved(best):
        return best
    nearest = _polished(problem, _bounded_least_squares(problem, guess))
    if not problem.solved(nearest):  # then there hardly is a balance, and no use in going on to the last digit
        return best if problem.solved(best) else nearest
    for start in (guess, nearest):
        best, _ = _least_effort(problem, start, _MOST_STEPS)
        if problem.solved(best):
            break
    return best


def _polished(problem: TrimProblem, unknowns: np.ndarray) -> np.ndarray:
    """Newton's method with what lies at a limit staying there."""
    return _newton(problem, unknowns, moving=problem.inside(unknowns))


def _newton(problem: TrimProblem, unknowns: np.ndarray, moving: np.ndarray | None = None) -> np.ndarray:
    """Newton steps (least-norm where the Jacobian is not square), halved until the residual falls.

    moving: which unknowns may move; all of them unless said.
    """
    columns = np.arange(len(unknowns)) if moving is None else np.flatnonzero(moving)
    for _ in range(_MAX_NEWTON_STEPS):
        residual, jacobian = problem.linearization(unknowns)
        norm = float(np.abs(residual).max())
        step = np.zeros(len(unknowns))
        step[columns] = np.linalg.lstsq(jacobian[:, columns], -residual, rcond=1e-12)[0]
        if not np.isfinite(step).all():
            break
        better = _halved(problem, unknowns, step, norm)
        if better is None:
            break
        unknowns = better
    return unknowns


def _halved(problem: TrimProblem, unknowns: np.ndarray, step: np.ndarray, norm: float) -> np.ndarray | None:
    """The longest of step, step/2, ... that lowers the residual; None when none does."""
    for halving in range(_MAX_HALVINGS):
        candidate = unknowns + step / 2**halving
        try:
            if np.abs(problem.residual(candidate)).max() < norm:
                return candidate
        except (BadInputError, FloatingPointError):
            continue  # outside the model: a shorter step stays inside
    return None


def _bounded_least_squares(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    from scipy.optimize import least_squares

    lowest, highest = problem.limits()
    inside = np.clip(guess, lowest + 1e-9, highest - 1e-9)
    result = least_squares(
        problem.residual,
        inside,
        jac=lambda unknowns: problem.linearization(unknowns)[1],
        bounds=(lowest, highest),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    return np.asarray(result.x)


def _least_effort(problem: TrimProblem, guess: np.ndarray, most: int) -> tuple[np.ndarray, bool]:
    """min Σ (u_i / scale_i)² over the free inputs, subject to the equations, within the limits; and whether fewer than
    `most` steps led there."""
    from scipy.optimize import minimize

    lowest, highest = problem.limits()
    effort = np.array([name in problem.model.inputs for name in problem.condition.free], dtype=float)
    # Equations that the unknowns cannot move (q = 0 gives θ' = 0) would make the constraints dependent.
    movable = np.abs(problem.linearization(guess)[1]).max(axis=1) > 1e-12
    result = minimize(
        lambda unknowns: float(effort @ unknowns**2),
        guess,
        jac=lambda unknowns: 2 * effort * unknowns,
        method="SLSQP",
        bounds=list(zip(lowest, highest, strict=True)),
        constraints=[
            {
                "type": "eq",
                "fun": lambda unknowns: problem.residual(unknowns)[movable],
                "jac": lambda unknowns: problem.linearization(unknowns)[1][movable],
            },
            *[{"type": "ineq", "fun": lambda unknowns: problem.slack(unknowns)}] * bool(problem.bounded),
        ],
        options={"ftol": 1e-15, "maxiter": most},
    )
    return _polished(problem, problem.clip(np.asarray(result.x))), bool(result.nit < most)
