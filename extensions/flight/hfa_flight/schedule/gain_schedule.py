"""Gain schedules over the scheduling variable of a model, and their files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from controller.critic.critic_file import refuse_other_step
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY
from hfa_aircraft.model import Model
from hfa_aircraft.readers.matrices_file import FileScales, file_scales
from hfa_aircraft.signals import PlantNames
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, numbers_in, prefix_errors
from hfa_support.matrices import LinearTable, checked_matrix, shape_text
from hfa_support.reporting.report import Reported

#: Share of the range of breakpoints by which a value may be beyond an end, where the gain is that
#: of the end: a trim at the end is not found more exactly, and angles in files are rounded.
_ROUNDING = 1e-9
#: Decimals of breakpoints in files, in degrees.
_DIGITS = 10


@dataclass(frozen=True, eq=False, repr=False)
class GainSchedule(Reported):
    """Gain schedule u = -K(η) x, with K linear in the scheduling variable η between breakpoints.

    K is constant beyond the breakpoints.

    breakpoints: (G,), increasing values of η, radians for angles. With a single gain, the value of
      the breakpoint has no effect
    gains: (G, m, n) in the units of the model, for the n states of the linear model
    model: model with the scheduling variable, states and inputs

    Raises BadInputError if a shape is wrong, the breakpoints do not increase, or a number is not
    finite.
    """

    breakpoints: np.ndarray
    gains: np.ndarray
    model: Model

    def __post_init__(self) -> None:
        """Raise BadInputError unless K and the breakpoints have valid shapes and values."""
        count = np.size(self.breakpoints)
        shape = (count, len(self.model.inputs), len(self.model.linear))
        if np.shape(self.gains) != shape:
            raise BadInputError(
                f"K has shape {np.shape(self.gains)}; give {shape} for {count} breakpoints"
            )
        if not (np.all(np.isfinite(self.breakpoints)) and np.all(np.isfinite(self.gains))):
            raise BadInputError(
                "K or the list of breakpoints contains a number that is not finite; give finite "
                "numbers"
            )
        if np.ndim(self.breakpoints) != 1 or count < 1 or np.any(np.diff(self.breakpoints) <= 0.0):
            raise BadInputError(
                f"{self.model.schedule_key} is not a list of increasing breakpoints; give the "
                "breakpoints of the table in increasing order"
            )

    @cached_property
    def table(self) -> LinearTable:
        """Table of K over η."""
        return LinearTable(self.breakpoints, self.gains)

    @property
    def file_breakpoints(self) -> np.ndarray:
        """Breakpoints as stored in files, (G,), with angles in degrees."""
        if self.model.is_typed_in_degrees:
            return np.asarray(np.degrees(self.breakpoints).round(_DIGITS))
        return self.breakpoints

    def refuse_beyond(self, lowest: float, highest: float) -> None:
        """Raise BadInputError if an interval of η is not within the breakpoints.

        A single gain is valid for all values.

        lowest, highest: ends of the interval
        """
        if len(self.breakpoints) == 1:
            return
        first = float(self.breakpoints[0])
        last = float(self.breakpoints[-1])
        rounding = _ROUNDING * (last - first)
        if lowest < first - rounding or highest > last + rounding:
            name = self.model.schedule
            covered = f"{self.model.describe(name, first)} to {self.model.describe(name, last)}"
            flown = f"{self.model.describe(name, lowest)} to {self.model.describe(name, highest)}"
            raise BadInputError(
                f"the gains cover {covered}, but {flown} is requested; choose values within the "
                "covered range"
            )


def load_gain_schedule(path: Path, model: Model) -> GainSchedule:
    """Return the gain schedule in a file.

    path: file with one gain K (m, n), or with K (G, m, n) and G breakpoints under the model's
      `schedule_key`, angles in degrees. In MATLAB files, K is (m, n, G)
    model: model with m inputs and n states of the linear model

    Gains in other units, `state_units` and `input_units`, are converted to the units of the model,
    and with them the breakpoints of a state.

    Raises BadInputError if K or the breakpoints are missing or have a wrong shape, if a unit cannot
    be converted or is not known, or if the gains are for a sample time.
    """
    stored = read_arrays(path)
    states, inputs = model.linear, tuple(model.inputs)
    plant = PlantNames(states, inputs, model.units(states), model.units(inputs))
    with prefix_errors(path):
        refuse_other_step(stored, None)  # a table is flown in continuous time
        if "K" not in stored:
            raise BadInputError(
                f"K is missing; add a K of {len(model.inputs)} x {len(model.linear)}, or one for "
                f"each value of {model.schedule_key}"
            )
        K = checked_matrix("K", stored["K"], LARGEST_CRITIC_ENTRY, ndim=None)
        scales = file_scales(stored, plant)
        if K.ndim != 3:
            return _single_gain(K, scales, model)
        return _gain_table(K, stored, scales, model)


def _single_gain(K: np.ndarray, scales: FileScales, model: Model) -> GainSchedule:
    """Return the schedule of one gain K (m, n) of a file."""
    m, n = len(model.inputs), len(model.linear)
    if K.shape != (m, n):
        raise BadInputError(
            f"K is {shape_text(K.shape)}; give a K of {m} x {n}, or one for each value of "
            f"{model.schedule_key}"
        )
    return GainSchedule(np.zeros(1), (K * scales.gain)[None], model)


def _gain_table(
    K: np.ndarray, stored: Mapping[str, Any], scales: FileScales, model: Model
) -> GainSchedule:
    """Return the schedule of a stack of gains of a file, (G, m, n), or (m, n, G) of MATLAB."""
    m, key = len(model.inputs), model.schedule_key  # such as dihedral_deg
    if key not in stored:
        raise BadInputError(f"{key} is missing; give one value for each gain K of the table")
    breakpoints = np.ravel(numbers_in(key, stored[key]))
    count = breakpoints.size
    if count < 2:
        raise BadInputError(
            f"{key} has fewer than two values; give at least two, in increasing order"
        )
    if K.shape[:2] != (count, m) and (K.shape[0], K.shape[2]) == (m, count):
        K = np.moveaxis(K, -1, 0)  # of MATLAB

    # Breakpoints in the unit of the model, which is known for angles and for a state of the gains.
    if model.is_typed_in_degrees:
        breakpoints = np.radians(breakpoints)
    elif model.schedule in model.linear:
        breakpoints = breakpoints / scales.states[model.linear.index(model.schedule)]
    elif np.any(scales.gain != 1.0):
        raise BadInputError(
            f"the gains are in other units than the model, and the unit of {key} is not known; "
            f"convert K and {key} to the units of the model"
        )
    if K.shape[1:] == scales.gain.shape:  # another shape is refused by the schedule
        K = K * scales.gain
    return GainSchedule(breakpoints, K, model)
