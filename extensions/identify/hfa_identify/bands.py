"""Accuracy of identified parameters: covariance, correlation, whiteness of residuals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hfa_identify.fit import Fit, inverse

#: Half-width of a band of 95 % in standard deviations.
BAND = 1.959964
#: Lags of the autocorrelation that a test of whiteness looks at.
LAGS = 25
#: Values of which a smaller share of lags is white are colored.
WHITE = 0.8
#: A quantity is not explained where its residuals vary by so much more than itself.
_WORSE = 1.5
#: Highest order of an autoregressive process that residuals are taken to be.
_MOST_ORDER = 4
#: Largest sum of its coefficients: the noise has a mean.
_SLOWEST = 0.995
#: Poles of slow noise beside white noise, and parts of the variance that it may have.
_POLES = (0.7, 0.8, 0.9, 0.94, 0.96, 0.97, 0.98, 0.985, 0.99, 0.993)
_SHARES = (0.02, 0.04, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
#: Largest part of the variance of the noise that the unknowns are taken to have taken.
_MOST_TAKEN = 0.5
#: Lags at which its autocorrelation is computed, and below which value it is gone.
_LENGTH = 8192
_GONE = 1e-3


def white_covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) Cramér-Rao bound, the inverse of the information, for white residuals.

    The noise variances are those of the residuals, enlarged by the unknowns that were fitted to
    them. The variance of a parameter is inf if no sample depends on it, or if its information is
    lost in rounding."""
    covariance = _enlarged(fit) * inverse(fit.information)
    unseen = (np.diag(fit.information) <= 0.0) | (np.diag(covariance) < 0.0)
    covariance[unseen, unseen] = np.inf
    return covariance


def _enlarged(fit: Fit) -> float:
    """Return N / (N - unknowns), the ratio of the noise variance to that of fitted residuals."""
    samples = int(fit.samples.sum())
    return samples / max(samples - _unknowns(fit), 1)


def _unknowns(fit: Fit) -> int:
    """Return the number of parameters and of initial states that the records determine."""
    starts = [np.linalg.matrix_rank(each.A, tol=1e-6 * np.trace(each.A)) for each in fit.normals]
    return len(fit.theta) + int(sum(starts))


def covariance(fit: Fit) -> np.ndarray:
    """Return the (p, p) covariance of the parameters with the residuals' own autocorrelation.

        C = D [Σ_i Σ_j S_i' R⁻¹ R_vv(i - j) R⁻¹ S_j] D,   D = (Σ S_i' R⁻¹ S_i)⁻¹

    S are the sensitivities without the part that another initial condition explains. R_vv is the
    autocovariance of the noise (`noise_of`). For white residuals C = D.

    Source: E. A. Morelli, V. Klein, Accuracy of aerodynamic model parameters estimated from flight
    test data, Journal of Guidance, Control, and Dynamics 20 (1997) 74-80.
    """
    D = inverse(fit.information)
    coloured = D @ sum(V for _, V, _ in weighted_scores(fit)) @ D
    # A band is no narrower than for white residuals: an estimate of R_vv is noisy itself.
    bound = white_covariance(fit)
    seen = np.isfinite(np.diag(bound))
    grown = np.ones(len(D))
    grown[seen] = np.sqrt(np.maximum(np.diag(coloured)[seen] / np.diag(bound)[seen], 1.0))
    return np.asarray(bound * grown[:, None] * grown)


#: Of a part of the records: information, covariance of the score, score.
Score = tuple[np.ndarray, np.ndarray, np.ndarray]


def weighted_scores(fit: Fit, halves: bool = False) -> list[Score]:
    """Return the information, the covariance of the score, and the score of each record.

    They are Σ S' R⁻¹ S, the covariance with the noise's autocovariance, and Σ S' R⁻¹ v.

    halves: whether each record is divided into two halves, with separate results
    """
    parts = []
    for residual, present, projected, noise in zip(
        fit.residuals, fit.present, fit.projected, noise_of(fit), strict=True
    ):
        middle = len(residual) // 2
        rows = [slice(0, middle), slice(middle, None)] if halves else [slice(None)]
        weights = np.where(present, 1.0 / fit.noise, 0.0)
        for part in rows:
            M, V, g = (np.zeros((len(fit.theta),) * size) for size in (2, 2, 1))
            for quantity, each in noise.items():
                S = projected[part, quantity]
                weighted = S * weights[part, quantity, None]
                M += weighted.T @ S
                g += weighted.T @ residual[part, quantity]
                V += _summed(weighted, each.variance * each.correlation)
            parts.append((M, V, g))
    return parts


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one quantity of a record.

    fitted: number of unknowns that its samples determine.
    lost: ratio of its variance to that of the residuals, from which the unknowns take a part.
    variance: its variance.
    correlation: its autocorrelation at lags 0, 1, ..., until it is gone.
    """

    fitted: float
    lost: float
    variance: float
    correlation: np.ndarray


def noise_of(fit: Fit) -> list[dict[int, Noise]]:
    """Return for each record the place of a measured quantity -> its noise.

    With the projection P of the noise onto the sensitivities S of all unknowns, the residuals are
    v = (I - P) e, so that the weighted sum of squares of a quantity q is

        Σ v² / r = N - 2 tr(K V_q) + tr(K V K M_q)

    M_q = S' S / r and V_q = S' R_vv S / r² of the quantity, V = Σ V_q, and K = (Σ M_q)⁻¹. Slow
    noise resembles the sensitivities, so that V_q exceeds M_q and the residuals lose more than one
    sample's variance to an unknown.
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
            V = _summed(S, variance / fit.noise[quantity] * correlation)
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


