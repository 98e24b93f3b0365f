"""One entry to all learning laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.certified import CertifiedSettings, certified_law
from controller.laws.integral_rl import IrlSettings, integral_learning
from controller.laws.run import run
from controller.training_data.recording import Stack
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.progress import Progress


@dataclass(frozen=True)
class Law:
    """settings: the dataclass of its options. build: (game, settings, seed, pool) -> the process to run."""

    settings: Callable[..., Any]
    build: Callable[[Game, Any, int, Stack | None], Any]


LAWS: dict[str, Law] = {
    "certified": Law(CertifiedSettings, certified_law),
    "irl": Law(IrlSettings, integral_learning),
}


def learn(
    game: Game,
    law: str = "certified",
    seed: int = 0,
    *,
    pool: Stack | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> LearningResult:
    """Learn the value z'Pz and the gain K of a game with one of `LAWS`.

    pool: recorded samples (z, F) to learn from; by default states drawn with `seed`. options: fields of the
    law's settings (`CertifiedSettings`, `IrlSettings`). progress is
    called with (fraction done, 1, residual).

    The result says "failed: reason" when the law ran to its end and a certificate does not hold. Raises
    BadInputError for an unknown law or option and for data that cannot determine the weights; NoSolutionError
    when the law cannot reach its end: no game value at this delta, (A, B) not stabilizable, overflow.
    """
    refuse_unknown("unknown law", law, LAWS)
    known = [field.name for field in fields(LAWS[law].settings)]  # type: ignore[arg-type]
    for name in options:
        refuse_unknown(f"law '{law}' has no setting", name, known)
    if not game.Q.any():
        raise BadInputError("Q is zero: every law measures its residual against z'Qz; give some state a cost")
    if not isinstance(pool, Stack | None):
        raise BadInputError(f"pool is {pool!r}; pool must be a Stack of recorded samples")
    process = LAWS[law].build(game, LAWS[law].settings(**options), seed, pool)
    result: LearningResult = process.conclude(run(process, progress=progress))
    return result
