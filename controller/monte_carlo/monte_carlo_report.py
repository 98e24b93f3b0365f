"""What a Monte Carlo says in short; the members are in the store."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.support.store import Store
from hfa_model.support.text import columns
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES

SCHEMA = "hfa.monte-carlo-summary/1"
#: Shares of the members that held, up to which a quantity stays below its quantile.
QUANTILES = (0.05, 0.5, 0.95, 1.0)
_SHOWN = (("rms_error", LINEAR_STATES), ("peak_error", LINEAR_STATES), ("effort", INPUTS))


def monte_carlo_data(plan: MonteCarlo, store: Store) -> dict[str, Any]:
    """Members that held and that left, quantiles over those that held, and the errors that were drawn.

    English units and radians; an entry is None where no member counts.
    """
    left, flown = store.read("left"), store.read("flown")
    held = left < 0
    return {
        "schema": SCHEMA,
        "dynamics": plan.dynamics,
        "plant": plan.plant,
        "law": plan.law.name,
        "members": plan.members,
        "seed": plan.seed,
        "duration": plan.course.duration,
        "held": int(held.sum()),
        "left": {name: int((left == index).sum()) for index, name in enumerate(STATES)},
        "first_left": None if held.all() else float(flown[~held].min()),
        "quantiles": list(QUANTILES),
        **{name: _quantiles(store.read(name)[held], of) for name, of in _SHOWN},
        "errors": _drawn(plan, store.read("factors")),
    }


def _quantiles(values: np.ndarray, names: tuple[str, ...]) -> dict[str, list[float] | None]:
    if not len(values):
        return dict.fromkeys(names)
    return dict(zip(names, np.quantile(values, QUANTILES, axis=0).T.tolist(), strict=True))


def _drawn(plan: MonteCarlo, factors: np.ndarray) -> dict[str, dict[str, float | None]]:
    """Parameter -> its relative standard deviation as asked for, and mean and deviation as drawn."""
    return {
        name: {
            "asked": asked,
            "mean": float(factors[:, index].mean()),
            "deviation": float(factors[:, index].std(ddof=1)) if plan.members > 1 else None,
        }
        for index, (name, asked) in enumerate(plan.uncertainty.errors.items())
    }


def monte_carlo_text(data: dict[str, Any], where: str) -> str:
    """The same for a person; degrees for angles."""
    lines = [
        f"Monte Carlo, {data['dynamics']} dynamics, {data['plant']} aircraft, law {data['law']}: "
        f"{data['members']} members of {data['duration']:g} s, seed {data['seed']}, {where}",
        "",
        f"held their envelope: {data['held']} of {data['members']}",
    ]
    gone = ", ".join(f"{name} {count}" for name, count in data["left"].items() if count)
    if gone:
        lines.append(f"left it, by the state that left first: {gone}; the first after {data['first_left']:.3g} s")
    if data["held"]:
        lines += ["", _quantile_table(data)]
    if data["errors"]:
        rows = [
            (name, *("-" if value is None else f"{value:.4g}" for value in drawn.values()))
            for name, drawn in data["errors"].items()
        ]
        lines += ["", columns(("parameter", "relative deviation", "drawn mean", "drawn deviation"), rows)]
    return "\n".join(lines)


def _quantile_table(data: dict[str, Any]) -> str:
    rows = []
    for quantity, names in _SHOWN:
        for name in names:
            unit = str((STATE_UNITS._asdict() | INPUT_UNITS._asdict())[name])
            scale = math.degrees(1.0) if unit.startswith("rad") else 1.0
            label = f"{quantity.replace('_', ' ')} {name}"
            rows.append((label, *(f"{scale * value:.4g}" for value in data[quantity][name]), _shown_unit(unit)))
    shares = ["largest" if share == 1.0 else f"{100 * share:g} %" for share in QUANTILES]
    return columns(("of those that held", *shares, "unit"), rows)


def _shown_unit(unit: str) -> str:
    return unit.replace("rad", "deg")
