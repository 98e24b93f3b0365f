"""What a stored sweep says in short; the numbers are in the store."""

from __future__ import annotations

from pathlib import Path

from hfa_model.jobs.store import Store
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table
from trim.sweeps.paper_range import plan_warnings
from trim.sweeps.stored_sweep import status_counts
from trim.sweeps.sweep_plan import SweepPlan

SCHEMA = "hfa.sweep-summary/1"


def stored_sweep_report(plan: SweepPlan, store: Store, path: Path) -> Report:
    """Points by status, and where they are."""
    counts, notes = status_counts(store, plan.count), plan_warnings(plan)
    return Report(
        title=f"Sweep over {', '.join(plan.variables)}, {plan.dynamics} dynamics, in {path}",
        parts=(Table(("status", "points"), [(status, str(count)) for status, count in counts.items()]),),
        notes=notes,
        data={
            "schema": SCHEMA,
            "store": str(path),
            "dynamics": plan.dynamics,
            "variables": list(plan.variables),
            "variable_units": list(plan.units),
            "grid": plan.grid,
            "condition": plan.condition.to_dict(),
            "points": plan.count,
            "counts": counts,
            "warnings": notes,
        },
    )
