"""Errors of record columns that are not estimated: how far they could shift the parameters.

The errors are bias, scale error and delay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from hfa_identify.bands import BAND, noise_of, variance_of_sum
from hfa_identify.directions import beyond_unknowns
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
    """Error of a column that is assumed to be 0.

    half: half-width of the 95 % band that the records would give for this error, or None if a
        change of the parameters has the same effect.
    unit: unit of `half`.
    moves: parameter that such an error shifts most, relative to the parameter's band.
    bands: shift of this parameter by an error of size `half`, in half-widths of the parameter's
        band, or None if `half` is None.
    """

    half: float | None
    unit: str
    moves: str
    bands: float | None

    @property
    def is_assumed(self) -> bool:
        """True if the parameters' bands are valid only if this error is 0.

        An error within its 95 % band would otherwise shift an estimate beyond the estimate's band.
        """
        return self.bands is None or self.bands > 1.0


def column_errors(search: Search, fit: Fit, half: np.ndarray) -> dict[str, ColumnError]:
    """Return the column errors that are not free, by name such as bias_alpha.

    Errors without an effect on the measured quantities are omitted.

    half: half-widths of the parameters' bands for white residuals, (p,)
    """
    errors = _not_free(search)
    if not errors:
        return {}
    found = beyond_unknowns(
        fit,
        {
            number: np.stack([_effect(search, fit, number, error) for error in errors], axis=2)
            for number in range(len(search.records))
        },
    )
    score = np.diag(_covariance_of_score(fit, found.beyond))
    information = np.diag(found.information_beyond)
    errors_of_columns = {}
    for place, error in enumerate(errors):
        own = found.information[place, place]
        if own == 0.0:
            continue
        shifts = np.abs(found.moved[:, place]) / half
        worst = int(shifts.argmax())
        width = bands = None
        if information[place] > _CONFOUNDED * own:
            width = BAND * math.sqrt(max(score[place], information[place])) / information[place]
            bands = shifts[worst] * width
        unit = error.signal(search.responses.model).unit
        moves = search.responses.free[worst]
        errors_of_columns[error.name] = ColumnError(width, unit, moves, bands)
    return errors_of_columns


def _covariance_of_score(fit: Fit, beyond: Mapping[int, np.ndarray]) -> np.ndarray:
    """Return the covariance (c, c) of Σ F' R⁻¹ v for the noise v."""
    # F (N, k, c) by index of the record
    total = np.zeros(())
    for number, (F, noise) in enumerate(zip(beyond.values(), noise_of(fit), strict=True)):
        weighted = F * fit.weights(number)[:, :, None]
        for place, each in noise.items():
            total = total + variance_of_sum(weighted[:, place], each.variance * each.correlation)
    return total


def _not_free(search: Search) -> list[SensorError]:
    """Return the column errors that the search does not estimate."""
    # The scale error or delay of a constant input, and every error of an input that is 0 in all
    # records, have no effect and are omitted.
    responses = search.responses
    steady = search.steady_inputs()
    columns = (*search.moving_inputs(), *steady, *responses.measured)
    return [
        error
        for name, error in sensor_errors(responses.model, columns).items()
        if name not in responses.free and (error.kind == "bias" or error.column not in steady)
    ]


def _effect(search: Search, fit: Fit, number: int, error: SensorError) -> np.ndarray:
    """Return the derivative (N, k) of a record's measured quantities by one column error."""
    # An error c changes the column by c d, where d is 1 for a bias, the column without its bias for
    # a scale, and minus the column's time derivative for a delay. The correction of an input also
    # changes the simulation.
    responses = search.responses
    record = search.records[number]
    y = fit.responses[number].y
    free = dict(zip(responses.free, fit.theta, strict=True))
    bias = free.get(SensorError("bias", error.column).name, 0.0)
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
        effect = np.zeros_like(y)
        effect[:, place] = change
        return effect
    small = _DIFFERENCE * error.signal(responses.model).nominal
    recorded = columns_of(responses.model, record)[error.column]
    moved = with_columns(responses.model, record, {error.column: recorded - small * change})
    return np.asarray((responses.simulated(moved, fit.starts[number], fit.theta).y - y) / small)
