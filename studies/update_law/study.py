"""The rows of the table of the study, and the runs of each row, as values for JSON.

None replaces a number that is not finite or was not reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from controller import random_pool, run
from controller.critic.training_run import TrainingRun, settled_at
from controller.learning.published import PublishedSettings, published_law
from controller.riccati.balancing import is_hurwitz
from hfa import Game, NoSolutionError, learn, verify
from hfa.paper import published_game
from hfa_model import published_models
from hfa_support.reporting.data_files import jsonable
from verification import relative_error

SCHEMA = "hfa.published-study/2"
#: Half-widths of a box of typical deviations, ft/s, rad and rad/s, in the order of
#: `LINEAR_STATES`.
FLIGHT_BOX = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
#: Fraction of the initial residual below which the law has settled.
SETTLED = 1e-8
#: Relative difference above which two results are different.
SAME_END = 0.05
#: Numbers of every run, and numbers of runs that reached T_w.
_AT_START = ("lambda_0", "alpha1", "alpha2", "explicit_step_limit")
_AT_END = ("P_error", "K_error", "settled", "last_lambda_0")
_LOST = {**dict.fromkeys(_AT_END), "stabilizing": False, "certified": False}
#: Initial state z(0) = x(0) - x_d(0) of Section 5.1 for flights.
FLIGHT_START = (-2.0, -0.05, 0.0, 0.0, -0.5, 0.0)
#: Relative changes of W(0) that should not change the result. If they do, it depends on rounding.
NEARBY = (-1e-9, 1e-9)
_POLICIES = ("frozen", "reevaluated")
_NORMALISATIONS = ("root", "squared")
_SCALED: dict[str, Any] = {"basis": "quadratic", "coordinates": "scaled"}
_IMPLICIT: dict[str, Any] = {"integrator": "proximal", "step": 0.01}


class Case(NamedTuple):
    """Settings of a run of the update law.

    changes: changed fields of `PublishedSettings`
    seed: seed of the recorded samples
    from_lqr: fields set to the weights of the stabilizing LQ solution
    box: whether samples are drawn from `FLIGHT_BOX` instead of the plant's stationary deviations
    nearby: relative changes of W(0) with which the run is repeated
    """

    changes: dict[str, Any]
    seed: int = 0
    from_lqr: tuple[str, ...] = ()
    box: bool = False
    nearby: tuple[float, ...] = ()


class Row(NamedTuple):
    """A row of the table of the study.

    cases: function that yields the cases, each of which is run on both printed models
    cause: cause of the outcome
    """

    cases: Callable[[], Iterator[Case]]
    cause: str


def _theorem(
    bases: tuple[str, ...], nearby: tuple[float, ...] = (), **fixed: Any
) -> Iterator[Case]:
    names = ("basis", "coordinates", "normalisation", "stack_policies")
    for chosen in product(bases, ("raw", "scaled"), _NORMALISATIONS, _POLICIES):
        yield Case(dict(zip(names, chosen, strict=True)) | fixed, nearby=nearby)


def _gain_cases(**fixed: Any) -> Iterator[Case]:
    for gain in (1.0, 10.0, 100.0, 1e3, 1e4):
        yield Case(fixed | {"flight_start": FLIGHT_START, "gains": (gain, gain)})


def _lqr_cases() -> Iterator[Case]:
    for policies, seed in product(_POLICIES, (0, 1)):
        flight = _SCALED | {
            "stack_policies": policies,
            "gains": (100.0, 100.0),
            "flight_start": FLIGHT_START,
        }
        yield Case(flight, seed, ("initial_weights", "recorded_weights"))


def _frozen_alone() -> Iterator[Case]:
    for kind in _NORMALISATIONS:
        yield Case(
            _SCALED | _IMPLICIT | {"normalisation": kind, "initial_weights": 0.0},
            0,
            ("recorded_weights",),
        )


def _reevaluated_alone(box: bool) -> Iterator[Case]:
    for kind, seed in product(_NORMALISATIONS, (0, 1, 2)):
        choice = _SCALED | _IMPLICIT | {"normalisation": kind, "stack_policies": "reevaluated"}
        yield Case(choice, seed, ("initial_weights",), box)


#: Rows of the table, in order.
ROWS = {
    "theorem gains, explicit": Row(
        lambda: _theorem(("quadratic", "paper", "quadratic+linear"), flight_start=FLIGHT_START),
        "lambda_0 of a stack on this aircraft is tiny, so alpha1 and alpha2 of Theorem 1 are huge,"
        " and the step that explicit integration needs is far below the 1e-4 s of the paper.",
    ),
    "theorem gains, implicit": Row(
        lambda: _theorem(("quadratic", "paper"), NEARBY, integrator="proximal", step=0.05),
        "The implicit step survives, but W(0) = 100 does not stabilize: frozen policies have no"
        " value, and re-evaluated ones end at a root of the Riccati equation that is not the"
        " stabilizing one, or by accident at it: where a run is decided by rounding, another start"
        " in the ninth digit of W(0) leads to another root.",
    ),
    "gains by hand, raw, W(0) = 100": Row(
        lambda: _gain_cases(coordinates="raw", basis="paper"),
        "W(0) = 100 does not stabilize; on the 5 degree model it makes a pole of -7.6e4 rad/s that"
        " no explicit step of 1e-4 s survives, and the flight is lost before the critic has"
        " learned.",
    ),
    "gains by hand, scaled, W(0) = 100": Row(
        lambda: _gain_cases(coordinates="scaled", basis="quadratic"),
        "As above; at 15 degrees scaling keeps some runs bounded and does not make them accurate.",
    ),
    "gains by hand, scaled, stabilizing W(0)": Row(
        _lqr_cases,
        "A stabilizing start, scaling and gains by hand keep flight and weights bounded; gains that"
        " an explicit step survives do not move the directions of the small eigenvalues of Sigma"
        " within T_w.",
    ),
    "learning alone, frozen, implicit": Row(
        _frozen_alone,
        "Settles within theta T_w / 2 as the proof of Theorem 1 gives, but at the value of the"
        " recorded policies, not of the game.",
    ),
    "learning alone, re-evaluated, implicit": Row(
        lambda: _reevaluated_alone(box=False),
        "With a stabilizing start, policies re-evaluated, an implicit step and states sampled"
        " with the plant's stationary deviations, the law finds the game's value.",
    ),
    "learning alone, re-evaluated, implicit, poorer stack": Row(
        lambda: _reevaluated_alone(box=True),
        "The same from states of an ordinary flight (rates as small as the angles): the ideal case"
        " of Theorem 1 does not occur because the residual is quadratic in the weight error, and"
        " Sigma moves: the gains are made for the lambda_0 of the start.",
    ),
}


class Reference(NamedTuple):
    """The game of a printed model, its exact solution, and weights that stabilize the model.

    lqr_weights: weights of the LQ solution for Q = 1000 I
    """

    dihedral_deg: float
    game: Game
    exact: TrainingRun
    lqr_weights: tuple[float, ...]

    def settings(self, case: Case) -> PublishedSettings:
        """Return the settings of the update law for one case."""
        return PublishedSettings(**case.changes | dict.fromkeys(case.from_lqr, self.lqr_weights))


def references() -> tuple[Reference, ...]:
    """Return the reference of each printed model, whose solutions are learned by the certified law.

    Raises NoSolutionError if the learning does not settle.
    """
    found = []
    for model in published_models():
        game = published_game(model.A, model.B)
        lqr = replace(game, Q=1000.0 * np.eye(len(game.A)), delta=np.inf)
        exact = learn(game, tick=0.1)
        start = learn(lqr, tick=0.1)
        if not (exact.settled and start.settled):
            raise NoSolutionError(
                f"learning does not settle at {model.dihedral_deg:g} deg; run hfa learn for details"
            )
        found.append(Reference(model.dihedral_deg, game, exact, tuple(start.weights[-1].tolist())))
    return tuple(found)


def made(reference: Reference, case: Case, chosen: PublishedSettings) -> dict[str, Any]:
    """Return the result of one run of the published law.

    - overflow: the reason, or "" if the run reached T_w
    - P_error, K_error: relative to the exact solution, or None after an overflow
    - settled: time after which the residual of the law stays below `SETTLED` times its initial
      value, s, or None
    - stabilizing: whether A - S P and A - B K are Hurwitz
    - certified: whether the final weights pass all checks
    - lambda_0, alpha1, alpha2, explicit_step_limit: at the start
    - last_lambda_0: lambda_0 at T_w, or None after an overflow
    - P_errors_nearby: P_error for the changed W(0) of `case.nearby`
    """
    game = reference.game
    exact = reference.exact
    widths = np.array(FLIGHT_BOX) if case.box else None
    pool = random_pool(game, chosen.pool_samples, case.seed, widths)
    law = published_law(game, chosen, case.seed, pool)
    facts = {"dihedral_deg": reference.dihedral_deg, "settings": asdict(chosen), **law.facts}
    stack: dict[str, Any] = {"seed": case.seed, "box": case.box}
    try:
        finished = run(law)
    except NoSolutionError as error:
        lost: dict[str, Any] = jsonable(
            {**facts, "overflow": str(error), **_LOST, **stack, "P_errors_nearby": []}
        )
        return lost
    result = law.conclude(finished)
    last = law.recorded(finished.memory["weights"])
    own = result.law_residual_norm
    start = np.array(chosen.initial_weights)
    nearby = [
        replace(chosen, initial_weights=(start * (1.0 + change)).tolist()) for change in case.nearby
    ]
    repeated = [published_law(game, other, case.seed, pool) for other in nearby]
    ended = {
        "P_error": relative_error(result.P, exact.P),
        "K_error": relative_error(result.K, exact.K),
        "settled": settled_at(result.time, own, SETTLED * own[0]),
        "last_lambda_0": float(np.linalg.svd(last.regressors, compute_uv=False)[-1] ** 2),
        "stabilizing": (
            is_hurwitz(game.A - game.S @ result.P) and is_hurwitz(game.A - game.B @ result.K)
        ),
        "certified": verify(game, result).ok,
    }
    stack["P_errors_nearby"] = [
        relative_error(other.conclude(run(other)).P, exact.P) for other in repeated
    ]
    whole: dict[str, Any] = jsonable({**facts, "overflow": "", **ended, **stack})
    return whole


def planned(
    name: str, of: tuple[Reference, ...]
) -> list[tuple[Reference, Case, PublishedSettings]]:
    """Return the runs of the row `name` of `ROWS`: every case on both models.

    A run is (reference, case, settings).
    """
    return [
        (reference, case, reference.settings(case))
        for case in ROWS[name].cases()
        for reference in of
    ]


def summed_up(name: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the data of a row of the table: counts, ranges [smallest, largest], and the runs.

    The count `decided_by_rounding` is None if no run was repeated from a nearby start.

    name: name of the row
    runs: results of the runs, as `made` returns them
    """
    finished = [one for one in runs if not one["overflow"]]
    return {
        "name": name,
        "cause": ROWS[name].cause,
        "count": len(runs),
        "overflow": len(runs) - len(finished),
        "stabilizing": sum(one["stabilizing"] for one in runs),
        "certified": sum(one["certified"] for one in runs),
        "decided_by_rounding": (
            sum(map(by_rounding, runs)) if any(one["P_errors_nearby"] for one in runs) else None
        ),
        "ranges": (
            {field: _range(field, runs) for field in _AT_START}
            | {field: _range(field, finished) for field in _AT_END}
        ),
        "runs": runs,
    }


def by_rounding(one: dict[str, Any]) -> bool:
    """Return whether rounding decides the result of a run.

    This is the case if a run from a slightly changed W(0) ends with another P_error. Two values of
    P_error differ if their relative difference is above `SAME_END`.

    one: result of the run, as `made` returns it
    """
    return any(
        abs(other - one["P_error"]) > SAME_END * one["P_error"] for other in one["P_errors_nearby"]
    )


def _range(field: str, runs: list[dict[str, Any]]) -> list[float | None]:
    values = [math.inf if one[field] is None else one[field] for one in runs]
    values += [error for one in runs for error in one["P_errors_nearby"] if field == "P_error"]
    found: list[float | None] = jsonable([min(values), max(values)]) if values else [None, None]
    return found
