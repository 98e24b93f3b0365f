"""A learned critic against the exact solution of the same game: how far off, and does it do what it should."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.basis import Basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from hfa_model.support.checks import Check, at_least, at_most, below
from hfa_model.support.jsonable import finite_or_none
from hfa_model.support.report import Report, Reported
from verification.critic.candidate import Candidate
from verification.critic.diagnosis import SIGNLESS, diagnose, relative_error
from verification.meaning.margins import DiskMargin, disk_margin
from verification.meaning.saddle import CHANGE, saddle_checks
from verification.riccati.certificate import INDEFINITENESS, relative_residual
from verification.riccati.gare import GameSolution, solve_game
from verification.riccati.l2_gain import bounded_real_gain
from verification.riccati.spectrum import spectrum
from verification.riccati.units import balanced_units, in_units

#: Default limit of the relative errors of P, K and policy, and of the Riccati residual.
LIMIT = 1e-6
#: With a larger limit the saddle checks, which see errors beyond it, are left out.
SADDLE_LIMIT = 1e-5
#: Relative Riccati residual, in balanced units, below which the judge calls a run settled.
SETTLED = 1e-9
#: The checks whose failure says that the critic is another one than the game's.
_ERRORS = (
    "K_rel_error",
    "K_balanced_error",
    "policy_rel_error",
    "P_rel_error",
    "P_balanced_error",
    "riccati_residual",
)
#: Half widths of the box of ordinary deviations in which policies of the aircraft are compared, the judge's own: ft/s,
#: rad and rad/s, in the order of `LINEAR_STATES`; the size of the commands of Section 5.1, less for the dihedral.
ORDINARY_DEVIATIONS = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
_BOX_SAMPLES = 2000
SCHEMA = "hfa.critic-check/1"


@dataclass(frozen=True, eq=False, repr=False)
class CriticCheck(Reported):
    """The verdict on one critic.

    P_rel_error = |P - P*| / |P*|, K_rel_error = |K - K*| / |K*|, Frobenius norms in the units of the game. The checks
    also hold |U (P - P*) U| / |U P* U| and |R^(1/2) (K - K*) U| / |R^(1/2) K* U| with U = diag(`balanced_units`),
    which see an entry that is small in the game's units alone.
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

    def report(self) -> Report:
        """The verdict, every check, the margins, and P and K entry by entry."""
        from verification.critic.check_report import check_report

        return check_report(self)

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

    Checked: relative errors of P and K (Frobenius, as given and in balanced units) and of the policy over a box of
    states, stability of A - B K and A - S P, P > 0, Riccati residual, saddle point, L2 gain below delta; for a run also
    the rank of its data, which is taken from it, and its `settling_time` against T_w. limit: of the errors and the
    residual. box: (n,), half widths, default balanced units. With a limit above `SADDLE_LIMIT` there are no saddle
    checks: they would refuse what the limit allows.
    Raises NoSolutionError when the game itself has no certified solution to compare with.
    """
    exact = solve_game(game)
    P_error = math.nan if candidate.P is None else relative_error(candidate.P, exact.P)
    K_error = relative_error(candidate.K, exact.K)
    finite = bool(np.all(np.isfinite(candidate.K))) and (candidate.P is None or bool(np.all(np.isfinite(candidate.P))))
    loop_abscissa = spectrum(game.A - game.B @ candidate.K).abscissa if finite else math.inf
    units, weights = balanced_units(game), _input_weights(game)
    K_balanced = relative_error(weights @ candidate.K * units, weights @ exact.K * units)
    checks = [
        at_most("K_rel_error", K_error, limit, f"K is off by {K_error:.2g}"),
        at_most("K_balanced_error", K_balanced, limit, f"K is off by {K_balanced:.2g} in balanced units"),
        _policy_check(candidate, exact, weights, units if box is None else box, limit, seed),
        below(
            "control_loop_abscissa", loop_abscissa, 0.0, f"A - B K is not Hurwitz (abscissa {loop_abscissa:+.3g} 1/s)"
        ),
        *(_value_checks(game, candidate.P, exact.P, limit, seed) if candidate.P is not None and finite else ()),
        *((_gain_check(game, candidate.K),) if math.isfinite(game.delta) and finite else ()),
        *(_run_checks(game, run, basis, predefined_time) if run is not None else ()),
    ]
    diagnosis = _poor_data(run) if run is not None else ""
    if not diagnosis and any(check.name in _ERRORS and not check.ok for check in checks):
        diagnosis = _worthless_start(game, run, basis) if run is not None else ""
        diagnosis = diagnosis or (diagnose(game, exact, candidate, basis, limit) if finite else "")
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


def _poor_data(run: LearningResult) -> str:
    if run.excitation.rank >= run.excitation.size:
        return ""
    return (
        f"the data have rank {run.excitation.rank} of {run.excitation.size}: whatever their residual, they do not "
        "determine the weights"
    )


def _worthless_start(game: Game, run: LearningResult, basis: Basis) -> str:
    start = spectrum(game.A - game.B @ game.gain(basis.matrix(run.weights[0]))).abscissa
    if start < 0.0 or run.law == "certified":  # which discounts such a start
        return ""
    return (
        f"the run starts from a policy that does not stabilize (abscissa of A - B K {start:+.3g} 1/s) and has "
        "no value to learn from; give initial_weights of a stabilizing one"
    )


def _input_weights(game: Game) -> np.ndarray:
    """R^(1/2), (m, m): |R^(1/2) u|² = u'Ru, whatever the units of the inputs."""
    eigenvalues, vectors = np.linalg.eigh(game.R)
    return np.asarray(np.sqrt(np.abs(eigenvalues))[:, None] * vectors.T)


