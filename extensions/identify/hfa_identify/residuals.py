"""Test of the residuals: which quantity of a record differs from the model, when and how far.

The residuals of a model that explains a record are noise, which depends on no input. Residuals that
follow the inputs are motion that the model lacks, or an error of a column. The test does not decide
between the two. It assumes that no controller moves the inputs in answer to gusts or noise.

Sources: L. Ljung, *System Identification: Theory for the User*, 2nd ed., 1999, chapter 16.6; C. W.
J. Granger, Econometrica 37 (1969) 424-438.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_identify.fit import Fit, inverse
from hfa_support.reporting.results import Result

#: Half-width of a 95 % band, in standard deviations.
BAND = 1.959964
#: Lags of the autocorrelation that a test of whiteness uses.
LAGS = 25
#: Residuals are colored if the fraction of white lags is smaller.
WHITE = 0.8
#: The model contradicts a quantity with a smaller coefficient of determination: a constant fits it
#: better.
WORSE = -0.5
#: Largest part of the noise variance that a fit is assumed to remove from the residuals.
_MOST_REMOVED = 0.5


def white_covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) Cramér-Rao bound for white residuals: the inverse information matrix.

    The noise variances are those of the residuals, times N / (N - number of unknowns). The variance
    of a parameter is inf if no sample depends on the parameter, or if its information is lost in
    rounding errors.
    """
    samples = int(fit.search.samples.sum())  # of all quantities and records
    covariance = samples / max(samples - _unknowns(fit), 1) * inverse(fit.information)
    unseen = (np.diag(fit.information) <= 0.0) | (np.diag(covariance) < 0.0)
    covariance[unseen, unseen] = np.inf  # their variances
    return covariance


def _unknowns(fit: Fit) -> float:
    """Return the number of parameters, and of the initial states that the records determine."""
    return len(fit.theta) + sum(normal.determined for normal in fit.normals)


def covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) covariance of the parameters, corrected for autocorrelated residuals.

    The variances are the diagonal elements of

        C = D [Σ_i Σ_j S_i' R⁻¹ R_vv(i - j) R⁻¹ S_j] D,   D = (Σ S_i' R⁻¹ S_i)⁻¹

    but at least the variances of `white_covariance`. The correlations are those of
    `white_covariance`. S are the sensitivities without the part that a change of the initial state
    explains. R is the noise variance, and R_vv is the autocovariance of the noise
    (`noise_covariance`).

    Source: E. A. Morelli, V. Klein, Accuracy of aerodynamic model parameters estimated from flight
    test data, Journal of Guidance, Control, and Dynamics 20 (1997) 74-80.
    """
    D = inverse(fit.information)
    coloured = D @ _covariance_of_score(fit) @ D
    # A band is not narrower than for white residuals, because the estimate of R_vv is noisy.
    bound = white_covariance(fit)
    seen = np.isfinite(np.diag(bound))
    widening = np.ones(len(D))
    widening[seen] = np.sqrt(np.maximum(np.diag(coloured)[seen] / np.diag(bound)[seen], 1.0))
    return np.asarray(bound * widening[:, None] * widening)


def _covariance_of_score(fit: Fit) -> np.ndarray:
    """Return the covariance (p, p) of Σ S' R⁻¹ v, with the autocovariance of the noise."""
    from scipy.linalg import matmul_toeplitz

    V = np.zeros((len(fit.theta), len(fit.theta)))
    unknowns = _unknowns(fit) / int(fit.search.samples.sum())
    for number, (residual, present) in enumerate(zip(fit.residuals, fit.present, strict=True)):
        projected, weights = fit.projected[number], fit.weights(number)
        for quantity in np.flatnonzero(present.any(axis=0)).tolist():
            noise = noise_covariance(residual[:, quantity], present[:, quantity], unknowns)
            at_lags = np.zeros(len(residual))
            at_lags[: len(noise)] = noise
            S = projected[:, quantity] * weights[:, quantity, None]
            V += S.T @ matmul_toeplitz(at_lags, S)
    return V


