"""What all laws share: their ticks, with history and progress; the certificates of a learned value,
computed from the game itself; the result that carries them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.game.learning_result import Excitation, LearningResult, settled_at
from controller.game.zero_sum import Game
from controller.learning.bellman_equations import StackEquations, control_root
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, checked

#: Largest relative Riccati residual, |A'P + PA + Q - PSP| over the sum of the norms of its terms.
RESIDUAL_LIMIT = 1e-9
#: Largest next Newton correction of P over |P|: to first order the relative error of P.
CORRECTION_LIMIT = 1e-9
#: Eigenvalues of Q below this fraction of the largest are rounding, and Q is singular.
SIGNLESS = 1e-12
#: Least eigenvalue of P over its largest where Q is singular.
INDEFINITENESS = -1e-10
#: Largest weight beyond the quadratic ones over the largest quadratic one, in scaled coordinates.
BEYOND_LIMIT = 1e-9
#: At most this many rows of history are kept of a run, evenly spread over its ticks.
MOST_ROWS = 20_001
#: Progress is reported this many times in a run.
REPORTS = 50
#: Most steps of a refinement; each squares the error until rounding stops it.
MOST_STEPS = 20


@dataclass(frozen=True, eq=False)
class Run:
    """memory: at the last tick. history: rows by name, (rows, ...)."""

    memory: Any
    history: dict[str, np.ndarray]


def run(process: Any, *, progress: Progress | None = None) -> Run:
    """Run all ticks of a law, any object with four members.

    ticks: number of steps. start(): the memory before the first, whatever the law carries from one
    tick to the next. advance(tick, memory): the memory after tick number `tick` (0 .. ticks - 1), a
    pure function. observe(tick, memory): the row after `tick` ticks (0 .. ticks): "time", s, and
    what else is to be kept, each time the same names; with "law_residual_norm", the residual that
    the law drives to zero, the progress shows it."""
    memory = process.start()
    rows = [_row(process, 0, memory)]
    every = -(-process.ticks // (MOST_ROWS - 1))
    report_every = max(1, process.ticks // REPORTS)
    for tick in range(1, process.ticks + 1):
        memory = process.advance(tick - 1, memory)
        last = tick == process.ticks
        if tick % every == 0 or last:
            rows.append(_row(process, tick, memory))
        if progress is not None and (tick % report_every == 0 or last):
            progress(tick / process.ticks, 1.0, _line(rows[-1]))
    return Run(memory, {name: np.array([row[name] for row in rows]) for name in rows[0]})


def _row(process: Any, tick: int, memory: Any) -> Mapping[str, Any]:
    """A row of history; a residual that overflows is inf in it, and the law itself says when it
    cannot go on."""
    with np.errstate(over="ignore", invalid="ignore"):
        return process.observe(tick, memory)


def _line(row: Mapping[str, Any]) -> str:
    residual = (
        f", residual of the law {row['law_residual_norm']:.3g}"
        if "law_residual_norm" in row
        else ""
    )
    return f"t = {row['time']:.3g} s{residual}"


def conclude(
    law: str,
    game: Game,
    equations: StackEquations,
    history: Mapping[str, np.ndarray],
    richness: Excitation,
    settings: dict[str, Any],
    seed: int,
    diagnostics: dict[str, float],
) -> LearningResult:
    """The result of a finished run: P and K of its last weights, with their certificates."""
    weights = history["weights"][-1]
    P = equations.basis.matrix(weights)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # a value that overflows fails its certificates
        rows = certificates(game, equations, weights, richness)
    return LearningResult(
        law=law,
        basis=equations.basis.name,
        times=history["time"],
        weights=history["weights"],
        residual_norm=history["residual_norm"],
        law_residual_norm=history["law_residual_norm"],
        P=P,
        K=game.gain(P),
        excitation=richness,
        settling_time=settled_at(history["time"], history["settling_residual"], RESIDUAL_LIMIT),
        certificates=rows,
        settings=settings,
        seed=seed,
        diagnostics=diagnostics,
    )


def certificates(
    game: Game, equations: StackEquations, weights: np.ndarray, richness: Excitation
) -> tuple[Check, ...]:
    """The checks of a learned value W'ψ(z), weights (M,) in the model's units.

    A - S P Hurwitz is what singles out the one root of the Riccati equation that is the value of
    the game: a small residual alone does not, and neither does one on a stack of rank below M."""
    scales = equations.scales
    P = equations.basis.matrix(weights)
    rows = [
        checked("abscissa of A - S P [1/s]", abscissa(game.A - game.S @ P), "<", 0.0),
        checked("abscissa of A - B K [1/s]", abscissa(game.A - game.B @ game.gain(P)), "<", 0.0),
        positivity(game, P, scales),
        checked(
            "relative Riccati residual", relative_residual(game, P, scales), "<=", RESIDUAL_LIMIT
        ),
        checked(
            "next Newton correction over |P|",
            relative_correction(game, P, scales),
            "<=",
            CORRECTION_LIMIT,
        ),
        checked("rank of the stack", float(richness.rank), ">=", float(richness.size)),
        checked(
            "smallest eigenvalue of Sigma", richness.smallest_eigenvalue, ">", richness.rounding
        ),
    ]
    if equations.basis.size > equations.basis.quadratic_size:
        magnitudes = np.abs(equations.scaled(weights))
        quadratic = equations.basis.quadratic_size
        beyond = float(magnitudes[quadratic:].max() / magnitudes[:quadratic].max())
        rows.append(checked("largest weight beyond the quadratic ones", beyond, "<=", BEYOND_LIMIT))
    return tuple(rows)


def positivity(game: Game, P: np.ndarray, scales: np.ndarray) -> Check:
    """Smallest eigenvalue of P over the largest in coordinates z / scales: P > 0, or P >= 0 where Q
    is singular.

    With Q > 0 the value is positive definite. Otherwise states that cost nothing may have the value
    0, which rounding makes negative. Whether Q is singular must not hang on rounding either."""
    outer = np.outer(scales, scales)
    of_Q, of_P = np.linalg.eigvalsh(game.Q * outer), np.linalg.eigvalsh(P * outer)
    smallest = float(of_P[0] / np.abs(of_P).max()) if np.any(P) else 0.0
    name = "smallest eigenvalue of scaled P over the largest"
    if of_Q[0] > SIGNLESS * of_Q[-1]:
        return checked(name, smallest, ">", 0.0)
    return checked(name, smallest, ">=", INDEFINITENESS)


def abscissa(matrix: np.ndarray) -> float:
    """Largest real part of the eigenvalues, 1/s."""
    return float(np.linalg.eigvals(matrix).real.max())


class Riccati(NamedTuple):
    """A'P + PA + Q - PSP with S = G G' - D D', control G (n, m), disturbance D (n, k); A, Q, P (n,
    n).

    P S P is taken from its roots: where few inputs hold a large P in check, |G'P| is not a small
    difference of large numbers, and S P is."""

    A: np.ndarray
    control: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, game: Game, scales: np.ndarray) -> Riccati:
        """The equation of a game in coordinates z / scales."""
        rows = scales[:, None]
        roots = control_root(game) / rows, game.E / game.delta / rows
        return cls(game.A * scales / rows, *roots, game.Q * rows * scales)

    def residual(self, P: np.ndarray) -> np.ndarray:
        """A'P + PA + Q - PSP, (n, n)."""
        pushed, disturbed = P @ self.control, P @ self.disturbance
        return self.A.T @ P + P @ self.A + self.Q - pushed @ pushed.T + disturbed @ disturbed.T

    def correction(self, P: np.ndarray) -> np.ndarray:
        """N with (A - S P)'N + N (A - S P) = `residual`, (n, n): P - N is the next policy
        iteration.

        Solved as n² linear equations. Raises numpy.linalg.LinAlgError when they are singular.
        """
        closed = (
            self.A
            - self.control @ (self.control.T @ P)
            + self.disturbance @ (self.disturbance.T @ P)
        )
        eye = np.eye(len(P))
        operator = np.kron(closed.T, eye) + np.kron(eye, closed.T)
        found: np.ndarray = np.linalg.solve(operator, self.residual(P).reshape(-1)).reshape(P.shape)
        return (found + found.T) / 2.0

    def refined(self, P: np.ndarray) -> np.ndarray:
        """P - N repeated until the correction no longer halves, which is rounding."""
        last = np.inf
        for _ in range(MOST_STEPS):
            try:
                correction = self.correction(P)
            except np.linalg.LinAlgError:
                break
            size = float(np.linalg.norm(correction))
            if not size < 0.5 * last:
                break
            P, last = P - correction, size
        return P


def relative_residual(game: Game, P: np.ndarray, scales: np.ndarray) -> float:
    """|A'P + PA + Q - PSP| / (2 |A'P| + |Q| + |PSP|) in coordinates z / scales, Frobenius norms; 0
    where nothing costs anything that a number can hold."""
    outer = np.outer(scales, scales)
    terms = (2.0 * game.A.T @ P, game.Q, P @ game.S @ P)
    total = sum(float(np.linalg.norm(term * outer)) for term in terms)
    left = float(np.linalg.norm(Riccati.of(game, scales).residual(P * outer)))
    return left / total if total > 0.0 else left


def relative_correction(game: Game, P: np.ndarray, scales: np.ndarray) -> float:
    """|N| / |P|, N of `Riccati.correction`, solved in coordinates z / scales; Frobenius norms; inf
    when singular."""
    outer = np.outer(scales, scales)
    try:
        correction = Riccati.of(game, scales).correction(P * outer) / outer
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.linalg.norm(correction) / np.linalg.norm(P)) if np.any(P) else np.inf
