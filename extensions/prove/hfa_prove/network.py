"""Proof of an upper bound on the error of a network over a box of states, by branch and bound."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.linear_game import Game
from hfa.options.output import ProgressLine
from hfa_prove.enclosure.relaxation import Relaxation
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report
from verification.box import Box, usual_box
from verification.judged_game import JudgedGame
from verification.network.search import Comparison
from verification.scope import LIMIT

#: Number of boxes for which bounds are computed before the next boxes are chosen.
_BATCH = 1024


class Proof(NamedTuple):
    """Proved bound on the errors of a network.

    what: the covered errors, such as "error of the policy". "error" means all errors.
    error: proved upper bound on the relative error.
    fraction: the bound is proved for |z_i| <= fraction b_i. It is 0 if nothing is proved.
    boxes: number of boxes for which bounds were computed.
    beyond: state (n,) whose error exceeds the bound, or None if no such state was found.
    left_out: compared functions whose errors are not bounded: the policy that follows from a V in
        discrete time, which minimizes the cost of each step.
    """

    what: str
    error: float
    fraction: float
    boxes: int
    beyond: np.ndarray | None = None
    left_out: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Proved part of the box in words, such as "in the box" or "on 0.96 times the box".

        The factor is rounded down.
        """
        if self.fraction == 1.0:
            return "in the box"
        return f"on {math.floor(100.0 * self.fraction) / 100.0:g} times the box"

    @property
    def holds(self) -> bool:
        """Whether the bound of the covered errors is proved in the whole box."""
        return self.fraction == 1.0

    def sentence(self) -> str:
        """Return what is proved of which errors, or why it is not, in a line."""
        if self.beyond is not None:
            state = ", ".join(f"{each:.3g}" for each in self.beyond)
            return f"FAIL: an error of the network exceeds {self.error:g} at z = ({state})"
        if not self.holds:
            return f"FAIL: no error above {self.error:g} is proved {self.where} alone; time is over"
        if self.left_out:
            others = " and ".join(self.left_out)
            return f"Proved, but not of the {others}: no error exceeds {self.error:g} in the box"
        return f"Proved: no error of the network exceeds {self.error:g} in the box"


@checks_arguments
def error_bound(
    game: Game,
    critic: Critic,
    *,
    box: Box | None = None,
    limit: float = LIMIT,
    seconds: float = 20.0,
    progress: Progress | None = None,
) -> Proof | None:
    """Prove that no error of a network exceeds a limit in a box of states.

    The errors are those of all functions that the network has, V, dV/dz and the policy, relative to
    the exact solution of the game. Of the V of a game in discrete time, the policy is left out
    (`Proof.left_out`). The proof holds for the expression as CasADi simplifies it. The result is
    None if no bound is implemented for an operation of the network.

    box: box of states, by default the usual box of the game
    limit: relative error to be proved
    seconds: time after which the proof ends, with the fraction of the box that is proved
    """
    judged = JudgedGame(game)
    b = (usual_box(game) if box is None else box).half_widths
    scales = np.sqrt(np.diag(judged.exact.price))
    about = Comparison(critic, judged.exact, scales, b, judged.exact_at)
    functions = about.functions
    kinds = tuple(kind for kind in functions if functions[kind].is_a("SXFunction"))
    if not kinds:
        return None
    proof = prove("error", about.function(kinds), b, limit, seconds, progress)
    left_out = tuple(kind for kind in functions if kind not in kinds)
    return None if proof is None else proof._replace(left_out=left_out)


class ProvedReport(NamedTuple):
    """Report of a verdict, with the proof as its first line, and whether the proof holds."""

    report: Report
    holds: bool


def with_bound(report: Report, game: Game, critic: Critic, limit: float) -> ProvedReport:
    """Return the report of `hfa verify` with the proved bound of a network's errors.

    limit: relative error to be proved

    Raises BadInputError if the critic is not a network.
    """
    if critic.is_quadratic:
        raise BadInputError("--prove bounds the errors of a network; remove it for this critic")
    proof = error_bound(game, critic, limit=limit, progress=ProgressLine("prove"))
    if proof is None:
        line = "FAIL: no bound is implemented for an operation of the network"
        return ProvedReport(replace(report, title=f"{line}\n{report.title}"), holds=False)
    report = replace(report, title=f"{proof.sentence()}\n{report.title}")
    return ProvedReport(report.with_data(proved=proof._asdict()), proof.holds)


def prove(
    what: str,
    errors: ca.Function,
    b: np.ndarray,
    limit: float,
    seconds: float,
    progress: Progress | None = None,
) -> Proof | None:
    """Prove |errors(z)| <= limit for |z_i| <= b_i by branch and bound, for at most `seconds` s.

    The proof also ends at a state whose error exceeds the limit. The result contains the fraction
    of the box that is proved. The result is None if `errors` contains operations for which no bound
    is implemented.

    what: description of the errors, for `Proof.what`
    b: half-widths of the box, (n,)
    """
    y = ca.SX.sym("y", len(b))
    scaled = ca.Function("errors", [y], [ca.densify(errors(ca.DM(b) * y))])
    try:
        relaxation = Relaxation(scaled, what)
    except (BadInputError, OverflowError):  # a coefficient overflows double precision
        return None
    begin = time.monotonic()
    centres = np.zeros((1, len(b)))
    half_widths = np.ones((1, len(b)))
    count = 0
    while len(centres):
        distances = np.max(np.abs(centres) - half_widths, axis=1)
        fraction = max(float(distances.min()), 0.0)
        elapsed = time.monotonic() - begin
        if progress is not None:
            progress(min(elapsed, seconds), seconds, f"proved on {fraction:.2g} times the box")
        if elapsed >= seconds:
            return Proof(what, limit, fraction, count)
        batch = min(_BATCH, len(centres))
        order = np.argpartition(distances, batch - 1)
        bounds = relaxation.over(centres[order[:batch]], half_widths[order[:batch]])
        count += batch
        worst = int(np.argmax(np.nan_to_num(bounds.lowest)))
        if bounds.lowest[worst] > limit:
            corner = bounds.corner[worst]
            if np.abs(np.array(scaled(corner))).max() > limit:
                return Proof(what, limit, fraction, count, b * corner)
        is_open = ~(bounds.highest <= limit)
        wide = order[:batch][is_open]
        halves = _halves(centres[wide], half_widths[wide], bounds.gaps[is_open])
        waiting = order[batch:]
        centres = np.concatenate([centres[waiting], halves[0]])
        half_widths = np.concatenate([half_widths[waiting], halves[1]])
    return Proof(what, limit, 1.0, count)


def _halves(
    centres: np.ndarray, half_widths: np.ndarray, gaps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres and half-widths of both halves of each box."""
    # Each box is halved across the input with the largest gap. If a gap is not finite or all are 0,
    # the box is halved across its widest input.
    boxes = np.arange(len(centres))
    # Without information on the gaps, as without a bound, the widest input is halved.
    known = np.all(np.isfinite(gaps), axis=1) & np.any(gaps > 0.0, axis=1)
    across = np.argmax(np.where(known[:, None], gaps, half_widths), axis=1)
    halved = half_widths.copy()
    halved[boxes, across] *= 0.5
    step = halved[boxes, across]
    lower = centres.copy()
    lower[boxes, across] -= step
    upper = centres.copy()
    upper[boxes, across] += step
    return np.concatenate([lower, upper]), np.concatenate([halved, halved])
