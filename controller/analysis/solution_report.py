"""What the exact solution of a game says: from its states with flight and margins, from measured outputs alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.analysis.cost import cost_checks, saddle_checks
from controller.analysis.margins import LoopMargin, loop_margins
from controller.game.zero_sum import Game
from controller.riccati.balancing import in_units, normal_form
from controller.riccati.frequency_response import DiskMargin, disk_margin, gain_checks
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.output_feedback import OutputGame, minimum_output_delta, solve_output_feedback
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_support.errors import NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, eigenvalue_text, entry_rows, matrix_table
from hfa_support.reporting.unit_system import in_force, unit_in_force

SCHEMA = "hfa.game-solution/1"
#: Percent of the time that have passed, with a plant of 100 states, once P is certified and once delta_min is found.
_SOLVED, _SEARCHED = 25, 75


@dataclass(frozen=True, eq=False, repr=False)
class AnalysedGame(Shown):
    """The certified solution, the smallest delta, what the policies do in simulation, and their margins."""

    solution: GameSolution
    delta_min: DeltaMin
    meaning: tuple[Check, ...]
    loops: tuple[LoopMargin, ...]
    disk: DiskMargin


def analyse_game(game: Game, progress: Progress | None = None) -> AnalysedGame:
    """Solve, then simulate and analyse the solution, in balanced units of state and with R = I: the verdict must not
    depend on the user's units, and the flight starts at one unit of each. progress: in percent, 100 whatever comes.

    Raises NoSolutionError when it is not certified, or when its policies do not mean what the certificate says.
    """
    told = progress or (lambda done, total: None)
    try:
        told(0, 100)
        return _analysed(game, told)
    finally:
        told(100, 100)


def _analysed(game: Game, told: Progress) -> AnalysedGame:
    solution, form = solve_game(game, told), normal_form(game)
    told(_SOLVED, 100)
    share = _SEARCHED - _SOLVED
    smallest = minimum_delta(game, lambda done, total: told(_SOLVED * total + share * done, 100 * total))
    alike = replace(in_units(game, form.units), B=form.B, R=np.eye(form.B.shape[1]))
    meaning = meaning_checks(alike, solution.P * np.outer(form.units, form.units), np.ones(len(form.units)))
    for check in meaning:
        if not check.ok:
            raise NoSolutionError(
                f"certified, but not confirmed in flight: {check.name}: {check.reason}; {smallest.advice(game.delta)}"
            )
    return AnalysedGame(solution, smallest, meaning, loop_margins(game, solution.K), disk_margin(game, solution.K))


def meaning_checks(game: Game, P: np.ndarray, initial: np.ndarray) -> tuple[Check, ...]:
    """Cost of the policies equals z0'P z0, neither player gains by deviating, and the L2 gain is below delta.

    P: (n, n), exact or learned; initial z0: (n,).  With delta = inf (no disturbance) the gain is not limited. A game
    of value 0 has no costs to compare, and no saddle checks.
    """
    return (
        *cost_checks(game, P, initial),
        *(saddle_checks(game, P, initial) if game.Q.any() or P.any() else ()),
        *gain_checks(game, game.gain(P)),
    )


def solution_report(
    found: AnalysedGame,
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    origin: str,
    state_units: tuple[str, ...] = (),
    input_units: tuple[str, ...] = (),
) -> Report:
    """P, K, certificate, meaning and margins; origin: what the plant is called; a unit is "" where it is not known."""
    units = state_units or ("",) * len(states), input_units or ("",) * len(inputs)
    solution, disk = found.solution, found.disk
    loops = [
        (name, f"{loop.gain_low:.3g} to {loop.gain_high:.3g}", f"{loop.phase:.4g}", f"{loop.disk:.4g}")
        for name, loop in zip(inputs, found.loops, strict=True)
    ]
    eigenvalues = ", ".join(eigenvalue_text(value) for value in solution.closed_loop_eigenvalues if value.imag >= 0)
    return Report(
        title=f"Exact game solution for {origin}\n{_standing(solution.delta, found.delta_min)}",
        parts=(
            matrix_table("P", states, states, solution.P, (units[0], -1), (units[0], -1)),
            matrix_table("K", inputs, states, solution.K, (units[1], 1), (units[0], -1)),
            f"closed loop A - B K, 1/s: {eigenvalues}",
            checks_block(solution.certificate.checks),
            checks_block(found.meaning),
            Table(("margins at the input", "gain", "phase deg", "disk"), loops),
            f"All inputs at once: disk {disk.disk:.4g}, gain {disk.gain:.4g}, phase {disk.phase:.4g} deg, "
            f"at {disk.frequency:.4g} rad/s",
        ),
        data={**_data(found, states, inputs), "state_units": list(units[0]), "input_units": list(units[1])},
        records=Table(
            ("matrix", "row", "column", "value", "unit"),
            entry_rows((solution.P,), (solution.K,), (states, inputs), units),
        ),
    )


def _standing(delta: float, smallest: DeltaMin) -> str:
    """Where delta stands; the doubt about the smallest one is said only where rounding leaves any."""
    doubt = f" (rounding leaves it open down to {smallest.refused:.7g})" if smallest.uncertain else ""
    return f"delta {delta:.6g}, smallest possible {smallest.value:.7g}{doubt}, margin {smallest.margin(delta):.4g}"


def _data(found: AnalysedGame, states: tuple[str, ...], inputs: tuple[str, ...]) -> dict[str, Any]:
    """Ready for JSON; what is infinite becomes null."""
    return {
        "schema": SCHEMA,
        "states": list(states),
        "inputs": list(inputs),
        **found.solution.to_dict(),
        "delta_min": found.delta_min.value,
        "delta_margin": finite_or_none(found.delta_min.margin(found.solution.delta)),
        "meaning": [check.to_dict() for check in found.meaning],
        "loop_margins": {
            name: {key: finite_or_none(value) for key, value in loop._asdict().items()}
            for name, loop in zip(inputs, found.loops, strict=True)
        },
        "disk_margin": {key: finite_or_none(value) for key, value in found.disk._asdict().items()},
    }


def output_report(problem: OutputGame, sensors: tuple[str, ...], units: tuple[str, ...]) -> Report:
    """The central controller of the game when only the sensors are known.

    Raises NoSolutionError that names the condition that fails.
    """
    smallest, condition = minimum_output_delta(problem)
    delta = problem.game.delta
    if delta < smallest:
        raise NoSolutionError(
            f"from measured outputs alone delta = {delta:.9g} is below delta_min = {smallest:.7g}, where the "
            f"{condition} fails; ask for a larger delta, or measure more"
        )
    found, noise = solve_output_feedback(problem), problem.V.diagonal().tolist()
    of_noise = [f"({unit})^2 s" for unit in units]
    rows = [
        (name, f"{in_force(value, unit):.4g}", unit_in_force(unit))
        for name, value, unit in zip(sensors, noise, of_noise, strict=True)
    ]
    return Report(
        title=f"From measured outputs alone: delta {delta:.6g}, smallest possible {smallest:.7g}"
        + (f", where the {condition} ends it" if condition != "none" else ""),
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
            "delta_min": smallest,
            "delta_min_condition": condition,
            "delta_margin": finite_or_none(delta / smallest) if smallest > 0.0 else None,
            "coupling": found.coupling,
            "X": found.X.tolist(),
            "Y": found.Y.tolist(),
            "Ak": found.Ak.tolist(),
            "Bk": found.Bk.tolist(),
            "Ck": found.Ck.tolist(),
            "checks": [check.to_dict() for check in found.checks],
        },
    )
