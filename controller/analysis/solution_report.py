"""What the exact solution of a game says: the policies in flight, and their margins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.analysis.cost import cost_checks, saddle_checks
from controller.game.zero_sum import Game
from controller.riccati.balancing import in_units, normal_form, reached
from controller.riccati.frequency_response import (
    DISK_AT_INFINITY,
    DiskMargin,
    balanced_sensitivity,
    disk_margin,
    disk_sizes,
    gain_checks,
    loop_grid,
)
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_support.errors import NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, eigenvalue_text, entry_rows, matrix_table

#: A gain below this, or above its inverse, is a crossover at infinite or no frequency that rounding moved.
ROUNDING = 1e-9
#: A step of the grid is cut into so many parts so many times, until a crossover has all its digits.
_PARTS, _ROUNDS = 16, 13


class LoopMargin(NamedTuple):
    """One input at a time, all other loops closed (classical margins, and the balanced disk margin).

    The loop stays stable while its gain is multiplied by a factor in (gain_low, gain_high), or its phase
    shifted by less than `phase`; with both at once, within the disk of margin `disk`.
    """

    gain_low: float
    gain_high: float
    phase: float
    disk: float
    disk_gain: float
    disk_phase: float


def loop_margins(game: Game, K: np.ndarray) -> tuple[LoopMargin, ...]:
    """Margins of each input, in the order of the inputs. K: (m, n).

    With M = S_ii - 1/2, S_ii = 1 / (1 + L_i), the loop is L_i = (1/2 - M) / (1/2 + M): real where M is, and of size 1
    where M is imaginary. Such frequencies are found where Im M or Re M change their signs between those of a grid,
    which has every resonance, and then in ever smaller parts. Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    grid = loop_grid(game, K)
    seen = np.diagonal(balanced_sensitivity(game, K, grid), axis1=1, axis2=2)
    return tuple(_loop_margin(game, K, i, grid, seen[:, i]) for i in range(game.B.shape[1]))


def _loop_margin(game: Game, K: np.ndarray, i: int, grid: np.ndarray, seen: np.ndarray) -> LoopMargin:
    """seen: M (jω) of the grid."""

    def crossing(part: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """M where this part of it changes its sign."""
        above = part(seen) > 0.0
        where = np.flatnonzero(above[1:] != above[:-1])
        low, high, columns = grid[where], grid[where + 1], np.arange(len(where))
        for _ in range(_ROUNDS):
            points = np.linspace(low, high, _PARTS + 1)
            there = balanced_sensitivity(game, K, points.ravel())[:, i, i].reshape(points.shape)
            first = np.argmax((part(there[1:]) > 0.0) != above[where], axis=0)
            low, high = points[first, columns], points[first + 1, columns]
        return np.asarray(balanced_sensitivity(game, K, high)[:, i, i])

    real = np.append(seen[0].real, crossing(np.imag).real)
    with np.errstate(divide="ignore"):
        gains = (real + 0.5) / (real - 0.5)  # -1 / L
    gains = gains[(gains > ROUNDING) & (gains < 1.0 / ROUNDING)]
    phases = 2.0 * np.degrees(np.arctan2(0.5, np.abs(crossing(np.real).imag)))
    disk = min(1.0 / float(np.abs(seen).max()), DISK_AT_INFINITY)
    gain, phase = disk_sizes(disk)
    return LoopMargin(
        gain_low=float(gains[gains < 1.0].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        disk=disk,
        disk_gain=gain,
        disk_phase=phase,
    )


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
    told, share = progress or (lambda *_: None), _SEARCHED - _SOLVED
    try:
        told(0, 100)
        solution, (inside, _) = solve_game(game, told), reached(game)
        told(_SOLVED, 100)
        smallest = minimum_delta(game, lambda done, total, *_: told(_SOLVED * total + share * done, 100 * total))
        found, form = solution if inside is game else solve_game(inside), normal_form(inside)
        alike = replace(in_units(inside, form.units), B=form.B, R=np.eye(form.B.shape[1]))
        meaning = meaning_checks(alike, found.P * np.outer(form.units, form.units), np.ones(len(form.units)))
        for check in meaning:
            if not check.ok:
                unconfirmed = f"certified, but not confirmed in flight: {check.name}: {check.reason}"
                raise NoSolutionError(f"{unconfirmed}; {smallest.advice(game.delta)}")
        return AnalysedGame(solution, smallest, meaning, loop_margins(inside, found.K), disk_margin(inside, found.K))
    finally:
        told(100, 100)


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
    solution, disk, smallest, delta = found.solution, found.disk, found.delta_min, found.solution.delta
    margin = smallest.margin(delta)
    doubt = f" (rounding leaves it open down to {smallest.refused:.7g})" if smallest.uncertain else ""
    loops = [
        (name, f"{loop.gain_low:.3g} to {loop.gain_high:.3g}", f"{loop.phase:.4g}", f"{loop.disk:.4g}")
        for name, loop in zip(inputs, found.loops, strict=True)
    ]
    eigenvalues = ", ".join(eigenvalue_text(value) for value in solution.closed_loop_eigenvalues if value.imag >= 0)
    return Report(
        title=f"Exact game solution for {origin}\n"
        f"delta {delta:.6g}, smallest possible {smallest.value:.7g}{doubt}, margin {margin:.4g}",
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
        data={
            "schema": SCHEMA,
            "states": list(states),
            "inputs": list(inputs),
            **solution.to_dict(),
            "delta_min": smallest.value,
            "delta_margin": finite_or_none(margin),
            "meaning": [check.to_dict() for check in found.meaning],
            "loop_margins": {name: _finite(loop) for name, loop in zip(inputs, found.loops, strict=True)},
            "disk_margin": _finite(disk),
            "state_units": list(units[0]),
            "input_units": list(units[1]),
        },
        records=Table(
            ("matrix", "row", "column", "value", "unit"),
            entry_rows((solution.P,), (solution.K,), (states, inputs), units),
        ),
    )


def _finite(margin: LoopMargin | DiskMargin) -> dict[str, Any]:
    """Ready for JSON; infinite values become null."""
    return {key: finite_or_none(value) for key, value in margin._asdict().items()}
