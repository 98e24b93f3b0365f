"""The report of `hfa solve` on a generalized plant."""

from __future__ import annotations

import numpy as np

from controller.riccati.balancing import spectrum
from controller.servo.generalized_plant import (
    GeneralizedPlant,
    StateFeedback,
    closed_plant,
    solve_plant,
)
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, eigenvalue_text, matrix_table, numbered

SCHEMA = "hfa.plant-solution/1"
#: delta / delta_min of a generalized plant that names no delta: nearer the controller gets ever
#: faster poles.
USUAL_MARGIN = 1.01


def plant_report(plant: GeneralizedPlant, delta: float | None, origin: str) -> Report:
    """The controller of a generalized plant at delta, by default `USUAL_MARGIN` times the smallest;
    origin: its name.

    Raises NoSolutionError that names the assumption or the condition that fails.
    """
    smallest = plant.minimum_delta()
    found = solve_plant(plant, (USUAL_MARGIN * smallest.value or 1.0) if delta is None else delta)
    states, inputs = numbered("x", len(plant.A)), numbered("u", plant.B2.shape[1])
    if isinstance(found, StateFeedback):
        what, names = "State feedback u = -K x", {"P": (states, states), "K": (inputs, states)}
        loop = plant.A - plant.B2 @ found.K
    else:
        what, seen = (
            "Output feedback xk' = Ak xk + Bk y, u = Ck xk + Dk y",
            numbered("y", len(plant.C2)),
        )
        loop, own = (
            closed_plant(plant, (found.Ak, found.Bk, found.Ck, found.Dk))[0],
            numbered("xk", len(plant.A)),
        )
        names = {"Ak": (own, own), "Bk": (own, seen), "Ck": (inputs, own), "Dk": (inputs, seen)}
    poles = spectrum(loop).eigenvalues
    ends = f", where the {smallest.condition} ends it" if smallest.condition != "none" else ""
    checks = [check.to_dict() for check in found.checks]
    values = {name: value for name, value in vars(found).items() if name not in ("delta", "checks")}
    return Report(
        title=f"{what} for {origin}\ndelta {found.delta:.6g}, smallest possible {smallest.value:.7g}{ends}",
        parts=(
            *(matrix_table(name, *both, getattr(found, name)) for name, both in names.items()),
            f"closed loop, 1/s: {', '.join(eigenvalue_text(value) for value in poles if value.imag >= 0)}",
            checks_block(found.checks),
        ),
        data={
            "schema": SCHEMA,
            "plant": origin,
            "feedback": "state" if isinstance(found, StateFeedback) else "output",
            "delta": finite_or_none(found.delta),
            "delta_min": smallest.value,
            "delta_min_refused": smallest.refused,
            "delta_min_condition": smallest.condition,
            "delta_margin": finite_or_none(smallest.margin(found.delta)),
            **{
                name: value.tolist() if isinstance(value, np.ndarray) else value
                for name, value in values.items()
            },
            "checks": checks,
            "certificate": {"ok": all(check.ok for check in found.checks), "checks": checks},
            "closed_loop_eigenvalues": [[value.real, value.imag] for value in poles.tolist()],
        },
        records=Table(
            ("matrix", "row", "column", "value"),
            [
                (name, row, column, getattr(found, name)[i, j])
                for name, (rows, columns) in names.items()
                for i, row in enumerate(rows)
                for j, column in enumerate(columns)
            ],
        ),
    )
