"""Accuracy of identified parameters: covariance, correlation, whiteness of the residuals."""

from __future__ import annotations

import math

import numpy as np

from hfa_identify.fit import Fit, inverse

#: Half-width of a 95 % band, in standard deviations.
BAND = 1.959964
#: Lags of the autocorrelation that a test of whiteness uses.
LAGS = 25
#: Residuals are colored if the fraction of white lags is smaller.
WHITE = 0.8
#: The model contradicts a quantity if the variance of the residuals exceeds that of the quantity by
#: this factor.
_WORSE = 1.5
#: Largest part of the noise that the fitted unknowns are assumed to absorb.
_MOST_TAKEN = 0.5


def white_covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) Cramér-Rao bound for white residuals: the inverse information matrix.

    The noise variances are those of the residuals, times N / (N - number of unknowns). The variance
    of a parameter is inf if no sample depends on the parameter, or if its information is lost in
    rounding errors.
    """
    covariance = _variance_ratio(fit) * inverse(fit.information)
    unseen = (np.diag(fit.information) <= 0.0) | (np.diag(covariance) < 0.0)
    covariance[unseen, unseen] = np.inf
    return covariance


def _variance_ratio(fit: Fit) -> float:
    """Return the ratio of noise variance to residual variance, N / (N - number of unknowns).

    N is the number of measured samples of all quantities and records.
    """
    samples = int(fit.search.samples.sum())
    return samples / max(samples - _unknowns(fit), 1)


def _unknowns(fit: Fit) -> float:
    """Return the number of parameters, and of the initial states that the records determine."""
    return len(fit.theta) + sum(each.determined for each in fit.normals)


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
    V = np.zeros((len(fit.theta), len(fit.theta)))
    unknowns = _unknowns(fit) / int(fit.search.samples.sum())
    for number, (residual, present) in enumerate(zip(fit.residuals, fit.present, strict=True)):
        projected, weights = fit.projected[number], fit.weights(number)
        for quantity in np.flatnonzero(present.any(axis=0)).tolist():
            noise = noise_covariance(residual[:, quantity], present[:, quantity], unknowns)
            V += variance_of_sum(projected[:, quantity] * weights[:, quantity, None], noise)
    return V


def noise_covariance(residual: np.ndarray, present: np.ndarray, unknowns: float) -> np.ndarray:
    """Return the autocovariance of a quantity's noise at lags 0, 1, ..., up to the last large one.

    The autocorrelation ρ of the residuals ends where it enters the 95 % band of white noise. The
    noise is e and the residuals are v = e - P e, where P projects onto the sensitivities, and P e
    is slow. Each unknown takes the variance 1 + 2 Σ ρ, in units of that of a sample, from the
    autocovariance of v at all these lags alike: this part is added again.

    residual: residuals v of the quantity, (N,)
    present: whether each sample was measured, (N,)
    unknowns: number of fitted unknowns for each sample
    """
    count = int(present.sum())
    correlation = autocorrelation(residual, present)
    white = np.flatnonzero(correlation < BAND / math.sqrt(count))
    until_white = correlation[: int(white[0])] if len(white) else correlation
    taken = min(unknowns * (1.0 + 2.0 * float(until_white[1:].sum())), _MOST_TAKEN)
    return float(residual @ residual) / count * (until_white + taken)


def variance_of_sum(S: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance Σ_i Σ_j S_i' r(i - j) S_j of the sum Σ S_i' e_i, (p, p).

    S: (N, p)
    covariance: autocovariance r of the noise e of one quantity at lags 0, 1, ...
    """
    from scipy.signal import oaconvolve

    r = covariance[: len(S)]
    if len(r) == 1:
        return np.asarray(r[0] * S.T @ S)
    both = np.concatenate([r[:0:-1], r])[:, None]
    filtered = oaconvolve(S, both, axes=0)[len(r) - 1 : len(r) - 1 + len(S)]
    total = S.T @ filtered
    return np.asarray(0.5 * (total + total.T))


def autocorrelation(residual: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the autocorrelation of the measured samples at lags 0 to N - 1.

    At each lag, all pairs of measured samples have equal weight.

    residual: (N,)
    present: whether each sample was measured, (N,)
    """
    from scipy.signal import correlate

    values = np.where(present, residual, 0.0)
    sums, pairs = (
        correlate(each, each, method="fft")[len(each) - 1 :]
        for each in (values, present.astype(float))
    )
    means = sums / np.maximum(np.round(pairs), 1.0)
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
    from its mean in each record), 0 for a constant quantity.
    """
    coefficients = []
    for place in range(len(fit.noise)):
        measured, residuals = _samples(fit, place)
        of_residuals = sum(float(each @ each) for each in residuals)
        about_means = sum(len(each) * float(each.var()) for each in measured if len(each))
        coefficients.append(1.0 - of_residuals / about_means if about_means else 0.0)
    return np.array(coefficients)


def contradicts_records(fit: Fit) -> np.ndarray:
    """Return a mask (k,), True for quantities whose simulated motion contradicts the records.

    For such a quantity, a constant would fit better than the simulation: the noise variance exceeds
    `_WORSE` times the variance of the measured samples.
    """
    motions = [np.concatenate(_samples(fit, place)[0]).var() for place in range(len(fit.noise))]
    return np.asarray(fit.noise > np.maximum(_WORSE * np.array(motions), fit.search.least))


def _samples(fit: Fit, place: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the measured samples and the residuals of one quantity, without missing samples.

    Both are lists with an array for each record.

    place: index of the quantity
    """
    measured, residuals = [], []
    for simulated, residual, present in zip(fit.simulated, fit.residuals, fit.present, strict=True):
        seen = present[:, place]
        residuals.append(residual[seen, place])
        measured.append(simulated.y[seen, place] + residual[seen, place])
    return measured, residuals


def correlations(covariance: np.ndarray) -> np.ndarray:
    """Return the correlation coefficients (p, p) of estimates with a given covariance.

    Coefficients of an estimate with infinite variance are 0.
    """
    variances = np.diag(covariance)
    seen = np.isfinite(variances) & (variances > 0.0)
    deviations = np.sqrt(np.where(seen, variances, 1.0))
    known = np.where(np.outer(seen, seen), covariance, 0.0)
    return np.asarray(known / deviations[:, None] / deviations)
