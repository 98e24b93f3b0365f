"""Errors of record columns, estimated after the search by one Newton step from 0.

The errors are bias, scale error and delay.
"""

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

#: An error cannot be estimated if parameters explain all but this fraction of the information on
#: it.
_CONFOUNDED = 1e-9
#: Step of finite differences, in nominal values.
_DIFFERENCE = 1e-7


@dataclass(frozen=True)
class ColumnError(Result):
    """Error of a column that the search did not estimate, estimated by one Newton step from 0.

    value: the estimate, or None if a change of the parameters has the same effect.
    half: half-width of the 95 % band of `value`, or None if `value` is None.
    unit: unit of `value` and `half`.
    moves: parameter that such an error shifts most, relative to the parameter's band.
    bands: shift of this parameter by an error of size `half`, in half-widths of the parameter's
        band, or None if `value` is None.
    shift: shift of this parameter by the estimated error, in half-widths of the parameter's band, 0
        if `value` is None.
    """

    value: float | None
    half: float | None
    unit: str
    moves: str
    bands: float | None
    shift: float

    @property
    def is_assumed(self) -> bool:
        """True if the parameters' bands are valid only if this error is 0.

        An error within its 95 % band would otherwise shift an estimate beyond the estimate's band.
        """
        return self.bands is None or self.bands > 1.0

    @property
    def clear(self) -> float:
        """Magnitude of the estimate divided by its standard deviation, or 0 without an estimate."""
        return abs(self.value) / self.half * BAND if self.value is not None and self.half else 0.0


def column_errors(search: Search, fit: Fit, half: np.ndarray) -> dict[str, ColumnError]:
    """Return the estimated errors of the record columns, by name such as bias_alpha.

    Errors without an effect on the measured quantities are omitted. With the information matrix M
    and the score g of the parameters θ and of one error c, the estimate of the error is

        c = s / m,  s = g_c - M_cθ M_θθ⁻¹ g_θ,  m = M_cc - M_cθ M_θθ⁻¹ M_θc.

    For the variance of s, the effect of the estimated error is subtracted from the residuals.
    Otherwise, a bias would be counted as slow noise.

    half: half-widths of the parameters' bands for white residuals, (p,)
    """
    responses = search.responses
    known = _estimated(search)
    if not known:
        return {}
    errors = list(known.values())
    slopes = [
        np.stack([_effect(search, fit, number, error) for error in errors], axis=2)
        for number in range(len(fit.responses))
    ]
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
    """Return name -> error, for each column error to be estimated after the search."""
    # These errors are omitted:
    # - an error that the search estimates
    # - an error that the model does not support
    # - the scale error or delay of a constant input
    # - every error of an input that is 0 in all records
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
    """Return the sum of products of two sets of slopes, (c, d)."""
    # The sum is over records, samples and quantities.
    # one (N, k, c), other (N, k, d)
    pairs = zip(one, other, strict=True)
    return np.asarray(sum(np.tensordot(*pair, ((0, 1), (0, 1))) for pair in pairs))


def _effect(search: Search, fit: Fit, number: int, error: SensorError) -> np.ndarray:
    """Return the derivative (N, k) of a record's measured quantities by one column error."""
    # An error c changes the column by c d, where d is 1 for a bias, the column without its bias for
    # a scale, and minus the column's time derivative for a delay. The correction of an input also
    # changes the simulation. In turbulence the correction of any column changes the predictions.
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
    """Return the variance of the score of one column error."""
    # The part that the estimated error explains is subtracted from the residuals.
    # effects (N, k)
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
