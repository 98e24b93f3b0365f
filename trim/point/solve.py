"""Search for an operating point: Newton's method from the default initial point, then other
searches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from trim.point.condition import TrimCondition, refuse_other_units, release, usual_condition
from trim.point.freed import freed_parameters, with_found_parameters, with_parameters_as_inputs
from trim.point.operating_point import OperatingPoint
from trim.point.problem import SearchEnd, TrimProblem
from trim.point.status import Status
from trim.point.uniqueness import is_determined, keepable, kept_states


class TrimError(NoSolutionError):
    """Error for a condition that has no trim.

    The message names the equations that do not balance, the active limits, and the values beyond
    the limits that balance would require.

    attempt: best point found within the limits
    required: sentences on the limits beyond which the equations balance, or "" if they do not
        balance beyond any limits
    """

    def __init__(self, message: str, attempt: OperatingPoint, required: str = "") -> None:
        super().__init__(message)
        self.attempt = attempt
        self.required = required

    def __reduce__(self) -> tuple[type[TrimError], tuple[str, OperatingPoint, str]]:
        return TrimError, (str(self), self.attempt, self.required)


def explained(error: TrimError, model: Model, condition: TrimCondition) -> TrimError:
    """Return the error of a failed trim with the model's explanation at the beginning of its
    message.

    The error is unchanged if the model has no explanation.

    error: error of the trim search
    condition: condition of the failed trim
    """
    from trim.point.diagnosis import explanation

    reason = explanation(model, condition)
    if not reason:
        return error
    details = str(error).removeprefix("no trim: ")
    return TrimError(f"no trim: {reason} ({details})", error.attempt, error.required)


def trim(
    model: Model,
    condition: TrimCondition | None = None,
    start: OperatingPoint | Mapping[str, float] | None = None,
    *,
    hold: Mapping[str, float | str] | None = None,
    free: str | Sequence[str] = (),
    at: float | str | None = None,
    **held: float | str,
) -> OperatingPoint:
    """Return the trim of an aircraft: f(X, U) = imposed rates and y(X, U) = imposed outputs.

    Every residual is at most `BALANCE` times its scale, and every variable is within its limits.

    - With as many equations as unknowns, Newton's method with halved steps is used.
    - States that the equations do not determine keep their start values, wherever the search
      begins: those that would move farthest for their size, unless the trim needs them. States that
      `free` names are not kept.
    - With more unknowns, the result has the least control effort Σ (u / scale)², a local minimum
      near the initial point.
    - If the first search fails, further searches begin at the least-squares solution within the
      limits, follow a path from the trim that the model declares (continuation), and begin at
      `STARTS` other points within the limits. `initial_point` of the result is the number of the
      successful point, or 0 for the first search.

    model: model of the aircraft
    condition: imposed and free variables; by default the trim that the model declares
    start: neighboring point at which the search begins, or some of its values by name; by default
        the declared initial values
    hold: variable, output, airspeed (kcas) or rate (speed_dot) -> imposed value, a number in the
        units of the model or text with a unit, such as "250 kt" or "FL200"; None for none
    free: variables and parameters to set free; a rate (h_dot) that is set free is not balanced. A
        parameter such as cg has the value found in `point.model`
    at: value of the scheduling variable, added to `hold`; None if not given
    held: further values of `hold`, as keyword arguments: speed=100.0

    Raises TrimError if the equations cannot be balanced within the limits. Raises BadInputError if
    the condition is not well posed, if `hold` or `held` also gives the scheduling variable of `at`,
    or if numbers overflow in the equations of the model.

    Source: Stevens, Lewis, Johnson, Aircraft Control and Simulation, Section 3.6.

    >>> import hfa
    >>> point = hfa.trim(hfa.aircraft(), hold={"dihedral": 0.2})
    >>> round(point["throttle"], 2)
    40.27
    """
    condition = condition or usual_condition(model)
    refuse_other_units(condition, model)
    held = {**(hold or {}), **held}
    if at is not None:
        if model.schedule in held:
            raise BadInputError(f"at and {model.schedule} are the same variable; give one of them")
        held[model.schedule or "at"] = at
    if held or free:
        free = (free,) if isinstance(free, str) else free
        condition = release(condition, hold=held, free=free)
    if isinstance(start, Mapping):
        for name in start:
            refuse_unknown("start names the unknown variable", name, model.variables)
    if freed_parameters(condition):
        return _trim_of_parameters(model, condition, start)
    begin = start.values if isinstance(start, OperatingPoint) else start
    problem = TrimProblem(model, condition, begin)
    try:
        with np.errstate(over="raise"):
            return _unique_trim(problem)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        if model.about.failed():
            raise BadInputError(f"no trim: {error}") from error
        raise BadInputError(
            f"the equations overflow or divide by zero; use other values or parameters ({error})"
        ) from error


def _trim_of_parameters(
    model: Model, condition: TrimCondition, start: OperatingPoint | Mapping[str, float] | None
) -> OperatingPoint:
    """Return the trim of a condition that sets parameters free, at the parameters that it needs."""
    names = freed_parameters(condition)
    wide = with_parameters_as_inputs(model, names)
    others = tuple(name for name in condition.freed if name not in names)
    try:
        point = trim(wide, replace(condition, model=wide, freed=others), start)
    except TrimError as error:
        attempt = with_found_parameters(error.attempt, model, condition)
        raise TrimError(str(error), attempt, error.required) from error
    return with_found_parameters(point, model, condition)


def _unknowns_of(problem: TrimProblem) -> np.ndarray | None:
    """Return the unknowns of the trim of a problem, (k,), or None without a trim."""
    with suppress(BadInputError, TrimError):
        return solution(problem).z
    return None


def _unique_trim(problem: TrimProblem) -> OperatingPoint:
    """Return the trim in which the states that the equations do not determine have their start
    values.

    Raises TrimError if no trim is found.
    """
    if keepable(problem.system, problem.asked.set_free):
        equations, unknowns = problem.count
        found = solution(problem) if unknowns <= equations else None
        if found is None or not is_determined(problem, found.z):
            problem = problem.keeping(kept_states(problem, _unknowns_of))
            found = solution(problem)
    else:
        found = solution(problem)
    return OperatingPoint._of(problem, found.z, Status.TRIMMED, found.initial_point)


def solution(problem: TrimProblem) -> SearchEnd:
    """Return the first trim that the searches find.

    A trim in which an angle without limits exceeds 90 deg is returned only if no other is found.

    Raises TrimError if no trim is found.
    """
    guess = problem.clip(problem.system.start)
    if not problem.free:  # nothing is free, and the point is an equilibrium
        return SearchEnd(guess, 0)
    nearest = guess  # the last unknowns that balance beyond limits, else the first search's end
    number = 0
    far_out: SearchEnd | None = None
    for z, number in _search_ends(problem, guess):
        if problem.solved(z):
            end = SearchEnd(problem.unwound(z), number)
            if not problem.system.beyond_quarter_turn(end.z).any():
                return end
            far_out = far_out or end
        elif problem.balanced(z):
            nearest = z
            # If only inputs are free, the equations are nearly affine and have one solution.
            if problem.system.only_inputs:
                break
        elif number == 0 and not problem.balanced(nearest):
            nearest = z
    if far_out is not None:
        return far_out
    raise _error_of(problem, nearest, number)


def _error_of(problem: TrimProblem, nearest: np.ndarray, others: int) -> TrimError:
    """Return the error of a condition without a trim.

    nearest: best scaled unknowns found, (k,)
    others: number of other initial points from which a search failed
    """
    from trim.point.diagnosis import binding_limits, failure

    message = failure(problem, nearest)
    required = ""
    if problem.balanced(nearest):
        required = "; ".join(binding_limits(problem, nearest).values())
    if others:
        message += f"; {others} other initial points failed too"
    attempt = OperatingPoint._of(problem, problem.clip(nearest), Status.FAILED)
    if rates := attempt._unmoved:
        message += f"; no input of the model changes {' and '.join(rates)}"
    return TrimError(message, attempt, required)


def _search_ends(problem: TrimProblem, guess: np.ndarray) -> Iterator[SearchEnd]:
    """Yield the end of each search: Newton's method from the guess (k,), unless there are more
    unknowns than equations, then the searches of `searches.py`.
    """
    equations, unknowns = problem.count
    if unknowns <= equations:
        yield SearchEnd(problem.newton(guess), 0)
    from trim.point import searches

    others = searches.of_least_effort if unknowns > equations else searches.in_balance
    yield from others(problem, guess)
