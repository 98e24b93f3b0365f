"""Options of the learning law.

They stand above `hfa.options`, which belongs to the core and reaches nothing that learns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from controller.learning.law_names import DEFAULT_LAW, LAW_NAMES
from hfa.options.argument_types import one_of, whole
from hfa.options.output import ProgressLine
from hfa.options.part import Part, option

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun
    from controller.game.zero_sum import Game


@dataclass(frozen=True, kw_only=True, eq=False)
class Learning(Part):
    """The learning law and the seed of its samples."""

    law: str = option(
        f"learning law: {', '.join(LAW_NAMES)}; default {DEFAULT_LAW}",
        "NAME",
        one_of(*LAW_NAMES),
        default=DEFAULT_LAW,
    )
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)

    def learned(self, game: Game) -> TrainingRun:
        """Return the training run of the selected learning law on a game."""
        from controller.learning.laws import learn

        return learn(game, self.law, self.seed, progress=ProgressLine("learn"))
