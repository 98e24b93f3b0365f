"""Exact solution of a discrete-time game by two derivations, with a certificate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.discrete.sensitivity import gain_change_in_steps
from controller.discrete.step_form import NoValueError, StepForm
from controller.game.discrete_game import DiscreteGame
from controller.game.zero_sum import Game
from controller.riccati.balancing import largest
from controller.riccati.careful_derivations import by_refined_doubling, by_schur, unrefined
from controller.riccati.certificate import (
    INDEFINITENESS,
    RESIDUAL,
    TEST_OF_SENSITIVITY,
    Certificate,
    agreement_checks,
    checks_of,
    refuse_failures,
)
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.double_double import add, exact
from controller.riccati.existence import existence
from controller.riccati.normal_form import RANK
from controller.riccati.reach import loses_rank
from controller.riccati.smallest_delta import TOLERANCE, DeltaMin, dependence
from controller.riccati.solution_report import sensitivity_warning
from hfa_aircraft.names import PlantNames
from hfa_support.arguments import checks_arguments
from hfa_support.errors import NoSolutionError, refuse_unless_positive
from hfa_support.matrices import spectral_radius
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, at_least, at_most, below, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Roots
from hfa_support.reporting.text import controller_tables, matrix_table

#: Lower bound of the smallest eigenvalue of I - E'P E/δ².
SADDLE = 1e-12
#: Smallest permitted coupling of an unstable mode to the inputs, in a game with cross weights.
FAINT_REACH = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteSolution(Result, Reported):
    """Certified solution of a discrete-time game.

    P: matrix of the value x'P x, (n, n)
    K: gain of the optimal policy u = -K x, (m, n)
    disturbance_gain: L of the worst disturbance w = L x, (k, n)
    problem: the game
    certificate: the checks that the solution passed
    radius: spectral radius of A - B K. The policy stabilizes the plant if the radius is below 1.
    discounted_radius: spectral radius of sqrt(discount) (A - B K). The cost is finite if the radius
        is below 1.
    """

    schema = "hfa.discrete-solution/1"

    P: Matrix
    K: Matrix
    disturbance_gain: Matrix
    problem: DiscreteGame
    certificate: Certificate
    radius: float
    discounted_radius: float

    @property
    def game(self) -> Game:
        """A, B, E, Q, R and delta of one step of the game."""
        return self.problem.step

    @property
    def names(self) -> PlantNames:
        """Names of the states and inputs."""
        return self.game.names

    @property
    def discount(self) -> float:
        """Discount α of one step."""
        return self.problem.discount

    def _has_finite_cost(self, printed: dict[str, np.ndarray]) -> bool:
        """Return whether a printed gain "K" gives sqrt(discount) (A - B K) a radius below 1."""
        loop = self.game.A - self.game.B @ printed["K"]
        return math.sqrt(self.discount) * spectral_radius(loop) < 1.0

    @property
    def H(self) -> Matrix:
        """Matrix of the Q-function over (x, u, w), or over (x, u) if delta = inf."""
        return self.problem.q_function(self.P)

    @property
    def closed_loop_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K, (n,), in discrete time."""
        return np.linalg.eigvals(self.game.A - self.game.B @ self.K)

    @cached_property
    def smallest(self) -> DeltaMin:
        """Bounds of the smallest delta that has a solution."""
        return minimum_delta_discrete(self.problem)

    @property
    def delta_min(self) -> float:
        """Smallest delta found to have a solution, an upper bound of the exact delta_min."""
        return self.smallest.value

    @property
    def delta_margin(self) -> float:
        """Ratio delta / delta_min, or inf if delta_min is 0."""
        return self.smallest.margin(self.game.delta)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "P": self.P,
            "K": self.K,
            "disturbance_gain": self.disturbance_gain,
            "states": self.problem.names.states,
            "inputs": self.problem.names.inputs,
            "delta": self.problem.step.delta,
            "discount": self.problem.discount,
            "certificate": self.certificate,
            "spectral_radius": self.radius,
            "discounted_spectral_radius": self.discounted_radius,
            "H": self.H,
            "closed_loop_eigenvalues": self.closed_loop_eigenvalues,
            "delta_min": self.delta_min,
            "delta_margin": self.delta_margin,
        }

    def report(self) -> Report:
        """Return a report of the solution: P, K, spectral radii, checks and delta_min."""
        states = self.names.states
        inputs = self.names.inputs
        stabilizes = "stabilizes" if self.radius < 1.0 else "does NOT stabilize"
        return Report(
            title=f"Exact game solution in discrete time for {self.names.origin}: certified\n"
            f"delta {self.game.delta:.6g}, smallest possible {self.delta_min:.7g}, "
            f"margin {self.delta_margin:.4g}, discount {self.discount:g} a step",
            parts=(
                matrix_table("P", states, states, self.P),
                *controller_tables({"K": (inputs, states, self.K)}, self._has_finite_cost),
                f"u = -K x {stabilizes}: A - B K has the spectral radius {self.radius:.7g},"
                f" sqrt(discount) (A - B K) {self.discounted_radius:.7g}",
                *sensitivity_warning(self.certificate),
                checks_block(self.certificate.checks),
            ),
            data=self.as_data(),
        )


