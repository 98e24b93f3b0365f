"""Handling qualities of an aircraft at a trim, from the modes and outputs that its model
declares."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.linear_model import LinearModel, linearize

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from trim.point.operating_point import OperatingPoint

#: Modes that oscillate, and those with one real eigenvalue, as models name them.
_OSCILLATING, _REAL = ("short period", "phugoid", "dutch roll"), ("roll", "spiral")


class Quantity(NamedTuple):
    """A number of handling qualities: short period damping, CAP, time to double of the spiral."""

    name: str
    value: float
    unit: str


def handling_qualities(aircraft: Model, point: OperatingPoint) -> list[Quantity]:
    """What the declaration of the model allows, of its linear states at a trim.

    Of a mode declared as `short period`, `phugoid` or `dutch roll`: natural frequency and damping,
    of two real eigenvalues those of their product and sum. `roll`: time constant -1/λ. `spiral`:
    time to double or half, ln 2/|λ|. With an output `load_factor` and a state `alpha` in the short
    period: n/alpha, and the control anticipation parameter CAP = ω²/(n/alpha) (MIL-F-8785C,
    3.2.2.1). n/alpha is the change of load factor by that of alpha, both at rest after a step of
    the input that pitches the aircraft most, with every state but alpha and pitch rate held."""
    model = aircraft
    outputs = ("load_factor",) if "load_factor" in model.outputs else None
    linear = linearize(aircraft, point, outputs=outputs, disturbances=())
    found = []
    for name in filter(model.modes.__contains__, _OSCILLATING):
        if (pair := _pair(linear, name)) is not None:
            frequency, damping = pair
            found += [
                Quantity(f"{name} frequency", frequency, "rad/s"),
                Quantity(f"{name} damping", damping, "1"),
            ]
            if name == "dutch roll":
                found.append(
                    Quantity("dutch roll damping times frequency", damping * frequency, "rad/s")
                )
            if name == "short period" and (ratio := _n_per_alpha(linear)):
                found.append(Quantity("n/alpha", ratio, "1/rad"))
                if frequency**2 / ratio > 0:
                    found.append(Quantity("CAP", frequency**2 / ratio, "1/s^2"))
    for name in filter(model.modes.__contains__, _REAL):
        values = _eigenvalues(linear, name)
        if len(values) == 1 and values[0].real and not values[0].imag:
            value = values[0].real
            if name == "roll":
                found.append(Quantity("roll time constant", -1 / value, "s"))
            else:
                time = f"spiral time to {'double' if value > 0 else 'half'}"
                found.append(Quantity(time, math.log(2) / abs(value), "s"))
    return found


def with_qualities(report: Report, aircraft: Model, point: OperatingPoint) -> Report:
    """The report of a linear model with its handling qualities, a row each; as it is where there
    are none."""
    found = handling_qualities(aircraft, point)
    if not found:
        return report
    table = Table(
        ("handling qualities", "value", "unit"),
        [(name, f"{value:.4f}", unit) for name, value, unit in found],
    )
    data = {each.name: {"value": each.value, "unit": each.unit} for each in found}
    return replace(report, parts=(*report.parts, table)).with_data(handling_qualities=data)


def _eigenvalues(linear: LinearModel, family: str) -> list[complex]:
    """Of the modes of a declared family, one of each conjugate pair."""
    return [mode.eigenvalue for mode in linear.modes if mode.name.partition(" (")[0] == family]


def _pair(linear: LinearModel, family: str) -> tuple[float, float] | None:
    """Natural frequency and damping of a conjugate pair or of two real eigenvalues of one sign."""
    values = _eigenvalues(linear, family)
    if len(values) == 1 and values[0].imag:
        values = [values[0], values[0].conjugate()]
    if (
        len(values) != 2
        or (product := (values[0] * values[1]).real) <= 0
        or abs(sum(values).imag) > 0
    ):
        return None
    return math.sqrt(product), -sum(values).real / (2 * math.sqrt(product))


def _n_per_alpha(linear: LinearModel) -> float | None:
    """d(load factor)/d(alpha) at rest in the short period, 1/rad."""
    model = linear.point.model
    family = tuple(name for name in model.modes["short period"] if name in linear.states)
    if linear.outputs != ("load_factor",) or "alpha" not in family or len(family) != 2:
        return None
    fast = linear.select(family)
    rate = 1 - family.index("alpha")
    sizes = np.array([model.inputs[name].nominal for name in fast.inputs])
    pitching = int(np.argmax(np.abs(fast.B[rate]) * sizes))
    at_rest = -np.linalg.solve(fast.A, fast.B[:, pitching])
    load = fast.C[0] @ at_rest + fast.D[0, pitching]
    return float(load / at_rest[1 - rate]) if at_rest[1 - rate] else None
