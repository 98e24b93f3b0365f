"""Handling qualities of an aircraft at a trim, from the declared modes and outputs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hfa_support.reporting.rows import Row
from trim.linear.modes import Mode
from trim.reports.levels import Airplane, chosen_airplane, graded, level_lines
from trim.reports.trimmed import Trimmed

#: Names that models give to oscillating modes.
_OSCILLATING = ("short period", "phugoid", "dutch roll")


class ModeFigures(NamedTuple):
    """Rows on the modes at a trim, and sentences below them on the levels."""

    rows: list[Row]
    lines: list[str]


def mode_figures(trimmed: Trimmed, airplane: Airplane) -> ModeFigures:
    """Return the eigenvalues of the modes, each with its handling qualities and their levels."""
    if trimmed.fault:
        return ModeFigures([], [f"no modes: {trimmed.fault}"])
    chosen, why = chosen_airplane(trimmed, airplane)
    qualities = [*handling_qualities(trimmed)]
    lines = []
    if "speed" in trimmed.roles:
        qualities = graded(qualities, chosen)
        lines = level_lines(qualities, [mode.name for mode in trimmed.modes], chosen, why)
    rows: list[Row] = []
    time = trimmed.model.time_unit
    for mode in trimmed.modes:
        times = _times_text(mode, time)
        rows.append(Row(f"{mode.name} eigenvalue", mode.eigenvalue, f"1/{time}", times))
        family = mode.name.partition(" (")[0]
        of_mode = [row for row in qualities if _belongs(row.name, family)]
        qualities = [row for row in qualities if row not in of_mode]
        if mode.eigenvalue.imag and not of_mode:
            of_mode = [
                Row(f"{mode.name} frequency", mode.frequency, f"rad/{time}", in_degrees=False),
                Row(f"{mode.name} damping", mode.damping),
            ]
        rows += of_mode
    return ModeFigures([*rows, *qualities], lines)


def _belongs(quality: str, family: str) -> bool:
    """Return whether a handling quality belongs to the modes of a family, such as "phugoid"."""
    if family == "short period" and quality in ("CAP", "n/alpha"):
        return True
    return quality.startswith(f"{family} ")


def _times_text(mode: Mode, unit: str) -> str:
    """Return period and time to half or double of a mode as text.

    unit: unit of time
    """
    words = []
    if mode.eigenvalue.imag:
        words.append(f"period {mode.period:.4g} {unit}")
    if mode.stable:
        words.append(f"time to half {mode.time_to_half:.4g} {unit}")
    elif mode.eigenvalue.real:
        words.append(f"time to double {mode.time_to_double:.4g} {unit}")
    return ", ".join(words)


def handling_qualities(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the handling qualities at a trim, as far as the model declares modes and outputs; none
    with a `fault`.

    - `short period`, `phugoid` and `dutch roll`: natural frequency and damping ratio, for two real
      eigenvalues from their product and sum
    - `dutch roll`: also the product of frequency and damping ratio, and |φ/β| of the mode's shape
    - `roll`: time constant -1/λ
    - `spiral`: time to double or half, ln 2/|λ|
    - `roll` or `spiral` coupled in an oscillation: the product of frequency and damping ratio
    - with an output `load_factor` and a state `alpha` in the short period: n/alpha and the control
      anticipation parameter CAP = ω²/(n/alpha) (MIL-F-8785C, 3.2.2.1)

    n/alpha is the steady change of the load factor divided by the steady change of alpha, after a
    step of the input that pitches the aircraft most. Lags follow, and all other states except alpha
    and pitch rate are held.
    """
    for name in _OSCILLATING:
        oscillation = _oscillation(trimmed, name)
        if oscillation is None:
            continue
        yield Row(f"{name} frequency", oscillation.frequency, "rad/s", in_degrees=False)
        yield Row(f"{name} damping", oscillation.damping)
        if name == "dutch roll":
            product = oscillation.damping * oscillation.frequency
            yield Row("dutch roll damping times frequency", product, "rad/s", in_degrees=False)
            yield from _bank_per_sideslip(trimmed)
        if name == "short period":
            yield from _anticipation(trimmed, oscillation.frequency)
    roll = _real_eigenvalue(trimmed, "roll")
    if roll:
        yield Row("roll time constant", -1 / roll, "s")
    spiral = _real_eigenvalue(trimmed, "spiral")
    if spiral:
        change = "double" if spiral > 0 else "half"
        yield Row(f"spiral time to {change}", math.log(2) / abs(spiral), "s")
    for name in ("roll", "spiral"):
        for value in _eigenvalues(trimmed, name):
            if value.imag:
                yield Row(f"{name} damping times frequency", -value.real, "rad/s", in_degrees=False)


def _eigenvalues(trimmed: Trimmed, family: str) -> list[complex]:
    """Return the eigenvalues, 1/s, of all modes with a given name, one for each conjugate pair."""
    if family not in trimmed.model.modes:
        return []
    modes = [mode for mode in trimmed.modes if mode.name.partition(" (")[0] == family]
    return [mode.eigenvalue * trimmed.per_second for mode in modes]


def _real_eigenvalue(trimmed: Trimmed, family: str) -> float | None:
    """Return the eigenvalue, 1/s, of the only mode with a declared name if it is real, or None."""
    values = _eigenvalues(trimmed, family)
    return values[0].real if len(values) == 1 and not values[0].imag else None


class _Oscillation(NamedTuple):
    """Natural frequency, rad/s, and damping ratio of a mode."""

    frequency: float
    damping: float


def _oscillation(trimmed: Trimmed, family: str) -> _Oscillation | None:
    """Return the natural frequency and damping ratio of the mode with a declared name, or None
    unless it consists of one conjugate pair or of two real eigenvalues of the same sign.
    """
    values = _eigenvalues(trimmed, family)
    if len(values) == 1 and values[0].imag:
        values = [values[0], values[0].conjugate()]
    if len(values) != 2:
        return None
    total = values[0] + values[1]
    product = (values[0] * values[1]).real
    if product <= 0 or total.imag:
        return None
    frequency = math.sqrt(product)
    return _Oscillation(frequency, -total.real / (2 * frequency))


def _bank_per_sideslip(trimmed: Trimmed) -> Iterator[Row]:
    """Yield |φ/β| of the eigenvector of the Dutch roll, if bank and sideslip are linear states."""
    states = trimmed.model.linear
    names = [trimmed.roles.get("phi", ""), trimmed.roles.get("beta", "")]
    oscillating = [value for value in _eigenvalues(trimmed, "dutch roll") if value.imag]
    if not {*names} <= {*states} or not oscillating:
        return
    values, vectors = np.linalg.eig(trimmed.A * trimmed.per_second)
    nearest = int(np.argmin(np.abs(values - oscillating[0])))
    shape = np.abs(vectors[:, nearest])
    bank, sideslip = (shape[states.index(name)] for name in names)
    if sideslip:
        yield Row("dutch roll phi/beta", float(bank / sideslip))


def _anticipation(trimmed: Trimmed, frequency: float) -> Iterator[Row]:
    """Yield n/alpha, unless it is unknown or 0, and the parameter CAP if it is positive."""
    pull_up = trimmed.pull_up
    if pull_up is None or not pull_up.alpha or not pull_up.load_factor:
        return
    load_per_alpha = pull_up.load_factor / pull_up.alpha
    if math.isnan(load_per_alpha):
        return
    yield Row("n/alpha", load_per_alpha, "1/rad")
    if frequency**2 / load_per_alpha > 0:
        yield Row("CAP", frequency**2 / load_per_alpha, "1/s^2")
