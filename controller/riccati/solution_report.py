"""Report of the exact solution of a game."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from controller.game.linear_game import disturbance_text, matrix_text
from controller.riccati.enclosure import has_indefinite_weights, warning_of
from controller.riccati.gare import Solution
from controller.riccati.lyapunov import stabilizes
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import storable
from hfa_support.reporting.text import (
    Table,
    eigenvalue_text,
    entry_rows,
    matrix_table,
)

#: Largest number of printed digits of an entry of K.
MOST_DIGITS = 17


def solution_report(solution: Solution) -> Report:
    """Return a report of P, K, the closed-loop eigenvalues, checks, delta_min and margins."""
    game = solution.game
    states = solution.names.states
    smallest = solution.delta_min_bounds
    title = (
        f"Exact game solution{' in discrete time' * game.is_discrete} for"
        f" {solution.names.origin}: proved{''.join(_findings(solution))}\n"
        f"delta {solution.delta:.6g}, smallest possible {smallest.value:.7g}"
        f", margin {solution.delta_margin:.4g}"
    )
    if game.is_discrete:
        radius = np.abs(solution.poles()).max()
        verb = "stabilizes" if solution.is_stable else "does NOT stabilize"
        loop = f"u = -K x {verb}: A - B K has the spectral radius {radius:.7g}"
        if game.discount != 1.0:
            title += f", discount {game.discount:g} a step"
            loop += f", sqrt(discount) (A - B K) {math.sqrt(game.discount) * radius:.7g}"
    else:
        poles = [value for value in solution.closed_loop_eigenvalues if value.imag >= 0]
        loop = f"closed loop A - B K, 1/s: {', '.join(map(eigenvalue_text, poles))}"
    return Report(
        title=title,
        parts=(
            "\n".join(_weights(solution)),
            matrix_table("P", states, states, solution.P),
            *_gain_table(solution),
            loop,
            "\n".join(("Proved in ball arithmetic:", *solution.certificate.proved)),
            *_margins(solution),
        ),
        data=storable(solution),
        records=Table(
            ("matrix", "row", "column", "value", "unit"),
            entry_rows((solution.P,), (solution.K,), solution.names),
        ),
    )


def _findings(solution: Solution) -> Iterator[str]:
    """Yield what the first line says of the weights and of the digits of the data."""
    if has_indefinite_weights(solution.game):
        yield ", weights indefinite"
    if warning_of(solution.certificate.data_change):
        yield ", last digits decide"


def _gain_table(solution: Solution) -> Iterator[Part]:
    """Yield a table of K, with enough digits that the printed K stabilizes.

    If no number of digits is enough, a line says so.
    """
    names = solution.names.inputs, solution.names.states
    for digits in (None, 8, MOST_DIGITS):  # None: four decimals
        table = matrix_table("K", *names, solution.K, digits)
        printed = np.array([row[1:] for row in table.rows], dtype=float)
        if stabilizes(solution.game, printed, is_discounted=True):
            yield table
            return
    yield matrix_table("K", *names, solution.K)
    yield "K, rounded to doubles, does not stabilize the plant; give slow modes more weight in Q"


def _margins(solution: Solution) -> Iterator[Part]:
    """Yield a table with the margins of each input, and those of all inputs, if they are known."""
    disk = solution.disk_margin
    if disk is None:
        if solution.is_stable:
            yield "Margins: not known, since a mode is undamped up to the rounding of doubles"
        return
    rows = []
    for name, loop in zip(solution.names.inputs, solution.loops, strict=True):
        gain = f"{loop.gain_low:.3g} to {loop.gain_high:.3g}"
        rows.append((name, gain, f"{loop.phase:.4g}", f"{loop.disk:.4g}"))
    yield Table(("margins at the input", "gain", "phase deg", "disk"), rows)
    unit = "rad/step" if solution.game.dt is True else "rad/s"
    yield (
        f"All inputs at once: disk {disk.disk:.4g}, gain {disk.gain:.4g},"
        f" phase {disk.phase:.4g} deg, at {disk.frequency:.4g} {unit}"
    )


def _weights(solution: Solution) -> Iterator[str]:
    """Yield a line for each weight matrix of the game, and for E."""
    yield f"Q {matrix_text(solution.game.Q)}"
    yield f"R {matrix_text(solution.game.R)}"
    if solution.game.N.any():
        yield f"N {matrix_text(solution.game.N)}"
    yield disturbance_text(solution.game)
