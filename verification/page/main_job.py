"""The main job: both printed pairs regenerated, the sweep, and every asked angle with its game and its critic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet
from hfa_model.published import published_models
from hfa_model.reporting.text import angle_text
from hfa_model.variants import variant_named
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import OperatingPoint
from trim.sweeps.sweep import sweep
from trim.sweeps.sweep_result import Sweep
from verification.page.angle_result import AngleResult, TrimmedAngle, angle_result, trimmed_angle
from verification.published.regeneration import regenerate_all
from verification.published.regeneration_result import Regeneration

#: Dihedral angles of the sweep, rad: the paper's range and a little beyond.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))
#: The angles that are shown in full: the printed ones.
ASKED = tuple(sorted(model.dihedral for model in published_models()))
#: A page with more would be too large to file (3 MB of data), or take minutes.
MOST_SWEPT, MOST_ASKED = 151, 20

#: Told which fraction of the work is done, and what is at work.
Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class StoredClaims:
    """The table of claims that `hfa reproduce` stored, and the file it was read from."""

    path: Path
    table: dict[str, Any]


@dataclass(frozen=True, eq=False)
class MainJob:
    """One aircraft: both pairs regenerated, trims and models over the dihedral angle, asked angles in full.

    points: one for each angle of the sweep. claims: None where none were given.
    """

    aircraft: Aircraft
    parameters: ParameterSet
    regeneration: Regeneration
    sweep: Sweep
    points: tuple[TrimmedAngle, ...]
    angles: tuple[AngleResult, ...]
    claims: StoredClaims | None = None

    @property
    def learned(self) -> bool:
        """Whether every learned critic agrees with the exact game solution."""
        return all(angle.ok for angle in self.angles)

    @property
    def ok(self) -> bool:
        """Whether everything holds; what became of the paper's claims is a finding and not counted."""
        return self.regeneration.ok and self.learned


def main_job(
    parameters: ParameterSet,
    dynamics: str,
    *,
    asked: Sequence[float] = ASKED,
    swept: np.ndarray = SWEEP,
    outputs: tuple[str, ...] | None = None,
    claims: StoredClaims | None = None,
    flight: NamedCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    progress: Progress = lambda fraction, what: None,
) -> MainJob:
    """Regenerate both pairs, sweep the dihedral angle, and solve, learn and compare at each asked angle (rad).

    flight, start: what is trimmed, as of `sweep`; the printed pairs are at the paper's condition.
    """
    aircraft = Aircraft(parameters.values, variant_named(dynamics))
    progress(0.0, "printed pairs")
    regeneration = regenerate_all(aircraft)
    progress(0.05, "sweep")
    over = sweep(aircraft, {"dihedral": swept}, condition=flight, start=start)
    points = tuple(trimmed_angle(aircraft, float(angle), None, flight, start) for angle in swept)
    found = []
    for count, angle in enumerate(asked):
        progress(0.1 + 0.9 * count / len(asked), f"dihedral {angle_text(angle)}")
        found.append(angle_result(aircraft, angle, outputs, flight, start))
    progress(1.0, "")
    return MainJob(aircraft, parameters, regeneration, over, points, tuple(found), claims)