@checks_arguments
def sampled(game: Game, dt: float, discount: float = 1.0) -> DiscreteGame:
    """Return a sampled continuous-time game, with constant u and w in each step of dt seconds.

    The cost of a step is dt (x'Qx + 2x'Nu + u'Ru - δ² w'w) at the beginning of the step. Therefore
    the weights of the step are Q dt, R dt and N dt, and the delta of the step is √dt δ. The step
    keeps the names and the box of states of the game.

    The matrix A of a step is stored with twice the digits, and A - I is computed without
    cancellation.

    Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, Section 4.3.

    dt: sample time, s
    discount: discount of one step

    Raises BadInputError if dt is not positive.
    """
    from scipy.linalg import expm

    refuse_unless_positive("dt", dt, " s")
    n, m = game.B.shape
    rates = np.hstack([game.A, game.A, game.B, game.E])
    held = np.zeros((rates.shape[1] - n, rates.shape[1]))
    over_a_step = expm(dt * np.vstack([rates, held]))[:n]
    _, change, B, E = np.split(over_a_step, [n, 2 * n, 2 * n + m], axis=1)
    A, A_low = add(exact(np.eye(n)), exact(change))
    step = replace(
        game,
        A=A,
        B=B,
        E=E,
        Q=game.Q * dt,
        R=game.R * dt,
        delta=game.delta * math.sqrt(dt),
        N=game.N * dt,
    )
    return DiscreteGame(step, discount, A_low, continuous=game, dt=dt)


@checks_arguments
def solve_discrete(problem: DiscreteGame, progress: Progress | None = None) -> DiscreteSolution:
    """Return the certified solution of a discrete-time game.

      P = Q + α A'P A - (α A'P G + [N 0]) (W + α G'P G)⁻¹ (α G'P A + [N 0]'),
      G = [B E],  W = blkdiag(R, -δ² I)

    A saddle point requires δ² I - α E'P E > 0 and P >= 0. The eigenvalues of √α (A - B K + E L) and
    of √α (A - B K) must be inside the unit circle. Source: Basar and Bernhard, H-infinity Optimal
    Control, Theorem 3.7, for √α A, √α B, √α E.

    progress: called during the search for the smallest delta, or None. The search runs only if no
        solution is certified.

    Raises NoSolutionError if no solution is certified. The message names the mode that excludes a
    solution at any delta, or the failed test and the smallest delta.
    """
    form = StepForm.of_problem(problem)
    _refuse_unreached(problem, form)
    try:
        X, accurate, certificate = _certified(form)
        K = accurate.gain(X) + problem.step.F
        radius = spectral_radius(problem.step.A - problem.step.B @ K)
        handed_out = _gain_check(math.sqrt(problem.discount) * radius)
        refuse_failures((handed_out,))
    except NoSolutionError as failure:
        prefix = "no certified value of the game in discrete time"
        smallest = _smallest_delta(form, progress)  # raises if no delta suffices
        advice = smallest.advice(form.delta)
        raise NoSolutionError(f"{prefix}: {failure}; {advice}") from failure
    moved = form.A
    if problem.continuous is not None:  # A - I is that of the entries, times the sample time
        moved = form.A - math.sqrt(problem.discount) * np.eye(len(form.A))
    change = gain_change_in_steps(accurate, X, form, moved)
    sensitivity = checks_of(TEST_OF_SENSITIVITY, {"gain_change": change})
    refuse_failures(sensitivity)
    return DiscreteSolution(
        P=accurate.value(X),
        K=K,
        disturbance_gain=accurate.disturbance_gain(X),
        problem=problem,
        certificate=Certificate((*certificate.checks, *sensitivity, handed_out)),
        radius=radius,
        discounted_radius=math.sqrt(problem.discount) * radius,
    )


