"""Variables of a trim with their limits, margins, and the nearest limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import beside_unit, short_number, shown_value
from hfa_support.units import conversion_factor
from trim.point.margins import Margin
from trim.reports.performance import lacks_coefficient
from trim.reports.trimmed import Trimmed

#: Number of nearest limits whose margins are named in data, in addition to those that bind.
_NEAREST = 3
#: Verdict on a free variable at its limit.
_BINDS = "BINDS"
#: Note on the star beside a limit.
ASSUMED = "* assumed: no data of the aircraft state this limit"


def variable_rows(trimmed: Trimmed) -> list[Row]:
    """Return the states, relevant outputs and inputs with their status and limits."""
    rows = []
    for name, margin in trimmed.point.margins.items():
        role = "imposed" if margin.role == "held" else margin.role
        limits = _limits_text(margin, name in trimmed.model.inputs)
        note = f"{role}, {limits}" if limits else role
        rows.append(Row(name, margin.value, margin.unit, note, digits=6))
    return rows


def _limits_text(margin: Margin, is_input: bool) -> str:
    """Return the limits of a variable as text, "" without limits: with the used share of an input,
    "±25, 12 % used", or the margin of another variable, "0* to 60*, margin 5" (* assumed).
    """
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
    inputs, margins = trimmed.model.inputs, trimmed.point.margins
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
    if "speed" not in trimmed.roles or not trimmed.point.ok or lacks_coefficient(trimmed):
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
    """Return the key that sorts limits: those reached, then declared ones, then those of variables
    with two limits, then the nearest.
    """
    has_one_limit = math.isinf(margin.highest - margin.lowest)
    share = margin.share
    if margin.assumed and not is_input and margin.nearer == "lowest" and margin.lowest >= 0.0:
        # Assumed limits of a positive state may be decades apart: its distance is compared with
        # its value too.
        share = max(share, margin.distance / max(abs(margin.value), margin.scale))
    return not margin.at_limit, margin.assumed, has_one_limit, share


def limit_rows(limited: Sequence[Margin]) -> list[Row]:
    """Return a row for the nearest declared and the nearest assumed limit, and one for the margin
    of each variable.

    limited: the variables, the nearest limit first (`nearest_first`)
    """
    rows = []
    for kind, is_assumed in (("declared", False), ("assumed", True)):
        of_kind = [margin for margin in limited if margin.assumed == is_assumed]
        if of_kind:
            nearest = of_kind[0]
            note = _verdict(nearest) or _distance_text(nearest)
            rows.append(Row(f"nearest {kind} limit", _limit_text(nearest), note=note))
    for margin in limited:
        verdict = _verdict(margin)
        tone = "far" if verdict == _BINDS else ""
        assumed = "assumed" if margin.assumed else ""
        note = ", ".join(filter(None, (verdict, _limit_text(margin), assumed)))
        name = f"{margin.name} margin"
        rows.append(Row(name, margin.distance, margin.unit, note, tone=tone, rare=not verdict))
    return rows


def _verdict(margin: Margin) -> str:
    """Return that a variable is at its limit, as held or as found by the trim, or ""."""
    if not margin.at_limit:
        return ""
    return "held there" if margin.role == "held" else _BINDS


def _limit_text(margin: Margin) -> str:
    """Return the nearer limit as text: "thrust lowest 0 N"."""
    is_other = margin.highest_is and margin.nearer == "highest"
    limit = margin.highest_is if is_other else f"{margin.name} {margin.nearer}"
    return beside_unit(f"{limit} {short_number(margin.nearer_limit, margin.unit, 6)}", margin.unit)


def _distance_text(margin: Margin) -> str:
    """Return the distance to the nearer limit as text: "margin 18.85 N, 31.4 % of its range"."""
    distance = beside_unit(short_number(margin.distance, margin.unit), margin.unit)
    is_ranged = math.isfinite(margin.highest - margin.lowest)
    share = f", {100 * margin.share:.1f} % of its range" if is_ranged else ""
    return f"margin {distance}{share}"


def named_nearest(limited: Sequence[Margin]) -> list[Margin]:
    """Return the margins of the `_NEAREST` nearest limits, and of all limits that are reached."""
    return [margin for index, margin in enumerate(limited) if index < _NEAREST or margin.at_limit]
