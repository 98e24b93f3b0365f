"""Suggested options where a trim does not exist."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_aircraft.model import Model
from hfa_support.errors import NoSolutionError
from trim.point.condition import TrimCondition, release
from trim.point.reasons import explained
from trim.point.solve import TrimError, find_operating_point

if TYPE_CHECKING:
    from hfa.options.trims import TrimOptions


def advised(
    failure: TrimError, request: TrimOptions, aircraft: Model, condition: TrimCondition
) -> TrimError:
    """Return the error with the options to type where a held angle of attack prevents the trim."""
    error = explained(failure, aircraft, condition)
    if "alpha" not in condition.imposed:
        return error
    freed = release(condition, free=("alpha",))
    try:
        free_point = find_operating_point(aircraft, freed, request.start_point)
    except NoSolutionError:
        return error
    describe = request.model.describe
    held = describe("alpha", condition.imposed["alpha"])
    trimmed = describe("alpha", free_point.states.alpha)
    advice = "add --free alpha"
    if "alpha" in request.hold:
        advice = f"leave --hold alpha out and {advice}"
    return TrimError(
        f"{error}; alpha is held at {held}; with alpha free the trim is at {trimmed}: {advice}",
        error.attempt,
    )
