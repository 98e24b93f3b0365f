"""Options of the learning law.

They stand above `hfa.options`, which belongs to the core and reaches nothing that learns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import one_of, whole
from hfa.options.critics import listed_numbers, settings_option
from hfa.options.output import ProgressLine
from hfa.options.part import Part, option

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun
    from controller.game.zero_sum import Game

DEFAULT_LAW = "certified"
#: The laws of `controller.learning.laws`, whose import would delay every help.
LEARNING_LAWS = (DEFAULT_LAW, "published", "modified", "integral-rl")


def law_option(*laws: str) -> Any:
    """Return the option --law, which selects the learning law.

    laws: other policies than learned ones, which replace all but the default learning law
    """
    choices = (*laws, DEFAULT_LAW) if laws else LEARNING_LAWS
    kind = "policy" if laws else "learning law"
    about = f"{kind}: {', '.join(choices)}; default {DEFAULT_LAW}"
    return option(about, "NAME", one_of(*choices), default=DEFAULT_LAW)


def setting_option(
    about: str = "setting of the learning law, for example predefined_time=2",
    more: Mapping[str, Callable[[str], Any]] | None = None,
) -> Any:
    """Return the option --set for the settings of the learning law.

    about: help of the option
    more: additional settings, name -> function that converts the text to the value; None for none
    """

    def kinds() -> dict[str, Callable[[str], Any]]:
        from controller.learning.laws import LAWS

        of_laws = {
            field.name: partial(_converted, str(field.type))
            for law in LAWS.values()
            for field in fields(law.settings)
        }
        return {**of_laws, **(more or {})}

    return settings_option(about, kinds, "a learning law")


def _converted(kind: str, text: str) -> Any:
    """Return the value of a setting of the learning law, from its text."""
    if kind.startswith("str"):
        return text
    if kind == "bool":
        return one_of("yes", "no")(text) == "yes"
    if kind.startswith("int"):
        return whole(0)(text)
    values = tuple(listed_numbers(text))
    return values[0] if len(values) == 1 and kind.startswith("float") else values


@dataclass(frozen=True, kw_only=True, eq=False)
class Learning(Part):
    """The learning law, its settings and the seed of its random numbers."""

    law: str = law_option()
    set: Mapping[str, Any] = setting_option()
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)

    def learned(self, game: Game) -> TrainingRun:
        """Return the training run of the selected learning law on a game."""
        from controller.learning.laws import learn

        return learn(game, self.law, self.seed, progress=ProgressLine("learn"), **self.set)
