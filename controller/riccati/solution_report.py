"""Exact solution of a game with the cost of its policies, its margins, and its report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.game.linear_game import game as game_on
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution, certified, solution_of
from controller.riccati.loop_margins import LoopMargin, loop_margins, named_margins
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.meaning import meaning_checks
from controller.riccati.normal_form import NormalForm
from controller.riccati.smallest_delta import DeltaMin, smallest_delta_of
from hfa_support.arguments import ArrayLike, checks_arguments
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.linear_model import LinearModel


@dataclass(frozen=True, eq=False, repr=False)
class AnalysedGame(Solution):
    """Certified solution with the smallest delta, the cost of its policies and its margins.

    smallest: bounds of the smallest delta
    meaning: checks of the cost and the L2 gain of the policies
    loops: margins of each input
    disk_margin: disk margin for all inputs together
    """

    schema = "hfa.game-solution/1"
    made_by = "hfa solve"
    json_keys = (
        f"states=names.states inputs=names.inputs {Solution.json_keys} delta_min delta_margin "
        "meaning loop_margins disk_margin state_units=names.state_units "
        "input_units=names.input_units"
    )

    smallest: DeltaMin
    meaning: tuple[Check, ...]
    loops: tuple[LoopMargin, ...]
    disk_margin: DiskMargin

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield K, P and the poles, for the assignment K, P, poles = hfa.lqr(A, B, Q, R)."""
        return iter((self.K, self.P, self.poles()))

    def __getitem__(self, place: int) -> np.ndarray:
        """Return K for place 0, P for 1, and the poles for 2."""
        return (*self,)[place]

    @property
    def delta_min(self) -> float:
        """Smallest delta found to have a solution, an upper bound of the exact delta_min."""
        return self.smallest.value

    @property
    def delta_margin(self) -> float:
        """Ratio delta / delta_min, or inf if delta_min is 0."""
        return self.smallest.margin(self.delta)

    @property
    def loop_margins(self) -> dict[str, dict[str, float]]:
        """Stability margins, input -> name of the margin -> value (`named_margins`)."""
        return named_margins(self.names.inputs, self.loops)

    def report(self) -> Report:
        """Return a report of the solution with delta_min, the checked cost of the policies, and the
        margins."""
        solved = super().report()
        disk = self.disk_margin
        doubt = ""
        if self.smallest.uncertain:
            doubt = f" (not decided, because of rounding, down to {self.smallest.refused:.7g})"
        return replace(
            solved,
            title=(
                f"Exact game solution for {self.names.origin}: certified\n"
                f"delta {self.delta:.6g}, smallest possible {self.delta_min:.7g}"
                f"{doubt}, margin {self.delta_margin:.4g}"
            ),
            parts=(
                *solved.parts,
                checks_block(self.meaning),
                _margins_table(self),
                f"All inputs at once: disk {disk.disk:.4g}, gain {disk.gain:.4g},"
                f" phase {disk.phase:.4g} deg, at {disk.frequency:.4g} rad/s",
            ),
            data=self.as_data(),
        )

    @property
    def solution(self) -> Solution:
        """The object itself, under the name that version 0.3 used for the solution."""
        return self


@checks_arguments
def solve(game: Game, progress: Progress | None = None) -> AnalysedGame:
    """Return the certified solution of a game with its smallest delta, cost and margins.

    All checks are made in normal form. The verdict therefore does not depend on the user's units.

    progress: called during the search for delta_min, or None

    Raises NoSolutionError if the game is not certified, or if the cost or L2 gain of its policies
    contradicts the certificate.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=2.0)
    >>> round(hfa.solve(game).delta_min, 4)
    1.0
    """
    form = NormalForm.of(game)
    solved = certified(form, progress)
    smallest = smallest_delta_of(form, progress)
    balanced = solved.form.game()
    K = balanced.gain(solved.X)
    meaning = meaning_checks(balanced, solved.X, np.ones(len(solved.X)))
    for check in meaning:
        if not check.ok:
            unconfirmed = f"certified, but not confirmed: {check.name}: {check.reason}"
            raise NoSolutionError(f"{unconfirmed}; {smallest.advice(game.delta)}")
    return AnalysedGame(
        **vars(solution_of(form, solved, game)),
        smallest=smallest,
        meaning=meaning,
        loops=loop_margins(balanced, K),
        disk_margin=disk_margin(balanced, K),
    )


@checks_arguments
def lqr(linear: LinearModel | ArrayLike, *more: Any, **weights: Any) -> AnalysedGame:
    """Return the linear-quadratic regulator u = -K z of a linear model, or of A and B.

    The function is called as lqr(linear, Q, R) or lqr(A, B, Q, R). The regulator is the solution of
    the game without disturbance, `hfa.game(linear, Q, R)`.

    linear: the linear model, or A
    more: B after A, then Q and R, as for `hfa.game`
    weights: Q and R as keyword arguments

    Raises BadInputError if B is missing or a weight does not fit, and NoSolutionError if there is
    no certified solution.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> hfa.lqr(hfa.linearize(model, hfa.find_operating_point(model))).K.shape
    (5, 6)
    """
    if not isinstance(linear, LinearModel):
        if not more:
            raise BadInputError("lqr: B is missing; call lqr(A, B, Q, R)")
        linear = LinearModel(np.asarray(linear), more[0])
        more = more[1:]
    return regulator(linear, *more, **weights)


@checks_arguments
def regulator(linear: LinearModel, Q: Any = None, R: Any = None) -> AnalysedGame:
    """Return the linear-quadratic regulator of a linear model with A and B, as an exact solution.

    Q, R: as for `hfa.game`
    """
    return solve(game_on(linear, Q, R))


def _margins_table(analysed: AnalysedGame) -> Table:
    """Return a table with the gain, phase and disk margins of each input."""
    inputs = analysed.names.inputs
    rows = []
    for name, loop in zip(inputs, analysed.loops, strict=True):
        gain = f"{loop.gain_low:.3g} to {loop.gain_high:.3g}"
        rows.append((name, gain, f"{loop.phase:.4g}", f"{loop.disk:.4g}"))
    return Table(("margins at the input", "gain", "phase deg", "disk"), rows)
