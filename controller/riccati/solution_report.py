"""Report of the exact solution of a game."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from controller.game.weights import matrix_text
from controller.riccati.balancing import is_hurwitz
from controller.riccati.certificate import NOTICEABLE, TEST_OF_SENSITIVITY, Certificate
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import (
    Table,
    controller_tables,
    eigenvalue_text,
    entry_rows,
    matrix_table,
)

if TYPE_CHECKING:
    from controller.riccati.gare import Solution


def solution_report(solution: Solution) -> Report:
    """Return a report of P, K, the closed-loop eigenvalues, checks, delta_min and margins."""
    game = solution.game
    inputs = solution.names.inputs
    states = solution.names.states
    poles = [value for value in solution.closed_loop_eigenvalues if value.imag >= 0]
    smallest = solution.smallest
    doubt = ""
    if smallest.uncertain:
        doubt = f" (not decided, because of rounding, down to {smallest.refused:.7g})"
    disk = solution.disk_margin
    confirmed = (checks_block(solution.meaning),) if solution.meaning else ()
    return Report(
        title=(
            f"Exact game solution for {solution.names.origin}: certified\n"
            f"delta {solution.delta:.6g}, smallest possible {smallest.value:.7g}"
            f"{doubt}, margin {solution.delta_margin:.4g}"
        ),
        parts=(
            "\n".join(_weights(solution)),
            matrix_table("P", states, states, solution.P),
            *controller_tables(
                {"K": (inputs, states, solution.K)},
                lambda printed: is_hurwitz(game.A - game.B @ printed["K"]),
            ),
            *sensitivity_warning(solution.certificate),
            f"closed loop A - B K, 1/s: {', '.join(map(eigenvalue_text, poles))}",
            checks_block(solution.certificate.checks),
            *confirmed,
            _margins_table(solution),
            f"All inputs at once: disk {disk.disk:.4g}, gain {disk.gain:.4g},"
            f" phase {disk.phase:.4g} deg, at {disk.frequency:.4g} rad/s",
        ),
        data=solution.as_data(),
        records=Table(
            ("matrix", "row", "column", "value", "unit"),
            entry_rows((solution.P,), (solution.K,), solution.names),
        ),
    )


def sensitivity_warning(certificate: Certificate) -> Iterator[str]:
    """Yield a warning if the last digits of the entries of the game change K noticeably."""
    for check in certificate.checks:
        if check.name in TEST_OF_SENSITIVITY and check.value > NOTICEABLE:
            yield (
                f"WARNING: one unit in the last place of the entries of the game changes K by\n"
                f"up to {check.value:.2g}, relative; further digits of K have no meaning"
            )


def _margins_table(solution: Solution) -> Table:
    """Return a table with the gain, phase and disk margins of each input."""
    rows = []
    for name, loop in zip(solution.names.inputs, solution.loops, strict=True):
        gain = f"{loop.gain_low:.3g} to {loop.gain_high:.3g}"
        rows.append((name, gain, f"{loop.phase:.4g}", f"{loop.disk:.4g}"))
    return Table(("margins at the input", "gain", "phase deg", "disk"), rows)


def _weights(solution: Solution) -> Iterator[str]:
    """Yield a line for each weight matrix of the game."""
    yield f"Q {matrix_text(solution.game.Q)}"
    yield f"R {matrix_text(solution.game.R)}"
    if solution.game.N.any():
        yield f"N {matrix_text(solution.game.N)}"
