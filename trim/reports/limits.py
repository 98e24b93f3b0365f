"""Variables of a trim with their limits, margins, and the nearest limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import beside_unit, short_number, shown_value
from hfa_support.units import conversion_factor
from trim.point.margins import Margin
from trim.reports.performance import no_force
from trim.reports.trimmed import Trimmed

#: Number of nearest limits whose margins are named in data, in addition to those that bind.
_NEAREST = 3
#: Note on the star beside a limit.
ASSUMED = "* assumed: no data of the aircraft state this limit"


def variable_rows(trimmed: Trimmed) -> list[Row]:
    """Return the states, relevant outputs and inputs with their status and limits."""
    rows = []
    for name, margin in trimmed.given.margins.items():
        role = "imposed" if margin.role == "held" else margin.role
        note = ", ".join(filter(None, (role, _limits_text(margin, name in trimmed.model.inputs))))
        rows.append(Row(name, margin.value, margin.unit, note, digits=6))
    return rows


def _limits_text(margin: Margin, is_input: bool) -> str:
    """Return limits and the used share or the margin as text: "±25, 12 % used"."""
    star = "*" * margin.assumed
    low, high = (
        f"{shown_value(end, margin.unit)}{star}" for end in (margin.lowest, margin.highest)
    )
    if not margin.nearer:
        return ""
    if math.isinf(margin.lowest):
        limits = f"up to {high}"
    elif math.isinf(margin.highest):
        limits = f"from {low}"
    elif margin.lowest == -margin.highest:
        limits = f"±{high}"
    else:
        limits = f"{low} to {high}"
    if is_input:
        return limits if math.isnan(margin.used) else f"{limits}, {100 * margin.used:.1f} % used"
    return f"{limits}, margin {short_number(margin.distance, margin.unit)}"


def nearest_first(trimmed: Trimmed) -> list[Margin]:
    """Return the variables whose limits matter, the nearest limit first.

    These are free variables and held inputs. Those at their limit come first, then declared limits,
    then assumed ones. The angle of attack is also limited by that of the largest lift.
    """
    inputs, margins = trimmed.model.inputs, trimmed.given.margins
    limited = [
        margin
        for name, margin in margins.items()
        if margin.nearer and (margin.role != "held" or name in inputs)
    ]
    alpha = margins.get(trimmed.roles.get("alpha", ""))
    if alpha is not None and (stalling := _limit_of_the_largest_lift(trimmed, alpha)):
        limited = [each for each in limited if each.name != alpha.name] + [stalling]
    return sorted(limited, key=lambda margin: _rank(margin, margin.name in inputs))


def _limit_of_the_largest_lift(trimmed: Trimmed, alpha: Margin) -> Margin | None:
    """Return the margin of alpha with its value at the largest lift as highest, if it is nearer."""
    if "speed" not in trimmed.roles or not trimmed.given.ok or no_force(trimmed):
        return None
    largest = trimmed.largest_lift
    if largest is None or largest.passed or not math.isfinite(largest.alpha):
        return None
    highest = largest.alpha * (conversion_factor("rad", alpha.unit) or 1.0)
    if highest > alpha.highest:
        return None
    margin = replace(alpha, highest=highest, assumed=False, highest_is="alpha of the largest lift")
    return margin if margin.nearer == "highest" else None


def _rank(margin: Margin, is_input: bool) -> tuple[bool, bool, bool, float]:
    """Return the key that sorts limits: those that bind, then declared ones, then the nearest."""
    # Assumed limits of a positive state may be decades apart: the distance to the lowest is also
    # compared with the value.
    # Variables with only one limit, and thus without a range, come after those with two.
    has_no_range = math.isinf(margin.highest - margin.lowest)
    share = margin.share
    if margin.assumed and not is_input and margin.nearer == "lowest" and margin.lowest >= 0.0:
        share = max(share, margin.distance / max(abs(margin.value), margin.scale))
    return not margin.at_limit, margin.assumed, has_no_range, share


def limit_rows(limited: Sequence[Margin]) -> list[Row]:
    """Return the nearest declared and the nearest assumed limit, and the margins of all variables.

    limited: the variables, the nearest limit first (`nearest_first`)
    """
    rows = []
    for kind, is_assumed in (("declared", False), ("assumed", True)):
        of_kind = [margin for margin in limited if margin.assumed == is_assumed]
        if of_kind:
            rows.append(Row(f"nearest {kind} limit", _end(of_kind[0]), note=_distance(of_kind[0])))
    for margin in limited:
        verdict, tone = "", ""
        if margin.at_limit:
            verdict, tone = ("held there", "") if margin.role == "held" else ("BINDS", "far")
        note = ", ".join(filter(None, (verdict, _end(margin), "assumed" * margin.assumed)))
        name = f"{margin.name} margin"
        rows.append(Row(name, margin.distance, margin.unit, note, tone=tone, rare=not verdict))
    return rows


def _end(margin: Margin) -> str:
    """Return a limit as text: "thrust lowest 0 N"."""
    is_other = margin.highest_is and margin.nearer == "highest"
    limit = margin.highest_is if is_other else f"{margin.name} {margin.nearer}"
    return beside_unit(f"{limit} {short_number(margin.nearer_limit, margin.unit, 6)}", margin.unit)


def _distance(margin: Margin) -> str:
    """Return the distance to the nearer limit as text: "margin 18.85 N, 31.4 % of its range"."""
    if margin.at_limit:
        return "held there" if margin.role == "held" else "BINDS"
    distance = beside_unit(short_number(margin.distance, margin.unit), margin.unit)
    is_ranged = math.isfinite(margin.highest - margin.lowest)
    share = f", {100 * margin.share:.1f} % of its range" if is_ranged else ""
    return f"margin {distance}{share}"


def named_nearest(limited: Sequence[Margin]) -> list[Margin]:
    """Return the nearest limits, and all at which a variable is."""
    return [margin for index, margin in enumerate(limited) if index < _NEAREST or margin.at_limit]
