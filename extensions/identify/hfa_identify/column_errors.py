"""Bias, scale and delay of each column of the records with bands, estimated by one step from 0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from hfa_identify.bands import (
    BAND,
    Noise,
    noise_of,
    smooth_autocorrelation,
    sums_of_products,
)
from hfa_identify.fit import Fit
from hfa_identify.records import columns_of, with_columns
from hfa_identify.search import Search
from hfa_identify.sensors import SensorError, sensor_errors
from hfa_support.reporting.results import Result

#: An error whose score has lost all but this part to the parameters cannot be estimated.
_CONFOUNDED = 1e-9
#: Step of a difference, in nominal sizes.
_DIFFERENCE = 1e-7


@dataclass(frozen=True)
class ColumnError(Result):
    """An error of a column that the search did not free, estimated by one step from 0.

    value: its estimate, or None if parameters compensate any such error.
    half: half-width of its 95 % band, or None where `value` is None.
    unit: unit of both.
    moves: the parameter that an error of this half-width shifts most, relative to its band.
    bands: that shift in half-widths of the parameter's band, or None if unbounded.
    shift: largest shift of a parameter by the estimated error, in half-widths of its band.
    """

    value: float | None
    half: float | None
    unit: str
    moves: str
    bands: float | None
    shift: float

    @property
    def is_assumed(self) -> bool:
        """True if the bands assume that the error is 0: within its own band it shifts an estimate
        beyond that estimate's band, or without bound."""
        return self.bands is None or self.bands > 1.0

    @property
    def clear(self) -> float:
        """Absolute value of the estimate divided by its standard deviation."""
        return abs(self.value) / self.half * BAND if self.value is not None and self.half else 0.0


def column_errors(search: Search, fit: Fit, half: np.ndarray) -> dict[str, ColumnError]:
    """Return name of an error, such as bias_alpha -> its estimate.

    An error without an effect on the measured quantities is left out.

    half: (p,) half-widths of the bands of white residuals

    With information M and score g of the parameters θ and of one error c,

        c = s / m,  s = g_c - M_cθ M_θθ⁻¹ g_θ,  m = M_cc - M_cθ M_θθ⁻¹ M_θc.

    The variance of s is computed from residuals without the error and their autocorrelation,
    because a bias is not slow noise.
    """
    responses = search.responses
    known = _estimated(search)
    if not known:
        return {}
    errors = list(known.values())
    slopes = [_slopes(search, fit, number, errors) for number in range(len(fit.responses))]
    beyond = fit.beyond_starts(slopes)
    weighted = [
        each * np.where(present, 1.0 / fit.noise, 0.0)[:, :, None]
        for each, present in zip(beyond, fit.present, strict=True)
    ]
    p = len(fit.theta)
    crossed = _summed(weighted, [each.slopes[:, :, :p] for each in fit.responses])
    own = np.diag(_summed(weighted, slopes))
    inside = np.linalg.pinv(fit.information, rcond=1e-13, hermitian=True)
    moved = -crossed @ inside
    left = own + (moved * crossed).sum(axis=1)
    residuals = [(each / fit.noise)[:, :, None] for each in fit.residuals]
    score = _summed(beyond, residuals)[:, 0] + moved @ _summed(fit.projected, residuals)[:, 0]
    noises = noise_of(fit)
    found = {}
    for place, (name, error) in enumerate(known.items()):
        m = float(left[place])
        worst = int(np.argmax(np.abs(moved[place]) / half))
        unit = error.signal(responses.model).unit
        moves = responses.free[worst]
        if own[place] == 0.0:
            continue
        if m < _CONFOUNDED * own[place]:
            found[name] = ColumnError(None, None, unit, moves, None, 0.0)
            continue
        effects = [
            each[:, :, place] + projected @ moved[place]
            for each, projected in zip(beyond, fit.projected, strict=True)
        ]
        value = float(score[place]) / m
        deviation = math.sqrt(max(_variance(fit, effects, value, noises), m)) / m
        per_unit = float(abs(moved[place, worst]) / half[worst])
        shift = per_unit * abs(value)
        bands = per_unit * BAND * deviation
        found[name] = ColumnError(value, BAND * deviation, unit, moves, bands, shift)
    return found


