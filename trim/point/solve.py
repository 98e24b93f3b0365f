"""Find an operating point: Newton's method from the usual start, then least squares within the
limits, continuation from the model's own trim, other starts; the least effort where unknowns
outnumber equations."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError
from trim.point.condition import TrimCondition, usual_condition
from trim.point.diagnosis import failure
from trim.point.newton import newton
from trim.point.operating_point import OperatingPoint, Status
from trim.point.problem import TrimProblem
from trim.point.system import Structure, declared_start, equations

#: Shares of the way from the model's own trim that continuation tries, and their number.
_FIRST_SHARE, _LEAST_SHARE, _MOST_STEPS = 0.25, 1e-3, 200
#: What a step of continuation may change, in scaled units.
_FARTHEST = 10.0

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
    model: Model, condition: TrimCondition, start: OperatingPoint | None = None
) -> OperatingPoint:
    """The state and input with f(X, U) = imposed rates and y(X, U) = imposed outputs, every
    residual within `BALANCE` of its scale, within the limits.

    As many equations as unknowns: Newton's method with step halving. More unknowns than equations:
    the point of least control effort Σ (u / scale)², a local minimum near the start. Where that
    leads to no trim: the same from the least squares within the limits, then along a path from
    the model's own trim (continuation), then from `STARTS` other points between the limits;
    `started` of the result is then the number of the point that led there.

    start: a neighbouring point to begin from; else where the declaration begins.
    Raises TrimError when the equations cannot be balanced within the limits, BadInputError when the
    condition is not well posed or its numbers, with the model's, overflow. Source: Stevens,
    Lewis, Johnson, Aircraft Control and Simulation, Section 3.6."""
    problem = TrimProblem(model, condition, start)
    try:
        with np.errstate(over="raise"):
            return _solution(problem, problem.clip(problem.system.start))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            f"the equations overflow or divide by zero at this condition with these parameters; "
            f"take other values ({error})"
        ) from error


def other_trims(
    model: Model, condition: TrimCondition, point: OperatingPoint
) -> list[OperatingPoint]:
    """Further solutions of the same condition, as many equations as unknowns, that Newton's method
    finds from where the declaration begins and from `STARTS` points between the limits: the back
    side of the power curve beside the front side. They may not be all."""
    problem = TrimProblem(model, condition, point)
    known = [problem.unknowns(point.values)]
    others: list[OperatingPoint] = []
    moved, unknowns = problem.count
    starts = [*problem.starts(known[0])] if moved == unknowns else []
    if starts:
        starts.append(problem.unknowns(declared_start(model, condition.imposed)))
    for start in starts:
        solution = _solved_from(problem, start, TrimProblem.newton_within)
        if solution is None:
            continue
        if min(float(np.abs(solution - each).max()) for each in known) > 1e-6:
            known.append(solution)
            others.append(problem.point(solution, Status.TRIMMED))
    return others


def _solution(problem: TrimProblem, guess: np.ndarray) -> OperatingPoint:
    """The trim from a guess, or TrimError."""
    problem.at(guess)  # where the equations have no value there, that is the answer
    moved, unknowns = problem.count
    search: _Search = TrimProblem.newton
    if unknowns > moved:
        search = _least_effort
    nearest = _nearest(problem, guess, search)
    if problem.solved(nearest):
        return problem.point(nearest, Status.TRIMMED)
    tried = 0
    # Beyond the limits the inputs alone, in which equations are nearly affine, balance them at one
    # point.
    if not (problem.system.only_inputs and problem.balanced(nearest)):
        continued = _continued(problem) if moved == unknowns else None
        if continued is not None and problem.solved(continued):
            return problem.point(continued, Status.TRIMMED)
        from_afar = search if search is _least_effort else TrimProblem.newton_within
        for tried, start in enumerate(problem.starts(guess), start=1):
            solution = _solved_from(problem, start, from_afar)
            if solution is not None:
                return problem.point(solution, Status.TRIMMED, tried)
        if continued is not None and not problem.balanced(nearest) and problem.balanced(continued):
            nearest = continued  # beyond the limits
    message = failure(problem, nearest)
    if tried:
        message += f"; {tried} other starts failed too"
    raise TrimError(message, problem.point(problem.clip(nearest), Status.FAILED))


def _solved_from(problem: TrimProblem, start: np.ndarray, search: _Search) -> np.ndarray | None:
    """The solution that a search leads to; None where it leads to none, or out of the model."""
    try:
        z = search(problem, start)
        return z if problem.solved(z) else None
    except (BadInputError, FloatingPointError, np.linalg.LinAlgError):
        return None


def _nearest(problem: TrimProblem, guess: np.ndarray, search: _Search) -> np.ndarray:
    """The solution that a search leads to, failing that the one that it leads to from the least
    squares within the limits, failing that these or what balances beyond the limits."""
    solution = _solved_from(problem, guess, search)
    if solution is not None:
        return solution
    nearest = _bounded_least_squares(problem, guess)
    if search is TrimProblem.newton:
        return _balancing(problem, nearest)
    nearest = _polished(problem, nearest)
    solution = _solved_from(problem, nearest, search) if problem.solved(nearest) else None
    return nearest if solution is None else solution


def _balancing(problem: TrimProblem, nearest: np.ndarray) -> np.ndarray:
    """What balances the equations whatever the limits say, near the least squares within them;
    these where nothing does."""
    z = problem.newton(nearest)
    try:
        return z if problem.balanced(z) else nearest
    except (BadInputError, FloatingPointError):
        return nearest


def _continued(problem: TrimProblem) -> np.ndarray | None:
    """The solution at the end of a path: from the model's own trim, its imposed values change to
    those asked for in steps that Newton's method can follow, each begun on the line through the
    two solutions before. None where the path ends, or there is none.

    c(s) = c0 + s (c1 - c0), r(z, c(s)) = 0, s from 0 to 1."""
    system, asked = problem.system, problem.c
    usual = usual_condition(problem.model)
    values = {
        name: np.array([usual.imposed[name]])
        for name in system.equations.constants
        if name in usual.imposed
    }
    values |= {name: np.zeros(1) for name in system.equations.constants if name.endswith("_dot")}
    first = system.constants(1, values)
    if np.array_equal(first, asked) or not system.equations.square:
        return None
    guess = system.unknowns(declared_start(problem.model, usual.imposed))[None]
    z, settled = newton(system, guess, first)
    previous, previous_share = z, 0.0
    share, step = 0.0, _FIRST_SHARE
    for _ in range(_MOST_STEPS):
        if not settled[0] or step < _LEAST_SHARE:
            return None
        if share == 1.0:
            return z[0]
        target = min(1.0, share + step)
        begin = z
        if share > previous_share:
            begin = z + (z - previous) * (target - share) / (share - previous_share)
        found, ok = newton(system, begin, first + target * (asked - first))
        if ok[0] and np.abs(found - begin).max() < _FARTHEST:
            previous, previous_share = z, share
            z, share = found, target
            step *= 2.0
        else:
            step /= 2.0
    return None


def _polished(problem: TrimProblem, z: np.ndarray) -> np.ndarray:
    """Newton's method with what lies at a limit staying there."""
    system = problem.system
    z = problem.clip(z)
    low = system.limits.at_lowest(z * system.scales)
    high = system.limits.at_highest(z * system.scales)
    z = np.where(low, system.lowest, np.where(high, system.highest, z))
    moving = np.flatnonzero(~(low | high))
    return problem.newton(z, moving) if moving.size else z


