"""Advice on options to change if a trim does not exist."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_aircraft.model import Model
from hfa_support.errors import NoSolutionError
from trim.point.condition import TrimCondition, release
from trim.point.solve import TrimError, explained, trim

if TYPE_CHECKING:
    from hfa.options.trims import TrimOptions


def advised(
    failure: TrimError, request: TrimOptions, aircraft: Model, condition: TrimCondition
) -> TrimError:
    """Return the error of a failed trim, with the reason and advice on options added.

    If alpha is held and a trim with free alpha exists, the message also advises --free alpha.

    failure: error of the trim search
    request: the options
    aircraft: the model
    condition: condition of the failed trim
    """
    error = explained(failure, aircraft, condition)
    if "alpha" not in condition.imposed:
        return error
    freed = release(condition, free=("alpha",))
    try:
        free_point = trim(aircraft, freed, request.start_point)
    except NoSolutionError:
        return error
    trimmed = request.model.describe("alpha", free_point.states.alpha)
    is_typed = "alpha" in request.hold
    advice = "replace --hold alpha by --free alpha" if is_typed else "add --free alpha"
    return TrimError(
        f"{error}; with alpha free, the trim is at {trimmed}: {advice}",
        error.attempt,
    )
