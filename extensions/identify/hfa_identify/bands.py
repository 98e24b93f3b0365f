"""How well records determine parameters: covariance, correlation, whiteness of residuals."""

from __future__ import annotations

import numpy as np

from hfa_identify.fit import Fit

#: Half-width of a band of 95 % in standard deviations.
BAND = 1.959964
#: Lags of the autocorrelation that a test of whiteness looks at.
LAGS = 25


def white_covariance(fit: Fit) -> np.ndarray:
    """(p, p) Cramér-Rao bound: the inverse of the information; it holds for white residuals.

    The noise variances are those of the residuals, enlarged by the unknowns that were fitted to
    them. A parameter that no sample depends on has the variance inf."""
    covariance = _enlarged(fit) * inverse(fit.information)
    unseen = np.diag(fit.information) <= 0.0
    covariance[unseen, unseen] = np.inf
    return covariance


def _enlarged(fit: Fit) -> float:
    """N / (N - unknowns): by how much fitted residuals are smaller than the noise."""
    samples = int(fit.samples.sum())
    unknowns = len(fit.theta) + sum(
        int(np.linalg.matrix_rank(each.A, tol=1e-6 * np.trace(each.A))) for each in fit.normals
    )
    return samples / max(samples - unknowns, 1)


def covariance(fit: Fit) -> np.ndarray:
    """(p, p) covariance of the parameters with the residuals' own autocorrelation:

        C = D [Σ_i Σ_j S_i' R⁻¹ R_vv(i - j) R⁻¹ S_j] D,   D = (Σ S_i' R⁻¹ S_i)⁻¹

    S: the sensitivities without what another start makes up for. R_vv is estimated up to the lag at
    which the autocorrelation is gone, with the weights of Parzen's window, and for white residuals
    C = D.

    Source: E. A. Morelli, V. Klein, Accuracy of aerodynamic model parameters estimated from flight
    test data, Journal of Guidance, Control, and Dynamics 20 (1997) 74-80.
    """
    D = inverse(fit.information)
    coloured = _enlarged(fit) * D @ sum(V for _, V, _ in weighted_scores(fit)) @ D
    # A band is no narrower than for white residuals: an estimate of R_vv is noisy itself.
    bound = white_covariance(fit)
    seen = np.isfinite(np.diag(bound))
    grown = np.ones(len(D))
    grown[seen] = np.sqrt(np.maximum(np.diag(coloured)[seen] / np.diag(bound)[seen], 1.0))
    return np.asarray(bound * grown[:, None] * grown)


#: Of a part of the records: information, covariance of the score, score.
Score = tuple[np.ndarray, np.ndarray, np.ndarray]


def weighted_scores(fit: Fit, halves: bool = False) -> list[Score]:
    """Of each record, or of both halves of each: Σ S' R⁻¹ S, the covariance of the score with the
    residuals' autocorrelation, and the score Σ S' R⁻¹ v."""
    parts = []
    for residual, present, projected in zip(fit.residuals, fit.present, fit.projected, strict=True):
        middle = len(residual) // 2
        rows = [slice(0, middle), slice(middle, None)] if halves else [slice(None)]
        weights = np.where(present, 1.0 / fit.noise, 0.0)
        for part in rows:
            M, V, g = (np.zeros((len(fit.theta),) * size) for size in (2, 2, 1))
            for quantity in range(residual.shape[1]):
                S = projected[:, quantity]
                weighted = S * weights[:, quantity, None]
                M += weighted[part].T @ S[part]
                g += weighted[part].T @ residual[part, quantity]
                V += _summed(weighted[part], residual[:, quantity], present[:, quantity])
            parts.append((M, V, g))
    return parts


def _summed(S: np.ndarray, residual: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Σ_i Σ_j S_i' r(i - j) S_j of one quantity of one record.

    S: of consecutive samples. residual, present: of the whole record, which r is estimated from."""
    correlation = autocorrelation(residual, present)
    variance = float(residual @ residual) / max(1, int(present.sum()))
    gone = _lag_of_white(correlation, int(present.sum()))
    total = variance * S.T @ S
    width = min(len(S) - 1, 3 * gone)
    for lag in range(1, width + 1):
        product = S[:-lag].T @ S[lag:]
        total += variance * correlation[lag] * _parzen(lag / (width + 1)) * (product + product.T)
    return total


def _lag_of_white(correlation: np.ndarray, count: int) -> int:
    """The first lag at which the autocorrelation is that of white noise; 0 where lag 1 is."""
    limit = 2.0 / np.sqrt(max(count, 1))
    beyond = np.flatnonzero(np.abs(correlation[1:]) < limit)
    return int(beyond[0]) if len(beyond) else len(correlation) - 1


def _parzen(share: float) -> float:
    """Parzen's window at a share of its half-width."""
    if share <= 0.5:
        return float(1.0 - 6.0 * share**2 * (1.0 - share))
    return float(2.0 * (1.0 - share) ** 3)


def autocorrelation(residual: np.ndarray, present: np.ndarray) -> np.ndarray:
    """The autocorrelation at lags 0 to N - 1; a missing sample counts as 0."""
    values = np.where(present, residual, 0.0)
    size = 2 ** int(np.ceil(np.log2(2 * len(values))))
    spectrum = np.fft.rfft(values, size)
    sums = np.fft.irfft(spectrum * spectrum.conj(), size)[: len(values)]
    return np.asarray(sums / max(sums[0], 1e-300))


def whiteness(residual: np.ndarray, present: np.ndarray) -> float:
    """The share of the first lags whose autocorrelation lies within 95 % of white noise's."""
    correlation = autocorrelation(residual, present)[1 : LAGS + 1]
    limit = BAND / np.sqrt(max(1, int(present.sum())))
    return float((np.abs(correlation) < limit).mean())


def correlations(covariance: np.ndarray) -> np.ndarray:
    """(p, p) correlation coefficients of estimates, 0 for those of infinite variance."""
    variances = np.diag(covariance)
    seen = np.isfinite(variances) & (variances > 0.0)
    deviations = np.sqrt(np.where(seen, variances, 1.0))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    return np.asarray(finite / deviations[:, None] / deviations)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """The inverse of a symmetric matrix with rows of different sizes."""
    diagonal = np.diag(matrix)
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix / size[:, None] / size
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) / size[:, None] / size)
