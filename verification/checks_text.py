"""Checks as a table for a person."""

from __future__ import annotations

from collections.abc import Iterable

from trim.text import columns
from verification.checks import Check


def checks_text(checks: Iterable[Check]) -> str:
    """One row a check, then the reason of each that failed."""
    found = tuple(checks)
    rows = [(check.name, f"{check.value:.3g}", f"{check.limit:.3g}", "pass" if check.ok else "FAIL") for check in found]
    reasons = [f"FAIL {check.name}: {check.reason}" for check in found if not check.ok]
    return "\n".join([columns(("check", "value", "limit", "verdict"), rows), *reasons])
