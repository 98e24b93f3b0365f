"""Text for the polynomials of proved statements."""

from __future__ import annotations

from collections.abc import Sequence

from hfa_boxes.check.piece import Piece
from hfa_proof.results import polynomial_in_words
from hfa_support.reporting.text import Table


def piece_in_words(piece: Piece, states: Sequence[str]) -> tuple[Table, str]:
    """Return a table of M, and W(y) as text, with y = M z."""
    variables = [f"y{i + 1}" for i in range(len(states))]
    rows = [
        (name, *(f"{entry:.6g}" for entry in row))
        for name, row in zip(variables, piece.M.tolist(), strict=True)
    ]
    W = polynomial_in_words(piece.W.terms, variables)
    return Table(("M", *states), rows), f"W(y) = {W}, y = M z"
