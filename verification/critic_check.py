"""A learned critic against the exact solution of the same game: how far off, and does it do what it should."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.basis import Basis
from controller.game import Game
from controller.result import LearningResult
from verification.candidate import Candidate
from verification.certificate import INDEFINITENESS, relative_residual
from verification.checks import Check, at_least, at_most, below, finite_or_none
from verification.diagnosis import SIGNLESS, diagnose, relative_error
from verification.gare import GameSolution, solve_game
from verification.l2_gain import bounded_real_gain
from verification.margins import DiskMargin, disk_margin
from verification.saddle import CHANGE, saddle_checks
from verification.spectrum import spectrum
from verification.units import balanced_units, in_units

#: Default limit of the relative errors of P, K and policy, and of the Riccati residual.
LIMIT = 1e-6
#: With a larger limit the saddle checks, which see errors beyond it, are left out.
SADDLE_LIMIT = 1e-5
_BOX_SAMPLES = 2000
SCHEMA = "hfa.critic-check/1"


@dataclass(frozen=True, eq=False)
class CriticCheck:
    """The verdict on one critic.

    exact: the certified solution. candidate: what was judged. P_rel_error is nan when only a gain was given.
    learned_margin, exact_margin: disk margins of both gains, nan-free only for stabilizing ones (else None).
    diagnosis: the mistake recognized, or "".
    """

    exact: GameSolution
    candidate: Candidate
    checks: tuple[Check, ...]
    P_rel_error: float
    K_rel_error: float
    learned_margin: DiskMargin | None
    exact_margin: DiskMargin
    diagnosis: str

    @property
    def ok(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        candidate = self.candidate
        return {
            "schema": SCHEMA,
            "ok": self.ok,
            "P_rel_error": finite_or_none(self.P_rel_error),
            "K_rel_error": finite_or_none(self.K_rel_error),
            "diagnosis": self.diagnosis,
            "checks": [check.to_dict() for check in self.checks],
            "P": None if candidate.P is None else candidate.P.tolist(),
            "K": candidate.K.tolist(),
            "P_exact": self.exact.P.tolist(),
            "K_exact": self.exact.K.tolist(),
            "disk_margin": None if self.learned_margin is None else self.learned_margin.disk,
            "disk_margin_exact": self.exact_margin.disk,
        }


def check_critic(
    game: Game,
    candidate: Candidate,
    basis: Basis,
    *,
    limit: float = LIMIT,
    box: np.ndarray | None = None,
    run: LearningResult | None = None,
    predefined_time: float | None = None,
    seed: int = 0,
) -> CriticCheck:
    """Hold a critic against the exact solution of its game.

    Checked: relative errors of P, K (Frobenius) and of the policy over a box of states, stability of A - B K and
    A - S P, P > 0, Riccati residual, saddle point, L2 gain below delta; for a run also the rank of its data and its
    settling time against T_w. limit: of the errors and the residual. box: (n,), half widths, default ones. With a
    limit above `SADDLE_LIMIT` there are no saddle checks: they would refuse what the limit allows.
    Raises NoSolutionError when the game itself has no certified solution to compare with.
    """
    exact = solve_game(game)
    widths = np.ones(len(game.A)) if box is None else box
    P_error = math.nan if candidate.P is None else relative_error(candidate.P, exact.P)
    K_error = relative_error(candidate.K, exact.K)
    finite = bool(np.all(np.isfinite(candidate.K))) and (candidate.P is None or bool(np.all(np.isfinite(candidate.P))))
    loop_abscissa = spectrum(game.A - game.B @ candidate.K).abscissa if finite else math.inf
    checks = [
        at_most("K_rel_error", K_error, limit, f"K is off by {K_error:.2g}"),
        _policy_check(candidate, exact, widths, limit, seed),
        below(
            "control_loop_abscissa", loop_abscissa, 0.0, f"A - B K is not Hurwitz (abscissa {loop_abscissa:+.3g} 1/s)"
        ),
        *(_value_checks(game, candidate.P, P_error, limit, seed) if candidate.P is not None and finite else ()),
        *((_gain_check(game, candidate.K),) if math.isfinite(game.delta) and finite else ()),
        *(_run_checks(run, predefined_time) if run is not None else ()),
    ]
    wrong = any(not check.ok for check in checks)
    diagnosis = diagnose(game, exact, candidate, basis, limit) if wrong and finite else ""
    if wrong and run is not None:
        diagnosis = _fault_of_the_run(game, run, basis) or diagnosis
    return CriticCheck(
        exact=exact,
        candidate=candidate,
        checks=tuple(_explained(checks, diagnosis)),
        P_rel_error=P_error,
        K_rel_error=K_error,
        learned_margin=disk_margin(game, candidate.K) if loop_abscissa < 0.0 else None,
        exact_margin=disk_margin(game, exact.K),
        diagnosis=diagnosis,
    )


def _fault_of_the_run(game: Game, run: LearningResult, basis: Basis) -> str:
    """What the run was given that it could not make up for: too few data, or a start without a value."""
    if run.excitation.rank < run.excitation.size:
        return (
            f"the data have rank {run.excitation.rank} of {run.excitation.size}: whatever their residual, they do not "
            "determine the weights"
        )
    start = spectrum(game.A - game.B @ game.gain(basis.matrix(run.weights[0]))).abscissa
    if start >= 0.0 and run.law != "certified":  # which discounts such a start
        return (
            f"the run starts from a policy that does not stabilize (abscissa of A - B K {start:+.3g} 1/s) and has "
            "no value to learn from; give initial_weights of a stabilizing one"
        )
    return ""


def _policy_check(candidate: Candidate, exact: GameSolution, box: np.ndarray, limit: float, seed: int) -> Check:
    """max |u(z) - u*(z)| / max |u*(z)| over random states of the box."""
    z = np.random.default_rng(seed).uniform(-box, box, size=(_BOX_SAMPLES, len(box)))
    best = -z @ exact.K.T
    difference = float(np.linalg.norm(candidate.policy(z) - best, axis=1).max())
    largest = float(np.linalg.norm(best, axis=1).max())
    error = difference / largest if largest > 0.0 else difference
    error = error if math.isfinite(error) else math.inf
    return at_most(
        "policy_rel_error", error, limit, f"the policy is off by {error:.2g} of the largest input in the box"
    )


def _value_checks(game: Game, P: np.ndarray, P_error: float, limit: float, seed: int) -> tuple[Check, ...]:
    units = balanced_units(game)
    balanced, scaled = in_units(game, units), P * np.outer(units, units)
    residual = relative_residual(balanced, scaled)
    smallest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0] / np.abs(scaled).max()) if np.any(scaled) else 0.0
    # The value of a state that costs nothing may be 0, which rounding makes negative; the certificate allows the same.
    least = 0.0 if _is_definite(balanced.Q) else -INDEFINITENESS
    abscissa, change = spectrum(game.A - game.S @ P).abscissa, _saddle_change(limit)
    return (
        at_most("P_rel_error", P_error, limit, f"P is off by {P_error:.2g}"),
        below("game_loop_abscissa", abscissa, 0.0, f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"),
        at_least(
            "P_smallest_eigenvalue",
            smallest,
            least,
            f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)",
        ),
        at_most("riccati_residual", residual, limit, f"the Riccati equation is left with a residual of {residual:.2g}"),
        *(saddle_checks(balanced, scaled, np.ones(len(P)), seed, change) if change is not None else ()),
    )


def _saddle_change(limit: float) -> float | None:
    """The change of cost under which errors within the limit hide, if it is small enough for a parabola."""
    if limit <= CHANGE:
        return CHANGE
    return 10.0 * limit if limit <= SADDLE_LIMIT else None


def _is_definite(matrix: np.ndarray) -> bool:
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] > SIGNLESS * eigenvalues[-1])


def _gain_check(game: Game, K: np.ndarray) -> Check:
    gain = bounded_real_gain(game, K)
    return below("l2_gain", gain, game.delta, f"the closed loop has an L2 gain of {gain:.4g}, not below delta")


def _run_checks(run: LearningResult, predefined_time: float | None) -> tuple[Check, ...]:
    """The richness of the data; the settling time only of a law that promises one."""
    rank = run.excitation
    rich = at_least("data_rank", rank.rank, rank.size, f"the data have rank {rank.rank} of {rank.size}")
    if predefined_time is None:
        return (rich,)
    late = (
        f"the residual settles at {run.settling_time:.4g} s"
        if math.isfinite(run.settling_time)
        else "the residual does not settle"
    )
    return (
        rich,
        at_most("settling_time", run.settling_time, predefined_time, f"{late}, not within T_w = {predefined_time:g} s"),
    )


def _explained(checks: Iterable[Check], diagnosis: str) -> Iterable[Check]:
    """The first failed check carries the diagnosis, so that the reason stands where a reader looks first."""
    told = not diagnosis
    for check in checks:
        if not check.ok and not told:
            told = True
            yield check._replace(reason=f"{check.reason}: {diagnosis}")
        else:
            yield check
