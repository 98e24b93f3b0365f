"""Report of a game: its matrices, with named rows and columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_support.reporting.report import Report
from hfa_support.reporting.text import matrix_table, numbered

if TYPE_CHECKING:
    from controller.game.zero_sum import Game

#: Matrices with more rows or columns are not printed.
_MOST = 12


def game_report(game: Game) -> Report:
    """Return a report with the matrices of the game, with named rows and columns.

    Matrices with more than `_MOST` rows or columns are omitted from the text.
    """
    states = game.names.states
    inputs = game.names.inputs
    disturbances = numbered("d", game.E.shape[1])
    names = {
        "A": (states, states),
        "B": (states, inputs),
        "E": (states, disturbances),
        "Q": (states, states),
        "R": (inputs, inputs),
    }
    cross = ""
    if game.N.any():
        names["N"] = (states, inputs)
        cross = " + 2 z'Nu"
    tables = [
        matrix_table(name, rows, columns, getattr(game, name))
        for name, (rows, columns) in names.items()
        if max(len(rows), len(columns)) <= _MOST
    ]
    return Report(
        title=f"Game on {game.names.origin}, delta {game.delta:.6g}:"
        f" z' = A z + B u + E d, cost z'Qz{cross} + u'Ru - delta^2 d'd",
        parts=tables,
        data={name: getattr(game, name) for name in (*names, "delta")},
    )
