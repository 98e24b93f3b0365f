"""Trims for the assessment or training of a policy."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, is_finite, shown
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim


def trims_of(model: Model, points: Iterable[Any] | None) -> tuple[OperatingPoint, ...]:
    """Return operating points, given or found at values of the scheduling variable.

    Without `points`, the result is the model's default trim.

    Raises BadInputError in these cases:
    - A point belongs to another aircraft.
    - A point is neither an operating point nor a finite number.
    - A number is given for a model without a scheduling variable.
    - `points` is empty.

    Raises TrimError if no trim is found.
    """
    if points is None:
        return (trim(model),)
    found: list[OperatingPoint] = []
    for point in _listed(points):
        if isinstance(point, OperatingPoint):
            point._refuse_other(model)
            found.append(point)
            continue
        if not is_finite(point) or not model.schedule:
            raise BadInputError(
                f"points contains {shown(point)}; give operating points, or values of the "
                "scheduling variable"
            )
        if model.schedule in model.parameters:
            found.append(trim(model.with_parameters(**{model.schedule: float(point)})))
        else:
            found.append(trim(model, at=float(point)))
    if not found:
        raise BadInputError(
            "points is empty; give at least one point, or None for the default trim of the model"
        )
    return tuple(found)


def _listed(points: Any) -> list[Any]:
    """Return one or several points as a list. An object that is not iterable is one point."""
    if isinstance(points, OperatingPoint):
        return [points]
    try:
        return list(points)
    except TypeError:  # NumPy and CasADi raise their own messages
        return [points]
