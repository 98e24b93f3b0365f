"""Exact solution of the zero-sum game on a linear model: certified, and confirmed by its cost."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.certificate import (
    Certificate,
    Certified,
    certified_solution,
)
from controller.riccati.loop_margins import LoopMargin, loop_margins, named_margins
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.meaning import meaning_checks
from controller.riccati.normal_form import NormalForm
from controller.riccati.smallest_delta import DeltaMin, smallest_delta_of, why_refused
from hfa_aircraft.names import PlantNames
from hfa_support.arguments import ArrayLike, checks_arguments, need
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Roots

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Result, Reported):
    """Value z'P z of a game, its policies u = -K z and d = L z, and its certificate.

    The smallest delta and the margins are computed when they are first used.

    P: (n, n), of the value z'P z
    K: (m, n), of the policy u = -K z
    disturbance_gain: L, (k, n), of the worst disturbance d = L z
    game: the game
    certificate: the tests that P passed
    closed_loop_eigenvalues: eigenvalues of A - B K, the loop without disturbance, 1/s
    worst_case_eigenvalues: eigenvalues of A - S P = A - B K + E L, the loop under the worst
        disturbance, 1/s
    abscissa_error: change of the largest real part of the eigenvalues of A - B K by rounding of A,
        B and K, 1/s, to first order
    meaning: checks of the cost and the L2 gain of the policies, () if they were not made

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=10.0)
    >>> solution = hfa.solve(game)
    >>> type(solution) is hfa.Solution, solution.K.shape
    (True, (1, 1))
    """

    schema = "hfa.game-solution/1"

    P: Matrix
    K: Matrix
    disturbance_gain: Matrix
    game: Game
    certificate: Certificate
    closed_loop_eigenvalues: Roots
    worst_case_eigenvalues: Roots
    abscissa_error: float
    meaning: tuple[Check, ...] = ()

    @property
    def delta(self) -> float:
        """Disturbance weight δ of the game."""
        return self.game.delta

    @property
    def names(self) -> PlantNames:
        """Names and units of the game's states and inputs."""
        return self.game.names

    @property
    def closed_loop(self) -> control.StateSpace:
        """Closed loop z' = (A - B K) z + E d as a python-control `StateSpace`.

        The inputs are the disturbances d, and the outputs are the states z.
        """
        import control

        game = self.game
        A = game.A - game.B @ self.K
        states = list(self.names.states)
        return control.ss(A, game.E, np.eye(len(A)), 0, states=states, outputs=states)

    def poles(self) -> np.ndarray:
        """Return the eigenvalues of A - B K, (n,) complex, 1/s."""
        return self.closed_loop_eigenvalues

    @property
    def is_stable(self) -> bool:
        """True if every eigenvalue of A - B K has a real part below -`abscissa_error`."""
        return bool(self.closed_loop_eigenvalues.real.max() < -self.abscissa_error)

    @cached_property
    def smallest(self) -> DeltaMin:
        """Bounds of the smallest delta that has a solution."""
        return smallest_delta_of(NormalForm.of(self.game))

    @property
    def delta_min(self) -> float:
        """Smallest delta found to have a solution, an upper bound of the exact delta_min."""
        return self.smallest.value

    @property
    def delta_margin(self) -> float:
        """Ratio delta / delta_min, or inf if delta_min is 0."""
        return self.smallest.margin(self.delta)

    @cached_property
    def loops(self) -> tuple[LoopMargin, ...]:
        """Margins at each input, with the loops of the other inputs closed."""
        return loop_margins(*self._balanced)

    @property
    def loop_margins(self) -> dict[str, dict[str, float]]:
        """Stability margins, input -> name of the margin -> value (`named_margins`)."""
        return named_margins(self.names.inputs, self.loops)

    @cached_property
    def disk_margin(self) -> DiskMargin:
        """Disk margin for all inputs together."""
        return disk_margin(*self._balanced)

    @property
    def _balanced(self) -> tuple[Game, np.ndarray]:
        """The game in normal form and its gain K there, so that margins do not depend on units."""
        solved = certified(NormalForm.of(self.game))
        balanced = solved.form.game()
        return balanced, balanced.gain(solved.X)

    def cost(self, z: ArrayLike) -> float:
        """Return z'P z, the value of the game from the initial state z, (n,).

        Raises BadInputError if z does not have shape (n,).
        """
        state = numbers_in("z", z)
        if state.shape != (len(self.P),):
            raise BadInputError(
                f"z has shape {state.shape}; give an array of shape ({len(self.P)},)"
            )
        return float(state @ self.P @ state)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "P": self.P,
            "K": self.K,
            "disturbance_gain": self.disturbance_gain,
            "states": self.game.names.states,
            "inputs": self.game.names.inputs,
            "state_units": self.game.names.state_units,
            "input_units": self.game.names.input_units,
            "certificate": self.certificate,
            "closed_loop_eigenvalues": self.closed_loop_eigenvalues,
            "worst_case_eigenvalues": self.worst_case_eigenvalues,
            "closed_loop_abscissa_error": self.abscissa_error,
            "meaning": self.meaning,
            "delta": self.delta,
            "delta_min": self.delta_min,
            "delta_margin": self.delta_margin,
            "loop_margins": self.loop_margins,
            "disk_margin": self.disk_margin,
        }

    def report(self) -> Report:
        """Return a report of the solution: P, K, eigenvalues, checks, delta_min and margins."""
        from controller.riccati.solution_report import solution_report

        return solution_report(self)


