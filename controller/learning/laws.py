"""The learning laws by name, and the verb that runs one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.learning.certified import CertifiedSettings, certified_law
from controller.learning.integral_rl import IrlSettings, integral_rl
from controller.learning.published import (
    ModifiedSettings,
    PublishedSettings,
    modified_law,
    published_law,
)
from controller.learning.recording import Stack
from controller.learning.ticks import run
from hfa_support.arguments import checks_arguments, need
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.progress import Progress

#: Law of `learn` by default.
DEFAULT = "certified"


class Law(NamedTuple):
    """A learning law.

    settings: dataclass of its settings
    make: function (game, settings, seed, pool) -> learner for `controller.run`, with `conclude`
    """

    settings: type[Any]
    make: Callable[[Game, Any, int, Stack | None], Any]


#: Name -> law: the one of this project, the paper's (Eq. 46) as printed, the same with
#: modifications that keep it bounded, and the paper's baseline.
LAWS: Mapping[str, Law] = {
    DEFAULT: Law(CertifiedSettings, certified_law),
    "published": Law(PublishedSettings, published_law),
    "modified": Law(ModifiedSettings, modified_law),
    "integral-rl": Law(IrlSettings, integral_rl),
}


@checks_arguments
def learn(
    game: Game,
    law: str = DEFAULT,
    seed: int = 0,
    *,
    pool: Stack | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> TrainingRun:
    """Return the training run of a learning law on a game, with the learned value z'Pz and gain K.

    - "certified": from recorded samples to the exact solution within a predefined time
    - "published": Eq. (46) of the paper with the gains of Theorem 1, as printed. Its weights
      overflow in the first step on the aircraft of the paper
    - "modified": Eq. (46) with gains by hand, scaled states and a stabilizing start
    - "integral-rl": off-policy integral learning on a simulated probing flight

    Use `run` for a learning law that you define yourself. The result is not verified.
    `hfa.verify` verifies it with the matrix A of the game.

    game: the game
    law: name of the law
    seed: seed of the samples
    pool: recorded samples (z, F); by default states drawn with `seed`
    progress: called with (fraction done, 1, text), or None
    options: settings of the law

    Raises BadInputError for an unknown law, an unknown or invalid option, for Q = 0, and for data
    that cannot determine the weights. Raises NoSolutionError if the law cannot finish: the game has
    no value at this delta, (A, B) is not stabilizable, or numbers overflow.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> hfa.learn(game, seed=1).K.round(4).tolist()
    [[3.0972]]
    """
    if progress is not None:
        progress(0.0, 1.0, "choosing samples")
    learner = learner_of(game, law, seed, pool=pool, **options)
    if progress is not None:
        progress(0.0, 1.0, "learning")
    finished: TrainingRun = learner.conclude(run(learner, progress=progress))
    return finished


def learner_of(
    game: Game, law: str = DEFAULT, seed: int = 0, *, pool: Stack | None = None, **options: Any
) -> Any:
    """Return the learner of a law for `run`, with its recorded samples.

    The arguments and errors are those of `learn`.
    """
    need(game, Game, "learn: game", "a game: hfa.game(linear, Q, R, delta)")
    if pool is not None:
        need(pool, Stack, "learn: pool", Stack.how_to_make)
    refuse_unknown("unknown law", law, LAWS)
    settings_of_law = [field.name for field in fields(LAWS[law].settings)]
    for name in options:
        refuse_unknown(f"law '{law}' has no setting", name, settings_of_law)
    if not game.without_cross_weights.Q.any():
        weight = "Q - N R^-1 N'" if game.N.any() else "Q"
        raise BadInputError(
            f"{weight} is zero, but every learning law divides by z'Qz; give at least one state a "
            "weight"
        )
    return LAWS[law].make(game, LAWS[law].settings(**options), seed, pool)
