"""What the paper's update law does when it is run as printed, and modified until it learns: one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game, published_game
from controller.laws.certified import CertifiedSettings, certified_law
from controller.laws.certify import settled_at
from controller.laws.published_law import PublishedSettings, published_law
from controller.laws.run import run
from controller.study.study_rows import STUDY, StudyCase
from controller.training_data.recording import random_pool
from hfa_model.printed_matrices import published_models
from hfa_support.errors import NoSolutionError, refuse_unknown
from hfa_support.jobs.workers import workers
from hfa_support.progress import SaidProgress

#: Half-widths of a box of ordinary deviations, ft/s, rad and rad/s, in the order of `LINEAR_STATES`.
FLIGHT_BOX = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
#: A stack residual below this fraction of its first value counts as settled.
SETTLED = 1e-8
#: Random states of which the samples of a stack are chosen.
POOL = 500
#: Ends that differ by more than this, relative, are not the same.
SAME_END = 0.05


@dataclass(frozen=True)
class StudyRun:
    """One run. overflow: the error line, or "" when the run reached T_w; then the other fields hold.

    P_error, K_error: relative Frobenius errors against the exact game. settled: when the law's own residual
    fell below `SETTLED` of its start for good, s (inf: never). stabilizing: A - S P and A - B K Hurwitz.
    lambda_0, alpha1, alpha2, explicit_step_limit: see `published_equations`; of the start. last_lambda_0: at T_w.
    seed, box: of the stack, see `StudyCase`. P_errors_nearby: P_error from W(0) changed as `StudyCase.nearby` says.
    """

    dihedral_deg: float
    settings: PublishedSettings
    lambda_0: float
    alpha1: float
    alpha2: float
    explicit_step_limit: float
    overflow: str = ""
    P_error: float = np.inf
    K_error: float = np.inf
    settled: float = np.inf
    last_lambda_0: float = np.nan
    stabilizing: bool = False
    certified: bool = False
    seed: int = 0
    box: bool = False
    P_errors_nearby: tuple[float, ...] = ()

    @property
    def decided_by_rounding(self) -> bool:
        """Whether starts that differ in the ninth digit end elsewhere: then P_error is one of several, not a number."""
        return any(abs(other - self.P_error) > SAME_END * self.P_error for other in self.P_errors_nearby)


@dataclass(frozen=True)
class StudyRow:
    """One line of the table: a setting, its runs, and why they end as they do."""

    name: str
    cause: str
    runs: tuple[StudyRun, ...]

    @property
    def finished(self) -> tuple[StudyRun, ...]:
        """The runs that reached T_w with finite numbers."""
        return tuple(one for one in self.runs if not one.overflow)

    @property
    def decided_by_rounding(self) -> int | None:
        """Number of runs whose end hangs on rounding; None where no run was made again from a start nearby."""
        asked = any(one.P_errors_nearby for one in self.runs)
        return sum(one.decided_by_rounding for one in self.runs) if asked else None

    def span(self, field: str) -> tuple[float, float]:
        """Smallest and largest value of a field over the finished runs, or over all for λ₀, α and the step."""
        runs = self.runs if field in ("lambda_0", "alpha1", "alpha2", "explicit_step_limit") else self.finished
        values = [float(getattr(one, field)) for one in runs]
        values += [error for one in runs for error in one.P_errors_nearby if field == "P_error"]
        return (min(values), max(values)) if values else (np.nan, np.nan)


class PlannedRun(NamedTuple):
    """One run of a row before it is made."""

    dihedral_deg: float
    case: StudyCase
    settings: PublishedSettings

    @property
    def stack(self) -> dict[str, Any]:
        """Where its samples come from."""
        return {"seed": self.case.seed, "box": self.case.box}


def planned_runs(name: str, references: Mapping[float, Reference]) -> tuple[PlannedRun, ...]:
    """The runs of a row of `STUDY`, every case on both models."""
    return tuple(
        PlannedRun(dihedral, case, reference.settings(case))
        for case in STUDY[name].cases()
        for dihedral, reference in references.items()
    )


def published_study(
    rows: tuple[str, ...] | None = None,
    progress: SaidProgress | None = None,
    *,
    known: Callable[[str, Sequence[PlannedRun]], tuple[StudyRun, ...] | None] = lambda name, planned: None,
    keep: Callable[[StudyRow, Sequence[PlannedRun]], None] = lambda row, planned: None,
    processes: int = 1,
) -> tuple[StudyRow, ...]:
    """Run every row of `STUDY` (or those named) on both published models.

    known: from a row's name and runs to the runs as they were made before, None for a row that is to be run. keep:
    called after each row that was run. processes: that share the runs. Raises BadInputError for an unknown row.
    """
    names = tuple(STUDY) if rows is None else rows
    for name in names:
        refuse_unknown("unknown row", name, STUDY)
    references = references_of_models()
    planned = {name: planned_runs(name, references) for name in names}
    before = {name: known(name, planned[name]) for name in names}
    finished = [StudyRow(name, STUDY[name].cause, before[name] or ()) for name in names]
    waiting = [(row, one) for row, name in enumerate(names) if before[name] is None for one in planned[name]]
    made: dict[int, StudyRun] = {}
    with workers(processes) as run_on:
        for key, result in run_on(_run, enumerate((references[one.dihedral_deg], one) for _, one in waiting)):
            made[key], row = result, waiting[key][0]
            if progress is not None:
                progress(len(made) / len(waiting), names[row])
            of_row = [made.get(each) for each, (other, _) in enumerate(waiting) if other == row]
            if None not in of_row:
                finished[row] = replace(finished[row], runs=tuple(filter(None, of_row)))
                keep(finished[row], planned[names[row]])
    return tuple(finished)


@dataclass(frozen=True)
class Reference:
    """The game, its exact solution, and a stabilizing start: the LQ solution for Q = 1000 I."""

    game: Game
    exact: LearningResult
    lqr_weights: tuple[float, ...]

    @classmethod
    def of(cls, game: Game) -> Reference:
        """The reference of one game. Raises NoSolutionError when the certified law does not find it."""
        lqr = replace(game, Q=1000.0 * np.eye(len(game.A)), delta=np.inf)
        return cls(game, _certified(game), tuple(_certified(lqr).weights[-1].tolist()))

    def settings(self, case: StudyCase) -> PublishedSettings:
        """The settings of one run on this model: 50 samples of a pool of 500, whatever the basis."""
        starts: dict[str, Any] = dict.fromkeys(case.from_lqr, self.lqr_weights)
        return PublishedSettings(samples=50, pool_samples=POOL, **case.changes, **starts)


def references_of_models() -> dict[float, Reference]:
    """The references of both printed models by dihedral angle, degrees."""
    return {model.dihedral_deg: Reference.of(published_game(model.A, model.B)) for model in published_models()}


def _certified(game: Game) -> LearningResult:
    law = certified_law(game, CertifiedSettings(tick=0.1), seed=0)
    result = law.conclude(run(law))
    if not result.converged:
        raise NoSolutionError(f"no certified reference for the study: {result.outcome}")
    return result


def _run(reference: Reference, planned: PlannedRun) -> StudyRun:
    """One run of the published law."""
    game, exact, case, chosen = reference.game, reference.exact, planned.case, planned.settings
    pool = random_pool(game, POOL, case.seed, np.array(FLIGHT_BOX)) if case.box else None
    law = published_law(game, chosen, case.seed, pool)
    facts: dict[str, Any] = {
        "dihedral_deg": planned.dihedral_deg,
        "settings": chosen,
        "lambda_0": law.theorem.lambda_0,
        "alpha1": law.gains[0],
        "alpha2": law.gains[1],
        "explicit_step_limit": law.explicit_step_limit,
        **planned.stack,
    }
    try:
        finished = run(law)
    except NoSolutionError as error:
        return StudyRun(**facts, overflow=str(error))
    result, end = law.conclude(finished), finished.memory["weights"]
    start = np.array(chosen.initial_weights)
    nearby = [replace(chosen, initial_weights=(start * (1.0 + change)).tolist()) for change in case.nearby]
    repeated = [published_law(game, other, case.seed, pool) for other in nearby]
    own = result.law_residual_norm
    return StudyRun(
        **facts,
        P_error=_error(result.P, exact.P),
        K_error=_error(result.K, exact.K),
        settled=settled_at(result.times, own, SETTLED * own[0]),
        stabilizing=all(row.ok for row in result.certificates if row.name.startswith("abscissa")),
        last_lambda_0=float(np.linalg.svd(law.history.at(end).regressors, compute_uv=False)[-1] ** 2),
        certified=result.converged,
        P_errors_nearby=tuple(_error(other.conclude(run(other)).P, exact.P) for other in repeated),
    )


def _error(learned: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(learned - exact) / np.linalg.norm(exact))
