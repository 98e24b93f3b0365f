"""The game from measured outputs alone: the central H-infinity controller, certified, or which condition fails."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from controller.game.array_file import checked_matrix
from controller.game.zero_sum import LARGEST, Game
from controller.riccati.balancing import RANK, balanced_units, in_units, normal_form, spectrum
from controller.riccati.certificate import relative_residual
from controller.riccati.frequency_response import gain_is_below, square_root
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.gare_schur import quick_solution, schur_solution
from controller.riccati.smallest_delta import dependence, has_value
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.checks import Check, at_most, below
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.text import eigenvalue_text

#: The two derivations of the controller differ by rounding alone: largest relative difference of their responses.
DERIVATIONS_AGREE = 1e-8
TOLERANCE = 1e-6
#: Where ρ(XY) is farther from δ² than this part of it, a search does without the last digits of X and Y.
_CLEAR = 1e-4
#: Relative residual, in balanced units, up to which a search believes a solution without a certificate.
_BELIEVED = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class OutputGame(Shown):
    """The game of `game` for who sees only y = C z + D u + n.

    C: (p, n). D: (p, m). V: (p, p) intensity of the measurement noise n, symmetric positive definite: n = V^½ v with v
    part of the disturbance, J = ∫ z'Qz + u'Ru - δ² (d'd + v'v). BadInputError when a shape or a sign is wrong.
    """

    game: Game
    C: np.ndarray
    D: np.ndarray
    V: np.ndarray

    def __post_init__(self) -> None:
        """Check everything once, so that no solver has to."""
        for name in ("C", "D", "V"):
            object.__setattr__(self, name, checked_matrix(name, getattr(self, name), LARGEST))
        n, m = self.game.B.shape
        p = len(self.C)
        for name, shape in (("C", (p, n)), ("D", (p, m)), ("V", (p, p))):
            found = getattr(self, name).shape
            if found != shape:
                raise BadInputError(f"{name} has shape {found}; with these outputs and states it must be {shape}")
        if p == 0:
            raise BadInputError("no output is measured; name at least one")

    @property
    def dual(self) -> Game:
        """The game whose Riccati equation is the filter's: A', C', Q^½, E E', V in place of A, B, E, Q, R."""
        return Game(
            A=self.game.A.T,
            B=self.C.T,
            E=scaled_root(self.game.Q),
            Q=self.game.S_disturbance,
            R=self.V,
            delta=self.game.delta,
        )

    def with_delta(self, delta: float) -> OutputGame:
        """The same at another disturbance weight."""
        return replace(self, game=self.game.with_delta(delta))

    def in_units(self, units: np.ndarray) -> OutputGame:
        """The same in the state y, z_i = u_i y_i; units: (n,)."""
        return replace(self, game=in_units(self.game, units), C=self.C * units)


def scaled_root(M: np.ndarray) -> np.ndarray:
    """F with F F' = M, (n, n), for M positive semidefinite: rows in the units of M, whatever they are.

    M = diag(d) N diag(d) with d_i = sqrt(M_ii), F = diag(d) N^½: a change of units scales F row by row, and no small
    entry is lost beside a large one.
    """
    d = np.sqrt(np.diag(M).clip(0.0))
    safe = np.where(d > 0.0, d, 1.0)
    return np.asarray(d[:, None] * square_root(M / np.outer(safe, safe)))


@dataclass(frozen=True, eq=False, repr=False)
class OutputFeedback(Shown):
    """x̂' = Ak x̂ + Bk y,  u = Ck x̂, and what certifies it.

    X, Y: (n, n), stabilizing solutions of the control and the filter equation. coupling: ρ(X Y) / δ², below 1.
    checks: of the two equations' certificates, the coupling, the closed loop and the second derivation.
    """

    Ak: np.ndarray
    Bk: np.ndarray
    Ck: np.ndarray
    X: np.ndarray
    Y: np.ndarray
    coupling: float
    checks: tuple[Check, ...]


def solve_output_feedback(problem: OutputGame) -> OutputFeedback:
    """A'X + XA + Q - X (B R⁻¹B' - δ⁻²E E') X = 0,   A Y + Y A' + E E' - Y (C'V⁻¹C - δ⁻²Q) Y = 0,   ρ(XY) < δ²,

        Ck = -R⁻¹B'X,  Bk = Z Y C'V⁻¹,  Z = (I - δ⁻² Y X)⁻¹,  Ak = A + δ⁻²E E'X + B Ck - Bk (C + D Ck).

    delta = inf is LQG. Raises NoSolutionError that names which of the three conditions fails, or the check.
    Source: Doyle, Glover, Khargonekar, Francis, IEEE Trans. Automatic Control 34 (1989), 831-847, Theorem 3.
    """
    _check_modes(problem)
    X = _solved(problem.game, "control").P
    Y = _solved(problem.dual, "filter").P
    delta = problem.game.delta
    radius = _radius(X, Y)
    if not radius < delta**2:
        raise NoSolutionError(
            f"the coupling condition fails: rho(XY) = {radius:.6g} is not below delta^2 = {delta**2:.6g}; "
            "ask for a larger delta, or measure more"
        )
    # The controller is made and checked in balanced units; x̂ has the user's.
    u = balanced_units(problem.game.with_delta(math.inf))
    there, X_there, Y_there = problem.in_units(u), X * np.outer(u, u), Y / np.outer(u, u)
    controller = central_controller(there, X_there, Y_there)
    checks = _checks(there, controller, _central_by_duality(there, X_there, Y_there), radius)
    failed = [check for check in checks if not check.ok]
    if failed:
        raise NoSolutionError(f"the controller is not certified: {failed[0].reason}")
    Ak, Bk, Ck = controller
    Ak, Bk, Ck = Ak * u[:, None] / u, Bk * u[:, None], Ck / u
    return OutputFeedback(Ak, Bk, Ck, X=X, Y=Y, coupling=radius / delta**2, checks=checks)


class OutputDeltaMin(NamedTuple):
    """Smallest δ of an output-feedback game, bracketed: refused < δ_min <= value, and the condition that ends there.

    value / refused <= 1 + 1e-6, or more where rounding hides the minimum; both are 0 where no δ is refused.
    """

    value: float
    refused: float
    condition: str


def minimum_output_delta(problem: OutputGame) -> OutputDeltaMin:
    """Bisection of log δ on the three conditions, to 1e-6 relative; NoSolutionError when they fail at δ = inf."""
    _check_modes(problem)
    _solved(problem.game.with_delta(math.inf), "control")
    _solved(problem.dual.with_delta(math.inf), "filter")
    upper = 1.0
    while (found := _conditions(problem.with_delta(upper)))[0] is not True:
        upper *= 4.0
        if upper > 1e12:
            raise NoSolutionError(f"no delta up to 1e12 will do: {found[1]}; check the scaling")
    lower = upper / 4.0
    while (found := _conditions(problem.with_delta(lower)))[0]:
        lower, upper = lower / 4.0, lower
        if upper < 1e-12:
            return OutputDeltaMin(0.0, 0.0, "none")
    condition = found[1]
    while upper > lower * (1.0 + TOLERANCE):
        middle = math.sqrt(lower * upper)
        held, said = _conditions(problem.with_delta(middle))
        lower, upper, condition = (lower, middle, condition) if held else (middle, upper, said)
    share = TOLERANCE
    while _conditions(problem.with_delta(lower))[0] is not False:  # rounding hides which it is
        if share > 1.0:
            return OutputDeltaMin(upper, 0.0, condition)
        lower, share = lower / (1.0 + share), 2.0 * share
    return OutputDeltaMin(upper, lower, condition)


def closed_loop(problem: OutputGame, controller: tuple[np.ndarray, np.ndarray, np.ndarray]) -> tuple[np.ndarray, ...]:
    """(A, B, C) from (d, v) to (Q^½ z, R^½ u) of plant and controller, states [z; x̂]."""
    Ak, Bk, Ck = controller
    game = problem.game
    noise = Bk @ square_root(problem.V)
    loop = np.block([[game.A, game.B @ Ck], [Bk @ problem.C, Ak + Bk @ problem.D @ Ck]])
    zeros = np.zeros
    into = np.block([[game.E, zeros((len(game.A), noise.shape[1]))], [zeros((len(Ak), game.E.shape[1])), noise]])
    paid = np.block(
        [
            [square_root(game.Q), zeros((len(game.A), len(Ak)))],
            [zeros((len(game.R), len(game.A))), square_root(game.R) @ Ck],
        ]
    )
    return loop, into, paid


def central_controller(problem: OutputGame, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ak, Bk, Ck of `solve_output_feedback` from X and Y, whatever they are: nothing is certified."""
    game = problem.game
    Ck = -game.gain(X)
    Z = np.linalg.inv(np.eye(len(X)) - Y @ X / game.delta**2)
    Bk = Z @ np.linalg.solve(problem.V, problem.C @ Y).T
    Ak = game.A + game.S_disturbance @ X / game.delta**2 + game.B @ Ck - Bk @ (problem.C + problem.D @ Ck)
    return Ak, Bk, Ck


