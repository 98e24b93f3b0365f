"""Reports of searches: what they proved, and why they did not prove more."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_aircraft.march.ending import Outcome
from hfa_prove.report import found_report
from hfa_prove.search.obstacles import NOT_RETURNED
from hfa_prove.search.region_search import Region
from hfa_prove.words import at_least, place_in_words
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table

#: Row of the table of obstacles.
_RISE = "V' >= 0 found"


def region_report(region: Region, policy: str = "") -> Report:
    """Return the report of a proved set, and of the obstacles to a larger set.

    policy: description of the policy, or ""
    """
    assert region.obstacles is not None  # of a search
    binding = region.obstacles.limits
    lines = [
        f"Limits that bind: {', '.join(binding) or 'none'}. Origin of V: {region.origin}. Degree: "
        f"{region.statement.degree}. Proved on {region.size} boxes."
    ]
    if policy:
        lines.insert(0, f"Policy: {policy}.")
    if region.stopped:
        lines.append(f"No larger set is proved: {region.stopped}.")
    starts = region.obstacles.starts
    data = {
        "origin": region.origin,
        "decrease_fails_at": _place(region, region.obstacles.rises),
        "leaves_limits_at": _place(region, starts.get(Outcome.LEFT)),
        "lost_at": _place(region, starts.get(Outcome.DIVERGED)),
        "limits_that_bind": list(binding),
        "stopped": region.stopped,
    }
    parts: tuple[Part, ...] = (_obstacles(region), "\n".join(lines))
    return found_report(region.statement, region.size, *parts, data=data)


def _obstacles(region: Region) -> Table:
    """Return a table of the lowest levels of V at which a larger set meets an obstacle."""
    assert region.obstacles is not None  # of a search
    rho = region.statement.rho
    rows = [("proved", at_least(rho, 6), "1", "")]
    nowhere = (np.inf, None)
    starts = region.obstacles.starts
    for name, (level, place) in (
        (_RISE, region.obstacles.rises),
        *((words, starts.get(kind, nowhere)) for kind, words in NOT_RETURNED.items()),
    ):
        if place is None:
            is_open = name != _RISE and not region.obstacles.simulated
            rows.append((name, "not simulated in the time" if is_open else "none found", "", ""))
            continue
        where = place_in_words(region.statement.loop, place)
        rows.append((name, f"{level:.6g}", f"{np.sqrt(level / rho):.3g}", where))
    return Table(("level", "V", "linearly", "at"), rows)


def _place(region: Region, found: tuple[float, np.ndarray | None] | None) -> dict[str, Any] | None:
    """Return the level of V at an obstacle and the state deviation there, or None."""
    if found is None or found[1] is None:
        return None
    level, place = found
    assert place is not None  # as found above
    return {"V": level, "z": dict(zip(region.statement.loop.states, place.tolist(), strict=True))}
