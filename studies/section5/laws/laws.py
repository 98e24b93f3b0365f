"""The learning laws of the study by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from controller import run
from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.learning.recording import Stack
from studies.section5.laws.certified import CertifiedSettings, certified_law
from studies.section5.laws.integral_rl import IrlSettings, integral_rl
from studies.section5.laws.published import (
    ModifiedSettings,
    PublishedSettings,
    modified_law,
    published_law,
)


class Law(NamedTuple):
    """A learning law.

    settings: dataclass of its settings
    make: function (game, settings, seed, pool) -> learner for `controller.run`, with `conclude`
    """

    settings: type[Any]
    make: Callable[[Game, Any, int, Stack | None], Any]


#: Name -> law: with a predefined time, the paper's (Eq. 46) as printed, the same with modifications
#: that keep it bounded, and the paper's baseline.
LAWS: Mapping[str, Law] = {
    "certified": Law(CertifiedSettings, certified_law),
    "published": Law(PublishedSettings, published_law),
    "modified": Law(ModifiedSettings, modified_law),
    "integral-rl": Law(IrlSettings, integral_rl),
}


def learner_of(game: Game, law: str, seed: int, pool: Stack | None = None, **options: Any) -> Any:
    """Return the learner of a law for `controller.run`, with its recorded samples.

    seed: seed of the samples
    pool: recorded samples (z, F), or None for states drawn with `seed`
    options: settings of the law
    """
    return LAWS[law].make(game, LAWS[law].settings(**options), seed, pool)


def learn(
    game: Game, law: str, seed: int, pool: Stack | None = None, **options: Any
) -> TrainingRun:
    """Return the training run of a law on a game. The arguments are those of `learner_of`."""
    learner = learner_of(game, law, seed, pool, **options)
    finished: TrainingRun = learner.conclude(run(learner))
    return finished
