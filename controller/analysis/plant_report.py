"""Reports of controllers: of a game from measured outputs alone, and of a generalized plant."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.generalized_plant import (
    GeneralizedPlant,
    OutputFeedback,
    PlantDeltaMin,
    StateFeedback,
    closed_loop,
    minimum_plant_delta,
    solve_plant,
)
from controller.riccati.output_feedback import OutputGame, minimum_output_delta, solve_output_feedback
from hfa_support.errors import NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, eigenvalue_text, matrix_table, numbered
from hfa_support.reporting.unit_system import in_force, unit_in_force

SCHEMA = "hfa.plant-solution/1"
#: delta / delta_min of a generalized plant that names no delta: nearer the controller gets ever faster poles.
USUAL_MARGIN = 1.01


def output_report(problem: OutputGame, sensors: tuple[str, ...], units: tuple[str, ...]) -> Report:
    """The central controller of the game when only the sensors are known.

    Raises NoSolutionError that names the condition that fails.
    """
    smallest, delta = minimum_output_delta(problem), problem.game.delta
    _refuse_below(smallest, delta, "from measured outputs alone ", "or measure more")
    found, noise = solve_output_feedback(problem), problem.V.diagonal().tolist()
    of_noise = [f"({unit})^2 s" for unit in units]
    rows = [
        (name, f"{in_force(value, unit):.4g}", unit_in_force(unit))
        for name, value, unit in zip(sensors, noise, of_noise, strict=True)
    ]
    return Report(
        title=f"From measured outputs alone: {_least(smallest, delta)}",
        parts=(
            Table(("sensor", "noise", "unit"), rows),
            f"coupling rho(XY) / delta^2: {found.coupling:.6g}, must stay below 1",
            checks_block(found.checks),
        ),
        data={
            "sensors": list(sensors),
            "sensor_units": list(units),
            "C": problem.C.tolist(),
            "D": problem.D.tolist(),
            "noise": noise,
            **_controller_data(found, smallest),
        },
    )


def plant_report(plant: GeneralizedPlant, delta: float | None, origin: str) -> Report:
    """The controller of a generalized plant at delta, by default `USUAL_MARGIN` times the smallest; origin: its name.

    Raises NoSolutionError that names the assumption or the condition that fails.
    """
    smallest = minimum_plant_delta(plant)
    if delta is None:
        delta = USUAL_MARGIN * smallest.value or 1.0
    _refuse_below(smallest, delta, "", "or change the plant")
    found, (n, m) = solve_plant(plant, delta), plant.B2.shape
    states, inputs = numbered("x", n), numbered("u", m)
    if isinstance(found, StateFeedback):
        what = "State feedback u = -K x"
        loop = plant.A - plant.B2 @ found.K
        matrices = [("P", states, states, found.P), ("K", inputs, states, found.K)]
    else:
        what, seen = "Output feedback xk' = Ak xk + Bk y, u = Ck xk + Dk y", numbered("y", len(plant.C2))
        loop = closed_loop(plant, (found.Ak, found.Bk, found.Ck, found.Dk))[0]
        own = numbered("xk", n)
        matrices = [("Ak", own, own, found.Ak), ("Bk", own, seen, found.Bk)]
        matrices += [("Ck", inputs, own, found.Ck), ("Dk", inputs, seen, found.Dk)]
    poles = spectrum(loop).eigenvalues
    return Report(
        title=f"{what} for {origin}\n{_least(smallest, delta)}",
        parts=(
            *(matrix_table(*each) for each in matrices),
            f"closed loop, 1/s: {', '.join(eigenvalue_text(value) for value in poles if value.imag >= 0)}",
            checks_block(found.checks),
        ),
        data={
            "schema": SCHEMA,
            "plant": origin,
            "feedback": "state" if isinstance(found, StateFeedback) else "output",
            "delta": finite_or_none(delta),
            "delta_min_refused": smallest.refused,
            **_controller_data(found, smallest),
            "closed_loop_eigenvalues": [[value.real, value.imag] for value in poles.tolist()],
        },
        records=Table(
            ("matrix", "row", "column", "value"),
            [
                (name, row, column, value)
                for name, rows, columns, matrix in matrices
                for row, line in zip(rows, matrix.tolist(), strict=True)
                for column, value in zip(columns, line, strict=True)
            ],
        ),
    )


def _refuse_below(smallest: PlantDeltaMin, delta: float, who: str, other: str) -> None:
    if delta >= smallest.value:
        return
    where = f"below delta_min = {smallest.value:.7g}"
    if delta > smallest.refused:
        where = f"too close to delta_min, which lies between {smallest.refused:.9g} and {smallest.value:.9g}"
    raise NoSolutionError(
        f"{who}delta = {delta:.9g} is {where}, where the {smallest.condition} fails; ask for a larger delta, {other}"
    )


def _least(smallest: PlantDeltaMin, delta: float) -> str:
    ends = f", where the {smallest.condition} ends it" if smallest.condition != "none" else ""
    return f"delta {delta:.6g}, smallest possible {smallest.value:.7g}{ends}"


def _controller_data(found: OutputFeedback | StateFeedback, smallest: PlantDeltaMin) -> dict[str, Any]:
    held = {name: value for name, value in vars(found).items() if name not in ("delta", "checks")}
    checks = [check.to_dict() for check in found.checks]
    return {
        "delta_min": smallest.value,
        "delta_min_condition": smallest.condition,
        "delta_margin": finite_or_none(found.delta / smallest.value) if smallest.value > 0.0 else None,
        **{name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in held.items()},
        "checks": checks,
        "certificate": {"ok": all(check.ok for check in found.checks), "checks": checks},
    }
