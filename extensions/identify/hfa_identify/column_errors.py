"""Bias, scale and delay of each column of the records, by one step from 0, with their bands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hfa_identify.bands import (
    BAND,
    fitted_by_quantity,
    smooth_autocorrelation,
    sums_of_products,
)
from hfa_identify.fit import Fit, OutputError
from hfa_identify.search import Search
from hfa_identify.sensors import sensor_errors
from hfa_support.reporting.results import Result

#: An error whose score has lost all but this part to the parameters cannot be estimated.
_CONFOUNDED = 1e-9


@dataclass(frozen=True)
class ColumnError(Result):
    """An error of a column that the search did not free, estimated by one step from 0.

    value: its estimate, or None where parameters make up for any such error.
    half: half-width of its 95 % band; None likewise.
    unit: of both.
    moves: the parameter that this half-width moves most, in its own bands.
    bands: by how many of its half-widths, or None without end.
    shift: by how many the estimated error moves any parameter.
    """

    value: float | None
    half: float | None
    unit: str
    moves: str
    bands: float | None
    shift: float

    @property
    def is_assumed(self) -> bool:
        """Return whether the bands assume that it is 0: within its own band it moves an estimate
        beyond that estimate's, or without end."""
        return self.bands is None or self.bands > 1.0

    @property
    def clear(self) -> float:
        """The estimate divided by its standard deviation."""
        return abs(self.value) / self.half * BAND if self.value is not None and self.half else 0.0


def column_errors(search: Search, fit: Fit, half: np.ndarray) -> dict[str, ColumnError]:
    """Name of an error, as bias_alpha -> its estimate.

    half: (p,) half-widths of the bands of white residuals

    With information M and score g of the parameters θ and of one error c:
    c = s / m, s = g_c - M_cθ M_θθ⁻¹ g_θ, m = M_cc - M_cθ M_θθ⁻¹ M_θc. The variance of s is that of
    residuals without the error, with their autocorrelation: a bias is no slow noise.
    """
    responses = search.responses
    model = responses.model
    p = len(responses.free)
    known = sensor_errors(model, (*search.moving_inputs(), *responses.measured))
    names = [
        name
        for name, error in known.items()
        if name not in responses.free and responses.has_error(error)
    ]
    if not names:
        return {}
    wider = responses.wider(names)
    bounds = np.array([(each.min, each.max) for each in wider.signals.values()])
    theta = np.concatenate([fit.theta, np.zeros(len(names))])
    at = OutputError(wider, search.records, bounds, search.guesses).at(theta, fit.starts)
    M = at.information
    g = _score(at)
    fitted = fitted_by_quantity(fit)
    inside = np.linalg.pinv(M[:p, :p], rcond=1e-13, hermitian=True)
    errors = {}
    for place, name in enumerate(names, start=p):
        along = np.zeros(len(theta))
        along[place] = 1.0
        along[:p] = -inside @ M[:p, place]
        m = float(M[place, place] + M[place, :p] @ along[:p])
        worst = int(np.argmax(np.abs(along[:p]) / half))
        unit = known[name].signal(model).unit
        moves = responses.free[worst]
        if m < _CONFOUNDED * M[place, place]:
            errors[name] = ColumnError(None, None, unit, moves, None, 0.0)
            continue
        value = float(along @ g) / m
        deviation = math.sqrt(max(_variance(at, along, value, fitted), m)) / m
        per_unit = float(abs(along[worst]) / half[worst])
        shift = per_unit * abs(value)
        bands = per_unit * BAND * deviation
        errors[name] = ColumnError(value, BAND * deviation, unit, moves, bands, shift)
    return errors


def _score(fit: Fit) -> np.ndarray:
    """(p,) Σ S' R⁻¹ v."""
    return np.asarray(
        sum(
            np.einsum("nkp,nk->p", projected, residual / fit.noise)
            for projected, residual in zip(fit.projected, fit.residuals, strict=True)
        )
    )


def _variance(fit: Fit, along: np.ndarray, value: float, fitted: list[np.ndarray]) -> float:
    """The variance of the score of one error, without the residuals that it explains.

    along: (p,) how the parameters move with the error. value: estimate of the error.
    fitted: (k,) of each record, number of unknowns that its samples determine."""
    total = 0.0
    for projected, residual, present, shares in zip(
        fit.projected, fit.residuals, fit.present, fitted, strict=True
    ):
        effect = projected @ along
        for quantity in np.flatnonzero(present.any(axis=0)):
            seen = present[:, quantity]
            left = np.where(seen, residual[:, quantity] - value * effect[:, quantity], 0.0)
            weighted = np.where(seen, effect[:, quantity] / fit.noise[quantity], 0.0)
            correlation = smooth_autocorrelation(left, seen, shares[quantity])
            lags = sums_of_products(weighted)
            count = min(len(correlation), len(lags))
            products = correlation[1:count] @ lags[1:count]
            total += float(left @ left) / int(seen.sum()) * (lags[0] + 2.0 * products)
    return float(total)
