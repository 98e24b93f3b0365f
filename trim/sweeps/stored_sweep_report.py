"""What a stored sweep says in short; the numbers are in the store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hfa_model.support.store import Store
from hfa_model.support.text import columns
from trim.sweeps.stored_sweep import status_counts
from trim.sweeps.sweep_plan import SweepPlan
from trim.sweeps.sweep_report import plan_warnings

SCHEMA = "hfa.sweep-summary/1"


def store_data(plan: SweepPlan, store: Store, path: Path) -> dict[str, Any]:
    """Points by status, and where they are."""
    return {
        "schema": SCHEMA,
        "store": str(path),
        "dynamics": plan.dynamics,
        "variables": list(plan.variables),
        "variable_units": list(plan.units),
        "points": plan.count,
        "counts": status_counts(store, plan.count),
        "warnings": plan_warnings(plan),
    }


def store_text(data: dict[str, Any]) -> str:
    """The same for a person."""
    varied = ", ".join(data["variables"])
    rows = [(status, str(count)) for status, count in data["counts"].items()]
    return f"Sweep over {varied}, {data['dynamics']} dynamics, in {data['store']}\n\n" + columns(
        ("status", "points"), rows
    )
