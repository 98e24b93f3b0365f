"""Search for the fewest breakpoints with a proved bound on the interpolation error between them.

The search uses double precision. On every cell, the tests of the checker prove enclosures of
trims, A, B and K, and bounds on their differences from the linear interpolation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from flint import arb, arb_mat

from controller.game.zero_sum import Game
from controller.hfa_game import usual_game
from controller.riccati.careful_derivations import by_schur
from controller.riccati.normal_form import NormalForm
from hfa_prove.check.game import Solution, lyapunov_operator, riccati_S, solution_on
from hfa_prove.check.schedule import interpolation_errors
from hfa_prove.check.trims import LinearModelBox, Rejected
from hfa_prove.results import InterpolatedModels
from hfa_prove.search.family import Box, Family, TrimSearch, bisected
from hfa_prove.search.game import weights_of
from hfa_prove.search.lines import find_line
from hfa_prove.search.proof import Content, Proof
from hfa_prove.statements.schedule import ModelsStatement, SolutionBox, Weights, trim_content
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress, with_progress
from verification.enclosure.balls import doubles, matrix, norm
from verification.enclosure.series import TaylorModel

#: Factors on the Newton step for the reach of the solution, tried in order. A small reach gives a
#: sharp bound but may be too small for a proof.
_REACHES = (2.5, 4.0)
#: Width of a cell, in steps of the family. Every breakpoint of a grid is an end of a cell.
_CELL = 2.0**-4
#: Width of the narrowest cell, in steps of the family.
_NARROWEST = 2.0**-8
#: Largest error of a cell with breakpoints at its own ends, as a part of the tolerance.
_LOOSE = 0.5
#: Relative enlargement of stated errors, because radii of balls have only 30 bits.
_ROUNDING = 1e-7
#: P is computed in doubles at the zeros of Chebyshev's polynomial of third order, which are 0 and
#: this value with both signs.
_ZERO = 0.75**0.5
_PARTS = ("A", "B", "inputs", "K")


@dataclass(frozen=True, eq=False)
class Cell:
    """A box of scheduling values with its proved linear model and solution of the game.

    box: the box
    linear: the linear model
    solution_box: stated enclosure of the solution
    exact: proved enclosure of the solution
    """

    box: Box
    linear: LinearModelBox
    solution_box: SolutionBox
    exact: Solution

    def at(self, s: float) -> dict[str, np.ndarray]:
        """Return A, B, the trim inputs and K at an end of the cell, name -> matrix.

        The matrices are in double precision.

        s: -1 for the lower end, 1 for the upper end
        """
        models = {
            "A": self.linear.A,
            "B": self.linear.B,
            "inputs": self.linear.inputs,
            "K": self.exact.K,
        }
        return {name: doubles(model.polynomial_at(s)) for name, model in models.items()}

    def content(self) -> Content:
        """Return the cell as stored in a certificate."""
        box = self.solution_box
        P = [doubles(part).tolist() for part in box.P.parts[:3]]
        proof = {"units": box.units, "P": P, "reach": float(box.reach)}
        return trim_content(self.linear.trim) | proof | {"H": box.line.H, "turn": box.line.turn}


@checks_arguments
def prove_models(
    family: Family, low: float, high: float, tolerance: float, *, progress: Progress | None = None
) -> Proof:
    """Return a proof of linear models that interpolate A, B, the trim inputs and K.

    K is the gain of the default game. From `low` on, each step is the longest for which every error
    is proved to be within the tolerance, at every scheduling value between the two breakpoints.
    Breakpoints are ends of cells. A cell is at most about `_CELL` steps of the family wide.

    The proof's `data` contains the breakpoints, A (g, n, n), B (g, n, m), inputs_offset (g, m),
    K (g, m, n) and `error`, the bounds of `ModelsStatement`.

    family: aircraft and its trims
    low, high: ends of the interval of the scheduling value
    tolerance: largest permitted error, as in `ModelsStatement`

    Raises NoSolutionError if a cell is not proved or its errors exceed the tolerance. Raises
    BadInputError unless low < high.
    """
    if not low < high:
        raise BadInputError(
            f"the interval is {low:g} to {high:g}; give two different finite ends, the lower first"
        )
    grid = GridSearch(family, low, high, tolerance)
    count = max(1, round((high - low) / (_CELL * family.step)))
    edges = np.linspace(low, high, count + 1).tolist()
    for box in with_progress([Box(*ends) for ends in pairwise(edges)], progress):
        grid.add(box)
    ends, errors = grid.coarsest()
    statement = replace(grid.tables(ends), errors=errors)
    data = InterpolatedModels(statement=statement, tolerance=tolerance).as_data()
    return Proof(statement, {"cells": [cell.content() for cell in grid.cells]}, data)


class GridSearch:
    """Consecutive cells of an interval, and grids whose breakpoints are ends of cells.

    family, low, high, tolerance: as for `prove_models`
    """

    def __init__(self, family: Family, low: float, high: float, tolerance: float) -> None:
        self.family = family
        self.tolerance = tolerance
        self.cells: list[Cell] = []
        self._trims = TrimSearch(family, low, high)
        self._flight = replace(self._trims.flight, trims=(self._trims.stated_trim(low),))
        first = self._trims.linear_model(Box(low, low))
        self._game = usual_game(family.model, doubles(first.A.parts[0]), doubles(first.B.parts[0]))
        self._weights = weights_of(self._game)

    def add(self, box: Box) -> None:
        """Prove the models on a box, halved as often as necessary, and append the cells.

        Raises NoSolutionError if a box of the smallest width is not proved.
        """
        for part, cell in bisected([box], self._prove, _NARROWEST * self.family.step):
            if cell is None:
                raise NoSolutionError(
                    f"the linear models from {part.low:g} to {part.high:g} "
                    f"{self.family.model.schedule_unit} cannot be bounded; leave out this part"
                )
            self.cells.append(cell)

    def _prove(self, box: Box) -> Cell | None:
        """Return the proved cell of a box, or None if the box must be halved.

        The box must be halved if the errors with breakpoints at its ends exceed `_LOOSE` times the
        tolerance, unless the box has the smallest width.

        Raises Undecided or Rejected if the trim or the solution of the game is not proved on the
        box.
        """
        linear = self._trims.linear_model(box)
        cell = self._solved(box, linear)
        if box.high - box.low > _NARROWEST * self.family.step:
            own_ends = self._tables([(cell, -1.0), (cell, 1.0)])
            errors = interpolation_errors(own_ends, linear, cell.exact)
            if max(float(error) for error in errors.values()) > _LOOSE * self.tolerance:
                return None
        return cell

    def _solved(self, box: Box, linear: LinearModelBox) -> Cell:
        """Return the cell of a box, with the proved solution of the game.

        linear: linear model on the box

        Raises Rejected if no solution is proved.
        """
        solution_box = _solution_near(self._game, self._weights, linear)
        for reach in _REACHES:
            tried = replace(solution_box, reach=arb(reach * float(solution_box.reach)))
            with suppress(Rejected):
                exact = solution_on(self._weights, linear.A, linear.B, tried, lowest=1)
                return Cell(box, linear, tried, exact)
        raise Rejected("the solution of the game is not proved on this box")

    def coarsest(self) -> tuple[list[int], dict[str, float]]:
        """Return the breakpoints of the coarsest permitted grid, and its largest errors by name.

        A breakpoint is given as the index of the cell that begins there. The last breakpoint is
        given as the number of cells.

        Raises NoSolutionError if the error on a single cell exceeds the tolerance.
        """
        ends = [0]
        largest = dict.fromkeys(_PARTS, 0.0)
        while ends[-1] < len(self.cells):
            first = ends[-1]
            last = first + 1
            errors = self._errors(first, last)
            if max(errors.values()) > self.tolerance:
                box = self.cells[first].box
                raise NoSolutionError(
                    f"no grid is proved within {self.tolerance:g}: from {box.low:g} to "
                    f"{box.high:g} {self.family.model.schedule_unit} the bound is "
                    f"{max(errors.values()):.3g}; choose a larger tolerance"
                )
            while last < len(self.cells):
                longer = self._errors(first, last + 1)
                if max(longer.values()) > self.tolerance:
                    break
                last += 1
                errors = longer
            ends.append(last)
            largest = {name: max(largest[name], errors[name]) for name in _PARTS}
        return ends, largest

    def tables(self, ends: Sequence[int]) -> ModelsStatement:
        """Return the models at breakpoints, in the form of a statement.

        ends: index of the cell that begins at each breakpoint, or the number of cells for the last
            breakpoint
        """
        count = len(self.cells)
        return self._tables(
            [(self.cells[k], -1.0) if k < count else (self.cells[-1], 1.0) for k in ends]
        )

    def _tables(self, ends: Sequence[tuple[Cell, float]]) -> ModelsStatement:
        parts = [cell.at(s) for cell, s in ends]
        tables = {name: np.array([part[name] for part in parts]) for name in _PARTS}
        breakpoints = np.array([cell.box.high if s > 0.0 else cell.box.low for cell, s in ends])
        return ModelsStatement(self._flight, self._weights, breakpoints, **tables, errors={})

    def _errors(self, first: int, last: int) -> dict[str, float]:
        """Return name -> largest error on the cells from `first` to before `last`.

        The models are interpolated between the lower end of the first and the upper end of the last
        cell.
        """
        tables = self.tables([first, last])
        largest = dict.fromkeys(_PARTS, 0.0)
        for cell in self.cells[first:last]:
            for name, error in interpolation_errors(tables, cell.linear, cell.exact).items():
                largest[name] = max(largest[name], float(error) * (1.0 + _ROUNDING))
        return largest


def _solution_near(game: Game, weights: Weights, linear: LinearModelBox) -> SolutionBox:
    """Return an unproved enclosure of the solution of the game on a box.

    The enclosure is a polynomial P(s) of degree 2, with a radius from the Newton step.

    Raises Rejected if A - S P is not proved Hurwitz at the center of the box.
    """
    middle = replace(game, A=doubles(linear.A.parts[0]), B=doubles(linear.B.parts[0]))
    units = NormalForm.of(middle).units
    T = matrix(np.diag(units))
    A = T.inv() * linear.A * T
    S = T.inv() * riccati_S(weights, linear.B) * T.inv()
    Q = T * matrix(weights.Q) * T
    before, here, after = _solutions(game, linear, units)
    slope = (after - before) / (2 * _ZERO)
    curvature = ((after + before) / 2 - here) / _ZERO**2
    P = TaylorModel(matrix(here), matrix(slope), matrix(curvature))
    loop = A - S * P
    half = (A - S * P * 0.5).transpose() * P
    residual = half + half.transpose() + Q
    inverse = matrix(np.linalg.inv(doubles(lyapunov_operator(loop.parts[0]))))
    column = arb_mat(len(units) ** 2, 1, residual.range().entries())
    reach = norm((inverse * column).entries()).upper()
    line = find_line(TaylorModel(loop.parts[0]))
    if line is None or line[0] != 0:
        raise Rejected("the solution of the game is not found on this box")
    return SolutionBox(units, P, reach, line[1])


def _solutions(game: Game, linear: LinearModelBox, units: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the symmetric solution P of the game at s = -_ZERO, 0 and _ZERO.

    units: units of the states in which P is expressed, (n,)
    """
    for s in (-_ZERO, 0.0, _ZERO):
        A, B = (doubles(model.polynomial_at(s)) for model in (linear.A, linear.B))
        form = NormalForm.of(replace(game, A=A, B=B))
        P = form.value(by_schur(form)) * np.outer(units, units)
        yield (P + P.T) / 2
