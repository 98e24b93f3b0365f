"""Explanations by a model of why a trim does not exist."""

from __future__ import annotations

from collections.abc import Mapping

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from trim.point.condition import TrimCondition, release
from trim.point.problem import TrimProblem


def explanation(model: Model, condition: TrimCondition) -> str:
    """Return the model's explanation of why a condition has no trim, or "" if it has none.

    The model's function `explain` may trim a changed condition, by Newton's method from the default
    initial point.
    """
    if model.extras.explain is None:
        return ""

    def solve(hold: Mapping[str, float], free: tuple[str, ...]) -> Mapping[str, float] | None:
        held = {name: value for name, value in hold.items() if name in model.holdable}
        try:
            changed = release(condition.resolved(), hold=held, free=free)
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

    return model.extras.explain(condition.imposed, solve)
