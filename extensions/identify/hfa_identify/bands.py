"""Accuracy of identified parameters: covariance, correlation, whiteness of the residuals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

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
#: Highest order of the autoregressive model of residuals.
_MOST_ORDER = 4
#: Largest sum of the coefficients of an autoregressive model. A process with the sum 1 has no
#: finite variance.
_SLOWEST = 0.995
#: Poles of slow noise in its sum with white noise, and fractions of the variance that it may have.
_POLES = (0.7, 0.8, 0.9, 0.94, 0.96, 0.97, 0.98, 0.985, 0.99, 0.993)
_SHARES = (0.02, 0.04, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
#: Largest fraction of the noise variance that the fitted unknowns are assumed to absorb.
_MOST_TAKEN = 0.5
#: Length of the period for which an autocorrelation is computed, and value below which it is
#: negligible.
_LENGTH = 8192
_GONE = 1e-3


def white_covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) Cramér-Rao bound for white residuals: the inverse information matrix.

    The noise variances are those of the residuals, times N / (N - number of unknowns). The variance
    of a parameter is inf if no sample depends on the parameter, or if its information is lost in
    rounding errors.
    """
    covariance = _enlarged(fit) * inverse(fit.information)
    unseen = (np.diag(fit.information) <= 0.0) | (np.diag(covariance) < 0.0)
    covariance[unseen, unseen] = np.inf
    return covariance


def _enlarged(fit: Fit) -> float:
    """Return the ratio of noise variance to residual variance, N / (N - number of unknowns)."""
    # N is the number of measured samples of all quantities and records.
    samples = int(fit.samples.sum())
    return samples / max(samples - _unknowns(fit), 1)


def _unknowns(fit: Fit) -> float:
    """Return the number of unknowns that the records determine: parameters and initial states."""
    # All parameters are counted.
    return len(fit.theta) + sum(each.determined for each in fit.normals)


def covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) covariance of the parameters, corrected for autocorrelated residuals.

    The variances are the diagonal elements of

        C = D [Σ_i Σ_j S_i' R⁻¹ R_vv(i - j) R⁻¹ S_j] D,   D = (Σ S_i' R⁻¹ S_i)⁻¹

    but at least the variances of `white_covariance`. The correlations are those of
    `white_covariance`. S are the sensitivities without the part that a change of the initial state
    explains. R is the noise variance, and R_vv is the autocovariance of the noise (`noise_of`).

    Source: E. A. Morelli, V. Klein, Accuracy of aerodynamic model parameters estimated from flight
    test data, Journal of Guidance, Control, and Dynamics 20 (1997) 74-80.
    """
    D = inverse(fit.information)
    coloured = D @ _covariance_of_score(fit) @ D
    # A band is not narrower than for white residuals, because the estimate of R_vv is noisy.
    bound = white_covariance(fit)
    seen = np.isfinite(np.diag(bound))
    grown = np.ones(len(D))
    grown[seen] = np.sqrt(np.maximum(np.diag(coloured)[seen] / np.diag(bound)[seen], 1.0))
    return np.asarray(bound * grown[:, None] * grown)


def _covariance_of_score(fit: Fit) -> np.ndarray:
    """Return the covariance (p, p) of Σ S' R⁻¹ v, with the autocovariance of the noise."""
    V = np.zeros((len(fit.theta), len(fit.theta)))
    for number, noise in enumerate(noise_of(fit)):
        projected, weights = fit.projected[number], fit.weights(number)
        for quantity, each in noise.items():
            weighted = projected[:, quantity] * weights[:, quantity, None]
            V += variance_of_sum(weighted, each.variance * each.correlation)
    return V


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one measured quantity in a record.

    fitted: number of unknowns that the samples of the quantity determine.
    lost: ratio of the noise variance to the variance of the residuals, at least 1.
    variance: noise variance.
    correlation: autocorrelation at lags 0, 1, ..., up to the last non-negligible lag.
    """

    fitted: float
    lost: float
    variance: float
    correlation: np.ndarray


def noise_of(fit: Fit) -> list[dict[int, Noise]]:
    """Return the noise of the measured quantities in each record, by index of the quantity.

    The residuals are v = (I - P) e, where e is the noise and P is the projection onto the
    sensitivities S of all unknowns. The expected weighted sum of squares of a quantity q with N
    samples is

        Σ v² / r = N - 2 tr(K V_q) + tr(K V K M_q)

    with the noise variance r, M_q = S' S / r and V_q = S' R_vv S / r² of the quantity, V = Σ V_q,
    and K = (Σ M_q)⁻¹. Slow noise resembles the sensitivities. V_q then exceeds M_q, and each
    unknown reduces the sum of squares by more than the variance of one sample. The assumed
    reduction is at most the fraction `_MOST_TAKEN`.
    """
    from scipy.linalg import block_diag

    p = len(fit.theta)
    D = inverse(fit.information)
    seen = []
    for residual, present, projected, response, normal in zip(
        fit.residuals, fit.present, fit.projected, fit.responses, fit.normals, strict=True
    ):
        slopes = np.concatenate([projected, response.slopes[:, :, p:]], axis=2)
        K = block_diag(D, normal.of_start)
        found = {}
        for quantity in np.flatnonzero(present.any(axis=0)).tolist():
            flags = present[:, quantity]
            S = slopes[:, quantity] * (flags / math.sqrt(fit.noise[quantity]))[:, None]
            M = S.T @ S
            fitted = float(np.sum(K * M))
            v = residual[:, quantity]
            variance = float(v @ v) / int(flags.sum())
            correlation = smooth_autocorrelation(v, flags, fitted)
            V = variance_of_sum(S, variance / fit.noise[quantity] * correlation)
            found[quantity] = (fitted, M, V, variance, correlation, int(flags.sum()))
        seen.append((K, found))
    total = np.sum([V[:p, :p] for _, found in seen for _, _, V, *_ in found.values()], axis=0)
    noises = []
    for K, found in seen:
        together = np.sum([V for _, _, V, *_ in found.values()], axis=0)
        together[:p, :p] = total
        within = K @ together @ K
        noise = {}
        for quantity, (fitted, M, V, variance, correlation, count) in found.items():
            taken = (2.0 * np.sum(K * V) - np.sum(within * M)) / count
            lost = 1.0 / (1.0 - min(taken, _MOST_TAKEN))
            noise[quantity] = Noise(fitted, lost, lost * variance, correlation)
        noises.append(noise)
    return noises


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


def smooth_autocorrelation(residual: np.ndarray, present: np.ndarray, fitted: float) -> np.ndarray:
    """Return the autocorrelation of the noise at lags 0, 1, ..., up to the last non-negligible lag.

    The noise is modeled as an autoregressive process of order 0 to 4, or as white noise plus a
    first-order process. The model with the least BIC (Bayesian information criterion) is chosen.

    The fit removes a part of the slow noise from the residuals. Therefore a positive sum a of the
    coefficients is increased by the first-order bias of its estimate, fitted (1 + 3 a) / N
    (Marriott and Pope, Biometrika 41 (1954) 390-402).

    residual: residuals of one quantity, (N,)
    present: whether each sample was measured, (N,)
    fitted: number of unknowns fitted to this quantity
    """
    from scipy.linalg import solve_toeplitz

    count = int(present.sum())
    seen = autocorrelation(residual, present)
    least = 0.0
    coefficients = np.zeros(0)
    for order in range(1, _MOST_ORDER + 1):
        found = solve_toeplitz(seen[:order], seen[1 : order + 1])
        left = max(1.0 - float(found @ seen[1 : order + 1]), 1e-12)
        criterion = count * math.log(left) + order * math.log(count)
        if criterion < least:
            least, coefficients = criterion, found
    criterion, pole, share = _white_and_slow(seen, count)
    if criterion < least:
        slow = _autocorrelation_of(np.array([_unbiased(pole, fitted, count)]))
        slow[1:] *= share
        return slow
    total = float(coefficients.sum())
    if total > 0.0:
        coefficients = coefficients * (_unbiased(total, fitted, count) / total)
    return _autocorrelation_of(coefficients)


def _unbiased(total: float, fitted: float, count: int) -> float:
    """Return the sum of autoregressive coefficients, corrected for bias and at most `_SLOWEST`."""
    return min(total + fitted * (1.0 + 3.0 * total) / count, _SLOWEST)


def _white_and_slow(seen: np.ndarray, count: int) -> tuple[float, float, float]:
    """Return (BIC, pole, share) of the best model of white noise plus a first-order process."""
    # The share is the fraction of the variance due to the first-order process. Pole and share are
    # chosen from fixed values by the largest Whittle likelihood.
    lags = np.arange(len(seen))
    decreasing = seen * (1.0 - lags / len(seen))
    power = np.maximum(2.0 * np.fft.rfft(decreasing, 2 * len(seen)).real - decreasing[0], 0.0)
    logarithms, inverses = _slow_spectra(len(power))
    levels = logarithms + np.log(inverses @ power / len(power))
    pole, share = np.unravel_index(int(levels.argmin()), levels.shape)
    criterion = count * float(levels[pole, share]) + 2.0 * math.log(count)
    return criterion, _POLES[pole], _SHARES[share]


@lru_cache(maxsize=4)
def _slow_spectra(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return properties of the spectra of white noise plus a first-order process."""
    # The first result contains the means of the logarithms of the spectra, (poles, shares). The
    # second contains the reciprocals of the spectra, (poles, shares, count).
    turns = np.cos(np.pi * np.arange(count) / (count - 1))
    poles = np.array(_POLES)[:, None, None]
    shares = np.array(_SHARES)[:, None]
    slow = (1.0 - poles**2) / (1.0 - 2.0 * poles * turns + poles**2)
    spectra = 1.0 - shares + shares * slow
    return np.log(spectra).mean(axis=-1), 1.0 / spectra


