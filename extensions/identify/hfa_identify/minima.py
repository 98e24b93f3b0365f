"""Uniqueness of the identified aircraft: second minima, and parts of records that disagree."""

from __future__ import annotations

import numpy as np

from hfa_identify.bands import weighted_scores, white_covariance
from hfa_identify.fit import Fit, inverse
from hfa_identify.search import Search

#: Two minima are as likely as each other where L differs by less, and apart where an estimate
#: differs by more standard deviations.
_AS_LIKELY = 3.0
_APART = 5.0
#: Parts disagree where chance explains their difference less often than this.
_CHANCE = 1e-4


def other_minimum(search: Search, fit: Fit) -> Fit | None:
    """Another minimum that explains the records as well as the fit, or better, or None where a
    search from the opposite side of the estimates, 2 θ - θ_before, finds none."""
    if not fit.converged:
        return None
    opposite = 2.0 * fit.theta - search.begin
    first = search.responses.turbulent
    opposite[:first] = fit.theta[:first]
    ends = search.bounds
    opposite = np.clip(opposite, ends[:, 0], ends[:, 1])
    try:
        near = search.thin(opposite, fit.starts)
        thin = fit if first else search.thin(fit.theta, fit.starts)
        if not near.converged or not _is_apart(near, thin, first):
            return None
        other = search.whole(near.theta, near.starts)
    except FloatingPointError:
        return None
    as_likely = other.likelihood < fit.likelihood + _AS_LIKELY
    return other if other.converged and as_likely and _is_apart(other, fit, first) else None


def _is_apart(one: Fit, other: Fit, first: int) -> bool:
    """Return whether estimates of two fits of the same samples differ by many standard deviations,
    from the unknown with the number `first` on."""
    deviations = np.sqrt(np.diag(white_covariance(other)))
    return bool((np.abs(one.theta - other.theta) > _APART * deviations)[first:].any())


def parts_disagree(search: Search, fit: Fit) -> str:
    """The unknown on which parts of the records disagree most, "" where they agree within their
    bands, corrected for coloured residuals.

    Parts are the records, or the halves of one record. With scores g of a part and of the others,
    informations M, M' and the covariances V, V' of the scores, the difference

        g - M (M + M')⁻¹ (g + g')

    has the covariance T V T' + (I - T) V' (I - T)', with T = M' (M + M')⁻¹.
    """
    from scipy.stats import chi2

    # Turbulence and noise of sensors are taken as known.
    first = search.responses.turbulent
    parts = [
        (M[first:, first:], V[first:, first:], g[first:])
        for M, V, g in weighted_scores(fit, halves=len(search.records) == 1)
    ]
    p = len(fit.theta) - first
    tested = max(1, len(parts))
    worst = ""
    least = _CHANCE / tested
    M_all, V_all, g_all = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
    for M, V, g in parts[: 1 if len(parts) == 2 else None]:
        whole = inverse(M_all)
        T = (M_all - M) @ whole
        rest = np.eye(p) - T
        difference = g - M @ whole @ g_all
        spread = T @ V @ T.T + rest @ (V_all - V) @ rest.T
        size = np.sqrt(np.maximum(np.diag(spread), 1e-300))
        values, axes = np.linalg.eigh(spread / size[:, None] / size)
        seen = values > 1e-6 * values.max()
        along = axes[:, seen].T @ (difference / size)
        chance = float(chi2.sf(np.sum(along**2 / values[seen]), int(seen.sum())))
        if chance < least:
            least = chance
            worst = search.responses.free[first + int(np.argmax(np.abs(difference) / size))]
    return worst