def noise_covariance(residual: np.ndarray, present: np.ndarray, unknowns: float) -> np.ndarray:
    """Return the autocovariance of a quantity's noise at lags 0, 1, ..., up to the last large one.

    The autocorrelation ρ of the residuals ends where it enters the 95 % band of white noise. The
    fit removes the projection P e of the noise e on the sensitivities: the residuals are v = e - P
    e. As P e is slow, this lowers the autocovariance by the same amount at all these lags. Added
    again is 1 + 2 Σ ρ times the variance of v, times the number of unknowns per sample.

    residual: residuals v of the quantity, (N,)
    present: whether each sample was measured, (N,)
    unknowns: number of fitted unknowns for each sample
    """
    count = int(present.sum())
    correlation = autocorrelation(residual, present)
    white = np.flatnonzero(correlation < BAND / math.sqrt(count))
    until_white = correlation[: int(white[0])] if len(white) else correlation
    removed = min(unknowns * (1.0 + 2.0 * float(until_white[1:].sum())), _MOST_REMOVED)
    return float(residual @ residual) / count * (until_white + removed)


def autocorrelation(residual: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the autocorrelation of the measured samples at lags 0 to N - 1.

    At each lag, all pairs of measured samples have equal weight.

    residual: (N,)
    present: whether each sample was measured, (N,)
    """
    from scipy.signal import correlate

    values = np.where(present, residual, 0.0)
    sums, pairs = (
        correlate(series, series, method="fft")[len(series) - 1 :]
        for series in (values, present.astype(float))
    )
    means = sums / np.maximum(np.round(pairs), 1.0)  # the FFT leaves whole numbers of pairs inexact
    return np.asarray(means / max(means[0], 1e-300))


def whiteness(residual: np.ndarray, present: np.ndarray) -> float:
    """Return the fraction of lags with an autocorrelation in the 95 % band of white noise.

    The lags are 1 to `LAGS`.

    residual: residuals of one quantity, (N,)
    present: whether each sample was measured, (N,)
    """
    correlation = autocorrelation(residual, present)[1 : LAGS + 1]
    limit = BAND / np.sqrt(max(1, int(present.sum())))
    return float((np.abs(correlation) < limit).mean())


def determination(fit: Fit) -> np.ndarray:
    """Return the coefficient of determination of each measured quantity, (k,).

    The coefficient is 1 - (sum of squared residuals) / (sum of squared deviations of the quantity
    from its mean in each record). The deviations are at least the least noise.
    """
    of_residuals, about_means = np.zeros((2, len(fit.noise)))
    for simulated, residual, present in zip(fit.simulated, fit.residuals, fit.present, strict=True):
        measured = simulated.y + residual
        mean = (measured * present).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
        of_residuals += (residual**2).sum(axis=0)
        about_means += (present * (measured - mean) ** 2).sum(axis=0)
    return np.asarray(
        1.0 - of_residuals / np.maximum(about_means, fit.search.samples * fit.search.least)
    )


def correlations(covariance: np.ndarray) -> np.ndarray:
    """Return the correlation coefficients (p, p) of estimates with a given covariance.

    Coefficients of an estimate with infinite variance are 0.
    """
    deviations = np.sqrt(np.diag(covariance))
    with np.errstate(all="ignore"):
        coefficients = covariance / deviations[:, None] / deviations
    return np.asarray(np.nan_to_num(coefficients))


#: Probability that chance causes such residuals in any quantity of any record, below which they are
#: a misfit.
_CHANCE = 1e-3
#: Number of delays at which residuals are compared with an input, and the part of the record that
#: the delays span.
_DELAYS = 10
_SPAN = 0.25
#: Least number of samples for each delay of each input.
_SAMPLES = 8
#: Combinations of delayed inputs are not tested if the unknowns explain all but this fraction.
_CONFOUNDED = 1e-3
#: Number of past residuals from which the next is predicted.
_PAST = 4
#: Distance of a sample from the mean of its neighbors, in robust standard deviations, beyond which
#: it is an outlier.
_FAR = 8.0


@dataclass(frozen=True)
class Misfit(Result):
    """A difference between a record and the model that is not noise.

    record: name of the record.
    quantity: the measured quantity.
    time: time of the largest difference, s.
    difference: recorded minus simulated value at this time, without noise.
    unit: unit of the difference.
    samples: number of outliers, 0 if the difference follows the inputs.
    """

    record: str
    quantity: str
    time: float
    difference: float
    unit: str
    samples: int = 0


def misfits(fit: Fit) -> list[Misfit]:
    """Return the misfits of the records, the least likely by chance first.

    For each quantity of each record, there are three cases:
    - A few samples are outliers: each is far from the mean of its neighbors.
    - Otherwise, the residuals follow the inputs.
    - Otherwise, the residuals are noise, and nothing is returned.
    """
    shows_noise = fit.noise > fit.search.least  # more than rounding
    measured = [
        (number, int(place))
        for number, present in enumerate(fit.present)
        for place in np.flatnonzero(present.any(axis=0) & shows_noise)
    ]
    candidates = [_candidate(fit, number, place) for number, place in measured]
    # Divided by the number of tests, so that one of them fails by chance with at most `_CHANCE`.
    clear = [candidate for candidate in candidates if candidate.chance < _CHANCE / len(measured)]
    return [candidate.misfit for candidate in sorted(clear, key=lambda candidate: candidate.chance)]


class _Candidate(NamedTuple):
    """The largest residual of a quantity, and the probability that chance causes the residuals."""

    chance: float
    misfit: Misfit


def _candidate(fit: Fit, number: int, place: int) -> _Candidate:
    """Return the largest residual of a quantity, and the probability that chance causes it."""
    record, name = fit.search.records[number], fit.search.responses.measured[place]
    residuals, present = fit.residuals[number][:, place], fit.present[number][:, place]
    outliers = _outliers(residuals, present)
    if len(outliers):
        chance, largest, difference = 0.0, int(outliers[0]), residuals
    else:  # `difference` is the part of the residuals that follows the inputs
        driven = _driven(fit, number, place)
        chance = _granger_p_value(residuals[present], driven[present])
        difference = driven @ np.linalg.lstsq(driven[present], residuals[present])[0]
        largest = int(np.abs(difference * present).argmax())
    misfit = Misfit(
        record=record.name,
        quantity=name,
        time=float(record.time[largest]),
        difference=float(difference[largest]),
        unit=fit.search.responses.model.unit(name),
        samples=len(outliers),
    )
    return _Candidate(chance, misfit)


def _outliers(residuals: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the indices of samples of a quantity that are far from the mean of their neighbors."""
    # Many such samples are heavy-tailed noise. None are returned if they are more than one, and
    # more than one in 50.
    rows = np.flatnonzero(present)
    v = residuals[rows]
    distances = np.abs(v[1:-1] - 0.5 * (v[:-2] + v[2:]))
    robust_deviation = 1.4826 * np.median(distances)  # of normally distributed distances
    far = np.flatnonzero(distances > _FAR * robust_deviation)
    # An outlier also changes the distances of its neighbors, by half as much. 0.7 excludes them.
    far = far[distances[far] > 0.7 * distances.max(initial=0.0)]
    return rows[far + 1] if len(far) <= max(1, len(v) // 50) else rows[:0]


class _Unexplained(NamedTuple):
    """Part F⊥ of changes F of a record's quantities that no change of the unknowns explains.

    changes: F⊥, (N, k, c)
    information_of_all: Σ F' R⁻¹ F with the variances R of the residuals, (c, c)
    information: Σ F⊥' R⁻¹ F⊥, (c, c)
    """

    changes: np.ndarray
    information_of_all: np.ndarray
    information: np.ndarray


def _beyond_unknowns(fit: Fit, number: int, F: np.ndarray) -> _Unexplained:
    """Return the part of changes F (N, k, c) of a record that no unknown explains."""
    # Subtracted are the least-squares projections on the initial state, then on the parameters.
    beyond_start, projected = fit.beyond_start(number, F), fit.projected[number]
    weighted = F * fit.weights(number)[:, :, None]
    by_parameters = _products(projected, weighted)
    change = np.linalg.pinv(fit.information, rcond=1e-13, hermitian=True) @ by_parameters
    return _Unexplained(
        changes=beyond_start - projected @ change,
        information_of_all=_products(F, weighted),
        information=_products(beyond_start, weighted) - change.T @ by_parameters,
    )


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the sums over samples and quantities of products (c, d) of (N, k, c) and (N, k, d)."""
    return np.asarray(np.tensordot(one, other, ((0, 1), (0, 1))))


def _driven(fit: Fit, number: int, place: int) -> np.ndarray:
    """Return changes of a quantity that follow the inputs, and that no unknown explains, (N, d).

    The changes are combinations of the delayed inputs, without those of which the unknowns explain
    all but the fraction `_CONFOUNDED`.
    """
    inputs = _delayed_inputs(fit, number)
    changes = np.zeros((*fit.residuals[number].shape, inputs.shape[1]))
    changes[:, place] = inputs
    unexplained = _beyond_unknowns(fit, number, changes)
    # Inputs scaled to unit information, so that an eigenvalue is an unexplained fraction.
    size = np.sqrt(np.maximum(np.diag(unexplained.information_of_all), 1e-300))
    fractions, combinations = np.linalg.eigh(unexplained.information / size[:, None] / size)
    kept = combinations[:, fractions > _CONFOUNDED]
    return np.asarray(unexplained.changes[:, place] / size @ kept)


def _delayed_inputs(fit: Fit, number: int) -> np.ndarray:
    """Return a constant and the inputs of a record at several delays, (N, c)."""
    # Inputs that are constant in all records are left out.
    records = fit.search.records
    varies = np.any([np.ptp(record.inputs, axis=0) > 0.0 for record in records], axis=0)
    time, moving = records[number].time, records[number].inputs[:, varies].T
    most_delays = len(time) // (_SAMPLES * max(len(moving), 1))
    count = max(1, min(_DELAYS, most_delays))
    delays = np.linspace(0.0, _SPAN * (time[-1] - time[0]), count)
    # np.interp gives an input its first value before the record: 0, as differences from it.
    delayed = [np.interp(time - delay, time, u - u[0]) for u in moving for delay in delays]
    return np.column_stack([np.ones(len(time)), *delayed])


def _granger_p_value(residuals: np.ndarray, driven: np.ndarray) -> float:
    """Return the probability that noise seems to depend on the inputs as much as the residuals."""
    # Noise is predicted from its own past, and changes that follow the inputs do not improve the
    # prediction. Relative to the squared prediction error with them, the decrease of the error is
    # then F-distributed.
    from scipy.special import fdtrc

    N, d = driven.shape
    past = np.column_stack([residuals[_PAST - lag : N - lag] for lag in range(1, _PAST + 1)])
    now = residuals[_PAST:]
    degrees_of_freedom = len(now) - _PAST - d
    if d == 0 or degrees_of_freedom < 1:
        return 1.0
    without = _squared_prediction_error(past, now)
    with_driven = _squared_prediction_error(np.hstack([past, driven[_PAST:]]), now)
    statistic = (without - with_driven) / d * degrees_of_freedom / max(with_driven, 1e-300)
    return float(fdtrc(d, degrees_of_freedom, statistic))


def _squared_prediction_error(known: np.ndarray, now: np.ndarray) -> float:
    """Return the sum of squared errors of a linear prediction of `now` (N,) from `known` (N, c)."""
    prediction = known @ np.linalg.lstsq(known, now)[0]
    return float(np.sum((now - prediction) ** 2))
