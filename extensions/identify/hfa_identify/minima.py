"""Uniqueness of the estimates: second minima, and comparison of parts of the records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from hfa_identify.bands import weighted_scores, white_covariance
from hfa_identify.fit import Fit, inverse
from hfa_identify.search import Search

#: Two minima are equally likely if L differs by less than AS_LIKELY. They are distinct if an
#: estimate differs by more than _APART standard deviations.
AS_LIKELY = 3.0
_APART = 5.0
#: A second minimum is searched at these multiples of an estimate, if the difference there is below
#: the fraction _FALL of its maximum on the way. At most _TRIED searches are made.
_MULTIPLES = np.linspace(-5.0, 7.0, 49)
_FALL = 0.5
_TRIED = 2
#: Parts of records disagree if chance causes their difference with a smaller probability.
_CHANCE = 1e-4


def other_minimum(search: Search, fit: Fit) -> Fit | None:
    """Return another minimum of L that explains the records as well as this fit, or None.

    The result is None if the fit did not converge, or if no search far from the fit finds another
    minimum.
    """
    if not fit.converged:
        return None
    others = (_searched(search, fit, *begin) for begin in _far_begins(search, fit))
    return next((other for other in others if other is not None), None)


def _far_begins(search: Search, fit: Fit) -> Iterator[tuple[np.ndarray, Sequence[np.ndarray]]]:
    """Yield (unknowns, initial states) from which to search for another minimum."""
    with suppress(FloatingPointError):
        near = search.thin(_opposite(search, fit), fit.starts)
        # The second minimum must be distinct from the first, which one step from the fit finds.
        thin = search.thin(fit.theta, fit.starts, 1)
        if near.converged and _is_apart(near, thin):
            yield near.theta, near.starts
    for theta in _far_values(search, fit):
        yield theta, fit.starts


def _opposite(search: Search, fit: Fit) -> np.ndarray:
    """Return the point 2 θ - θ₀ beyond the estimates θ, clipped to the limits, (p,)."""
    # θ₀ are the values at the start of the search.
    opposite = 2.0 * fit.theta - search.begin
    ends = search.bounds
    return np.clip(opposite, ends[:, 0], ends[:, 1])


def _far_values(search: Search, fit: Fit) -> list[np.ndarray]:
    """Return values of the unknowns (p,) near which a second minimum may lie."""
    # At most `_TRIED` values within the limits are returned, the most promising first. Each differs
    # from the fit in one parameter. The new value of this parameter is one of:
    # - a value for which the state derivatives and measured quantities along the simulation are
    #   similar
    # - without such a value, the negative of the estimate, if L there rises by less than the
    #   fraction `_FALL` of its rise at 0
    least = search.level(fit.theta, fit.starts)
    flown = [
        search.responses.simulated(record, start, fit.theta)
        for record, start in zip(search.records, fit.starts, strict=True)
    ]
    found: list[tuple[float, np.ndarray]] = []
    for place, name in enumerate(search.responses.free):
        value = fit.theta[place]
        if name not in search.responses.model.parameters or value == 0.0:
            continue
        values = _MULTIPLES * value
        changes = [search.responses.differences(each, place, values) for each in flown]
        others = list(_alike(_MULTIPLES, np.sum(changes, axis=0)))
        if not others:
            ends = [search.level(_with(fit, place, each), fit.starts) for each in (-value, 0.0)]
            if ends[0] - least < _FALL * (ends[1] - least):
                others = [(-1.0, 1.0)]
        found += [(part, _with(fit, place, multiple * value)) for multiple, part in others]
    low, high = search.bounds.T
    within = [each for each in found if ((low <= each[1]) & (each[1] <= high)).all()]
    return [theta for _, theta in sorted(within, key=lambda each: each[0])[:_TRIED]]


def _with(fit: Fit, place: int, value: float) -> np.ndarray:
    """Return the estimates, (p,), with the estimate at one index replaced."""
    theta = fit.theta.copy()
    theta[place] = value
    return theta


def _alike(multiples: np.ndarray, different: np.ndarray) -> Iterator[tuple[float, float]]:
    """Yield (multiple, ratio) for each second minimum of the change of the equations."""
    # The first minimum is the one nearest to the multiple 1. The ratio is the value at the second
    # minimum divided by the largest value between both. Only minima with a ratio below `_FALL` are
    # yielded.
    middle = different[1:-1]
    lowest = 1 + np.flatnonzero((middle <= different[:-2]) & (middle < different[2:]))
    found = int(np.argmin(np.abs(multiples - 1.0)))
    for at in lowest[lowest != found]:
        larger = different[min(at, found) : max(at, found)].max()
        if different[at] < _FALL * larger:
            yield float(multiples[at]), float(different[at] / larger)


def _searched(
    search: Search, fit: Fit, theta: np.ndarray, starts: Sequence[np.ndarray]
) -> Fit | None:
    """Return the fit found from distant unknowns, or None in these cases:"""
    # - The search diverges or does not converge.
    # - L exceeds that of the original fit by `AS_LIKELY` or more.
    # - Both fits agree.
    # theta (p,), starts (n,)
    try:
        other = search.whole(theta, starts)
    except FloatingPointError:
        return None
    as_likely = other.likelihood < fit.likelihood + AS_LIKELY
    return other if other.converged and as_likely and _is_apart(other, fit) else None


def _is_apart(one: Fit, other: Fit) -> bool:
    """Return whether two fits differ by more than `_APART` deviations in an unknown."""
    deviations = np.sqrt(np.diag(white_covariance(other)))
    return bool((np.abs(one.theta - other.theta) > _APART * deviations).any())


def parts_disagree(search: Search, fit: Fit) -> str:
    """Return the unknown on which parts of the records disagree most beyond their bands, or "".

    The parts are the records, or the halves of a single record. The bands are corrected for colored
    residuals. Let g be the score of a part, M its information and V the covariance of its score,
    and g', M', V' those of all other parts. The difference

        g - M (M + M')⁻¹ (g + g')

    has the covariance T V T' + (I - T) V' (I - T)', with T = M' (M + M')⁻¹.
    """
    from scipy.special import chdtrc

    parts = weighted_scores(fit, halves=len(search.records) == 1)
    p = len(fit.theta)
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
        chance = float(chdtrc(int(seen.sum()), np.sum(along**2 / values[seen])))
        if chance < least:
            least = chance
            worst = search.responses.free[int(np.argmax(np.abs(difference) / size))]
    return worst
