"""What the paper's update law does when it is run as printed, and with the help that it needs: one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game, published_game
from controller.laws.certified import CertifiedSettings, certified_law
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


@dataclass(frozen=True)
class StudyRun:
    """One run. overflow: the error line, or "" when the run reached T_w; then the other fields hold.

    P_error, K_error: relative Frobenius errors against the exact game. settled: when the law's own residual
    fell below `SETTLED` of its start for good, s (inf: never). stabilizing: A - S P and A - B K Hurwitz.
    lambda_0, alpha1, alpha2, explicit_step_limit: see `published_equations`; of the start. last_lambda_0: at T_w.
    seed, box: of the stack, see `Case`.
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


def published_study(
    rows: tuple[str, ...] | None = None,
    progress: Progress | None = None,
    *,
    finished: tuple[StudyRow, ...] = (),
    keep: Callable[[tuple[StudyRow, ...]], None] | None = None,
) -> tuple[StudyRow, ...]:
    """Run every row of `STUDY` (or those named) on both published models; takes a few minutes.

    finished: rows of an earlier study, taken as they are. keep: called after each row with all rows that there are.
    Raises BadInputError for an unknown row, and for a finished one that today's `STUDY` would run otherwise.
    """
    names = tuple(STUDY) if rows is None else rows
    for name in (*names, *(row.name for row in finished)):
        if name not in STUDY:
            raise BadInputError(f"unknown row '{name}'; choose from: {', '.join(STUDY)}")
    references = {model.dihedral_deg: _Reference.of(published_game(model.A, model.B)) for model in published_models()}
    done = {row.name: _as_today(row, references) for row in finished}
    cases = {name: tuple(STUDY[name].cases()) for name in names if name not in done}
    count, total = 0, sum(len(of_row) for of_row in cases.values())
    for name, of_row in cases.items():
        runs: list[StudyRun] = []
        for case in of_row:
            runs += [_run(dihedral, reference, case) for dihedral, reference in references.items()]
            count += 1
            if progress is not None:
                progress(count / total, name)
        done[name] = StudyRow(name, STUDY[name].cause, tuple(runs))
        if keep is not None:
            keep(tuple(done.values()))
    return tuple(done[name] for name in names)


def _as_today(row: StudyRow, references: dict[float, _Reference]) -> StudyRow:
    """The row with today's words on its cause, if its runs are those that would be made today."""
    today = [
        (dihedral, case.seed, case.box, reference.settings(case))
        for case in STUDY[row.name].cases()
        for dihedral, reference in references.items()
    ]
    stored = [(run.dihedral_deg, run.seed, run.box, run.settings) for run in row.runs]
    if len(stored) != len(today) or not all(map(_are_alike, stored, today)):
        raise BadInputError(f"row '{row.name}' was made with other settings than today's; run it anew")
    return replace(row, cause=STUDY[row.name].cause)


