"""What the paper's update law does when it is run as printed, and modified until it learns: one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game, published_game
from controller.laws.certified import CertifiedSettings, certified_law
from controller.laws.certify import settled_at
from controller.laws.published_law import PublishedSettings, published_law
from controller.laws.run import Progress, run
from controller.samples.recording import random_pool
from hfa_model.published import published_models
from hfa_model.support.errors import BadInputError, NoSolutionError

#: z(0) = x(0) - x_d(0) of Section 5.1: the flight that gives the current sample starts here.
FLIGHT_START = (-2.0, -0.05, 0.0, 0.0, -0.5, 0.0)
#: Half-widths of a box of ordinary deviations, ft/s, rad and rad/s, in the order of `LINEAR_STATES`.
FLIGHT_BOX = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
#: A stack residual below this fraction of its first value counts as settled.
SETTLED = 1e-8
#: Random states of which the samples of a stack are chosen.
POOL = 500


@dataclass(frozen=True)
class StudyRun:
    """One run. overflow: the error line, or "" when the run reached T_w; then the other fields hold.

    P_error, K_error: relative Frobenius errors against the exact game. settled: when the law's own residual
    fell below `SETTLED` of its start for good, s (inf: never). stabilizing: A - S P and A - B K Hurwitz.
    lambda_0, alpha1, alpha2, explicit_step_limit: see `published_equations`; of the start. last_lambda_0: at T_w.
    seed, box: of the stack, see `StudyCase`.
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

    def span(self, field: str) -> tuple[float, float]:
        """Smallest and largest value of a field over the finished runs, or over all for λ₀, α and the step."""
        runs = self.runs if field in ("lambda_0", "alpha1", "alpha2", "explicit_step_limit") else self.finished
        values = [float(getattr(one, field)) for one in runs]
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
    progress: Progress | None = None,
    *,
    known: Callable[[str, Sequence[PlannedRun]], tuple[StudyRun, ...] | None] = lambda name, planned: None,
    keep: Callable[[StudyRow, Sequence[PlannedRun]], None] = lambda row, planned: None,
) -> tuple[StudyRow, ...]:
    """Run every row of `STUDY` (or those named) on both published models; takes a few minutes.

    known: from a row's name and runs to the runs as they were made before, None for a row that is to be run. keep:
    called after each row that was run. Raises BadInputError for an unknown row.
    """
    names = tuple(STUDY) if rows is None else rows
    for name in names:
        if name not in STUDY:
            raise BadInputError(f"unknown row '{name}'; choose from: {', '.join(STUDY)}")
    references = references_of_models()
    planned = {name: planned_runs(name, references) for name in names}
    before = {name: known(name, planned[name]) for name in names}
    count, total = 0, sum(len(planned[name]) for name in names if before[name] is None)
    done = []
    for name in names:
        runs = list(before[name] or ())
        for one in planned[name][len(runs) :]:
            runs.append(_run(references[one.dihedral_deg], one))
            count += 1
            if progress is not None:
                progress(count / total, name)
        done.append(StudyRow(name, STUDY[name].cause, tuple(runs)))
        if before[name] is None:
            keep(done[-1], planned[name])
    return tuple(done)


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
    own = result.law_residual_norm
    return StudyRun(
        **facts,
        P_error=_error(result.P, exact.P),
        K_error=_error(result.K, exact.K),
        settled=settled_at(result.times, own, SETTLED * own[0]),
        stabilizing=all(row.ok for row in result.certificates if row.name.startswith("abscissa")),
        last_lambda_0=float(np.linalg.svd(law.history.at(end).regressors, compute_uv=False)[-1] ** 2),
        certified=result.converged,
    )


def _error(learned: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(learned - exact) / np.linalg.norm(exact))


class StudyCase(NamedTuple):
    """changes: of `PublishedSettings`. seed: of the stack. from_lqr: weights set to the stabilizing start.

    box: the stack is drawn from `FLIGHT_BOX` instead of `recording.natural_spread`.
    """

    changes: dict[str, Any]
    seed: int = 0
    from_lqr: tuple[str, ...] = ()
    box: bool = False


@dataclass(frozen=True)
class _Row:
    cases: Callable[[], Iterator[StudyCase]]
    cause: str


_COORDINATES, _NORMALISATIONS, _POLICIES = ("raw", "scaled"), ("root", "squared"), ("frozen", "reevaluated")


