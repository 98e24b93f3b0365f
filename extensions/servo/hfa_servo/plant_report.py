"""The report of `hfa solve` on a generalized plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.certificate import Certificate
from controller.riccati.smallest_delta import DeltaMin
from hfa_servo.generalized_plant import (
    GeneralizedPlant,
    OutputFeedback,
    StateFeedback,
    closed_plant,
    solve_plant,
    stored_plant,
)
from hfa_servo.results import PlantSolution
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, eigenvalue_text, matrix_table, numbered

#: Of a solution, beside its matrices.
_SHARED = ("delta", "checks")
#: delta / delta_min of a generalized plant that names no delta: nearer the controller gets ever
#: faster poles.
USUAL_MARGIN = 1.01


def solved_plant(file: Path, arrays: dict[str, Any], delta: float | None) -> Report:
    """The report on the controller of a generalized plant, of the arrays of its file.

    delta: what the gain is to be below; None: as the file says it."""
    plant, stored_delta, notes = stored_plant(file, arrays)
    bound = stored_delta if delta is None else delta
    return plant_report(plant, bound, str(file)).with_data(warnings=list(notes))


def plant_report(plant: GeneralizedPlant, delta: float | None, origin: str) -> Report:
    """The controller of a generalized plant at delta, by default `USUAL_MARGIN` times the smallest;
    origin: its name.

    NoSolutionError names the assumption or the condition that fails.
    """
    smallest = plant.minimum_delta()
    if delta is None:
        delta = USUAL_MARGIN * smallest.value or 1.0
    solution = solve_plant(plant, delta)
    states = numbered("x", len(plant.A))
    inputs = numbered("u", plant.B2.shape[1])
    if isinstance(solution, StateFeedback):
        kind = "state"
        title = "State feedback u = -K x"
        names = {"P": (states, states), "K": (inputs, states)}
        loop = plant.A - plant.B2 @ solution.K
    else:
        kind = "output"
        title = "Output feedback xk' = Ak xk + Bk y, u = Ck xk + Dk y"
        measured = numbered("y", len(plant.C2))
        own = numbered("xk", len(plant.A))
        names = {
            "Ak": (own, own),
            "Bk": (own, measured),
            "Ck": (inputs, own),
            "Dk": (inputs, measured),
        }
        controller = (solution.Ak, solution.Bk, solution.Ck, solution.Dk)
        loop = closed_plant(plant, controller)[0]
    poles = spectrum(loop).eigenvalues
    matrices = [
        matrix_table(name, rows, columns, getattr(solution, name))
        for name, (rows, columns) in names.items()
    ]
    upper = ", ".join(eigenvalue_text(value) for value in poles if value.imag >= 0)
    limits = f"delta {solution.delta:.6g}, smallest possible {smallest.value:.7g}"
    if smallest.condition != "none":
        limits += f", where the {smallest.condition} ends it"
    return Report(
        title=f"{title} for {origin}\n{limits}",
        parts=(*matrices, f"closed loop, 1/s: {upper}", checks_block(solution.checks)),
        data=_data(solution, smallest, poles, origin, kind),
        records=_records(solution, names),
    )


def _data(
    solution: OutputFeedback | StateFeedback,
    smallest: DeltaMin,
    poles: np.ndarray,
    origin: str,
    kind: str,
) -> dict[str, Any]:
    """The data of a solution."""
    matrices = {name: value for name, value in vars(solution).items() if name not in _SHARED}
    return PlantSolution(
        plant=origin,
        feedback=kind,
        delta=solution.delta,
        delta_min=smallest.value,
        delta_min_refused=smallest.refused,
        delta_min_condition=smallest.condition,
        delta_margin=smallest.margin(solution.delta),
        **matrices,
        checks=solution.checks,
        certificate=Certificate(solution.checks),
        closed_loop_eigenvalues=poles,
    ).as_data()


def _records(
    solution: OutputFeedback | StateFeedback,
    names: dict[str, tuple[tuple[str, ...], tuple[str, ...]]],
) -> Table:
    """A row an entry of each matrix."""
    rows = []
    for name, (row_names, column_names) in names.items():
        matrix = getattr(solution, name)
        for i, row in enumerate(row_names):
            for j, column in enumerate(column_names):
                rows.append((name, row, column, matrix[i, j]))
    return Table(("matrix", "row", "column", "value"), rows)
