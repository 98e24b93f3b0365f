"""What a sweep visits: which variables take which values, and any part of it on demand."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, numbers_in, shown
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint, beyond_range
from trim.sweeps.points import COMPILE_FROM, condition_at

#: Of a grid, which is never made as a whole.
MOST_POINTS = 1_000_000_000


@dataclass(frozen=True)
class Steps:
    """`count` values from `start` on, `step` apart: a range of any length in three numbers."""

    start: float
    step: float
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: Any) -> Any:
        return self.start + self.step * index


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """N points over named variables, for one aircraft.

    axes: variable -> its values on a grid, listed or as `Steps`: all combinations, the last
    variable running fastest. listed: the axes are columns of equal length, a point a row. Internal
    units. condition: what the other variables do, the model's own trim unless given. start: where
    the search begins at each point. BadInputError when a name or a range is wrong."""

    axes: Mapping[str, Any]
    aircraft: Model
    condition: TrimCondition = None  # type: ignore[assignment]  # replaced below
    start: OperatingPoint | None = None
    listed: bool = False

    def __post_init__(self) -> None:
        """Check everything before anything runs."""
        model = self.model
        if self.condition is None:
            object.__setattr__(self, "condition", usual_condition(model))
        if not self.axes:
            raise BadInputError(
                f"nothing to sweep; choose from {', '.join((*model.holdable, *model.parameters))}"
            )
        axes: dict[str, Any] = {}
        for name, values in self.axes.items():
            model.refuse_unheld("cannot sweep", name, tuple(model.parameters))
            if isinstance(values, Steps):
                axes[name] = values
                continue
            array = numbers_in(name, values)
            if array.ndim != 1 or not array.size:
                raise BadInputError(
                    f"the values of {name} are {shown(values)}; give a list of numbers"
                )
            axes[name] = tuple(array.tolist())
        object.__setattr__(self, "axes", axes)
        if self.listed and len({len(values) for values in axes.values()}) > 1:
            raise BadInputError(
                f"the columns of a list of conditions have {shown(self._lengths)} values; give as many"
            )
        if self.count > MOST_POINTS:
            raise BadInputError(
                f"the sweep has {self.count:,.15g} points, at most {MOST_POINTS:,} are allowed; take larger steps"
            )
        for name in {*axes} & {*model.parameters}:
            lowest, highest, most = *self._ends[name], model.parameters[name]
            if not most.min <= lowest <= highest <= most.max:
                allowed = (
                    f"between {model.describe(name, most.min)} and {model.describe(name, most.max)}"
                )
                said = " to ".join(
                    dict.fromkeys(model.describe(name, each) for each in (lowest, highest))
                )
                raise BadInputError(f"{name} is {said} in the sweep; it must lie {allowed}")
        for corner in np.array(list(self._ends.values())).T:
            condition_at(self.condition, self.variables, corner)

    def __eq__(self, other: object) -> bool:  # the order of the axes counts
        return isinstance(other, SweepPlan) and json.dumps(self.to_dict()) == json.dumps(
            other.to_dict()
        )

    @property
    def model(self) -> Model:
        """Whose trims these are."""
        return self.aircraft

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what varies, in order."""
        return tuple(self.axes)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each variable, in order."""
        return self.model.units(self.variables)

    @property
    def _ends(self) -> dict[str, tuple[float, float]]:
        """Variable -> its lowest and highest value."""
        ends = {
            name: (v[0], v[len(v) - 1]) if isinstance(v, Steps) else v
            for name, v in self.axes.items()
        }
        return {
            name: (float(np.min(values)), float(np.max(values))) for name, values in ends.items()
        }

    @property
    def _lengths(self) -> list[int]:
        return [len(values) for values in self.axes.values()]

    @property
    def sizes(self) -> list[int]:
        """Number of values of each variable of a grid, in order; of a list the number of its
        rows."""
        return self._lengths[:1] if self.listed else self._lengths

    @cached_property
    def count(self) -> int:
        """Number of points."""
        return math.prod(self.sizes)

    @property
    def warnings(self) -> list[str]:
        """What a user should know before trusting a sweep: the farthest value of each variable
        beyond a range."""
        return beyond_range(
            self.model, {name: max(ends, key=abs) for name, ends in self._ends.items()}
        )

    def _axes_data(self) -> dict[str, Any]:
        return {
            name: asdict(v) if isinstance(v, Steps) else list(v) for name, v in self.axes.items()
        }

    @property
    def varied(self) -> dict[str, Any]:
        """What varies, over which values and about which condition, as JSON data; `grid`: variable
        -> its unit and its values, listed, or start, step and count."""
        grid = {}
        for (name, values), unit in zip(self._axes_data().items(), self.units, strict=True):
            kind = values if isinstance(values, dict) else {"values": values}
            grid[name] = kind | {"unit": unit}
        names, units = list(self.variables), list(self.units)
        return {
            "variables": names,
            "variable_units": units,
            "grid": grid,
            "condition": self.condition.to_dict(),
        }

    def values(self, start: int, stop: int) -> np.ndarray:
        """Rows start .. stop - 1 of the (N, variables) table of values."""
        index = np.arange(start, stop)
        indices = [index] * len(self.axes) if self.listed else np.unravel_index(index, self.sizes)
        axes = (
            values if isinstance(values, Steps) else np.array(values)
            for values in self.axes.values()
        )
        return np.stack([values[each] for values, each in zip(axes, indices, strict=True)], axis=-1)

    def task(self, start: int, stop: int) -> tuple[Any, ...]:
        """Arguments of `run_points` for rows start .. stop - 1."""
        values, compiled = self.values(start, stop), self.count >= COMPILE_FROM
        return self.aircraft, self.variables, values, self.condition, self.start, compiled

    def to_dict(self) -> dict[str, Any]:
        """The plan as JSON data; two plans with the same data visit the same points."""
        return {
            "axes": self._axes_data(),
            "parameters": {name: each.start for name, each in self.model.parameters.items()},
            "dynamics": self.model.name,
            "source": list(self.model.source),
            "listed": self.listed,
            "condition": self.condition.to_dict(),
            "start": None if self.start is None else self.start.to_dict(),
        }
