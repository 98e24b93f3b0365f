"""What a sweep visits: which variables take which values, any part of it on demand, and what lies beyond the
paper's range of dihedral."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import FIELDS, Parameters
from hfa_model.variants import Variant, variant_named
from hfa_support.errors import BadInputError, numbers_in, shown
from hfa_support.model import Model
from trim.point.condition import LEVEL_FLIGHT, TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.sweeps.points import condition_at

#: Of a grid, which is never made as a whole.
MOST_POINTS = 1_000_000_000
#: Of a Latin hypercube, which is: 10 bytes and more a sample and variable.
MOST_SAMPLES = 10_000_000


@dataclass(frozen=True)
class Steps:
    """`count` values from `start` on, `step` apart: a range of any length in three numbers."""

    start: float
    step: float
    count: int

    def at(self, index: np.ndarray) -> np.ndarray:
        """The values of the given indices."""
        return self.start + self.step * index


@dataclass(frozen=True)
class SweepPlan:
    """N points over named variables, for one aircraft.

    axes: variable -> its values on a grid, listed or as `Steps` (all combinations, the last variable running
    fastest), or, when `samples` > 0, variable -> (lowest, highest; twice the same for a constant) of a Latin
    hypercube of that many points under `seed` (scipy.stats.qmc). listed: the axes are columns of equal length, a point
    a row. Internal units. parameters, dynamics: the HFA where
    it is not varied; dynamics by name or a `Variant`, or any other `Model`, which has its own parameters. condition:
    what the other variables do. start: where the search begins at each point. BadInputError when a name or a range is
    wrong.
    """

    axes: Mapping[str, Sequence[float] | np.ndarray | Steps]
    parameters: Parameters | None
    dynamics: str | Variant | Model
    samples: int = 0
    seed: int = 0
    condition: TrimCondition = LEVEL_FLIGHT
    start: OperatingPoint | None = None
    listed: bool = False

    def __post_init__(self) -> None:
        """Check everything before anything runs."""
        model = self.condition.model
        if not self.axes:
            raise BadInputError(f"nothing to sweep; choose from {', '.join((*model.holdable, *model.parameters))}")
        ends_of, listed = {}, {}
        for name, values in self.axes.items():
            model.refuse_unheld("cannot sweep", name, tuple(model.parameters))
            ends = values.at(np.array([0, values.count - 1])) if isinstance(values, Steps) else numbers_in(name, values)
            if ends.ndim != 1 or not ends.size:
                raise BadInputError(f"the values of {name} are {shown(values)}; give a list of numbers")
            ends_of[name], listed[name] = ends, values if isinstance(values, Steps) else tuple(ends.tolist())
            if self.parameters and name in FIELDS._fields and getattr(FIELDS, name).positive and not min(ends) > 0:
                raise BadInputError(f"{name} is {min(ends):g} in the sweep; it must be positive")
            if self.samples and (isinstance(values, Steps) or len(values) != 2 or not values[0] <= values[1]):
                raise BadInputError(f"{name} needs a range lowest:highest for random samples")
        object.__setattr__(self, "axes", listed)
        if self.listed and len(set(self._lengths)) > 1:
            raise BadInputError(f"the columns of a list of conditions have {shown(self._lengths)} values; give as many")
        if not 0 <= self.samples <= MOST_SAMPLES:
            raise BadInputError(f"samples is {self.samples}; it must lie between 0 and {MOST_SAMPLES:,}")
        if self.count > MOST_POINTS:
            raise BadInputError(
                f"the sweep has {self.count:,.15g} points, at most {MOST_POINTS:,} are allowed; take larger steps"
            )
        if isinstance(self.dynamics, str):
            variant_named(self.dynamics)
        for corner in (np.argmin, np.argmax):
            condition_at(self.condition, self.variables, np.array([ends[corner(ends)] for ends in ends_of.values()]))

    @cached_property
    def aircraft(self) -> Aircraft | Model:
        """What is not varied of the aircraft."""
        return self.dynamics if isinstance(self.dynamics, Model) else Aircraft(self.parameters, self.dynamics)

    @property
    def dynamics_name(self) -> str:
        """Name of the dynamics."""
        return self.dynamics if isinstance(self.dynamics, str) else self.dynamics.name

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what varies, in order."""
        return tuple(self.axes)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each variable, in order."""
        return self.condition.model.units(self.variables)

    @property
    def grid(self) -> dict[str, dict[str, Any]]:
        """Variable -> its unit and its values: listed, or start, step and count; of samples lowest and highest."""
        found: dict[str, dict[str, Any]] = {}
        for (name, values), unit in zip(self.axes.items(), self.units, strict=True):
            if isinstance(values, Steps):
                found[name] = asdict(values) | {"unit": unit}
            elif self.samples:
                found[name] = {"lowest": values[0], "highest": values[1], "unit": unit}
            else:
                found[name] = {"values": list(values), "unit": unit}
        return found

    @property
    def varied(self) -> dict[str, Any]:
        """What varies, over which values and about which condition, as JSON data."""
        return {
            "variables": list(self.variables),
            "variable_units": list(self.units),
            "grid": self.grid,
            "condition": self.condition.to_dict(),
        }

    @cached_property
    def count(self) -> int:
        """Number of points."""
        return self.samples or math.prod(self.sizes)

    def values(self, start: int, stop: int) -> np.ndarray:
        """Rows start .. stop - 1 of the (N, variables) table of values."""
        if self.samples:
            return self._hypercube[start:stop]
        if self.listed:
            return np.column_stack([np.asarray(values) for values in self.axes.values()])[start:stop]
        indices = np.unravel_index(np.arange(start, stop), self.sizes)
        columns = [
            values.at(index) if isinstance(values, Steps) else np.asarray(values)[index]
            for values, index in zip(self.axes.values(), indices, strict=True)
        ]
        return np.stack(columns, axis=-1)

    @property
    def sizes(self) -> list[int]:
        """Number of values of each variable of a grid, in order; of a list the number of its rows."""
        return self._lengths[:1] if self.listed else self._lengths

    @property
    def _lengths(self) -> list[int]:
        return [values.count if isinstance(values, Steps) else len(values) for values in self.axes.values()]

    def to_dict(self) -> dict[str, Any]:
        """The plan as JSON data; two plans with the same data visit the same points."""
        return {
            "axes": {
                name: asdict(values) if isinstance(values, Steps) else list(values)
                for name, values in self.axes.items()
            },
            "parameters": {name: each.start for name, each in self.aircraft.model.parameters.items()},
            "dynamics": self.dynamics_name,
            **({"source": list(self.dynamics.source)} if isinstance(self.dynamics, Model) else {}),
            **({"listed": True} if self.listed else {}),
            "samples": self.samples,
            "seed": self.seed,
            "condition": self.condition.to_dict(),
            "start": None if self.start is None else self.start.to_dict(),
        }

    @cached_property
    def identity(self) -> str:
        """A hash of everything that decides the results."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()

    @cached_property
    def _hypercube(self) -> np.ndarray:
        from scipy.stats import qmc

        unit = qmc.LatinHypercube(d=len(self.axes), rng=np.random.default_rng(self.seed)).random(self.samples)
        bounds = np.array(list(self.axes.values()))
        return np.asarray(bounds[:, 0] + unit * (bounds[:, 1] - bounds[:, 0]))


def plan_warnings(plan: SweepPlan) -> list[str]:
    """What a user should know before trusting a sweep of any size; a grid is counted without making its points."""
    model, found = plan.condition.model, []
    for name, (most, whose) in model.range.items():
        if name not in plan.axes:
            continue
        values, limit = plan.axes[name], most * (1 + 1e-12)
        if isinstance(values, Steps):
            # Of i = 0 ... count - 1 the ones between `first` and `last` have -limit <= start + i step <= limit.
            first = max(math.ceil((-limit - values.start) / values.step), 0)
            last = min(math.floor((limit - values.start) / values.step), values.count - 1)
            beyond, each = values.count - max(last - first + 1, 0), plan.count // values.count
        else:
            listed = plan.values(0, plan.count)[:, plan.variables.index(name)] if plan.samples else np.asarray(values)
            beyond, each = int(np.count_nonzero(np.abs(listed) > limit)), plan.count // len(listed)
        if beyond:
            lie = f"{beyond * each} of {plan.count} points {'lies' if beyond * each == 1 else 'lie'}"
            where = f"beyond {whose} of {name}, which ends at {model.describe(name, most)}"
            found.append(f"{lie if plan.count > 1 else 'the point lies'} {where}")
    return found
