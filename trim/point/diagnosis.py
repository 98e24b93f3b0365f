"""Reasons why a trim condition has no trim, as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from trim.point.condition import TrimCondition, release
from trim.point.problem import DEPENDENT, TrimProblem
from trim.point.status import BALANCE

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
    imbalances = _imbalances(problem, z)
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
    """Yield the active limits, and the free variables that are too few or without an effect.

    nearest: the best scaled unknowns found, (k,), possibly beyond their limits
    """
    balances_beyond_limits = problem.balanced(nearest)
    binding = binding_limits(problem, nearest)
    yield f"active limits: {'; '.join(binding.values())}" if binding else "no limit is active"
    equations, unknowns = problem.count
    effects = problem.balanced_effects(problem.clip(nearest)).matrix
    idle = _without_effect(problem, effects)
    if equations > unknowns + len(idle) and not balances_beyond_limits:
        yield f"{equations} equations for {unknowns} unknowns; free more variables"
    if idle:
        yield f"no effect of {' and '.join(idle)}; free another variable"
    elif not balances_beyond_limits and (dependent := _dependent_effects(problem, effects)):
        yield f"{'; '.join(dependent)}; free another variable"


def beyond_limits(model: Model, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """Return the reason why a condition that balances only beyond the limits has no trim, as one
    line.

    balancing: free variable -> value for which the equations balance
    """
    problem = TrimProblem(model, condition)
    return failure(problem, problem.unknowns(balancing))


def _imbalances(problem: TrimProblem, z: np.ndarray) -> list[str]:
    """Return a text such as "speed by -0.3 ft/s^2" for each equation that does not balance, the
    largest first. Residuals below `MINOR` of the largest are omitted.

    z: scaled unknowns, (k,)
    """
    model, rows = problem.model, problem.system.equations.rows
    residuals = problem.at(z).residual
    sizes = np.abs(residuals)
    least = max(BALANCE, MINOR * sizes.max())
    texts = []
    for place in np.argsort(-sizes, kind="stable").tolist():
        if sizes[place] > least:
            row = rows[place]
            unit = model.rate_unit(row.name) if row.is_rate else model.unit(row.name)
            text = f"{row.name} by {residuals[place] * row.scale:.3g} {unit}"
            texts.append(text.removesuffix(" 1"))
    return texts


def _without_effect(problem: TrimProblem, effects: np.ndarray) -> list[str]:
    """Return the names of the free variables that affect no equation.

    effects: Jacobian in balanced units, (m, k)
    """
    affected = np.any(effects, axis=0)
    without = [problem.free[column] for column in np.flatnonzero(~affected)]
    return [*problem.idle, *without]


def _dependent_effects(problem: TrimProblem, effects: np.ndarray) -> list[str]:
    """Return a sentence for each free variable whose column of effects is a linear combination of
    the columns of those before it; none if the Jacobian has full row rank.

    effects: Jacobian in balanced units, (m, k), without columns of zeros
    """
    sentences: list[str] = []
    independent: list[int] = []  # columns
    for column, name in enumerate(problem.free):
        before = effects[:, independent]
        shares = np.linalg.lstsq(before, effects[:, column])[0]
        remainder = np.linalg.norm(effects[:, column] - before @ shares)
        if remainder > DEPENDENT:
            independent.append(column)
            continue
        significant = np.flatnonzero(np.abs(shares) > DEPENDENT)
        others = [problem.free[independent[i]] for i in significant]
        sentences.append(f"{name} has no effect independent of {' and '.join(others)}")
    has_full_row_rank = len(independent) == problem.count.equations
    return [] if has_full_row_rank else sentences


def binding_limits(problem: TrimProblem, nearest: np.ndarray) -> dict[str, str]:
    """Return a sentence for each free variable at a limit, name -> sentence.

    If the equations balance only beyond this limit, the sentence contains the value that balance
    requires.

    nearest: the best scaled unknowns found, (k,), possibly beyond their limits
    """
    z = problem.clip(nearest)
    limits = problem.system.limits
    describe = problem.model.describe
    values = z * problem.system.scales
    required = (nearest if problem.balanced(nearest) else z) * problem.system.scales
    at_lowest = limits.at_lowest(values)
    at_highest = limits.at_highest(values)
    beyond = ~limits.within(required)
    sentences = {}
    for i, name in enumerate(problem.free):
        if at_lowest[i]:
            sentence = f"{name} at minimum {describe(name, limits.lowest[i])}"
        elif at_highest[i]:
            sentence = f"{name} at maximum {describe(name, limits.highest[i])}"
        else:
            continue
        if beyond[i]:
            sentence += f", {describe(name, required[i])} required"
        sentences[name] = sentence
    return sentences


def explanation(model: Model, condition: TrimCondition) -> str:
    """Return the model's explanation of why a condition has no trim, or "" if it has none, or if
    held inputs leave fewer unknowns than equations.

    The model's function `explain` may trim a changed condition, by Newton's method from the default
    initial point.
    """
    if model.trimming.explain is None:
        return ""
    posed = TrimProblem(model, condition)
    equations, unknowns = posed.count
    held = condition.imposed.keys() - model.trim.keys()
    if equations > unknowns and not held.isdisjoint(model.inputs):
        return ""

    def solve(hold: Mapping[str, float], free: tuple[str, ...]) -> Mapping[str, float] | None:
        """Return name -> value at the trim of the changed condition, or None if none is found."""
        held = {name: value for name, value in hold.items() if name in model.holdable}
        try:
            changed = release(posed.condition, hold=held, free=free)
            problem = TrimProblem(posed.model, changed)
            z = problem.newton(problem.clip(problem.system.start))
            if not problem.solved(z):
                return None
            evaluation = problem.at(z)
        except (BadInputError, ArithmeticError):
            return None
        x, u = evaluation.x, evaluation.u
        rates = model.rates_at(x, u)
        return {
            **x._asdict(),
            **u._asdict(),
            **model.outputs_at(x, u),
            **{f"{name}_dot": rate for name, rate in rates.items()},
        }

    return model.trimming.explain(condition.imposed, solve)