@checks_arguments
def solve(game: Game, progress: Progress | None = None) -> Solution:
    """Return the exact solution of a game, certified and confirmed (paper Section 3.1).

    A'P + P A + Q - P S P = 0,  K = R⁻¹B'P,  L = δ⁻²E'P,  S = B R⁻¹ B' - δ⁻²E E'

    With cross weights N, A is replaced by A - B R⁻¹N', Q by Q - N R⁻¹N', and K is R⁻¹(B'P + N').

    The certificate is a set of tests of P. The cost and the L2 gain of the policies confirm it. All
    tests are made in normal form. The verdict therefore does not depend on the user's units.

    game: the game
    progress: called by the search for delta_min, which runs only if there is no solution

    Raises NoSolutionError if there is no certified solution, or if the cost or L2 gain of its
    policies contradicts the certificate. The message names the mode for which no delta has a
    solution, or the failed test and delta_min.
    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> solution = hfa.solve(game)
    >>> solution.K.round(4).tolist(), round(solution.delta_min, 4)
    ([[3.0972]], 1.0)
    """
    need(game, Game, "solve: game", "a game: hfa.game(linear, Q, R, delta)")
    form = NormalForm.of(game)
    solved = certified(form, progress)
    meaning = meaning_checks(solved.form.game(), solved.X, np.ones(len(solved.X)))
    for check in meaning:
        if not check.ok:
            unconfirmed = f"certified, but not confirmed: {check.name}: {check.reason}"
            advice = smallest_delta_of(form, progress).advice(game.delta)
            raise NoSolutionError(f"{unconfirmed}; {advice}")
    return replace(solution_of(form, solved, game), meaning=meaning)


def unconfirmed_solution(game: Game) -> Solution:
    """Return the certified solution of a game without the checks of its cost and L2 gain.

    For searches and sweeps that solve many games. The arguments and errors are those of `solve`.
    """
    need(game, Game, "unconfirmed_solution: game", "a game: hfa.game(linear, Q, R, delta)")
    form = NormalForm.of(game)
    return solution_of(form, certified(form), game)


def certified(form: NormalForm, progress: Progress | None = None) -> Certified:
    """Return the certified solution of a game.

    form: normal form of the game
    progress: called by the search for delta_min, which runs only if there is no solution

    Raises NoSolutionError if there is no certified solution. The message contains the failed test
    and delta_min, or the reason why no delta has a solution.
    """
    try:
        return certified_solution(form)
    except NoSolutionError as failure:
        raise NoSolutionError(why_refused(form, str(failure), progress)) from failure


def solution_of(form: NormalForm, certified: Certified, game: Game) -> Solution:
    """Return the solution of a game in the user's coordinates.

    form: normal form of the game
    certified: certified solution of the game, possibly in other coordinates
    game: the game as the user gave it
    """
    X = certified.X
    accurate = certified.form
    P = accurate.value(X)
    P.setflags(write=False)
    return Solution(
        P=P,
        K=accurate.gain(X),
        disturbance_gain=accurate.disturbance_gain(X),
        game=game,
        certificate=certified.certificate,
        closed_loop_eigenvalues=np.sort_complex(certified.loops.control),
        worst_case_eigenvalues=np.sort_complex(certified.loops.game),
        abscissa_error=_abscissa_error(form, certified),
    )


def _abscissa_error(form: NormalForm, certified: Certified) -> float:
    """Return the change of the largest real part of the eigenvalues of A - B K by rounding, 1/s."""
    # The result is a first-order bound, or inf if A - B K is defective. Rounding affects A, B and
    # K. A change D of the matrix moves the eigenvalue with right eigenvector x and left eigenvector
    # y by y'D x / y'x. Rounding changes A by at most n ε |A|, and the gain by at most n ε |K|, in
    # the coordinates of the normal form and in those of the solution. Source: Golub and Van Loan,
    # Matrix Computations, Section 7.2.2.
    form_of_X = certified.form
    A = form_of_X.A
    B = form_of_X.B
    K = B.T @ certified.X
    _, values, right, rows = certified.loops  # rows: y with y'x = 1
    if not np.isfinite(rows).all():
        return math.inf
    x = x_in_form = turned_x = np.abs(right)
    y = y_in_form = np.abs(rows).T
    if form_of_X is not form:
        turn = form_of_X.T * form.units  # from one form to the other
        x_in_form = np.abs(np.linalg.solve(turn, right))
        turned_x = np.abs(turn) @ x_in_form
        y_in_form = np.abs(rows @ turn).T
    moved = y * ((np.abs(A) + np.abs(B) @ np.abs(K)) @ x)
    moved += y_in_form * (np.abs(form.A) @ x_in_form)
    through_gain = np.abs(rows @ B).T * (np.abs(K) @ (x + turned_x))
    rounding = len(A) * np.finfo(float).eps * (moved.sum(axis=0) + through_gain.sum(axis=0))
    return float((values.real + rounding).max() - values.real.max())
