"""Trims of an aircraft over an interval of its scheduling variable, read from a certificate.

Scheduling values are stored as a user types them, radians of the model in degrees, because their
doubles are then exact. All other numbers are in the units of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, Stated, entry, require
from hfa_prove.statements.aircraft import facts, read_model


def _read_limits(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    """Return signal -> (lowest, highest).

    Limits of disturbances, and of signals that have no limits in the model, may be omitted;
    airspeeds have none of their own.

    Raises Malformed in these cases:
    - A limit is wider than the model's limit.
    - A signal with limits in the model has no limits in the certificate.
    """
    model = known.model
    stated = file.fields(name)
    limits = {}
    for signal, (least, most) in model.limits.items():
        if signal in model.airspeeds:
            continue  # a function of signals that have limits
        needed = bool(np.isfinite((least, most)).any()) and signal not in model.disturbances
        if needed or stated.has(signal):
            low, high = stated.pair(signal)
            where = f"limits: {signal} beyond the model's"
            require(least <= low and high <= most, where, [low, high])
            limits[signal] = (low, high)
    stated.close()
    return limits


def _read_range(file: Fields, name: str) -> tuple[float, float]:
    """Return the ends (low, high) of an interval, low < high."""
    low, high = file.pair(name)
    require(low < high, name, [low, high])
    return low, high


def unknowns_of(model: Model, imposed: Mapping[str, float]) -> tuple[str, ...]:
    """Return the names of the unknowns of a trim."""
    return tuple(name for name in model.variables if name not in (model.schedule, *imposed))


@dataclass(frozen=True, eq=False)
class Flight(Stated):
    """Trims of an aircraft at every scheduling value of an interval, within its limits.

    model: the equations
    parameters: every parameter of the model -> value
    imposed: imposed variable -> value, the same for every trim
    limits: state, input or output -> (lowest, highest)
    range: lowest and highest scheduling value
    first: unknown -> value at the trim at the lowest scheduling value, from which the branch of
        trims begins, within `SAME_TRIM` nominal values
    """

    model: Model = entry(read_model, store=facts, subject="aircraft")
    parameters: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, tuple(known.model.parameters)),
        subject="parameters",
    )
    imposed: Mapping[str, float] = entry(
        lambda file, name, known: file.numbers(
            name, [each for each in known.model.holdable if each != known.model.schedule]
        ),
        subject="trim",
    )
    limits: Mapping[str, tuple[float, float]] = entry(_read_limits, subject="limits")
    range: tuple[float, float] = entry(lambda file, name, known: _read_range(file, name))
    first: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, unknowns_of(known.model, known.imposed))
    )

    @property
    def low(self) -> float:
        """Lowest scheduling value."""
        return self.range[0]

    @property
    def high(self) -> float:
        """Highest scheduling value."""
        return self.range[1]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of a trim."""
        return unknowns_of(self.model, self.imposed)

    def check_consistent(self) -> None:
        """Raise Malformed if no unknown is left, or an imposed or scheduling value is not within
        its limits.
        """
        require(bool(self.unknowns), "imposed", self.imposed)
        ends = {name: (value, value) for name, value in self.imposed.items()}
        low, high = (in_model_unit(self.model, each) for each in self.range)
        ends[self.model.schedule] = (low, high)
        for name, (lowest, highest) in ends.items():
            if name in self.limits:
                least, most = self.limits[name]
                require(least <= lowest and highest <= most, f"{name} beyond its limits", lowest)


def in_model_unit(model: Model, scheduling_value: float) -> float:
    """Return a scheduling value of a certificate in the unit of the model."""
    return math.radians(scheduling_value) if model.is_typed_in_degrees else scheduling_value


def unit_of_schedule(model: Model) -> arb:
    """Return the unit of the scheduling values of a certificate in the unit of the model."""
    return arb.pi() / 180 if model.is_typed_in_degrees else arb(1)
