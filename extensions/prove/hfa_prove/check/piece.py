"""Polynomial W about an equilibrium, and the set where W is at most c.

z are the deviations of the states from the equilibrium, and y = M z. The set is {W(y) <= c} within
the cube |y_i| <= 1. Each proof requires W > c on every box that meets a face of the cube.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_prove.check.cover import Boxes, Question, cover
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.enclosure.balls import doubles, matrix
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.taylor import TaylorProgram, amounts_by_edge, lowest
from hfa_prove.fields import Rejected
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.piece import Piece
from hfa_support.progress import Progress

#: Largest error of a few sums and products of doubles, relative to the sizes of the terms.
ROUNDING = 1e-13
#: Largest difference between the numbers of halvings of two edges of a box.
_FLATTEST = 4


class Symbols(NamedTuple):
    """Symbols in which the functions of a proof are written.

    y: coordinates, (n,)
    z: deviations of the states from the equilibrium, (n,)
    e: error of the computed equilibrium, (n,)
    """

    y: ca.SX
    z: ca.SX
    e: ca.SX


@dataclass(frozen=True, eq=False)
class OnPiece(Question):
    """Property of a closed loop on the set of a piece, decided box by box.

    loop: the closed loop with its limits
    equilibrium: enclosure of its equilibrium
    piece: the set
    """

    loop: Loop
    equilibrium: Equilibrium
    piece: Piece

    @property
    def n(self) -> int:
        """Number of states, which is the dimension of the boxes."""
        return len(self.piece.M)

    @abstractmethod
    def check_limits(self) -> None:
        """Raise Rejected if a limit is exceeded that is checked without subdivision into boxes."""

    def proved(self, most: int, progress: Progress | None = None) -> int:
        """Prove the property and return the number of boxes that were evaluated.

        most: number of boxes after which the proof stops

        Raises Rejected if the property is not proved.
        """
        self.loop.check_held()
        self.check_limits()
        return cover(self, most, progress)

    @cached_property
    def inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """Approximate inverse of M and a bound of its error, (n, n) each.

        Raises Rejected if M is singular.
        """
        try:
            exact = matrix(self.piece.M).inv()
        except ZeroDivisionError as error:
            raise Rejected("the matrix M of the coordinates y = M z is singular") from error
        N = doubles(exact)
        radius = np.array([[float(entry.rad()) for entry in row] for row in exact.tolist()])
        return N, (radius + 1e-15 * np.abs(N)) * (1.0 + ROUNDING)

    def within(self, places: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of the points in the set with all states within their limits.

        A point is in the set if W <= c, computed in double precision.

        places: points y, (N, n)
        """
        low, high = self.loop.ends(self.loop.states).T
        x = self.equilibrium.x + places @ self.inverse[0].T
        is_allowed = np.all((low <= x) & (x <= high), axis=1)
        return np.asarray(is_allowed & (self.piece.W.at(places) <= self.piece.c))

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        """Return the mask (N,) of the boxes on which W > c is proved."""
        level = self._level.over(boxes.centres, boxes.half_widths)
        return np.asarray(lowest(level, self.n)[0] > self.piece.c)

    def decisive_edges(self, boxes: Boxes, lowered_by: np.ndarray) -> np.ndarray:
        """Return the index of the edge to halve for each box, (N,).

        - Box about the equilibrium: the longest edge.
        - Box that meets a face of the cube: the edge with the largest effect on the lower bound of
          W.
        - Other boxes: the edge with the largest effect on the lower bound of the undecided
          function.

        Edges with more than `_FLATTEST` halvings above the least halved edge are excluded.

        lowered_by: (N, n), amount by which each edge lowers the lower bound of the undecided
            function
        """
        half_widths = boxes.half_widths
        sizes = np.where(np.isfinite(lowered_by), lowered_by, half_widths)
        on_face = np.flatnonzero(boxes.reach >= 1.0)
        if len(on_face):
            level = self._level.over(boxes.centres[on_face], half_widths[on_face])
            with np.errstate(all="ignore"):
                sizes[on_face] = amounts_by_edge(level, self.n)[0].T
        about_zero = np.all(np.abs(boxes.centres) <= half_widths, axis=1)
        sizes[about_zero] = half_widths[about_zero]
        is_short = boxes.depths > boxes.depths.min(axis=1, keepdims=True) + _FLATTEST
        return np.argmax(np.where(is_short, -np.inf, sizes), axis=1)

    @cached_property
    def _level(self) -> TaylorProgram:
        """Program y -> W, for Taylor models."""
        y = ca.SX.sym("y", self.n)
        function = ca.Function("W", [y], [self.piece.W.expressions(y)[0]])
        return TaylorProgram(Program(function, self.loop.model.name), self.n)

    @cached_property
    def symbols(self) -> Symbols:
        """Symbols in which the functions of the proof are written."""
        return Symbols(*(ca.SX.sym(name, self.n) for name in "yze"))

    def program(self, outputs: Sequence[ca.SX]) -> Program:
        """Return the program that evaluates expressions in the symbols."""
        inputs = ca.vertcat(*self.symbols)
        function = ca.Function("f", [inputs], [ca.densify(ca.vertcat(*outputs))])
        return Program(function, self.loop.model.name)

    def taylor(self, outputs: Sequence[ca.SX]) -> TaylorProgram:
        """Return the program for Taylor models of expressions in the symbols, over boxes of y."""
        return TaylorProgram(self.program(outputs), self.n)

    def symbols_on(self, boxes: Boxes) -> tuple[np.ndarray, np.ndarray]:
        """Return linear models of the symbols on boxes.

        The models are coefficients (symbols, 1 + n, boxes) and radii (symbols, boxes).
        """
        n = self.n
        N, off = self.inverse
        centres = boxes.centres.T
        half_widths = boxes.half_widths.T
        linear = np.zeros((3 * n, 1 + n, len(boxes.centres)))
        radius = np.zeros((3 * n, len(boxes.centres)))
        linear[:n, 0] = centres
        linear[np.arange(n), np.arange(1, n + 1)] = half_widths
        linear[n : 2 * n, 0] = N @ centres
        linear[n : 2 * n, 1:] = N[:, :, None] * half_widths[None]
        sizes = np.abs(centres) + half_widths
        radius[n : 2 * n] = ((off + 1e-15 * (n + 2) * np.abs(N)) @ sizes) * (1.0 + ROUNDING)
        radius[2 * n :] = self.equilibrium.radius[:, None]
        return linear, radius
