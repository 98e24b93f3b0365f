"""The exact solution of a game, what it means, and how to say it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.checks import Check, checks_text
from hfa_model.support.errors import NoSolutionError
from hfa_model.support.jsonable import finite_or_none
from hfa_model.support.text import Table, columns, matrix_text
from verification.meaning.margins import DiskMargin, LoopMargin, disk_margin, loop_margins
from verification.meaning.meaning import meaning_checks
from verification.riccati.delta_min import DeltaMin, minimum_delta
from verification.riccati.gare import GameSolution, solve_game
from verification.riccati.units import balanced_units, in_units

SCHEMA = "hfa.game-solution/1"


@dataclass(frozen=True, eq=False)
class SolutionReport:
    """The certified solution, the smallest delta, what the policies do when flown, and their margins."""

    solution: GameSolution
    delta_min: DeltaMin
    meaning: tuple[Check, ...]
    loops: tuple[LoopMargin, ...]
    disk: DiskMargin


def solution_report(game: Game) -> SolutionReport:
    """Solve, then fly and analyse the solution, in balanced units of state: the verdict must not depend on the
    user's, and the flight starts at one unit of each.

    Raises NoSolutionError when it is not certified, or when its policies do not mean what the certificate says.
    """
    solution, units = solve_game(game), balanced_units(game)
    meaning = meaning_checks(in_units(game, units), solution.P * np.outer(units, units), np.ones(len(units)))
    smallest = minimum_delta(game)
    for check in meaning:
        if not check.ok:
            raise NoSolutionError(
                f"certified, but not confirmed in flight: {check.name}: {check.reason}; {smallest.advice(game.delta)}"
            )
    return SolutionReport(solution, smallest, meaning, loop_margins(game, solution.K), disk_margin(game, solution.K))


def solution_data(report: SolutionReport, states: tuple[str, ...], inputs: tuple[str, ...]) -> dict[str, Any]:
    """Ready for JSON; what is infinite becomes null."""
    return {
        "schema": SCHEMA,
        "states": list(states),
        "inputs": list(inputs),
        **report.solution.to_dict(),
        "delta_min": report.delta_min.value,
        "delta_margin": finite_or_none(report.delta_min.margin(report.solution.delta)),
        "meaning": [check.to_dict() for check in report.meaning],
        "loop_margins": {
            name: {key: finite_or_none(value) for key, value in loop._asdict().items()}
            for name, loop in zip(inputs, report.loops, strict=True)
        },
        "disk_margin": {key: finite_or_none(value) for key, value in report.disk._asdict().items()},
    }


def solution_table(report: SolutionReport, states: tuple[str, ...], inputs: tuple[str, ...]) -> Table:
    """Rows (matrix, row, column, value) of P and K."""
    rows: list[tuple[Any, ...]] = []
    for name, row_names, matrix in (("P", states, report.solution.P), ("K", inputs, report.solution.K)):
        for i, row in enumerate(row_names):
            rows += [(name, row, column, matrix[i, j]) for j, column in enumerate(states)]
    return Table(("matrix", "row", "column", "value"), rows)


def solution_text(report: SolutionReport, states: tuple[str, ...], inputs: tuple[str, ...], origin: str) -> str:
    """P, K, certificate, meaning and margins on a terminal."""
    solution, smallest = report.solution, report.delta_min
    loops = [
        (
            name,
            f"{loop.gain_low:.3g} to {loop.gain_high:.3g}",
            f"{loop.phase:.4g}",
            f"{loop.disk:.4g}",
        )
        for name, loop in zip(inputs, report.loops, strict=True)
    ]
    disk = report.disk
    return "\n\n".join(
        [
            f"Exact game solution for {origin}\ndelta {solution.delta:.6g}, smallest possible {smallest.value:.7g}, "
            f"margin {smallest.margin(solution.delta):.4g}",
            matrix_text("P", states, states, solution.P),
            matrix_text("K", inputs, states, solution.K),
            _spectrum_text("closed loop A - B K, 1/s", solution.closed_loop_eigenvalues),
            checks_text(solution.certificate.checks),
            checks_text(report.meaning),
            columns(("margins at the input", "gain", "phase deg", "disk"), loops),
            f"All inputs at once: disk {disk.disk:.4g}, gain {disk.gain:.4g}, phase {disk.phase:.4g} deg, "
            f"at {disk.frequency:.4g} rad/s",
        ]
    )


def _spectrum_text(title: str, eigenvalues: np.ndarray) -> str:
    shown = ", ".join(
        f"{value.real:.4f}" + (f" ± {value.imag:.4f}i" if value.imag else "")
        for value in eigenvalues
        if value.imag >= 0
    )
    return f"{title}: {shown}"
