"""Test of the residuals: which quantity of a record differs from the model, when and how far.

The residuals of a model that explains a record are noise, which depends on no input. Residuals that
follow the inputs are motion that the model lacks, or an error of a column. The test does not decide
between the two. It assumes that no controller moves the inputs in answer to gusts or noise.

Sources: L. Ljung, *System Identification: Theory for the User*, 2nd ed., 1999, chapter 16.6; C. W.
J. Granger, Econometrica 37 (1969) 424-438.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_identify.fit import Fit
from hfa_support.reporting.results import Result

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
#: it stands alone.
_ALONE = 8.0


@dataclass(frozen=True)
class Misfit(Result):
    """A difference between a record and the model that is not noise.

    record: name of the record.
    quantity: the measured quantity.
    time: time of the largest difference, s.
    difference: recorded minus simulated value at this time, without noise.
    unit: unit of the difference.
    samples: number of samples that stand alone, 0 if the difference follows the inputs.
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
    - A few samples stand alone: each is far from the mean of its neighbors.
    - Otherwise, the residuals follow the inputs.
    - Otherwise, the residuals are noise, and nothing is returned.
    """
    measured = [
        (number, int(place))
        for number, present in enumerate(fit.present)
        for place in np.flatnonzero(present.any(axis=0))
    ]
    candidates = [_candidate(fit, number, place) for number, place in measured]
    clear = [each for each in candidates if each.chance < _CHANCE / len(measured)]
    return [each.misfit for each in sorted(clear, key=lambda each: each.chance)]


class _Candidate(NamedTuple):
    """The largest residual of a quantity, and the probability that chance causes the residuals."""

    chance: float
    misfit: Misfit


def _candidate(fit: Fit, number: int, place: int) -> _Candidate:
    """Return the largest residual of a quantity, by the indices of the record and the quantity."""
    record, name = fit.search.records[number], fit.search.responses.measured[place]
    residuals, present = fit.residuals[number][:, place], fit.present[number][:, place]
    alone = _standing_alone(residuals, present)
    if len(alone):
        chance, largest, difference = 0.0, int(alone[0]), residuals
    else:
        driven = _driven(fit, number, place)
        chance = _granger_p_value(residuals[present], driven[present])
        difference = driven @ np.linalg.lstsq(driven[present], residuals[present])[0]
        largest = int(np.abs(difference * present).argmax())
    misfit = Misfit(
        record.name,
        name,
        float(record.time[largest]),
        float(difference[largest]),
        fit.search.responses.model.unit(name),
        len(alone),
    )
    return _Candidate(chance, misfit)


def _standing_alone(residuals: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the indices of samples of a quantity that are far from the mean of their neighbors."""
    # At most one sample in 50, or a single one, stands alone.
    # residuals, present (N,)
    rows = np.flatnonzero(present)
    v = residuals[rows]
    apart = np.abs(v[1:-1] - 0.5 * (v[:-2] + v[2:]))
    far = np.flatnonzero(apart > _ALONE * 1.4826 * np.median(apart))
    # Such a sample also changes the distances of its neighbors, by half as much.
    far = far[apart[far] > 0.7 * apart.max(initial=0.0)]
    return rows[far + 1] if len(far) <= max(1, len(v) // 50) else rows[:0]


class _Beyond(NamedTuple):
    """Changes F of the quantities of a record that no change of the unknowns explains.

    beyond: part F⊥ that parameters and initial state do not explain, (N, k, c)
    information: Σ F' R⁻¹ F with the variances R of the residuals, (c, c)
    information_beyond: Σ F⊥' R⁻¹ F⊥, (c, c)
    """

    beyond: np.ndarray
    information: np.ndarray
    information_beyond: np.ndarray


def _beyond_unknowns(fit: Fit, number: int, F: np.ndarray) -> _Beyond:
    """Return the part of changes F (N, k, c) of a record that no unknown explains."""
    beyond_start, projected = fit.beyond_start(number, F), fit.projected[number]
    weighted = F * fit.weights(number)[:, :, None]
    by_parameters = _products(projected, weighted)
    change = np.linalg.pinv(fit.information, rcond=1e-13, hermitian=True) @ by_parameters
    return _Beyond(
        beyond_start - projected @ change,
        _products(F, weighted),
        _products(beyond_start, weighted) - change.T @ by_parameters,
    )


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the sums over samples and quantities of products (c, d) of (N, k, c) and (N, k, d)."""
    return np.asarray(np.tensordot(one, other, ((0, 1), (0, 1))))


def _driven(fit: Fit, number: int, place: int) -> np.ndarray:
    """Return changes of a quantity that follow the inputs, and that no unknown explains, (N, d)."""
    inputs = _delayed_inputs(fit, number)
    changes = np.zeros((*fit.residuals[number].shape, inputs.shape[1]))
    changes[:, place] = inputs
    found = _beyond_unknowns(fit, number, changes)
    size = np.sqrt(np.maximum(np.diag(found.information), 1e-300))
    parts, axes = np.linalg.eigh(found.information_beyond / size[:, None] / size)
    return np.asarray(found.beyond[:, place] / size @ axes[:, parts > _CONFOUNDED])


def _delayed_inputs(fit: Fit, number: int) -> np.ndarray:
    """Return a constant and the inputs of a record at several delays, (N, c).

    Inputs that are constant in all records are left out.
    """
    records = fit.search.records
    varies = np.any([np.ptp(record.inputs, axis=0) > 0.0 for record in records], axis=0)
    time, moving = records[number].time, records[number].inputs[:, varies].T
    most = len(time) // (_SAMPLES * max(len(moving), 1))
    delays = np.linspace(0.0, _SPAN * (time[-1] - time[0]), max(1, min(_DELAYS, most)))
    late = [np.interp(time - delay, time, u - u[0]) for u in moving for delay in delays]
    return np.column_stack([np.ones(len(time)), *late])


def _granger_p_value(residuals: np.ndarray, driven: np.ndarray) -> float:
    """Return the probability that noise seems to depend on the inputs as much as the residuals.

    Changes that follow the inputs do not help to predict noise from its own past. The sum of
    squared prediction errors without them, less that with them, is then F-distributed relative to
    the latter.

    residuals: (N,)
    driven: changes that follow the inputs, (N, d)
    """
    from scipy.special import fdtrc

    N, d = driven.shape
    past = np.column_stack([residuals[_PAST - lag : N - lag] for lag in range(1, _PAST + 1)])
    now = residuals[_PAST:]
    degrees_of_freedom = len(now) - _PAST - d
    if d == 0 or degrees_of_freedom < 1:
        return 1.0
    without, with_driven = (
        float(np.sum((now - known @ np.linalg.lstsq(known, now)[0]) ** 2))
        for known in (past, np.hstack([past, driven[_PAST:]]))
    )
    statistic = (without - with_driven) / d * degrees_of_freedom / max(with_driven, 1e-300)
    return float(fdtrc(d, degrees_of_freedom, statistic))