def _bounded_least_squares(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """The least |r|² within the limits, from a guess."""
    from scipy.optimize import least_squares

    def residual(z: np.ndarray) -> np.ndarray:
        try:
            return problem.at(z).residual
        except (BadInputError, FloatingPointError):  # outside the model
            return np.full(len(problem.names), np.inf)

    lowest, highest = problem.system.lowest, problem.system.highest
    inside = np.clip(guess, lowest + 1e-9, highest - 1e-9)
    tight: Any = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "bounds": (lowest, highest)}
    solution = least_squares(residual, inside, jac=lambda z: problem.at(z).jacobian, **tight)
    return np.asarray(solution.x)


_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-10,
    "bound_relax_factor": 0.0,
    "max_iter": 200,
}


@lru_cache(maxsize=16)
def _effort_program(structure: Structure) -> ca.Function:
    """min Σ z_i² over the inputs among the unknowns z, with g = the residuals that they can move
    and the watched outputs."""
    e = equations(structure)
    inputs = [i for i, name in enumerate(e.unknowns) if name in structure.layout.names[1]]
    scales = ca.DM([scale for _, scale in structure.watched])
    program = {
        "x": e.z,
        "p": e.c,
        "f": ca.sumsqr(e.z[inputs]),
        "g": ca.vertcat(e.residual[: e.jacobian.shape[0]], e.y / scales),
    }
    return ca.nlpsol(
        "effort",
        "ipopt",
        program,
        {"print_time": False, "show_eval_warnings": False, "ipopt": _IPOPT},
    )


def _least_effort(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """min Σ (u_i / scale_i)² over the free inputs, subject to the equations, within the limits
    (IPOPT, exact derivatives); then Newton's method on the equations."""
    system = problem.system
    balanced = np.zeros(system.moved)
    scales = np.array([scale for _, scale in system.structure.watched])
    solution = _effort_program(system.structure)(
        x0=guess,
        p=problem.c[0],
        lbx=system.lowest,
        ubx=system.highest,
        lbg=np.concatenate([balanced, system.watched.lowest / scales]),
        ubg=np.concatenate([balanced, system.watched.highest / scales]),
    )
    return _polished(problem, np.array(solution["x"]).ravel())
