"""Assessment of a deployed policy on aircraft with one changed parameter or input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessor import Assessor
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.errors import BadInputError, is_finite, refuse_unknown, shown
from hfa_support.progress import Progress
from hfa_support.reporting.results import Result
from trim.point.operating_point import OperatingPoint

#: Number of evenly spaced values of a range, including its ends.
VALUES = 5
#: Largest number of flights on a changed aircraft.
_MOST_SAMPLES = 100


@dataclass(frozen=True, eq=False)
class Variation(Result):
    """Assessment of a policy on an aircraft with one change.

    name: name of the changed parameter or input.
    value: changed value.
    assessed: assessment at the states and inputs of the original trim.
    """

    name: str
    value: float
    assessed: AssessedPoint

    @property
    def holds(self) -> bool:
        """True if the policy holds on the changed aircraft."""
        return self.assessed.holds

    @property
    def text(self) -> str:
        """Name and value of the change, with the unit."""
        return f"{self.name} {self.assessed.point.model.describe(self.name, self.value)}"

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "name": self.name,
            "value": self.value,
            "holds": self.assessed.holds,
            "spectral_radius": self.assessed.radius,
            "equilibrium": self.assessed.equilibrium_states,
            "flights": self.assessed.flights,
            "disturbed": self.assessed.disturbed,
        }


def changes_of(
    deployed: Deployed, vary: Mapping[str, tuple[float, float]]
) -> list[tuple[str, float]]:
    """Return `VALUES` changes of the aircraft for each variation, as (name, value).

    vary: parameter, or input that no action moves -> (lowest, highest)

    Raises BadInputError for another name, for limits that are not two finite numbers in ascending
    order, and for values outside the limits of the model.
    """
    model = deployed.model
    inputs = [name for name in model.inputs if name not in deployed.commanded]
    changes = []
    for name, limits in vary.items():
        refuse_unvaried(model, name, inputs)
        low, high = _lowest_and_highest(name, limits)
        values = np.linspace(low, high, VALUES).tolist()
        if name in model.inputs:
            _refuse_beyond(model, name, values)
        else:
            for value in values:
                model.with_parameters(**{name: value})
        changes += [(name, value) for value in values]
    return changes


def refuse_unvaried(model: Model, name: str, inputs: Sequence[str]) -> None:
    """Raise BadInputError unless `name` is a parameter of the model or is in `inputs`."""
    if name in inputs:
        return
    if name in model.inputs:
        raise BadInputError(
            f"cannot vary {name}: this input is an action of the deployment file; choose a "
            "parameter or another input"
        )
    if not model.parameters and not inputs:
        raise BadInputError(
            f"cannot vary {name!r}: {model.title} has no parameters, and every input is an action; "
            "remove this variation"
        )
    refuse_unknown("cannot vary", name, (*model.parameters, *inputs))


def variations(
    assessor: Assessor,
    changes: Sequence[tuple[str, float]],
    progress: Progress | None = None,
) -> list[Variation]:
    """Return the assessments of the policy on changed aircraft, one change at a time.

    Each change is assessed at each trim.

    changes: (name, value) of each change, from `changes_of`
    """
    found: list[Variation] = []
    for point in assessor.points if changes else ():
        changed = replace(
            assessor,
            deployed=frozen_at(assessor.deployed, point),
            points=tuple(_changed(point, name, value) for name, value in changes),
            samples=min(assessor.samples, _MOST_SAMPLES),
            steady=point,
        )
        assessed = changed.assessed(progress)
        rows = zip(changes, assessed, strict=True)
        found += [Variation(name, value, each) for (name, value), each in rows]
    return found


def _lowest_and_highest(name: str, limits: Any) -> tuple[float, float]:
    """Return the lowest and highest value of a variation."""
    pair = tuple(limits) if isinstance(limits, (tuple, list, np.ndarray)) else ()
    is_pair = len(pair) == 2 and all(is_finite(value) for value in pair)
    if not is_pair or pair[0] > pair[1]:
        raise BadInputError(
            f"vary[{name!r}] is {shown(limits)}; give (lowest, highest), two "
            "finite numbers in ascending order"
        )
    return float(pair[0]), float(pair[1])


def _refuse_beyond(model: Model, name: str, values: Sequence[float]) -> None:
    """Raise BadInputError for a value outside the limits of an input."""
    limits = Limits.of(model, (name,))
    for value in values:
        if not limits.within([value]).all():
            raise BadInputError(
                f"{name} is {model.describe(name, value)}; give a value between "
                f"{limits.between(name)}"
            )


def _changed(point: OperatingPoint, name: str, value: float) -> OperatingPoint:
    """Return the operating point with another value of one parameter or input."""
    model = point.model
    if name in model.parameters:
        return replace(point, model=model.with_parameters(**{name: value}), problem=None)
    return replace(point, inputs=point.inputs._replace(**{name: value}), problem=None)


def frozen_at(deployed: Deployed, point: OperatingPoint) -> Deployed:
    """Return the deployment with fixed numbers in place of trim values in its observations."""
    own = deployed.deployment
    whole = {name: {**entry, "about": 0.0, "scale": 1.0} for name, entry in own.observation.items()}
    trim = deployed.trim_vector(point)
    n, m = len(deployed.model.states), len(deployed.model.inputs)
    observe = Deployed(own.changed(observation=whole), deployed.model).observe
    values = np.array(observe(trim[:n], trim[n : n + m], trim)).ravel().tolist()
    observation: dict[str, Any] = {}
    for (name, entry), value in zip(own.observation.items(), values, strict=True):
        about = entry.get("about", "trim")
        observation[name] = {**entry, "about": value if about == "trim" else about}
    return Deployed(own.changed(observation=observation), deployed.model)
