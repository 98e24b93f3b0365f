"""Options of the learning law.

They stand above `hfa.options`, which belongs to the core and reaches nothing that learns.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from controller.learning.law_names import DEFAULT_LAW, LAW_NAMES
from hfa.options.argument_types import input_file, one_of, whole
from hfa.options.parser import option
from hfa_support.files import TABLE_FILES


@dataclass(frozen=True, kw_only=True, eq=False)
class LearningOptions:
    """The data, the learning law and the seed of simulated data."""

    data: tuple[Path, ...] = option(
        "recorded transitions x, u and x_next or x_rate, or columns by name "
        f"({' '.join(TABLE_FILES)}), one file for each episode; default: simulated ones",
        "FILE",
        input_file(*TABLE_FILES),
        default=(),
        count="+",
    )
    law: str | None = option(
        f"learning law: {', '.join(LAW_NAMES)}; default {DEFAULT_LAW}", "NAME", one_of(*LAW_NAMES)
    )
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)
