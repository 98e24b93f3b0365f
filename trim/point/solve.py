"""Solve a trim condition: scaled Newton on exact Jacobians; bounded least squares where that is not enough."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS
from hfa_support.errors import BadInputError, NoSolutionError
from trim.point.condition import VARIABLES, TrimCondition
from trim.point.operating_point import OperatingPoint, Status
from trim.point.trim_problem import TrimProblem

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
    aircraft: Aircraft, condition: TrimCondition, start: OperatingPoint | None = None
) -> OperatingPoint:
    """Solve f(X, U) = imposed rates for the free variables, every residual within `BALANCE` of its scale.

    As many equations as unknowns: Newton's method with step halving. More unknowns than equations: the point
    of least control effort Σ (u / scale)², a local minimum near the start. When Newton leaves the limits, or
    with more equations than unknowns: least squares within the limits.

    start: a neighbouring point to begin from (warm start); else an analytic guess. Raises TrimError when the
    equations cannot be balanced within the limits, BadInputError when the condition is not well posed or its
    numbers, with the aircraft's, overflow.
    Source: Stevens, Lewis, Johnson, Aircraft Control and Simulation, Section 3.6.
    """
    if not condition.free:
        raise BadInputError("nothing is free; set at least one of " + ", ".join(VARIABLES) + " free")
    condition = condition.at() if condition.tables else condition
    condition.check_pitch()
    problem = TrimProblem(aircraft, condition)
    try:
        with np.errstate(over="raise"):
            return _solution(problem, problem.clip(problem.first_guess(start)))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            "the equations overflow or divide by zero at this condition with these parameters"
            f"{_zeros(aircraft)}; take values nearer to an aircraft's"
        ) from error


def _zeros(aircraft: Aircraft) -> str:
    names = [name for name, value in aircraft.parameters._asdict().items() if value == 0.0]
    return f", of which {' and '.join(names)} {'is' if len(names) == 1 else 'are'} zero" if names else ""


def beyond_limits(aircraft: Aircraft, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """What `find_operating_point` says of a condition that balances beyond the limits only, at these free variables."""
    problem = TrimProblem(aircraft, condition)
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
    effort = np.array([name in INPUTS for name in problem.condition.free], dtype=float)
    # Equations that the unknowns cannot move (q = 0 gives θ' = 0) would make the constraints dependent.
    movable = np.abs(problem.linearization(guess)[1]).max(axis=1) > 1e-12
    result = minimize(
        lambda unknowns: float(effort @ unknowns**2),
        guess,
        jac=lambda unknowns: 2 * effort * unknowns,
        method="SLSQP",
        bounds=list(zip(lowest, highest, strict=True)),
        constraints={
            "type": "eq",
            "fun": lambda unknowns: problem.residual(unknowns)[movable],
            "jac": lambda unknowns: problem.linearization(unknowns)[1][movable],
        },
        options={"ftol": 1e-15, "maxiter": most},
    )
    return _polished(problem, problem.clip(np.asarray(result.x))), bool(result.nit < most)