def _central_by_duality(problem: OutputGame, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The transposed controller of the transposed problem: the worst case is folded into u instead of x̂.

    x̂' = (A + δ⁻² Y Q - L C) x̂ + B u + L y - L D u,  L = Y C'V⁻¹,  u = -R⁻¹B'X (I - δ⁻² Y X)⁻¹ x̂.
    """
    game = problem.game
    L = np.linalg.solve(problem.V, problem.C @ Y).T
    Ck = -game.gain(X) @ np.linalg.inv(np.eye(len(X)) - Y @ X / game.delta**2)
    Ak = game.A + Y @ game.Q / game.delta**2 - L @ problem.C + (game.B - L @ problem.D) @ Ck
    return Ak, L, Ck


def _checks(
    problem: OutputGame,
    controller: tuple[np.ndarray, np.ndarray, np.ndarray],
    other: tuple[np.ndarray, np.ndarray, np.ndarray],
    radius: float,
) -> tuple[Check, ...]:
    delta = problem.game.delta
    loop, into, paid = closed_loop(problem, controller)
    abscissa = spectrum(loop).abscissa
    found = [
        below("coupling", radius, delta**2, f"rho(XY) = {radius:.6g} is not below delta^2"),
        below("closed_loop_abscissa", abscissa, 0.0, f"the closed loop has a pole at {abscissa:.3g} 1/s"),
    ]
    if math.isfinite(delta):
        whole = Game(
            A=loop, B=np.zeros((len(loop), 1)), E=into, Q=paid.T @ paid, R=np.eye(1), delta=delta
        )  # the bounded-real test of a loop that is closed already
        kept = gain_is_below(whole, np.zeros((1, len(loop))), delta)
        reason = f"the closed loop's gain from disturbance to what is paid for is not below delta = {delta:.6g}"
        found.append(at_most("gain_above_delta", 0.0 if kept else 1.0, 0.0, reason))
    apart = _response_difference(controller, other)
    reason = f"the two derivations of the controller differ by {apart:.2g} of their response"
    return (*found, at_most("derivations_agree", apart, DERIVATIONS_AGREE, reason))


def _response_difference(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> float:
    """Largest |K1(jω) - K2(jω)| / |K1(jω)|, or |K2(jω)| where K1 is zero, over the controllers' own frequencies."""
    poles = np.abs(np.linalg.eigvals(one[0]))
    grid = np.geomspace(1e-2 * max(poles.min(), 1e-6), 1e2 * poles.max(), 60)
    apart = 0.0
    for omega in grid:
        first, second = (Ck @ np.linalg.solve(1j * omega * np.eye(len(Ak)) - Ak, Bk) for Ak, Bk, Ck in (one, other))
        apart = max(apart, float(np.linalg.norm(first - second) / (np.linalg.norm(first) or 1.0)))
    return apart


def _check_modes(problem: OutputGame) -> None:
    """[A - λI; C] has full rank at every λ of A that is not stable, [A - λI, E] at every λ with Re λ = 0.

    NoSolutionError names the λ where not: without that the filter's equation has no stabilizing solution.
    """
    form = normal_form(problem.dual.with_delta(math.inf))
    size = float(np.linalg.norm(form.A, 2)) or 1.0
    for value in np.linalg.eigvals(form.A):
        text = f"the mode with eigenvalue {eigenvalue_text(value)}"
        if value.real >= -RANK * size and dependence(form.A, value, form.B.T, size) <= RANK:
            raise NoSolutionError(f"the sensors do not see {text}, which is not stable; measure more")
        if abs(value.real) <= RANK * size and dependence(form.A.T, value, form.Q, size) <= RANK:
            raise NoSolutionError(
                f"the disturbance does not reach {text}, which does not decay, so its estimate would never settle; "
                "let the disturbance enter there"
            )


def _solved(game: Game, which: str) -> GameSolution:
    try:
        return solve_game(game)
    except NoSolutionError as error:
        raise NoSolutionError(f"the {which} Riccati equation: {error}") from error


def _conditions(problem: OutputGame) -> tuple[bool | None, str]:
    """Whether the three conditions hold, None where rounding hides it, and the first that does not; no certificates."""
    games = problem.game, problem.dual
    for which, game in zip(("control", "filter"), games, strict=True):
        if not (found := has_value(game)):
            return found, f"{which} Riccati equation" + " (rounding leaves it open)" * (found is None)
    limit = problem.game.delta**2
    for solution in (quick_solution, schur_solution):
        X, Y = (_believed(game, solution) for game in games)
        if X is None or Y is None:
            continue
        radius = _radius(X, Y)
        if solution is schur_solution or abs(radius - limit) > _CLEAR * limit:
            return (True, "") if radius < limit else (False, "coupling condition")
    return None, "accuracy of a Riccati solution"


def _believed(game: Game, solution: Callable[[Game], np.ndarray]) -> np.ndarray | None:
    """The stabilizing solution with a small residual, or None."""
    with suppress(NoSolutionError):
        P, units = solution(game), balanced_units(game)
        residual = relative_residual(in_units(game, units), P * np.outer(units, units))
        if residual <= _BELIEVED and spectrum(game.A - game.S @ P).abscissa < 0.0:
            return P
    return None


def _radius(X: np.ndarray, Y: np.ndarray) -> float:
    """ρ(XY), real and not negative for X, Y >= 0, in whatever units."""
    half = scaled_root(Y)
    product = half.T @ X @ half
    return float(np.linalg.eigvalsh((product + product.T) / 2.0)[-1])
