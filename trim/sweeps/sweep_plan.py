"""Points of a sweep: variables and their values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, numbers_in, shown
from hfa_support.origin import Identified
from hfa_support.reporting.results import without_empty
from trim.point.condition import (
    TrimCondition,
    freed_parameters,
    stated_cells,
    stated_values,
)
from trim.point.operating_point import OperatingPoint, beyond_range
from trim.sweeps.points import condition_at


class SweepArray(NamedTuple):
    """Array in the result of a sweep, whose first axes are the points of the sweep.

    axes: names of the further axes
    attributes: by the CF conventions, description and unit; `units_of` names the coordinates that
        contain the unit of each entry, if these have different units
    fill: value and type of an entry that is not computed yet
    """

    axes: tuple[str, ...]
    attributes: dict[str, Any]
    fill: Any = np.nan


def arrays_of(model: Model) -> dict[str, SweepArray]:
    """Return the arrays of a sweep, name -> axes, attributes, and value of an entry not computed.

    A and B are those of the linear states. The default value is nan.
    """
    columns = "fastest first in a Zarr store, otherwise one mode in each column"
    return {
        "states": SweepArray(("state",), {"long_name": "X0", "units_of": "state_unit"}),
        "inputs": SweepArray(("input",), {"long_name": "U0", "units_of": "input_unit"}),
        "A": SweepArray(
            ("rate", "linear_state"),
            {"long_name": "dx'/dx", "units_of": "rate_unit / linear_state_unit"},
        ),
        "B": SweepArray(
            ("rate", "input"), {"long_name": "dx'/du", "units_of": "rate_unit / input_unit"}
        ),
        "eigenvalues": SweepArray(
            ("mode",),
            {"long_name": f"of A; {columns}", "units": f"1/{model.time_unit}"},
            complex(np.nan, np.nan),
        ),
        "at_limit": SweepArray(
            ("limited",),
            {"long_name": "-1 at the lowest limit, 1 at the highest, 0 between and without a trim"},
            np.int8(0),
        ),
        "stalled": SweepArray((), {"long_name": "1 beyond the largest lift"}, np.int8(0)),
    }


def limited(condition: TrimCondition) -> tuple[str, ...]:
    """Return the free states and the inputs of a sweep, whose limits a trim can reach."""
    free = (name for name in condition.free if name in condition.model.states)
    return (*free, *condition.model.inputs)


def at_limit(condition: TrimCondition, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Return which `limited` variables are at their lowest (-1) or highest (1) limit, (N, k).

    states: (N, n), nan without a trim
    inputs: (N, m)
    """
    names = limited(condition)
    limits = condition.limits_on(names)
    places = [[*condition.model.states, *condition.model.inputs].index(name) for name in names]
    values = np.hstack([states, inputs])[:, places]
    at_lowest, at_highest = limits.at_limits(values)
    return at_highest.astype(np.int8) - at_lowest.astype(np.int8)


def coordinates_of(condition: TrimCondition) -> dict[str, tuple[str, np.ndarray]]:
    """Return the xarray coordinates of a sweep: names and units along each axis."""
    model = condition.model
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    labels = {
        "limited": ("limited", _words(limited(condition))),
        "state": ("state", _words(states)),
        "state_unit": ("state", _words(model.units(states))),
        "linear_state": ("linear_state", _words(model.linear)),
        "linear_state_unit": ("linear_state", _words(model.units(model.linear))),
        "rate": ("rate", _words(model.linear)),
        "rate_unit": ("rate", _words(model.rate_unit(name) for name in model.linear)),
    }
    if inputs:
        labels["input"] = ("input", _words(inputs))
        labels["input_unit"] = ("input", _words(model.units(inputs)))
    return labels


def _words(words: Iterable[str]) -> np.ndarray:
    """Return words as an array of objects. Zarr stores strings of any length in such an array."""
    return np.array([*words], dtype=object)


#: Largest number of points of a grid, which is never stored as a whole.
MOST_POINTS = 1_000_000_000


@dataclass(frozen=True)
class Steps:
    """Evenly spaced values of a swept variable, each computed when it is read.

    start: first value
    step: difference of consecutive values
    count: number of values
    """

    start: float
    step: float
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: Any) -> Any:
        return self.start + self.step * index


class Task(NamedTuple):
    """Some points of a sweep, as the arguments of `run_points`."""

    model: Model
    variables: tuple[str, ...]
    values: np.ndarray
    condition: TrimCondition
    start: OperatingPoint | None