def minimum_delta_discrete(problem: DiscreteGame) -> DeltaMin:
    """Return the smallest δ for which a discrete-time game has a solution.

    The δ stored in the game has no effect.

    Raises NoSolutionError if no solution exists for any δ.
    """
    form = StepForm.of_problem(problem)
    _refuse_unreached(problem, form)
    return _smallest_delta(form)


def quick_discrete(problem: DiscreteGame) -> tuple[np.ndarray, np.ndarray]:
    """Return P and K of a discrete-time game without refinement and without a certificate.

    The function is used in searches.

    Raises NoSolutionError if no solution exists.
    """
    form = StepForm.unbalanced(problem)
    X = unrefined(form.equivalent)
    return form.value(X), form.gain(X) + problem.step.F


def value_checks(problem: DiscreteGame, P: np.ndarray) -> tuple[Check, ...]:
    """Return the six checks of `_checks` for a given matrix P (n, n) of the value x'P x."""
    form = StepForm.of_problem(problem)
    back = np.linalg.inv(form.T)
    return _checks(form, back.T @ P @ back)


def bellman_residual(problem: DiscreteGame, P: np.ndarray) -> float:
    """Return the residual of Bellman's equation at P (n, n), relative to the largest term."""
    return value_checks(problem, P)[0].value


class _Certified(NamedTuple):
    """Certified solution of a game in normal form."""

    X: np.ndarray  # solution of the Riccati equation of `form`, (n, n)
    form: StepForm  # the game, in the coordinates in which X is accurate
    certificate: Certificate  # the checks that X passed


def _certified(form: StepForm) -> _Certified:
    """Return the certified solution X of the Riccati equation of a game."""
    try:
        form = form.turned()
        X = form.refined(by_schur(form.equivalent))
        checks = _checks(form, X)
        refuse_failures(checks)
        checks += agreement_checks(X, form.refined(by_refined_doubling(form.equivalent)))
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(
            "delta^2 I - discount E'P E becomes singular during the iteration"
        ) from error
    refuse_failures(checks)
    return _Certified(X, form, Certificate(checks))


def _checks(form: StepForm, X: np.ndarray) -> tuple[Check, ...]:
    """Return the six checks of a solution X of the Riccati equation."""
    gains = form.policies(X)
    size = float(largest(X)) or 1.0
    loop = form.A - form.B @ gains.K
    terms = np.abs(form.Q) + np.abs(gains.K.T @ gains.K) + np.abs(X)
    terms = terms + np.abs(loop.T) @ np.abs(X) @ np.abs(loop)
    step = form.newton_step(X)
    residual = float(largest(step.residual) / (terms.max() or 1.0))
    error = float(largest(step.correction)) / size
    smallest = float(np.linalg.eigvalsh(X)[0]) / size
    saddle = np.eye(form.E.shape[1]) - form.E.T @ X @ form.E
    paid = float(np.linalg.eigvalsh((saddle + saddle.T) / 2.0).min(initial=1.0))
    game_radius = spectral_radius(loop + form.E @ gains.L)
    radius = spectral_radius(loop)
    unsolved = f"the residual of Bellman's equation is {residual:.2g}"
    moved = f"a Newton step changes P by {error:.2g}"
    indefinite = f"P is indefinite ({smallest:.3g} of its size)"
    unpaid = "delta^2 I - discount E'P E is not positive definite"
    worst_case = f"sqrt(discount) (A - B K + E L) has radius {game_radius:.6g}"
    unstable = f"sqrt(discount) (A - B K) has radius {radius:.6g}"
    return (
        at_most("residual", residual, RESIDUAL, unsolved),
        at_most("newton_correction", error, RESIDUAL, moved),
        at_least("positive_semidefinite", smallest, -INDEFINITENESS, indefinite),
        at_least("disturbance_pays", paid, SADDLE, unpaid),
        below("game_loop_radius", game_radius, 1.0, worst_case),
        below("control_loop_radius", radius, 1.0, unstable),
    )


def _gain_check(radius: float) -> Check:
    """Return the check that the gain K in the user's coordinates stabilizes the discounted loop."""
    reason = f"sqrt(discount) (A - B K) of the returned K has radius {radius:.6g}"
    return below("gain_radius", radius, 1.0, reason)


