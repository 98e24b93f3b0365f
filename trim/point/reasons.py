"""Explanations by a model of why a trim does not exist."""

from __future__ import annotations

from collections.abc import Mapping

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from trim.point.condition import TrimCondition, release
from trim.point.operating_point import Status
from trim.point.problem import TrimProblem
from trim.point.solve import TrimError


def explained(error: TrimError, model: Model, condition: TrimCondition) -> TrimError:
    """Return the error of a failed trim with the model's explanation at the beginning of its
    message.

    The model's function `explain` may trim a changed condition, by Newton's method from the default
    initial point. The error is unchanged if the model has no explanation.

    error: error of the trim search
    condition: condition of the failed trim
    """
    if model.extras.explain is None:
        return error

    def solve(hold: Mapping[str, float], free: tuple[str, ...]) -> Mapping[str, float] | None:
        held = {name: value for name, value in hold.items() if name in model.holdable}
        try:
            changed = release(condition.resolved(), hold=held, free=free)
            problem = TrimProblem(model, changed)
            z = problem.newton(problem.clip(problem.system.start))
            if not problem.solved(z):
                return None
            point = problem.point(z, Status.TRIMMED)
        except (BadInputError, ArithmeticError):
            return None
        rates = model.rates_at(point.states, point.inputs)
        return {
            **point.values,
            **model.outputs_at(point.states, point.inputs),
            **{f"{name}_dot": rate for name, rate in rates.items()},
        }

    reason = model.extras.explain(condition.imposed, solve)
    if not reason:
        return error
    details = str(error).removeprefix("no trim: ")
    return TrimError(f"no trim: {reason} ({details})", error.attempt)
