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


def failure(problem: TrimProblem, found: np.ndarray) -> str:
    """Return the reason why a condition has no trim, as one line of text.

    - If all equations balance within the limits of the unknowns, the line names the states and
      outputs beyond their limits, or says that the search for the least effort failed.
    - Otherwise the line names the two equations with the largest residuals and the number of other
      equations that do not balance, the active limits, and free variables without an independent
      effect.

    problem: the trim problem
    found: the best unknowns found, (k,), possibly beyond their limits
    """
    z = problem.clip(found)
    off = _imbalances(problem, z)
    if not off:
        broken = problem.system.watched.broken(problem.at(z).y)
        if not broken:
            return "the equations balance, but the search for the least effort does not converge"
        return f"no trim within limits: {'; '.join(broken)}"
    only_rates = all(row.is_rate for row in problem.system.equations.rows)
    kind = "rates" if only_rates else "equations"
    more = f" and {len(off) - 2} more" if len(off) > 2 else ""
    causes = "; ".join(_causes(problem, found))
    return f"no trim: these {kind} do not balance: {', '.join(off[:2])}{more} ({causes})"


def _causes(problem: TrimProblem, found: np.ndarray) -> Iterator[str]:
    """Yield the active limits, and the free variables that are too few or without an effect."""
    balances_beyond_limits = problem.balanced(found)
    binding = binding_limits(problem, found)
    yield f"active limits: {'; '.join(binding.values())}" if binding else "no limit is active"
    equations, unknowns = problem.count
    effects = problem.balanced_effects(problem.clip(found)).matrix
    idle = _without_effect(problem, effects)
    if equations > unknowns + len(idle) and not balances_beyond_limits:
        yield f"{equations} equations for {unknowns} unknowns; free more variables"
    if idle:
        yield f"no effect of {' and '.join(idle)}; free another variable"
    elif not balances_beyond_limits and (alike := _alike(problem, effects)):
        yield f"{'; '.join(alike)}; free another variable"


def beyond_limits(model: Model, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """Return the reason why a condition that balances only beyond the limits has no trim, as one
    line.

    balancing: free variable -> value for which the equations balance
    """
    problem = TrimProblem(model, condition)
    return failure(problem, problem.unknowns(balancing))


def _imbalances(problem: TrimProblem, z: np.ndarray) -> list[str]:
    """Return a text for each equation that does not balance, the largest first."""
    # Equations with a residual much smaller than the largest are omitted.
    # z (k,)
    model = problem.model
    scaled = problem.at(z).residual.tolist()
    by_size = sorted(
        zip(problem.system.equations.rows, scaled, strict=True), key=lambda pair: -abs(pair[1])
    )
    least = max(BALANCE, MINOR * max(map(abs, scaled)))
    words = []
    for row, residual in by_size:
        if abs(residual) > least:
            unit = model.rate_unit(row.name) if row.is_rate else model.unit(row.name)
            word = f"{row.name} by {residual * row.scale:.3g} {unit}"
            words.append(word.removesuffix(" 1"))
    return words


def _without_effect(problem: TrimProblem, effects: np.ndarray) -> list[str]:
    """Return the names of the free variables that affect no equation.

    effects: Jacobian in balanced units, (m, k)
    """
    affects = np.any(effects, axis=0).tolist()
    return [
        *problem.idle,
        *(name for name, some in zip(problem.free, affects, strict=True) if not some),
    ]


def _alike(problem: TrimProblem, effects: np.ndarray) -> list[str]:
    """Return a sentence for each free variable without an effect of its own on the equations.

    effects: Jacobian in balanced units, (m, k), without columns of zeros
    """
    # The column of such a variable is a linear combination of the columns of the free variables
    # before it. The list is empty if the Jacobian has full row rank.
    sentences: list[str] = []
    kept: list[int] = []
    for column, name in enumerate(problem.free):
        before = effects[:, kept]
        shares = np.linalg.lstsq(before, effects[:, column])[0]
        remainder = np.linalg.norm(effects[:, column] - before @ shares)
        if remainder > DEPENDENT:
            kept.append(column)
            continue
        significant = np.flatnonzero(np.abs(shares) > DEPENDENT)
        others = [problem.free[kept[i]] for i in significant]
        sentences.append(f"{name} has no effect independent of {' and '.join(others)}")
    if len(kept) == problem.count.equations:
        return []
    return sentences


def binding_limits(problem: TrimProblem, found: np.ndarray) -> dict[str, str]:
    """Return a sentence for each free variable at a limit, name -> sentence.

    If the equations balance only beyond this limit, the sentence contains the value that balance
    requires.

    found: the best unknowns found, (k,), possibly beyond their limits
    """
    z = problem.clip(found)
    wanted = found if problem.balanced(found) else z
    limits = problem.system.limits
    describe = problem.model.describe
    values = z * problem.system.scales
    needed = wanted * problem.system.scales
    low = limits.at_lowest(values)
    high = limits.at_highest(values)
    beyond = ~limits.within(needed)
    sentences = {}
    for i, name in enumerate(problem.free):
        if not (low[i] or high[i]):
            continue
        word, limit = ("minimum", limits.lowest[i]) if low[i] else ("maximum", limits.highest[i])
        sentence = f"{name} at {word} {describe(name, limit)}"
        if beyond[i]:
            sentence += f", {describe(name, needed[i])} required"
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
    equations, unknowns = TrimProblem(model, condition.resolved(model)).count
    if equations > unknowns and not condition.imposed.keys().isdisjoint(model.inputs):
        return ""

    def solve(hold: Mapping[str, float], free: tuple[str, ...]) -> Mapping[str, float] | None:
        held = {name: value for name, value in hold.items() if name in model.holdable}
        try:
            changed = release(condition.resolved(model), hold=held, free=free)
            problem = TrimProblem(model, changed)
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
