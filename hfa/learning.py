"""Options of the learning law.

They stand above `hfa.options`, which belongs to the core and reaches nothing that learns.
"""

from __future__ import annotations

from dataclasses import dataclass

from controller.learning.law_names import DEFAULT_LAW, LAW_NAMES
from hfa.options.argument_types import one_of, whole
from hfa.options.option import option


@dataclass(frozen=True, kw_only=True, eq=False)
class LearningOptions:
    """The learning law and the seed of its samples."""

    law: str | None = option(
        f"learning law: {', '.join(LAW_NAMES)}; default {DEFAULT_LAW}", "NAME", one_of(*LAW_NAMES)
    )
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)
