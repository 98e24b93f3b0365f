"""Handling qualities of an aircraft at a trim, from the declared modes and outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.model import recognized
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.linear_model import LinearModel
from trim.point.performance import Quantity, pull_up

if TYPE_CHECKING:
    from trim.point.operating_point import OperatingPoint

#: Names that models give to oscillating modes.
_OSCILLATING = ("short period", "phugoid", "dutch roll")


def handling_qualities(point: OperatingPoint) -> list[Quantity]:
    """Return the handling qualities at a trim, as `OperatingPoint.handling_qualities` says."""
    point = point.in_radians
    linear = point.linearize(disturbances=())
    quantities = []
    for name in _OSCILLATING:
        oscillation = _oscillation(linear, name)
        if oscillation is None:
            continue
        frequency, damping = oscillation
        quantities.append(Quantity(f"{name} frequency", frequency, "rad/s"))
        quantities.append(Quantity(f"{name} damping", damping, "1"))
        if name == "dutch roll":
            product = damping * frequency
            quantities.append(Quantity("dutch roll damping times frequency", product, "rad/s"))
            quantities += _bank_per_sideslip(linear)
        if name == "short period":
            quantities += _anticipation(point, frequency)
    roll = _real_eigenvalue(linear, "roll")
    if roll:
        quantities.append(Quantity("roll time constant", -1 / roll, "s"))
    spiral = _real_eigenvalue(linear, "spiral")
    if spiral:
        change = "double" if spiral > 0 else "half"
        quantities.append(Quantity(f"spiral time to {change}", math.log(2) / abs(spiral), "s"))
    for name in ("roll", "spiral"):
        for value in _eigenvalues(linear, name):
            if value.imag:
                quantities.append(Quantity(f"{name} damping times frequency", -value.real, "rad/s"))
    return quantities


def with_qualities(report: Report, point: OperatingPoint, states: Sequence[str]) -> Report:
    """Return the report of a linear model with a table of the handling qualities of the aircraft.

    The report is unchanged for a model without handling qualities.

    states: states of the linear model; with fewer than the aircraft's, the table says of how many
        its figures are
    """
    quantities = point.handling_qualities
    if not quantities:
        return report
    rows = [(each.name, f"{each.value:.4f}", each.unit) for each in quantities]
    whole = point.model.linear
    of_all = f", all {len(whole)} states" * (len(states) < len(whole))
    table = Table((f"handling qualities{of_all}", "value", "unit"), rows)
    return replace(report, parts=(*report.parts, table)).with_data(
        handling_qualities=dict(quantities)
    )


def _eigenvalues(linear: LinearModel, family: str) -> list[complex]:
    """Return the eigenvalues of all modes with a given name, one for each conjugate pair."""
    if family not in linear.model.modes:
        return []
    return [mode.eigenvalue for mode in linear.modes if mode.name.partition(" (")[0] == family]


def _real_eigenvalue(linear: LinearModel, family: str) -> float | None:
    """Return the real eigenvalue of the mode with a declared name, 1/s."""
    # The result is None unless exactly one mode has this name and the eigenvalue of the mode is
    # real.
    values = _eigenvalues(linear, family)
    if len(values) != 1 or values[0].imag:
        return None
    return values[0].real


def _oscillation(linear: LinearModel, family: str) -> tuple[float, float] | None:
    """Return the natural frequency, rad/s, and damping ratio of the mode with a declared name."""
    # The mode must consist of one conjugate pair, or of two real eigenvalues of the same sign.
    # Otherwise the result is None.
    values = _eigenvalues(linear, family)
    if len(values) == 1 and values[0].imag:
        values = [values[0], values[0].conjugate()]
    if len(values) != 2:
        return None
    total = values[0] + values[1]
    product = (values[0] * values[1]).real
    if product <= 0 or total.imag:
        return None
    frequency = math.sqrt(product)
    return frequency, -total.real / (2 * frequency)


def _bank_per_sideslip(linear: LinearModel) -> list[Quantity]:
    """Return |φ/β| of the eigenvector of the Dutch roll, if bank and sideslip are states."""
    roles = recognized(linear.model.states)
    names = [roles.get("phi", ""), roles.get("beta", "")]
    pair = [value for value in _eigenvalues(linear, "dutch roll") if value.imag]
    if not {*names} <= {*linear.states} or not pair:
        return []
    values, vectors = np.linalg.eig(linear.A)
    shape = np.abs(vectors[:, int(np.argmin(np.abs(values - pair[0])))])
    bank, sideslip = (shape[linear.states.index(name)] for name in names)
    return [Quantity("dutch roll phi/beta", float(bank / sideslip), "1")] if sideslip else []


def _anticipation(point: OperatingPoint, frequency: float) -> list[Quantity]:
    """Return two handling qualities of the short period: n/alpha, and the parameter CAP."""
    # CAP is the control anticipation parameter, and is omitted unless it is positive. The list is
    # empty if n/alpha is unknown or 0.
    pulled = pull_up(point)
    if pulled is None or not pulled.alpha or not pulled.load_factor:
        return []
    ratio = pulled.load_factor / pulled.alpha
    if math.isnan(ratio):
        return []
    quantities = [Quantity("n/alpha", ratio, "1/rad")]
    if frequency**2 / ratio > 0:
        quantities.append(Quantity("CAP", frequency**2 / ratio, "1/s^2"))
    return quantities
