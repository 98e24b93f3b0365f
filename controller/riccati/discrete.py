"""The exact solution of a game in discrete time, by two derivations, with a certificate."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from controller.game.discrete_game import DiscreteGame
from controller.game.names import PlantNames
from controller.game.zero_sum import Game
from controller.riccati.certificate import (
    DISAGREEMENT,
    INDEFINITENESS,
    RESIDUAL,
    Certificate,
    refuse_failures,
)
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.derivations import largest
from controller.riccati.discrete_derivations import (
    NoValueError,
    by_doubling,
    by_precise_doubling,
    by_symplectic_pencil,
    newton_step,
    policies,
    refined,
)
from controller.riccati.normal_form import RANK, NormalForm
from controller.riccati.smallest_delta import TOLERANCE, DeltaMin, dependence
from hfa_support.errors import NoSolutionError, refuse_unless_positive
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.fields import Shown

#: δ² I - E'P E, relative to δ², must exceed this.
SADDLE = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteSolution(Shown):
    """The value x'P x of a game in discrete time, its policies u = -K x and w = L x.

    P: (n, n)
    K: (m, n)
    disturbance_gain: L, (k, n)
    problem: the game
    certificate: the tests that hold
    radius: the spectral radius of A - B K, which decides whether the policy stabilizes
    discounted_radius: of sqrt(discount) (A - B K), on which the cost depends
    """

    P: np.ndarray
    K: np.ndarray
    disturbance_gain: np.ndarray
    problem: DiscreteGame
    certificate: Certificate
    radius: float
    discounted_radius: float

    @property
    def game(self) -> Game:
        """A, B, E, Q, R, delta of one step of time."""
        return self.problem.step

    @property
    def names(self) -> PlantNames:
        """What the states and inputs are called."""
        return self.game.names

    @property
    def discount(self) -> float:
        """α of a step."""
        return self.problem.discount

    @property
    def H(self) -> np.ndarray:
        """The Q-function over (x, u, w), `DiscreteGame.q_function`."""
        return self.problem.q_function(self.P)


def sampled(game: Game, dt: float) -> Game:
    """The game of one step: u and w are held for dt seconds, and a step costs dt (x'Qx + u'Ru - δ²
    w'w) at its start.

    [A B E] of the step are those of exp([[A, B, E], [0, 0, 0]] dt); its weights Q dt and R dt, its
    delta √dt δ. Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, Section
    4.3."""
    from scipy.linalg import expm

    refuse_unless_positive("dt", dt, " s")
    n, m = game.B.shape
    moved = np.hstack([game.A, game.B, game.E])
    held = np.zeros((moved.shape[1] - n, moved.shape[1]))
    step = expm(dt * np.vstack([moved, held]))[:n]
    A, B, E = np.split(step, [n, n + m], axis=1)
    return Game(A=A, B=B, E=E, Q=game.Q * dt, R=game.R * dt, delta=game.delta * math.sqrt(dt))


def solve_discounted(game: Game, discount: float, dt: float | None = None) -> DiscreteSolution:
    """`solve_discrete` of one step of time, or with dt (s) of a game in continuous time, which is
    `sampled`."""
    step = game if dt is None else sampled(game, dt)
    return solve_discrete(DiscreteGame(step, discount))


def solve_discrete(problem: DiscreteGame, progress: Progress | None = None) -> DiscreteSolution:
    """P = Q + α A'P A - (α A'P G + [N 0]) (W + α G'P G)⁻¹ (α G'P A + [N 0]'),  G = [B E],  W =
    blkdiag(R, -δ² I).

    With δ² I - α E'P E > 0 and P >= 0 the saddle point exists; √α (A - B K + E L) must have its
    eigenvalues within the unit circle, and so must √α (A - B K). NoSolutionError names the mode
    that rules out a solution at any delta, or the test that fails with the smallest delta, whose
    search calls `progress`. Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 3.7,
    for √α A, √α B, √α E."""
    form = _discrete_form(problem)
    try:
        X, certificate = _certified(form)
    except NoSolutionError as failure:
        prefix = "no certified value of the game in discrete time"
        smallest = _smallest_delta(form, progress)  # raises by itself when no delta would do
        advice = smallest.advice(form.delta)
        raise NoSolutionError(f"{prefix}: {failure}; {advice}") from failure
    P = form.value(X)
    K, L = _user_policies(problem, form, X)
    step = problem.step
    radius = _radius(step.A - step.B @ K)
    return DiscreteSolution(
        P=P,
        K=K,
        disturbance_gain=L,
        problem=problem,
        certificate=certificate,
        radius=radius,
        discounted_radius=math.sqrt(problem.discount) * radius,
    )


def minimum_delta_discrete(problem: DiscreteGame, progress: Progress | None = None) -> DeltaMin:
    """The smallest δ of a game in discrete time, by bisection on the tests of P; its own plays no
    part."""
    return _smallest_delta(_discrete_form(problem), progress)


def quick_discrete(problem: DiscreteGame) -> tuple[np.ndarray, np.ndarray]:
    """P and K, neither refined nor certified: for a search.

    NoSolutionError where there is none.
    """
    form = _discrete_form(problem)
    X = by_symplectic_pencil(form)
    return form.value(X), _user_policies(problem, form, X)[0]


def value_checks(problem: DiscreteGame, P: np.ndarray) -> tuple[Check, ...]:
    """The tests of a P, (n, n), of a game in discrete time: Bellman's equation, signs, loops."""
    form = _discrete_form(problem)
    back = np.linalg.inv(form.T)
    return _checks(form, back.T @ P @ back)


def bellman_residual(problem: DiscreteGame, P: np.ndarray) -> float:
    """What is left of Bellman's equation at P, (n, n), relative to its terms."""
    return value_checks(problem, P)[0].value


def _discrete_form(problem: DiscreteGame) -> NormalForm:
    """The normal form of a game of the same value, without discount and cross weights."""
    step, _ = problem.without_cross_weights()
    root = math.sqrt(problem.discount)
    return NormalForm.of(replace(step, A=root * step.A, B=root * step.B, E=root * step.E))


def _user_policies(
    problem: DiscreteGame, form: NormalForm, X: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """K and L in the user's coordinates."""
    gains = policies(form, X)
    _, feed = problem.without_cross_weights()
    K = np.linalg.solve(form.root.T, gains.K @ form.T) + feed
    return K, gains.L @ form.T / form.delta


def _certified(form: NormalForm) -> tuple[np.ndarray, Certificate]:
    """P in normal form, X (n, n), by a Schur form, and its certificate: the tests of X, and that
    value iteration gives the same.

    NoSolutionError when a test fails or a matrix that must be inverted is singular.
    """
    try:
        X = _first_derivation(form)
        checks = _checks(form, X)
        refuse_failures(checks)
        difference = math.inf
        with suppress(NoSolutionError, np.linalg.LinAlgError):
            difference = _difference(X, by_doubling(form))
        if not difference <= DISAGREEMENT:  # for want of digits, perhaps
            difference = _difference(X, by_precise_doubling(form))
    except np.linalg.LinAlgError as error:
        raise NoSolutionError("delta^2 I - discount E'P E is singular on the way") from error
    reason = f"value iteration gives another P (difference {difference:.2g})"
    checks = (*checks, at_most("second_derivation", difference, DISAGREEMENT, reason))
    refuse_failures(checks)
    return X, Certificate(checks)


def _first_derivation(form: NormalForm) -> np.ndarray:
    """X, (n, n), of the symplectic pencil, after Newton steps."""
    return refined(form, by_symplectic_pencil(form))


def _difference(X: np.ndarray, other: np.ndarray) -> float:
    """The largest difference of an entry, relative to the largest entry of X."""
    return float(largest(X - other)) / (float(largest(X)) or 1.0)


def _checks(form: NormalForm, X: np.ndarray) -> tuple[Check, ...]:
    """The tests of X alone: Bellman's equation, signs, both closed loops."""
    gains = policies(form, X)
    size = float(largest(X)) or 1.0
    loop = form.A - form.B @ gains.K
    terms = np.abs(form.Q) + np.abs(gains.K.T @ gains.K) + np.abs(X)
    terms = terms + np.abs(loop.T) @ np.abs(X) @ np.abs(loop)
    step = newton_step(form, X)
    residual = float(largest(step.residual) / (terms.max() or 1.0))
    error = float(largest(step.correction)) / size
    smallest = float(np.linalg.eigvalsh(X)[0]) / size
    saddle = np.eye(form.E.shape[1]) - form.E.T @ X @ form.E
    paid = float(np.linalg.eigvalsh((saddle + saddle.T) / 2.0).min(initial=1.0))
    game_radius = _radius(loop + form.E @ gains.L)
    radius = _radius(loop)
    unsolved = f"Bellman's equation is left with a residual of {residual:.2g}"
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


def _smallest_delta(form: NormalForm, progress: Progress | None) -> DeltaMin:
    """By bisection of log δ on the tests of X."""
    without = form.with_delta(math.inf)
    try:
        X, _ = _certified(without)
    except NoSolutionError as failure:
        raise NoSolutionError(_obstacle(without, str(failure))) from failure
    attack = form.disturbance.T @ X @ form.disturbance
    most = float(np.linalg.eigvalsh((attack + attack.T) / 2.0).max(initial=0.0))
    if most <= 0.0:
        return DeltaMin(0.0, 0.0)

    def ask(delta: float) -> Answer:
        trial = form.with_delta(delta)
        with suppress(NoSolutionError, np.linalg.LinAlgError):
            if all(check.ok for check in _checks(trial, _first_derivation(trial))):
                return Answer(True)
        try:
            by_precise_doubling(trial)
        except NoValueError as error:
            return Answer(False, str(error))
        except (NoSolutionError, np.linalg.LinAlgError) as error:
            return Answer(None, str(error))
        return Answer(None, "a test of the solution fails by rounding")

    value, refused, _ = smallest_delta(ask, 2.0 * math.sqrt(most), TOLERANCE, progress)
    return DeltaMin(value, refused)


def _obstacle(form: NormalForm, failure: str) -> str:
    """One line on why there is no solution without disturbance; failure: of its certificate."""
    size = float(np.linalg.norm(form.A, 2)) or 1.0
    for value in np.linalg.eigvals(form.A):
        mode = f"mode with eigenvalue {value.real:.4g}"
        if value.imag:
            mode += f" ± {abs(value.imag):.4g}i"
        if abs(value) < 1.0 - RANK:
            continue
        if dependence(form.A, value, form.B.T, size) <= RANK:
            return (
                f"no input reaches the {mode} of sqrt(discount) A, which does not decay; change B"
                " or lower the discount"
            )
        if dependence(form.A.T, value, form.Q, size) <= RANK:
            return f"the {mode} of sqrt(discount) A costs nothing; give Q weight on it"
    return (
        f"the game without disturbance (delta = inf) is not certified: {failure}; check the"
        " scaling of A, B, Q, R"
    )


def _radius(matrix: np.ndarray) -> float:
    """The largest |λ| of the eigenvalues."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())