def _estimated(search: Search) -> dict[str, SensorError]:
    """Return the errors of columns that the search did not free, by name.

    A constant input can have a bias alone: its scale is one, and its delay has no effect."""
    responses = search.responses
    steady = search.steady_inputs()
    columns = (*search.moving_inputs(), *steady, *responses.measured)
    return {
        name: error
        for name, error in sensor_errors(responses.model, columns).items()
        if name not in responses.free
        and responses.has_error(error)
        and (error.kind == "bias" or error.column not in steady)
    }


def _summed(one: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> np.ndarray:
    """Return the (c, d) sums over samples and quantities of the products of (N, k, c) and (N, k, d)
    of each record."""
    pairs = zip(one, other, strict=True)
    return np.asarray(sum(np.tensordot(*pair, ((0, 1), (0, 1))) for pair in pairs))


def _slopes(search: Search, fit: Fit, number: int, errors: Sequence[SensorError]) -> np.ndarray:
    """Return the (N, k, errors) derivatives of the measured quantities of a record with respect to
    errors of columns."""
    return np.stack([_effect(search, fit, number, error) for error in errors], axis=2)


def _effect(search: Search, fit: Fit, number: int, error: SensorError) -> np.ndarray:
    """Return the (N, k) derivative of the measured quantities of a record with respect to an error
    of a column.

    Correcting an error c subtracts c d from the column: d is 1 for a bias, the column itself for a
    scale, and minus its slope for a delay. A change of an input, and in turbulence of any column,
    also changes the simulation."""
    responses = search.responses
    record = search.records[number]
    y = fit.responses[number].y
    free = dict(zip(responses.free, fit.theta, strict=True))
    bias = free.get(SensorError("bias", error.column).name, 0.0)
    effect = np.zeros_like(y)
    if error.column in responses.measured:
        place = responses.measured.index(error.column)
        values = y[:, place]
        slopes = CubicSpline(record.time, values)(record.time, 1)
    else:
        place = list(responses.model.inputs).index(error.column)
        values = record.inputs[:, place]
        slopes = responses.input_slopes(record, place, record.time)
    change = {"bias": np.ones(len(y)), "scale": values - bias, "delay": -slopes}[error.kind]
    if error.column in responses.measured:
        effect[:, place] = change
        if not responses.turbulent:
            return effect
    columns = columns_of(responses.model, record)
    if error.column not in columns:
        return effect
    small = _DIFFERENCE * error.signal(responses.model).nominal
    changed = {error.column: columns[error.column] - small * change}
    moved = with_columns(responses.model, record, changed)
    simulated = responses.simulated(moved, fit.starts[number], fit.theta)
    return np.asarray(effect + (simulated.y - y) / small)


def _variance(
    fit: Fit, effects: list[np.ndarray], value: float, noises: list[dict[int, Noise]]
) -> float:
    """Return the variance of the score of one error, without the residuals that it explains.

    effects: (N, k) of each record, of the error with the parameters moved along
    value: its estimate
    noises: noise of the quantities of each record
    """
    total = 0.0
    for effect, residual, present, noise in zip(
        effects, fit.residuals, fit.present, noises, strict=True
    ):
        for quantity, each in noise.items():
            seen = present[:, quantity]
            left = np.where(seen, residual[:, quantity] - value * effect[:, quantity], 0.0)
            weighted = np.where(seen, effect[:, quantity] / fit.noise[quantity], 0.0)
            correlation = smooth_autocorrelation(left, seen, each.fitted)
            lags = sums_of_products(weighted)
            count = min(len(correlation), len(lags))
            products = correlation[1:count] @ lags[1:count]
            variance = each.lost * float(left @ left) / int(seen.sum())
            total += variance * (lags[0] + 2.0 * products)
    return float(total)