def _summed(S: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return Σ_i Σ_j S_i' r(i - j) S_j of one quantity.

    S: sensitivities of consecutive samples
    covariance: r at lags 0, 1, ..., 0 beyond
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
    """Return the autocorrelation of the noise at lags 0, 1, ..., up to the lag at which it is gone.

    It is that of an autoregressive process of order 0 to 4, or of white noise together with slow
    noise of order 1. The process of least BIC is chosen.

    fitted: number of unknowns that were fitted to this quantity. They take a part of the slow noise
        out of its residuals. The sum a of the coefficients is corrected by the first-order bias of
        its estimate, fitted (1 + 3 a) / N (Marriott and Pope, Biometrika 41 (1954) 390-402).
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
    """Return the sum of the coefficients of a process, corrected for the bias of its estimate."""
    return min(total + fitted * (1.0 + 3.0 * total) / count, _SLOWEST)


def _white_and_slow(seen: np.ndarray, count: int) -> tuple[float, float, float]:
    """Return BIC, pole and share of the variance of the slow noise that explains an autocorrelation
    best.

    The total noise is the sum of white and slow noise. The criterion is the Whittle likelihood.
    """
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
    """Return means of logarithms and inverses of the spectra of white noise with slow noise.

    The means are (poles, shares), the inverses (poles, shares, count).
    """
    turns = np.cos(np.pi * np.arange(count) / (count - 1))
    poles = np.array(_POLES)[:, None, None]
    shares = np.array(_SHARES)[:, None]
    slow = (1.0 - poles**2) / (1.0 - 2.0 * poles * turns + poles**2)
    spectra = 1.0 - shares + shares * slow
    return np.log(spectra).mean(axis=-1), 1.0 / spectra


def _autocorrelation_of(coefficients: np.ndarray) -> np.ndarray:
    """Return the autocorrelation of an autoregressive process, up to the lag at which it is
    gone."""
    lags = np.arange(1, len(coefficients) + 1)
    turns = np.exp(-2j * np.pi * np.outer(np.arange(_LENGTH) / _LENGTH, lags))
    spectrum = 1.0 / np.abs(1.0 - turns @ coefficients) ** 2
    correlation = np.fft.ifft(spectrum).real[: _LENGTH // 2]
    correlation /= correlation[0]
    beyond = np.flatnonzero(np.abs(correlation) > _GONE)
    return np.asarray(correlation[: beyond[-1] + 1])


def autocorrelation(residual: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the autocorrelation at lags 0 to N - 1 of the samples that are present, with equal
    weights of all pairs."""
    values = np.where(present, residual, 0.0)
    pairs = np.maximum(np.round(sums_of_products(present.astype(float))), 1.0)
    means = sums_of_products(values) / pairs
    return np.asarray(means / max(means[0], 1e-300))


def sums_of_products(values: np.ndarray) -> np.ndarray:
    """Return Σ_i v_i v_(i + lag) of N values for lags 0 to N - 1."""
    size = 2 ** int(np.ceil(np.log2(2 * len(values))))
    spectrum = np.fft.rfft(values, size)
    return np.asarray(np.fft.irfft(spectrum * spectrum.conj(), size)[: len(values)])


def whiteness(residual: np.ndarray, present: np.ndarray) -> float:
    """Return the share of the first lags whose autocorrelation lies within 95 % of white
    noise's."""
    correlation = autocorrelation(residual, present)[1 : LAGS + 1]
    limit = BAND / np.sqrt(max(1, int(present.sum())))
    return float((np.abs(correlation) < limit).mean())


def explained(fit: Fit) -> np.ndarray:
    """Return the (k,) coefficients of determination: 1 - (sum of squared residuals) / (sum of
    squares of the measured quantity about its mean)."""
    parts = []
    for place in range(len(fit.noise)):
        measured, residuals = _samples(fit, place)
        left = sum(float(each @ each) for each in residuals)
        varied = sum(len(each) * float(each.var()) for each in measured if len(each))
        parts.append(1.0 - left / varied)
    return np.array(parts)


def unexplained(fit: Fit) -> np.ndarray:
    """Return flags of quantities whose simulated motion contradicts the measured one, (k,).

    Their residuals would be smaller without the motion. Large noise alone sets no flag.
    """
    motions = [np.concatenate(_samples(fit, place)[0]).var() for place in range(len(fit.noise))]
    return np.asarray(fit.noise > _WORSE * np.array(motions))


def _samples(fit: Fit, place: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the measured samples of a quantity and their residuals for each record, (N,) each.

    place: of the quantity"""
    measured, residuals = [], []
    for simulated, residual, present in zip(fit.simulated, fit.residuals, fit.present, strict=True):
        seen = present[:, place]
        residuals.append(residual[seen, place])
        measured.append(simulated.y[seen, place] + residual[seen, place])
    return measured, residuals


def correlations(covariance: np.ndarray) -> np.ndarray:
    """Return the (p, p) correlation coefficients of estimates, 0 for an estimate of infinite
    variance."""
    variances = np.diag(covariance)
    seen = np.isfinite(variances) & (variances > 0.0)
    deviations = np.sqrt(np.where(seen, variances, 1.0))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    return np.asarray(finite / deviations[:, None] / deviations)