def _grid(bases: tuple[str, ...], **fixed: Any) -> Iterator[StudyCase]:
    for name, coordinates, kind, policies in product(bases, _COORDINATES, _NORMALISATIONS, _POLICIES):
        choice = {"basis": name, "coordinates": coordinates, "normalisation": kind, "stack_policies": policies}
        yield StudyCase(choice | fixed)


def _by_hand(coordinates: str, basis: str) -> Iterator[StudyCase]:
    for gain in (1.0, 10.0, 100.0, 1e3, 1e4):
        flight = {"coordinates": coordinates, "basis": basis, "flight_start": FLIGHT_START}
        yield StudyCase(flight | {"gains": (gain, gain)})


def _by_hand_from_lqr() -> Iterator[StudyCase]:
    for policies, seed in product(_POLICIES, (0, 1)):
        flight = _SCALED | {"stack_policies": policies, "gains": (100.0, 100.0), "flight_start": FLIGHT_START}
        yield StudyCase(flight, seed, ("initial_weights", "recorded_weights"))


def _frozen_alone() -> Iterator[StudyCase]:
    for kind in _NORMALISATIONS:
        yield StudyCase(_SCALED | _IMPLICIT | {"normalisation": kind, "initial_weights": 0.0}, 0, ("recorded_weights",))


def _reevaluated_alone(box: bool) -> Iterator[StudyCase]:
    for kind, seed in product(_NORMALISATIONS, (0, 1, 2)):
        choice = _SCALED | _IMPLICIT | {"normalisation": kind, "stack_policies": "reevaluated"}
        yield StudyCase(choice, seed, ("initial_weights",), box)


_SCALED: dict[str, Any] = {"basis": "quadratic", "coordinates": "scaled"}
_IMPLICIT: dict[str, Any] = {"integrator": "proximal", "step": 0.01}

#: The rows of the table in order.
STUDY: dict[str, _Row] = {
    "theorem gains, explicit": _Row(
        lambda: _grid(("quadratic", "paper", "quadratic+linear"), flight_start=FLIGHT_START),
        "lambda_0 of a stack on this aircraft is tiny, so alpha1 and alpha2 of Theorem 1 are huge, and the step"
        " that explicit integration needs is far below the 1e-4 s of the paper.",
    ),
    "theorem gains, implicit": _Row(
        lambda: _grid(("quadratic", "paper"), integrator="proximal", step=0.05),
        "The implicit step survives, but W(0) = 100 does not stabilize: frozen policies have no value, and"
        " re-evaluated ones do not lead to the stabilizing root of the Riccati equation.",
    ),
    "gains by hand, raw, W(0) = 100": _Row(
        lambda: _by_hand("raw", "paper"),
        "W(0) = 100 does not stabilize; on the 5 degree model it makes a pole of -7.6e4 rad/s that no explicit"
        " step of 1e-4 s survives, and the flight is lost before the critic has learned.",
    ),
    "gains by hand, scaled, W(0) = 100": _Row(
        lambda: _by_hand("scaled", "quadratic"),
        "As above; at 15 degrees scaling keeps some runs bounded and does not make them accurate.",
    ),
    "gains by hand, scaled, stabilizing W(0)": _Row(
        _by_hand_from_lqr,
        "A stabilizing start, scaling and gains by hand keep flight and weights bounded; gains that an explicit"
        " step survives do not move the directions of the small eigenvalues of Sigma within T_w.",
    ),
    "learning alone, frozen, implicit": _Row(
        _frozen_alone,
        "Settles within theta T_w / 2 as the proof of Theorem 1 gives, but at the value of the recorded policies,"
        " not of the game.",
    ),
    "learning alone, re-evaluated, implicit": _Row(
        lambda: _reevaluated_alone(box=False),
        "With a stabilizing start, policies re-evaluated, an implicit step and states sampled"
        " with the plant's stationary deviations, the law finds the game's value.",
    ),
    "learning alone, re-evaluated, implicit, poorer stack": _Row(
        lambda: _reevaluated_alone(box=True),
        "The same from states of an ordinary flight (rates as small as the angles): the ideal case of Theorem 1"
        " does not occur because the residual is quadratic in the weight error, and Sigma moves: the gains are"
        " made for the lambda_0 of the start.",
    ),
}