def _autocorrelation_of(coefficients: np.ndarray) -> np.ndarray:
    """Return the autocorrelation of an autoregressive process up to its last large lag."""
    # coefficients (order,)
    polynomial = np.fft.rfft(np.append(1.0, -coefficients), _LENGTH)
    correlation = np.fft.irfft(1.0 / np.abs(polynomial) ** 2, _LENGTH)[: _LENGTH // 2]
    correlation /= correlation[0]
    beyond = np.flatnonzero(np.abs(correlation) > _GONE)
    return np.asarray(correlation[: beyond[-1] + 1])


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


def explained(fit: Fit) -> np.ndarray:
    """Return the coefficient of determination of each measured quantity, (k,).

    The coefficient is 1 - (sum of squared residuals) / (sum of squared deviations of the quantity
    from its mean in each record).
    """
    parts = []
    for place in range(len(fit.noise)):
        measured, residuals = _samples(fit, place)
        left = sum(float(each @ each) for each in residuals)
        varied = sum(len(each) * float(each.var()) for each in measured if len(each))
        parts.append(1.0 - left / varied)
    return np.array(parts)


def unexplained(fit: Fit) -> np.ndarray:
    """Return a mask (k,), True for quantities whose simulated motion contradicts the records.

    For such a quantity, a constant would fit better than the simulation: the noise variance exceeds
    `_WORSE` times the variance of the measured samples.
    """
    motions = [np.concatenate(_samples(fit, place)[0]).var() for place in range(len(fit.noise))]
    return np.asarray(fit.noise > _WORSE * np.array(motions))


def _samples(fit: Fit, place: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the measured samples and the residuals of one quantity, as two lists."""
    # Each list has an array for each record, without missing samples.
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
