"""Search for an operating point: Newton's method from the default initial point, then other
searches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.reporting.results import Result
from trim.point import searches
from trim.point.condition import (
    OTHER_UNITS,
    TrimCondition,
    freed_parameters,
    release,
    usual_condition,
)
from trim.point.freed import with_found_parameters, with_parameters_as_inputs
from trim.point.operating_point import OperatingPoint
from trim.point.problem import TrimProblem, keepable, undetermined
from trim.point.status import BALANCE, Status

#: Residuals, and differences of two trims, below this fraction of the largest are not named.
MINOR = 1e-3


def failure(problem: TrimProblem, nearest: np.ndarray) -> str:
    """Return the reason why a condition has no trim, as one line of text.

    - If all equations balance within the limits of the unknowns, the line names the states and
      outputs beyond their limits, or says that the search for the least effort failed.
    - Otherwise the line names the two equations with the largest residuals and the number of other
      equations that do not balance, the active limits, and free variables without an independent
      effect.

    problem: the trim problem
    nearest: the best scaled unknowns found, (k,), possibly beyond their limits
    """
    z = problem.clip(nearest)
    imbalances = _imbalances(OperatingPoint._of(problem, z, Status.FAILED))
    if not imbalances:
        broken = problem.system.watched.broken(problem.at(z).y)
        if not broken:
            return "the equations balance, but the search for the least effort does not converge"
        return f"no trim within limits: {'; '.join(broken)}"
    only_rates = all(row.is_rate for row in problem.system.equations.rows)
    kind = "rates" if only_rates else "equations"
    largest = ", ".join(imbalances[:2])
    more = f" and {len(imbalances) - 2} more" if len(imbalances) > 2 else ""
    causes = "; ".join(_causes(problem, nearest))
    return f"no trim: these {kind} do not balance: {largest}{more} ({causes})"


def _causes(problem: TrimProblem, nearest: np.ndarray) -> Iterator[str]:
    """Yield the active limits, and the free variables that are too few or without an effect."""
    balances_beyond_limits = problem.balanced(nearest)
    binding = binding_limits(problem, nearest)
    yield f"active limits: {'; '.join(binding)}" if binding else "no limit is active"
    equations, unknowns = problem.count
    effects = problem.balanced_effects(problem.clip(nearest)).matrix
    without = np.flatnonzero(~np.any(effects, axis=0))
    idle = [*problem.idle, *(problem.free[column] for column in without)]
    if equations > unknowns + len(idle) and not balances_beyond_limits:
        yield f"{equations} equations for {unknowns} unknowns; free more variables"
    if idle:
        yield f"no effect of {' and '.join(idle)}; free another variable"


def _imbalances(point: OperatingPoint) -> list[str]:
    """Return texts such as "speed by -0.3 ft/s^2" on imbalances above `MINOR`, largest first."""
    sizes = {name: abs(residual) for name, residual in point.scaled_residuals.items()}
    least = max(BALANCE, MINOR * point.residual)
    texts = []
    for name in sorted(sizes, key=lambda name: -sizes[name]):
        if sizes[name] > least:
            text = f"{name} by {point.residuals[name]:.3g} {point.equation_unit(name)}"
            texts.append(text.removesuffix(" 1"))  # without a unit
    return texts


def binding_limits(problem: TrimProblem, nearest: np.ndarray) -> list[str]:
    """Return a sentence for each free variable at a limit.

    If the equations balance only beyond this limit, the sentence contains the value that balance
    requires.

    nearest: the best scaled unknowns found, (k,), possibly beyond their limits
    """
    z = problem.clip(nearest)
    limits = problem.system.limits
    describe = problem.model.describe
    values = z * problem.system.scales
    required = (nearest if problem.balanced(nearest) else z) * problem.system.scales
    at_lowest, at_highest = limits.at_limits(values)
    beyond = ~limits.within(required)
    sentences = []
    for i, name in enumerate(problem.free):
        if at_lowest[i]:
            sentence = f"{name} at minimum {describe(name, limits.lowest[i])}"
        elif at_highest[i]:
            sentence = f"{name} at maximum {describe(name, limits.highest[i])}"
        else:
            continue
        if beyond[i]:
            sentence += f", {describe(name, required[i])} required"
        sentences.append(sentence)
    return sentences


class TrimError(NoSolutionError):
    """Error for a condition that has no trim.

    The message names the equations that do not balance, the active limits, and the values beyond
    the limits that balance would require.

    attempt: best point found within the limits
    required: sentences on the limits beyond which the equations balance, or "" if they do not
        balance beyond any limits
    saturated: input -> limit that prevents the trim; None if the reason is not known
    """

    def __init__(
        self,
        message: str,
        attempt: OperatingPoint,
        required: str = "",
        saturated: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(message)
        self.attempt, self.required, self.saturated = attempt, required, saturated

    def __reduce__(self) -> tuple[Any, ...]:
        return TrimError, (str(self), self.attempt, self.required, self.saturated)


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
      limits, and at `STARTS` other points within the limits. `initial_point` of the result is the
      number of the successful point, or 0 for the first search.

    model: model of the aircraft
    condition: imposed and free variables; by default the trim that the model declares
    start: neighboring point at which the search begins, or some of its values by name; by default
        the declared initial values
    hold: variable, output, parameter, airspeed (kcas) or rate (speed_dot) -> value, a number in the
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
    if bool(condition.model.source.native) != bool(model.source.native):  # one was converted to SI
        raise BadInputError(OTHER_UNITS)
    held = {**(hold or {}), **held}
    if parameters := {name: held.pop(name) for name in [*held] if name in model.parameters}:
        model = model.with_parameters(**parameters)
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
        if model.about.failed():  # a compiled program, whose error has the reason
            raise BadInputError(f"no trim: {error}") from error
        raise BadInputError(f"the equations overflow or divide by zero: {error}") from error


def _trim_of_parameters(
    model: Model, condition: TrimCondition, start: OperatingPoint | Mapping[str, float] | None
) -> OperatingPoint:
    """Return the trim of a condition that sets parameters free, at the parameters that it needs."""
    names = freed_parameters(condition)
    extended = with_parameters_as_inputs(model, names)
    others = tuple(name for name in condition.freed if name not in names)
    try:
        point = trim(extended, replace(condition, model=extended, freed=others), start)
    except TrimError as error:
        attempt = with_found_parameters(error.attempt, model, condition)
        raise TrimError(str(error), attempt, error.required) from error
    return with_found_parameters(point, model, condition)


def _unique_trim(problem: TrimProblem) -> OperatingPoint:
    """Return the trim in which states that no equation determines have their start values."""
    # With more unknowns than equations, a search would minimize the control effort, and move such
    # states: they are kept before any search.
    equations, unknowns = problem.count
    only_inputs = problem.system.only_inputs
    found = solution(problem) if unknowns <= equations or only_inputs else None
    if found is None or not (only_inputs or problem.balanced_effects(found.z).rank == unknowns):
        problem = problem.keeping(_kept_states(problem))
        found = solution(problem)
    return OperatingPoint._of(problem, found.z, Status.TRIMMED, found.initial_point)


def _kept_states(problem: TrimProblem) -> tuple[str, ...]:
    """Return the states that keep their start values, so that the equations determine the trim."""
    # Of the states that no equation determines, the one that moves farthest for its size is kept,
    # until the trim is unique. A state without a trim at its start value is not kept. The result
    # does not depend on where the search begins.
    problem = TrimProblem(problem.model, problem.asked)
    start = problem.clip(problem.system.start)
    examined = [start, problem.newton(start)]  # points at which states may be undetermined
    while examined:
        candidates = _candidates(problem, examined)
        examined = []  # ends the loop if no candidate can be kept
        for name in candidates:
            with suppress(BadInputError, TrimError):
                tried = problem.keeping((*problem.kept, name))
                problem, examined = tried, [solution(tried).z]
                break
    return problem.kept


def _candidates(problem: TrimProblem, points: list[np.ndarray]) -> list[str]:
    """Return the states that a trim may keep, and that the equations do not determine at a point.

    It is the first of the points (k,) at which there are any. The state that can move farthest for
    its size comes first (`undetermined`).
    """
    may_be_kept = keepable(problem.system, problem.asked)
    for z in points:
        with suppress(BadInputError, ArithmeticError):
            names = undetermined(problem, z).names
            if candidates := [name for name in names if name in may_be_kept]:
                return candidates
    return []


class SearchEnd(NamedTuple):
    """End of one search for a trim.

    z: scaled unknowns, (k,), which need not be a trim
    initial_point: number of the initial point of the search, 0 for the default one
    """

    z: np.ndarray
    initial_point: int


def solution(problem: TrimProblem) -> SearchEnd:
    """Return the first trim that the searches find.

    A trim in which an angle without limits exceeds 90 deg is returned only if no other is found.

    Raises TrimError if no trim is found.
    """
    guess = problem.clip(problem.system.start)
    if not problem.free:  # nothing is free, and the point is an equilibrium
        return SearchEnd(guess, 0)
    equations, unknowns = problem.count
    if unknowns > equations:
        ends = searches.of_least_effort(problem, guess)
    else:
        ends = chain([(problem.newton(guess), 0)], searches.after_newton(problem, guess))
    # `nearest`: where the last search ends that balances the equations beyond limits, or without
    # one, where the last search from the default initial point (number 0) ends
    nearest = guess
    number = 0
    far_out = None  # the first trim with an angle beyond 90 deg
    quarter_turn = problem.system.quarter_turn
    for z, number in ends:
        if problem.solved(z):
            if (np.abs(z) <= quarter_turn).all():
                return SearchEnd(z, number)
            far_out = far_out or SearchEnd(z, number)
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
    """Return the error of a condition that has no trim.

    nearest: the best scaled unknowns found, (k,), possibly beyond their limits
    others: number of other initial points from which the search failed
    """
    message = failure(problem, nearest)
    beyond_limits = ""  # `TrimError.required`
    if problem.balanced(nearest):
        beyond_limits = "; ".join(binding_limits(problem, nearest))
    if others:
        message += f"; {others} other initial points failed too"
    attempt = OperatingPoint._of(problem, problem.clip(nearest), Status.FAILED)
    return TrimError(message, attempt, beyond_limits)


@dataclass(frozen=True, eq=False)
class CommandedTrim(Result):
    """Trim at commanded values, found beyond the limits of the free variables if necessary.

    command: state -> commanded deviation from the trim
    needed: free variable -> value at which the equations balance; empty if none was found
    beyond: free variable outside its limits -> the limit that it exceeds, the largest for its
        nominal value first
    model: model of the aircraft
    reason: why no values were found, or ""
    unheld: commanded state that is no variable of a trim, or None
    """

    command: Mapping[str, float]
    needed: Mapping[str, float]
    beyond: Mapping[str, float]
    model: Model
    reason: str = ""
    unheld: str | None = None

    @property
    def is_reachable(self) -> bool | None:
        """Whether the aircraft has a trim at the command, within all limits; None if unknown."""
        return None if self.unheld else not (self.beyond or self.reason)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {name: value for name, value in super()._entries().items() if name != "model"}


def commanded_trim(point: OperatingPoint, command: Mapping[str, float]) -> CommandedTrim:
    """Return the trim in which some states are held away from their trim values.

    The other conditions are those of the trim. The free variables have no limits in this search, so
    that what the command would need is found.

    point: the trim; its problem is known
    command: state -> deviation from the trim, in the units of the model
    """
    for name in command:
        if name not in (*point.model.holdable, *point.model.replaced):
            # without values `needed` and `beyond`
            return CommandedTrim(command, {}, {}, point.model, unheld=name)
    try:
        found = _trim_without_limits(point, command)
    except (TrimError, BadInputError) as error:
        return CommandedTrim(command, {}, {}, point.model, reason=str(error))
    needed = {name: found[name] for name in found.trim_problem.asked.free}
    beyond = {}
    for name in sorted(
        needed, key=lambda name: -abs(needed[name]) / point.model.signal(name).nominal
    ):
        value = needed[name]
        lowest, highest = point.trim_problem.asked.limits_of(name)
        if not lowest <= value <= highest:
            beyond[name] = lowest if value < lowest else highest
    return CommandedTrim(command, needed, beyond, point.model)


def _trim_without_limits(point: OperatingPoint, command: Mapping[str, float]) -> OperatingPoint:
    """Return the trim at a command, whose free variables may exceed their limits."""
    model, condition = point.model, point.trim_problem.asked
    if replaced := {state: name for state, name in model.replaced.items() if state in command}:
        # Such as gamma in place of the pitch: the commanded state is a variable again.
        others = {state: name for state, name in model.replaced.items() if state not in command}
        model = replace(model, replaced=others)
        condition = release(replace(condition, model=model), free=[*replaced.values()])
    held = {name: point[name] + deviation for name, deviation in command.items()}
    condition = release(condition, hold=held)
    limits = dict.fromkeys(condition.free, (-math.inf, math.inf))
    return trim(model, release(condition, limits=limits), point)