def _are_alike(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """The same run; weights, which another processor rounds in another way, to nine digits."""
    weights = ("initial_weights", "recorded_weights")
    (*facts, chosen), (*other_facts, other_chosen) = one, other
    pairs = [(np.array(getattr(chosen, name)), np.array(getattr(other_chosen, name))) for name in weights]
    blank = dict.fromkeys(weights, 0.0)
    return (
        facts == other_facts
        and replace(chosen, **blank) == replace(other_chosen, **blank)
        and all(a.shape == b.shape and np.allclose(a, b, rtol=1e-9, atol=0.0) for a, b in pairs)
    )


@dataclass(frozen=True)
class _Reference:
    """The game, its exact solution, and a stabilizing start: the LQ solution for Q = 1000 I."""

    game: Game
    exact: LearningResult
    lqr_weights: tuple[float, ...]

    @classmethod
    def of(cls, game: Game) -> _Reference:
        lqr = replace(game, Q=1000.0 * np.eye(len(game.A)), delta=np.inf)
        return cls(game, _certified(game), tuple(_certified(lqr).weights[-1].tolist()))

    def settings(self, case: Case) -> PublishedSettings:
        """The settings of one run on this model."""
        starts: dict[str, Any] = dict.fromkeys(case.from_lqr, self.lqr_weights)
        return PublishedSettings(**case.changes, **starts)


def _certified(game: Game) -> LearningResult:
    law = certified_law(game, CertifiedSettings(tick=0.1), seed=0)
    result = law.conclude(run(law))
    if not result.converged:
        raise NoSolutionError(f"no certified reference for the study: {result.status}")
    return result


def _run(dihedral: float, reference: _Reference, case: Case) -> StudyRun:
    """One run of the published law."""
    chosen = reference.settings(case)
    pool = random_pool(reference.game, chosen.pool_samples, case.seed, np.array(FLIGHT_BOX)) if case.box else None
    law = published_law(reference.game, chosen, case.seed, pool)
    facts: dict[str, Any] = {
        "dihedral_deg": dihedral,
        "settings": chosen,
        "lambda_0": law.theorem.lambda_0,
        "alpha1": law.gains[0],
        "alpha2": law.gains[1],
        "explicit_step_limit": law.explicit_step_limit,
        "seed": case.seed,
        "box": case.box,
    }
    try:
        finished = run(law)
    except NoSolutionError as error:
        return StudyRun(**facts, overflow=str(error))
    result, end = law.conclude(finished), finished.memory["weights"]
    own = result.law_residual_norm
    above = np.flatnonzero(~(own <= SETTLED * own[0]))
    return StudyRun(
        **facts,
        P_error=_error(result.P, reference.exact.P),
        K_error=_error(result.K, reference.exact.K),
        settled=float(result.times[above[-1] + 1]) if above[-1] + 1 < len(own) else np.inf,
        stabilizing=all(row.ok for row in result.certificates if row.name.startswith("abscissa")),
        last_lambda_0=float(np.linalg.svd(law.history.at(end).regressors, compute_uv=False)[-1] ** 2),
        certified=result.converged,
    )


def _error(learned: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(learned - exact) / np.linalg.norm(exact))


class Case(NamedTuple):
    """changes: of `PublishedSettings`. seed: of the stack. from_lqr: weights set to the stabilizing start.

    box: the stack is drawn from `FLIGHT_BOX` instead of `recorder.natural_spread`.
    """

    changes: dict[str, Any]
    seed: int = 0
    from_lqr: tuple[str, ...] = ()
    box: bool = False


@dataclass(frozen=True)
class _Row:
    cases: Callable[[], Iterator[Case]]
    cause: str


_COORDINATES, _NORMALISATIONS, _POLICIES = ("raw", "scaled"), ("root", "squared"), ("frozen", "reevaluated")


def _grid(bases: tuple[str, ...], **fixed: Any) -> Iterator[Case]:
    for name, coordinates, kind, policies in product(bases, _COORDINATES, _NORMALISATIONS, _POLICIES):
        choice = {"basis": name, "coordinates": coordinates, "normalisation": kind, "stack_policies": policies}
        yield Case(choice | fixed)


def _by_hand(coordinates: str, basis: str) -> Iterator[Case]:
    for gain in (1.0, 10.0, 100.0, 1e3, 1e4):
        flight = {"coordinates": coordinates, "basis": basis, "flight_start": FLIGHT_START}
        yield Case(flight | {"gains": (gain, gain)})


def _by_hand_from_lqr() -> Iterator[Case]:
    for policies, seed in product(_POLICIES, (0, 1)):
        flight = _SCALED | {"stack_policies": policies, "gains": (100.0, 100.0), "flight_start": FLIGHT_START}
        yield Case(flight, seed, ("initial_weights", "recorded_weights"))


def _frozen_alone() -> Iterator[Case]:
    for kind in _NORMALISATIONS:
        yield Case(_SCALED | _IMPLICIT | {"normalisation": kind, "initial_weights": 0.0}, 0, ("recorded_weights",))


def _reevaluated_alone(box: bool) -> Iterator[Case]:
    for kind, seed in product(_NORMALISATIONS, (0, 1, 2)):
        choice = _SCALED | _IMPLICIT | {"normalisation": kind, "stack_policies": "reevaluated"}
        yield Case(choice, seed, ("initial_weights",), box)


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
        "With a stabilizing start, policies re-evaluated, an implicit step and a stack spread as the plant spreads"
        " its states, the law finds the game's value.",
    ),
    "learning alone, re-evaluated, implicit, poorer stack": _Row(
        lambda: _reevaluated_alone(box=True),
        "The same from states of an ordinary flight (rates as small as the angles): the ideal case of Theorem 1"
        " does not occur because the residual is quadratic in the weight error, and Sigma moves: the gains are"
        " made for the lambda_0 of the start.",
    ),
}
