"""What the exact solution of a game says: the policies in flight, and their margins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.analysis.cost import cost_checks, saddle_checks
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced, in_units, normal_form, reached
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

#: A gain below this is a crossover at infinite frequency that rounding moved off zero.
ROUNDING = 1e-12
#: How near to the axis an eigenvalue must lie to be tried, and a polished response to its condition to be taken.
_NEAR, _MET = 1e-3, 1e-9
_STEPS = 20


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

    L_i(s) = K_i (sI - A + Σ_{j≠i} B_j K_j)⁻¹ B_i.  Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    peaks = np.abs(balanced_sensitivity(game, K, loop_grid(game, K))).max(axis=0)
    return tuple(_loop_margin(game, K, i, float(peaks[i, i])) for i in range(game.B.shape[1]))


def _loop_margin(game: Game, K: np.ndarray, i: int, largest: float) -> LoopMargin:
    """largest: |S_ii - 1/2| at its peak; S_ii = 1/(1 + L_i)."""
    others = [j for j in range(game.B.shape[1]) if j != i]
    loop = Loop(game.A - game.B[:, others] @ K[others], game.B[:, i], K[i])
    real = loop.real_responses()
    gains = 1.0 / -real[real < 0.0]
    phases = np.abs(np.angle(-loop.unit_responses(), deg=True))
    disk = min(1.0 / largest, DISK_AT_INFINITY)
    gain, phase = disk_sizes(disk)
    return LoopMargin(
        gain_low=float(gains[(gains < 1.0) & (gains > ROUNDING)].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        disk=disk,
        disk_gain=gain,
        disk_phase=phase,
    )


@dataclass(frozen=True, eq=False)
class Loop:
    """L(s) = c (sI - A)⁻¹ b. A: (n, n), b, c: (n,)."""

    A: np.ndarray
    b: np.ndarray
    c: np.ndarray

    def at(self, frequency: float) -> tuple[complex, complex]:
        """L and dL/dω at jω, nan at a pole."""
        resolvent = 1j * frequency * np.eye(len(self.A)) - self.A
        try:
            x = np.linalg.solve(resolvent, self.b)
            return complex(self.c @ x), complex(-1j * self.c @ np.linalg.solve(resolvent, x))
        except np.linalg.LinAlgError:
            return complex(np.nan), complex(np.nan)

    def real_responses(self) -> np.ndarray:
        """L(jω) wherever it is real, ω >= 0: at 0, and where c (A² - s²I)⁻¹ b = 0 at s = jω."""
        from scipy.linalg import eigvals

        n = len(self.A)
        pencil = np.block([[self.A @ self.A, self.b[:, None]], [self.c[None], np.zeros((1, 1))]])
        squares = eigvals(balanced(pencil)[0], np.diag([*np.ones(n), 0.0]))
        candidates = [0.0, *_frequencies(np.emath.sqrt(squares[np.isfinite(squares)]))]

        def met(frequency: float) -> tuple[float, float, float]:
            response, slope = self.at(frequency)
            return response.imag, slope.imag, abs(response)

        return np.array([self.at(each)[0].real for each in _polished(candidates, met)])

    def unit_responses(self) -> np.ndarray:
        """L(jω) wherever |L| = 1, ω >= 0: jω is an eigenvalue of [[A, bb'], [-cc', -A']]."""
        H = np.block([[self.A, np.outer(self.b, self.b)], [-np.outer(self.c, self.c), -self.A.T]])

        def met(frequency: float) -> tuple[float, float, float]:
            response, slope = self.at(frequency)
            return abs(response) ** 2 - 1.0, 2.0 * (np.conj(response) * slope).real, 1.0

        candidates = _frequencies(np.linalg.eigvals(balanced(H)[0]))
        return np.array([self.at(each)[0] for each in _polished(candidates, met)])


def _frequencies(eigenvalues: np.ndarray) -> list[float]:
    """ω >= 0 of the eigenvalues that may lie on the imaginary axis."""
    near = np.abs(eigenvalues.real) <= _NEAR * np.abs(eigenvalues)
    return np.unique(np.abs(eigenvalues[near].imag)).tolist()


def _polished(candidates: list[float], met: Callable[[float], tuple[float, float, float]]) -> list[float]:
    """Where Newton's method on `met` (value, slope, scale) ends near a candidate, and the value is rounding."""
    found = []
    for start in candidates:
        best, least = start, np.inf
        frequency = start
        for _ in range(_STEPS):
            value, slope, scale = met(frequency)
            if not np.isfinite(value) or abs(frequency - start) > _NEAR * max(start, 1e-300):
                break
            if abs(value) < least * scale:
                best, least = frequency, abs(value) / scale
            if value == 0.0 or slope == 0.0 or start == 0.0:
                break
            frequency -= value / slope
        if least <= _MET:
            found.append(best)
    return found


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
    told = progress or (lambda *_: None)
    try:
        told(0, 100)
        return _analysed(game, told)
    finally:
        told(100, 100)


def _analysed(game: Game, told: Progress) -> AnalysedGame:
    solution, (inside, _) = solve_game(game, told), reached(game)
    told(_SOLVED, 100)
    share = _SEARCHED - _SOLVED
    smallest = minimum_delta(game, lambda done, total, *_: told(_SOLVED * total + share * done, 100 * total))
    found, form = solution if inside is game else solve_game(inside), normal_form(inside)
    alike = replace(in_units(inside, form.units), B=form.B, R=np.eye(form.B.shape[1]))
    meaning = meaning_checks(alike, found.P * np.outer(form.units, form.units), np.ones(len(form.units)))
    for check in meaning:
        if not check.ok:
            raise NoSolutionError(
                f"certified, but not confirmed in flight: {check.name}: {check.reason}; {smallest.advice(game.delta)}"
            )
    return AnalysedGame(solution, smallest, meaning, loop_margins(inside, found.K), disk_margin(inside, found.K))


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
    """Where delta stands; the uncertainty of the smallest one is stated only where rounding leaves any."""
    doubt = f" (rounding leaves it open down to {smallest.refused:.7g})" if smallest.uncertain else ""
    return f"delta {delta:.6g}, smallest possible {smallest.value:.7g}{doubt}, margin {smallest.margin(delta):.4g}"


def _data(found: AnalysedGame, states: tuple[str, ...], inputs: tuple[str, ...]) -> dict[str, Any]:
    """Ready for JSON; infinite values become null."""
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
