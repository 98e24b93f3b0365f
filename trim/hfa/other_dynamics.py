"""Differences of the modes between the `published` and the `newton` dynamics, in percent."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from hfa_model.choice import aircraft
from hfa_model.declaration import parameters_of
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.results import Result
from hfa_support.reporting.rows import Group, Row
from trim.linear.linear_model import LinearModel
from trim.linear.modes import Mode
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim


@dataclass(frozen=True)
class ModeDifference(Result):
    """Mode of two dynamics at the same condition.

    mode: name of the mode
    eigenvalue: eigenvalue of the reported dynamics, 1/s
    other: eigenvalue of the other dynamics, 1/s
    percent: 100 |other - eigenvalue| / |eigenvalue|
    """

    mode: str
    eigenvalue: complex
    other: complex
    percent: float


def with_other_dynamics(point: OperatingPoint) -> LinearModel | None:
    """Return the linear model of the other dynamics at the condition of a trim.

    The result is None for dynamics besides `published` and `newton`, in SI units, and if the other
    dynamics have no trim there.
    """
    model = point.model
    if model.name not in VARIANTS or model.native is not model or point.found_by is None:
        return None
    name = next(each for each in VARIANTS if each != model.name)
    other = aircraft(name, parameters_of(model))
    with suppress(BadInputError, NoSolutionError):
        return trim(other, point.found_by.asked.at(), point).linearize()
    return None


def mode_differences(modes: Sequence[Mode], others: Sequence[Mode]) -> tuple[ModeDifference, ...]:
    """Return the differences of the modes that both dynamics have, by name."""
    by_name = {mode.name: mode.eigenvalue for mode in others}
    differences = []
    for mode in modes:
        other = by_name.get(mode.name)
        if other is not None and mode.eigenvalue:
            percent = 100.0 * abs(other - mode.eigenvalue) / abs(mode.eigenvalue)
            differences.append(ModeDifference(mode.name, mode.eigenvalue, other, percent))
    return tuple(differences)


def differences_group(other: str, differences: Sequence[ModeDifference]) -> Group:
    """Return the eigenvalues of the other dynamics, and how far they are from the reported ones.

    other: name of the other dynamics
    """
    rows = [
        Row(each.mode, each.other, "1/s", f"{each.percent:.3g} % apart") for each in differences
    ]
    return Group(f"modes of {other} dynamics", tuple(rows))