def _policy_check(
    candidate: Candidate, exact: GameSolution, weights: np.ndarray, box: np.ndarray, limit: float, seed: int
) -> Check:
    """max |u(z) - u*(z)| / max |u*(z)| over random states of the box, |u|² = u'Ru; weights: R^(1/2)."""
    z = np.random.default_rng(seed).uniform(-box, box, size=(_BOX_SAMPLES, len(box)))
    best = -z @ exact.K.T
    difference = float(np.linalg.norm((candidate.policy(z) - best) @ weights.T, axis=1).max())
    largest = float(np.linalg.norm(best @ weights.T, axis=1).max())
    error = difference / largest if largest > 0.0 else difference
    error = error if math.isfinite(error) else math.inf
    return at_most(
        "policy_rel_error", error, limit, f"the policy is off by {error:.2g} of the largest input in the box"
    )


def _value_checks(game: Game, P: np.ndarray, exact: np.ndarray, limit: float, seed: int) -> tuple[Check, ...]:
    units = balanced_units(game)
    squared = np.outer(units, units)
    balanced, scaled = in_units(game, units), P * squared
    residual = relative_residual(balanced, scaled)
    P_error, P_balanced = relative_error(P, exact), relative_error(scaled, exact * squared)
    smallest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0] / np.abs(scaled).max()) if np.any(scaled) else 0.0
    # The value of a state that costs nothing may be 0, which rounding makes negative; the certificate allows the same.
    least = 0.0 if _is_definite(balanced.Q) else -INDEFINITENESS
    abscissa, change = spectrum(game.A - game.S @ P).abscissa, _saddle_change(limit)
    return (
        at_most("P_rel_error", P_error, limit, f"P is off by {P_error:.2g}"),
        at_most("P_balanced_error", P_balanced, limit, f"P is off by {P_balanced:.2g} in balanced units"),
        below("game_loop_abscissa", abscissa, 0.0, f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"),
        at_least(
            "P_smallest_eigenvalue",
            smallest,
            least,
            f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)",
        ),
        at_most("riccati_residual", residual, limit, f"the Riccati equation is left with a residual of {residual:.2g}"),
        *(
            saddle_checks(balanced, scaled, np.ones(len(P)), seed, change)
            if change is not None and (game.Q.any() or P.any())
            else ()
        ),
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


def _run_checks(game: Game, run: LearningResult, basis: Basis, predefined_time: float | None) -> tuple[Check, ...]:
    """The richness of the data, as the run says it; the settling time only of a law that promises one."""
    rank = run.excitation
    rich = at_least("data_rank", rank.rank, rank.size, f"the data have rank {rank.rank} of {rank.size}")
    if predefined_time is None:
        return (rich,)
    settled = settling_time(game, run, basis)
    late = f"the residual settles at {settled:.4g} s" if math.isfinite(settled) else "the residual does not settle"
    return (rich, at_most("settling_time", settled, predefined_time, f"{late}, not within T_w = {predefined_time:g} s"))


def settling_time(game: Game, run: LearningResult, basis: Basis) -> float:
    """First time from which the Riccati residual of the run's P(t) stays within `SETTLED`, s; inf when it does not.

    Computed from the recorded weights, with `certificate.relative_residual` in balanced units: whatever the law
    measures is not asked.
    """
    units = balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    residuals = np.array([relative_residual(balanced, basis.matrix(weights) * squared) for weights in run.weights])
    above = np.flatnonzero(~(residuals <= SETTLED))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(run.times[first]) if first < len(run.times) else math.inf


def _explained(checks: Iterable[Check], diagnosis: str) -> Iterable[Check]:
    """The first failed check carries the diagnosis, so that the reason stands where a reader looks first."""
    told = not diagnosis
    for check in checks:
        if not check.ok and not told:
            told = True
            yield check._replace(reason=f"{check.reason}: {diagnosis}")
        else:
            yield check
