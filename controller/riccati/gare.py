"""Exact solution of a zero-sum game, in continuous or in discrete time, with its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from controller.game.q_function import q_function
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum, stability
from controller.riccati.certificate import Certificate, Certified, certified_solution, form_of
from controller.riccati.form import Form
from controller.riccati.loop_margins import LoopMargin, loop_margins, named_margins
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.meaning import bounded_real_gain, meaning_checks
from controller.riccati.smallest_delta import DeltaMin, smallest_delta_of, why_refused
from hfa_aircraft.names import PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Roots, without_empty

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
    certified: P in the coordinates in which the game was solved, with the tests that it passed
    meaning: checks of the cost and the L2 gain of the policies, () if they were not made

    The eigenvalues of a game in discrete time are those of a step. With a discount, the optimal
    policy may not stabilize the plant (`is_stable`).

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
    certified: Certified
    meaning: tuple[Check, ...] = ()

    @property
    def L(self) -> Matrix:
        """Gain L of the worst disturbance d = L z, (k, n), as `disturbance_gain`."""
        return self.disturbance_gain

    @property
    def certificate(self) -> Certificate:
        """The tests that P passed."""
        return self.certified.certificate

    @property
    def delta(self) -> float:
        """Disturbance weight δ of the game."""
        return self.game.delta

    @property
    def discount(self) -> float | None:
        """Discount α of one step, or None in continuous time."""
        return self.game.discount if self.game.is_discrete else None

    @property
    def spectral_radius(self) -> float | None:
        """Spectral radius of A - B K in discrete time, otherwise None."""
        return float(np.abs(self.poles()).max()) if self.game.is_discrete else None

    @property
    def H(self) -> Matrix | None:
        """Matrix of the Q-function over (x, u, w), or (x, u), in discrete time, otherwise None."""
        return q_function(self.game, self.P) if self.game.is_discrete else None

    @property
    def price(self) -> np.ndarray:
        """Weight of u - u* in the cost above V*: R, in discrete time R + α B'P B, (m, m)."""
        return self.game.price(self.P)

    @property
    def names(self) -> PlantNames:
        """Names and units of the game's states and inputs."""
        return self.game.names

    @cached_property
    def l2_gain(self) -> float:
        """L2 gain of the closed loop with u = -K z, from d to the cost (`bounded_real_gain`)."""
        return bounded_real_gain(self.game, self.K)

    @cached_property
    def closed_loop_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K, the loop without disturbance, (n,), 1/s."""
        return spectrum(self.game.A - self.game.B @ self.K)

    @cached_property
    def worst_case_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K + E L, the loop under the worst disturbance, (n,), 1/s."""
        worst = self.game.E @ self.disturbance_gain - self.game.B @ self.K
        return spectrum(self.game.A + worst)

    @property
    def closed_loop(self) -> control.StateSpace:
        """Closed loop z' = (A - B K) z + E d as a python-control `StateSpace`.

        The inputs are the disturbances d, and the outputs are the states z.
        """
        import control

        game = self.game
        A = game.A - game.B @ self.K
        states = list(self.names.states)
        time = {"states": states, "outputs": states, "dt": game.dt or 0}
        return control.ss(A, game.E, np.eye(len(A)), 0, **time)

    def __iter__(self) -> NoReturn:
        raise BadInputError("no tuple; write solution.K, solution.P, solution.poles()")

    def poles(self) -> np.ndarray:
        """Return the eigenvalues of A - B K, (n,) complex, 1/s."""
        return self.closed_loop_eigenvalues

    @property
    def is_stable(self) -> bool:
        """True if A - B K is stable."""
        game = self.game
        loop = game.A - game.B @ self.K
        return stability(loop, is_discrete=game.is_discrete).is_stable

    @cached_property
    def smallest(self) -> DeltaMin:
        """Bounds of the smallest delta that has a solution."""
        return smallest_delta_of(form_of(self.game))

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
        """Margins at each input, with the loops of the other inputs closed; () if not stable."""
        return loop_margins(self.game, self.K) if self.is_stable else ()

    @property
    def loop_margins(self) -> dict[str, dict[str, float]] | None:
        """Stability margins, input -> name of the margin -> value (`named_margins`), or None."""
        return named_margins(self.names.inputs, self.loops) if self.loops else None

    @cached_property
    def disk_margin(self) -> DiskMargin | None:
        """Disk margin for all inputs together, or None without stability."""
        return disk_margin(self.game, self.K) if self.is_stable else None

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

    def _entries(self) -> dict[str, Any]:
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
            "meaning": self.meaning,
            "delta": self.delta,
            "delta_min": self.delta_min,
            "delta_margin": self.delta_margin,
        } | without_empty(
            discount=self.discount,
            spectral_radius=self.spectral_radius,
            H=self.H,
            loop_margins=self.loop_margins,
            disk_margin=self.disk_margin,
        )

    def report(self) -> Report:
        """Return a report of the solution (`controller.solution_report`)."""
        import controller

        return controller.solution_report(self)


def solve(game: Game, progress: Progress | None = None) -> Solution:
    """Return the exact solution of a game, certified and confirmed (paper Section 3.1).

    A'P + P A + Q - P S P = 0,  K = R⁻¹B'P,  L = δ⁻²E'P,  S = B R⁻¹ B' - δ⁻²E E'

    In discrete time, with G = [√α B  √α E/δ] and W = blkdiag(R, -I):

    P = Q + α A'P A - √α A'P G (W + G'P G)⁻¹ √α G'P A,  [K; -δL] = (W + G'P G)⁻¹ √α G'P A

    With cross weights N, A is replaced by A - B R⁻¹N', Q by Q - N R⁻¹N', and K is R⁻¹(B'P + N').

    The certificate is a set of tests of P. The cost and the L2 gain of the policies confirm it. All
    tests are made in balanced units. The verdict therefore does not depend on the user's units.

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
    form = form_of(game)
    solved = certified(form, progress)
    meaning = meaning_checks(solved.form, solved.X)
    for check in meaning:
        if not check.ok:
            unconfirmed = f"certified, but not confirmed: {check.name}: {check.reason}"
            advice = smallest_delta_of(form, progress).advice(game.delta)
            raise NoSolutionError(f"{unconfirmed}; {advice}")
    return solution_of(solved, game, meaning)


def unconfirmed_solution(game: Game) -> Solution:
    """Return the certified solution of a game without the checks of its cost and L2 gain.

    For searches and sweeps that solve many games. The arguments and errors are those of `solve`.
    """
    return solution_of(certified(form_of(game)), game)


def certified(form: Form, progress: Progress | None = None) -> Certified:
    """Return the certified solution of a game.

    form: form of the game
    progress: called by the search for delta_min, which runs only if there is no solution

    Raises NoSolutionError if there is no certified solution. The message contains the failed test
    and delta_min, or the reason why no delta has a solution.
    """
    try:
        return certified_solution(form)
    except NoSolutionError as failure:
        raise NoSolutionError(why_refused(form, str(failure), progress)) from failure


def solution_of(certified: Certified, game: Game, meaning: tuple[Check, ...] = ()) -> Solution:
    """Return the solution of a game in the user's coordinates.

    certified: certified solution of the game
    game: the game as the user gave it
    meaning: checks of the cost and the L2 gain, () if they were not made
    """
    P = certified.form.value(certified.X)
    K, L = certified.form.policies(certified.X)
    P.setflags(write=False)
    return Solution(P, K, L, game, certified, meaning)
