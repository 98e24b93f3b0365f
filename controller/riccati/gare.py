"""The exact solution of the zero-sum game on a linear model, certified, or the reason why there is
none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import reached, spectrum
from controller.riccati.certificate import Certificate, certified_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_support.errors import NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, eigenvalue_text, matrix_table, numbered


@dataclass(frozen=True, eq=False, repr=False)
class GameSolution(Reported):
    """The value z'P z of a game, its policies u = -K z and d = L z, and the certificate that holds
    for them.

    P: (n, n); K: (m, n); disturbance_gain L: (k, n). closed_loop_eigenvalues: of A - B K, the
    flight without disturbance, rad/s. worst_case_eigenvalues: of A - S P = A - B K + E L, the
    flight against the worst disturbance, rad/s. abscissa_error: by which rounding of A, B and K may
    move the abscissa of A - B K, 1/s, to first order."""

    P: np.ndarray
    K: np.ndarray
    disturbance_gain: np.ndarray
    delta: float
    certificate: Certificate
    closed_loop_eigenvalues: np.ndarray
    worst_case_eigenvalues: np.ndarray
    abscissa_error: float

    def report(self) -> Report:
        """P, K, the closed loop and the certificate."""
        m, n = self.K.shape
        states, inputs, poles = numbered("x", n), numbered("u", m), self.closed_loop_eigenvalues
        spectrum_of_loop = [("", eigenvalue_text(value)) for value in poles if value.imag >= 0]
        return Report(
            title=f"Exact game solution, delta {self.delta:.6g}",
            parts=(
                matrix_table("P", states, states, self.P),
                matrix_table("K", inputs, states, self.K),
                Table(("closed loop A - B K", "1/s"), spectrum_of_loop),
                checks_block(self.certificate.checks),
            ),
            data=self.to_dict(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and floats for JSON; eigenvalues as [real, imaginary]; delta = inf becomes
        None."""
        return {
            "P": self.P.tolist(),
            "K": self.K.tolist(),
            "disturbance_gain": self.disturbance_gain.tolist(),
            "delta": finite_or_none(self.delta),
            "certificate": self.certificate.to_dict(),
            "closed_loop_eigenvalues": _pairs(self.closed_loop_eigenvalues),
            "closed_loop_abscissa_error": finite_or_none(self.abscissa_error),
            "worst_case_eigenvalues": _pairs(self.worst_case_eigenvalues),
        }


def solve_game(game: Game, progress: Progress | None = None) -> GameSolution:
    """A'P + P A + Q - P S P = 0,  K = R⁻¹B'P,  L = δ⁻²E'P,  S = B R⁻¹B' - δ⁻²E E' (paper Section
    3.1).

    Raises NoSolutionError with one line: the mode that rules out a solution at any delta, or the
    test of the certificate that failed together with delta_min, whose search calls `progress`.
    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11."""
    try:
        return solve_certified(game)
    except NoSolutionError as failure:
        smallest = minimum_delta(game, progress)  # which raises by itself when no delta would do
        verdict = "no value of the game" if game.delta <= smallest.refused else "not certified"
        raise NoSolutionError(f"{verdict}: {failure}; {smallest.advice(game.delta)}") from failure


def solve_certified(game: Game) -> GameSolution:
    """`solve_game` without the search for what delta would do."""
    alike, T = reached(game)
    P_alike, certificate = certified_solution(alike)
    P, K, disturbance_gain = P_alike, alike.gain(P_alike), alike.disturbance_gain(P_alike)
    loop = spectrum(alike.A - alike.B @ K)
    if alike is not game:
        P, K, disturbance_gain = T.T @ P @ T, K @ T, disturbance_gain @ T
        P = (P + P.T) / 2.0
        P.setflags(write=False)
    return GameSolution(
        P=P,
        K=K,
        disturbance_gain=disturbance_gain,
        delta=game.delta,
        certificate=certificate,
        closed_loop_eigenvalues=loop.eigenvalues,
        worst_case_eigenvalues=spectrum(alike.A - alike.S @ P_alike).eigenvalues,
        abscissa_error=_abscissa_error(game, alike, T, P_alike),
    )


def _abscissa_error(game: Game, alike: Game, T: np.ndarray, P: np.ndarray) -> float:
    """By how much rounding of A, B and K may move the abscissa of A - B K, 1/s, to first order; inf
    where defective.

    A change D of the matrix moves the eigenvalue of x and y by y'D x / y'x. The vectors are those
    of the game `alike` in T z, whose value is P, where they are accurate; |D| <= n ε |A| in both
    coordinates, and n ε |K| of the gain. Source: Golub and Van Loan, Matrix Computations, Section
    7.2.2."""
    K = alike.gain(P)
    values, right = np.linalg.eig(alike.A - alike.B @ K)
    try:
        left = np.linalg.inv(right)  # rows y with y'x = 1
    except np.linalg.LinAlgError:
        return math.inf
    x, y = np.abs(right), np.abs(left)
    x_given, y_given = np.abs(np.linalg.solve(T, right)), np.abs(left @ T)
    moved = np.sum(y.T * (np.abs(alike.A) @ x) + y_given.T * (np.abs(game.A) @ x_given), axis=0)
    moved += np.sum(np.abs(left @ alike.B).T * (np.abs(K) @ (x + np.abs(T) @ x_given)), axis=0)
    moved += np.sum(y.T * (np.abs(alike.B) @ np.abs(K) @ x), axis=0)
    return float((values.real + len(T) * np.finfo(float).eps * moved).max() - values.real.max())


def _pairs(eigenvalues: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in eigenvalues]
