"""Report of a search for a region: what is proved, and why no larger set."""

from __future__ import annotations

from hfa_prove.report import found_report
from hfa_prove.search.region_search import Region
from hfa_support.reporting.report import Report


def region_report(region: Region, policy: str = "") -> Report:
    """Return the report of a proved set.

    policy: description of the policy, or ""
    """
    lines = [
        f"Origin of V: {region.origin}. Degree: {region.statement.degree}. Proved on {region.size} "
        "boxes."
    ]
    if policy:
        lines.insert(0, f"Policy: {policy}.")
    if region.stopped:
        lines.append(f"No larger set is proved: {region.stopped}.")
    data = {"origin": region.origin, "stopped": region.stopped}
    return found_report(region.statement, region.size, "\n".join(lines), data=data)