@dataclass(frozen=True, eq=False)
class SweepPlan(Identified):
    """Points of a sweep: the values of named variables of one model, in the units of the model.

    axes: variable -> its values, as a list or as `Steps`. The points are all combinations, in which
        the last variable varies fastest, unless `listed` is True.
    model: model of the aircraft.
    condition: condition of all other variables.
    start: initial point of the search at each point, or None for the default.
    listed: whether the axes are columns of equal length, with one row for each point.
    names: name of each point of a list, or ().

    Raises BadInputError if a name or a range is wrong.
    """

    axes: Mapping[str, Any]
    model: Model
    condition: TrimCondition
    start: OperatingPoint | None = None
    listed: bool = False
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check all fields, including the condition at the extreme values of a grid.

        Raises BadInputError for an unknown name, a value of a grid outside its limits, and too many
        points.
        """
        model = self.model
        for name in freed_parameters(self.condition):
            raise BadInputError(f"a sweep does not free the parameter {name}; hold values of it")
        if not self.axes:
            choices = ", ".join((*model.holdable, *model.parameters))
            raise BadInputError(f"no variable is swept; choose from {choices}")
        axes = {name: self._checked_axis(name, values) for name, values in self.axes.items()}
        vars(self)["axes"] = axes
        lengths = [len(values) for values in axes.values()]
        if self.listed and len({*lengths}) > 1:
            raise BadInputError(
                f"the columns of a list of points have {shown(lengths)} values; use equal lengths"
            )
        if self.count > MOST_POINTS:
            raise BadInputError(
                f"the sweep has {self.count:,.15g} points (maximum {MOST_POINTS:,}); use larger "
                "steps"
            )
        if self.listed:  # a point outside a limit has no trim
            return
        self._check_parameters()
        for corner in np.array(list(self._ends.values())).T:  # all lowest, then all highest values
            condition_at(self.condition, self.variables, corner)

    def _checked_axis(self, name: str, values: Any) -> Steps | tuple[float, ...]:
        """Return the values of a variable as steps or numbers."""
        self.model.refuse_unheld("cannot sweep", name, tuple(self.model.parameters))
        if isinstance(values, Steps):
            return values
        if isinstance(values, list | tuple):
            values = [self.model.number(name, value) for value in values]
        array = numbers_in(name, values)
        if array.ndim != 1 or not array.size:
            raise BadInputError(f"the values of {name} are {shown(values)}; give a list of numbers")
        return tuple(array.tolist())

    def _check_parameters(self) -> None:
        """Raise BadInputError if a value of a swept parameter is outside the parameter's limits."""
        model = self.model
        for name, ends in self._ends.items():
            if name not in model.parameters:
                continue
            limits = Limits.of(model, (name,))
            if not limits.within(np.array(ends)[:, None]).all():
                described = dict.fromkeys(model.describe(name, end) for end in ends)
                raise BadInputError(
                    f"{name} is {' to '.join(described)} in the sweep; give values between "
                    f"{limits.between(name)}"
                )

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the swept variables, in order."""
        return tuple(self.axes)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each swept variable, in order."""
        return self.model.units(self.variables)

    @property
    def _ends(self) -> dict[str, tuple[float, float]]:
        """Extreme values of each swept variable, name -> (lowest, highest)."""
        ends = {}
        for name, values in self.axes.items():
            extremes = values
            if isinstance(values, Steps):
                extremes = (values[0], values[len(values) - 1])
            ends[name] = (float(np.min(extremes)), float(np.max(extremes)))
        return ends

    @property
    def sizes(self) -> list[int]:
        """Number of values of each variable of a grid, in order.

        For a list of points, the result contains only the number of points.
        """
        lengths = [len(values) for values in self.axes.values()]
        return lengths[:1] if self.listed else lengths

    @cached_property
    def count(self) -> int:
        """Number of points of the sweep."""
        return math.prod(self.sizes)

    @property
    def warnings(self) -> list[str]:
        """Notes on swept variables with values beyond the model's range of validity."""
        farthest = {name: max(ends, key=abs) for name, ends in self._ends.items()}
        return beyond_range(self.model, farthest)

    @property
    def grid(self) -> dict[str, Any]:
        """Unit and values of each swept variable, by name. A range is stored as start, step and
        count.
        """
        grid = {}
        for (name, values), unit in zip(self.axes.items(), self.units, strict=True):
            content = asdict(values) if isinstance(values, Steps) else {"values": list(values)}
            grid[name] = content | {"unit": unit}
        return grid

    def entries(self) -> dict[str, Any]:
        """Return what the file of a sweep says about its points, name -> value."""
        return {
            "variables": self.variables,
            "variable_units": self.units,
            "grid": self.grid,
            "condition": self.condition.changes,
        } | without_empty(names=self.names)

    def cells_of_all(self) -> dict[str, Any]:
        """Return what all points impose, as columns of a file of conditions, heading -> cell."""
        return stated_cells(self.model, stated_values(self.condition, self.variables))

    def values(self, first: int, stop: int) -> np.ndarray:
        """Return the values of the swept variables at the points first .. stop - 1.

        The shape is (stop - first, variables).
        """
        flat_index = np.arange(first, stop)
        if self.listed:  # one row for each point
            per_axis = [flat_index] * len(self.axes)
        else:
            per_axis = [*np.unravel_index(flat_index, self.sizes)]
        columns = []
        for values, place in zip(self.axes.values(), per_axis, strict=True):
            axis = values if isinstance(values, Steps) else np.array(values)
            columns.append(axis[place])
        return np.stack(columns, axis=-1)

    def task(self, first: int, stop: int) -> Task:
        """Return the arguments with which `run_points` computes the points first .. stop - 1."""
        values = self.values(first, stop)
        return Task(self.model, self.variables, values, self.condition, self.start)