def _refuse_unreached(problem: DiscreteGame, form: StepForm) -> None:
    """Raise NoSolutionError if a mode of sqrt(discount) A does not decay and is uncontrollable."""
    # The test uses A and B of the plant, because rounding of A - B R⁻¹ N' couples every mode to the
    # inputs. If N is not 0, a mode that is coupled to the inputs by at most `FAINT_REACH` is also
    # refused, because P would have no correct digits.
    root = math.sqrt(problem.discount)
    A = form.T @ (root * problem.step.A) @ np.linalg.inv(form.T)
    B = form.T @ problem.step.B
    size = float(np.linalg.norm(A, 2)) or 1.0
    for value in np.linalg.eigvals(A):
        if abs(value) < 1.0 - RANK:
            continue
        is_faint = problem.step.N.any() and dependence(A, value, B.T, size) <= FAINT_REACH
        if is_faint or loses_rank(A, B.T, value, _not_shrinking):
            raise NoSolutionError(_unreached(value))


def _not_shrinking(values: np.ndarray) -> np.ndarray:
    """Return for each eigenvalue the nearest point on or outside the unit circle."""
    return values / np.minimum(np.abs(values), 1.0)


def _unreached(value: complex) -> str:
    """Return the message that no input reaches the mode with the given eigenvalue."""
    return (
        f"no input reaches the {_mode_text(value)} of sqrt(discount) A, which does not decay;"
        " change B or lower the discount"
    )


def _mode_text(value: complex) -> str:
    """Return a phrase that names the mode, such as "mode with eigenvalue 1.1 ± 0.2i"."""
    text = f"mode with eigenvalue {value.real:.4g}"
    return f"{text} ± {abs(value.imag):.4g}i" if value.imag else text


def _smallest_delta(form: StepForm, progress: Progress | None = None) -> DeltaMin:
    """Return the smallest δ for which a game has a value, found by bisection of log δ."""
    without = form.with_delta(math.inf)
    try:
        X, accurate, _ = _certified(without)
    except NoSolutionError as failure:
        raise NoSolutionError(_obstacle(without, str(failure))) from failure
    attack = accurate.disturbance.T @ X @ accurate.disturbance
    most = float(np.linalg.eigvalsh((attack + attack.T) / 2.0).max(initial=0.0))
    if most <= 0.0:
        return DeltaMin(0.0, 0.0)

    def existence_at(delta: float) -> Answer:
        return _existence(accurate.with_delta(delta))

    value, refused, _ = smallest_delta(existence_at, 2.0 * math.sqrt(most), TOLERANCE, progress)
    return DeltaMin(value, refused)


def _existence(form: StepForm) -> Answer:
    """Return whether a game has a value at its δ, and the reason if the game has no value."""
    # A value exists if the equivalent continuous-time game has a value and δ² I - α E'P E > 0. The
    # answer is None if the computation fails, or if rounding hides the sign.
    try:
        answer = existence(form.equivalent)
        if not answer.exists:
            return answer
        X = form.refined(by_schur(form.equivalent))
    except NoValueError as shown:
        return Answer(False, str(shown))
    except (NoSolutionError, np.linalg.LinAlgError) as failure:
        return Answer(None, str(failure))
    attack = form.E.T @ X @ form.E
    paid = float(np.linalg.eigvalsh(np.eye(len(attack)) - (attack + attack.T) / 2.0).min())
    rounding = SADDLE * max(1.0, float((np.abs(form.E).T @ np.abs(X) @ np.abs(form.E)).max()))
    if paid > rounding:
        return Answer(True)
    if paid < -rounding:
        return Answer(False, "delta^2 I - discount E'P E is not positive definite")
    return Answer(None, "rounding hides whether delta^2 I - discount E'P E is positive definite")


def _obstacle(form: StepForm, failure: str) -> str:
    """Return one line that explains why a game has no solution even without disturbance."""
    size = float(np.linalg.norm(form.A, 2)) or 1.0
    for value in np.linalg.eigvals(form.A):
        if abs(value) < 1.0 - RANK:
            continue
        if dependence(form.A, value, form.B.T, size) <= RANK:
            return _unreached(value)
        is_undamped = abs(value) <= 1.0 + RANK
        if is_undamped and dependence(form.A.T, value, form.Q, size) <= RANK:
            return (
                f"the {_mode_text(value)} of sqrt(discount) A neither decays nor grows and"
                " has no cost: no P stabilizes it; give it weight in Q"
            )
    return f"the game without disturbance (delta = inf) is not certified: {failure}"
