"""Comparison of printed and exact numbers, in half units of the last printed digit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from studies.published.exact_answer import Plant, answer_change, answer_of
from studies.published.printed_file import PrintedFile

#: Accuracy of answers printed with 15 to 17 digits, relative to the largest entry of their block.
FLOOR = 1e-12
#: Blocks that are symmetric.
_SYMMETRIC = ("P", "H")


class Position(NamedTuple):
    """Position of an entry in a matrix.

    block: name of the matrix, such as "A".
    row, column: counted from 0.
    """

    block: str
    row: int
    column: int

    def __str__(self) -> str:
        if self.block == "gamma":
            return self.block
        separator = "," if max(self.row, self.column) >= 9 else ""
        return f"{self.block}{self.row + 1}{separator}{self.column + 1}"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Printed entries of an answer and their exact values.

    positions: positions of the N entries
    printed: printed values, (N,)
    exact: exact values with the printed sign convention, (N,)
    half_units: half a unit of the last printed digit, (N,)
    allowed: tolerance, (N,), the half unit or a larger minimum for rounding errors
    """

    positions: tuple[Position, ...]
    printed: np.ndarray
    exact: np.ndarray
    half_units: np.ndarray
    allowed: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """|printed - exact| divided by the tolerance, (N,). Right digits give at most 1."""
        return np.abs(self.printed - self.exact) / np.maximum(self.allowed, 1e-300)

    @property
    def outside(self) -> np.ndarray:
        """Mask (N,) of the wrong entries: |printed - exact| exceeds the tolerance."""
        return np.abs(self.printed - self.exact) > self.allowed

    @property
    def wrong_positions(self) -> list[Position]:
        """Positions of the wrong entries in ascending order.

        Of two mirrored entries of a symmetric matrix, only the position in the upper triangle is
        listed.
        """
        wrong = {_mirrored(self.positions[index]) for index in np.flatnonzero(self.outside)}
        return sorted(wrong)

    def relative(self, block: str) -> float:
        """Return the relative error |printed - exact| / |exact| of a matrix in Frobenius norms.

        If the exact matrix is 0, the result is |printed|.

        block: name of the matrix
        """
        members = np.array([position.block == block for position in self.positions])
        size = float(np.linalg.norm(self.exact[members])) or 1.0
        return float(np.linalg.norm((self.printed - self.exact)[members])) / size

    @property
    def relative_error(self) -> float:
        """Largest relative error of the printed matrices."""
        return max(
            self.relative(block) for block in {position.block for position in self.positions}
        )

    def evidence(self) -> np.ndarray:
        """Return log₁₀ max(1, r) for the error r of each entry, the largest first.

        Two mirrored entries of a symmetric matrix count once, with the larger error.
        """
        terms: dict[Position, float] = {}
        for position, error in zip(self.positions, self.errors, strict=True):
            upper = _mirrored(position)
            terms[upper] = max(terms.get(upper, 0.0), float(np.log10(max(1.0, error))))
        return np.array(sorted(terms.values(), reverse=True))


def compare(file: PrintedFile, plant: Plant, P: np.ndarray) -> Comparison:
    """Return the comparison of the printed answer with the answer of a plant.

    P: matrix of the plant's value x'P x, (n, n)
    """
    return compare_answer(file, answer_of(plant, P))


def compare_answer(file: PrintedFile, answer: Mapping[str, np.ndarray]) -> Comparison:
    """Return the comparison of the printed answer with another answer.

    answer: name of a matrix -> matrix
    """
    positions = []
    allowed = []
    for name, block in file.answer.items():
        floor = FLOOR * float(np.abs(answer[name]).max(initial=0.0))
        allowed.append(np.maximum(block.half_units, floor).ravel())
        for row, column in np.ndindex(block.values.shape):
            positions.append(Position(name, row, column))
    blocks = file.answer.values()
    return Comparison(
        positions=tuple(positions),
        printed=np.concatenate([block.values.ravel() for block in blocks]),
        exact=in_signs(file, answer),
        half_units=np.concatenate([block.half_units.ravel() for block in blocks]),
        allowed=np.concatenate(allowed),
    )


def change(file: PrintedFile, plant: Plant, P: np.ndarray, position: Position) -> np.ndarray:
    """Return the derivative of `Comparison.exact` with respect to one entry of the plant, (N,).

    P: matrix of the plant's value x'P x, (n, n)
    position: position of the entry
    """
    return in_signs(file, answer_change(plant, P, *position))


def in_signs(file: PrintedFile, answer: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return those entries of an answer that are printed, (N,), with the printed signs.

    answer: name of a matrix -> matrix or stack of matrices. A stack gives a stack of results.
    """
    rows = []
    for name in file.answer:
        matrix = answer[name]
        row = matrix.reshape(*matrix.shape[:-2], -1)
        rows.append(file.signs.get(name, 1.0) * row)
    return np.concatenate(rows, axis=-1)


def _mirrored(position: Position) -> Position:
    """Return the position in the upper triangle for an entry of a symmetric matrix, P or H."""
    if position.block in _SYMMETRIC and position.row > position.column:
        return Position(position.block, position.column, position.row)
    return position
