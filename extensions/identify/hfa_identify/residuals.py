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
    """Return the largest residual of a quantity, and the probability that chance causes it.

    number, place: indices of the record and of the quantity
    """
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
    """Return the indices of samples of a quantity that are far from the mean of their neighbors.

    Without any if there are more than a single one, or than one sample in 50.

    residuals: (N,)
    present: whether each sample was measured, (N,)
    """
    rows = np.flatnonzero(present)
    v = residuals[rows]
    distances = np.abs(v[1:-1] - 0.5 * (v[:-2] + v[2:]))
    robust_deviation = 1.4826 * np.median(distances)  # of normally distributed distances
    far = np.flatnonzero(distances > _ALONE * robust_deviation)
    # Such a sample also changes the distances of its neighbors, by half as much.
    far = far[distances[far] > 0.7 * distances.max(initial=0.0)]
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
    """Return the part of changes F (N, k, c) of a record that no unknown explains.

    number: index of the record
    """
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
    """Return changes of a quantity that follow the inputs, and that no unknown explains, (N, d).

    They are combinations of the delayed inputs, without those of which the unknowns explain all but
    the fraction `_CONFOUNDED`.

    number, place: indices of the record and of the quantity
    """
    inputs = _delayed_inputs(fit, number)
    changes = np.zeros((*fit.residuals[number].shape, inputs.shape[1]))
    changes[:, place] = inputs
    unexplained = _beyond_unknowns(fit, number, changes)
    size = np.sqrt(np.maximum(np.diag(unexplained.information), 1e-300))
    fractions, combinations = np.linalg.eigh(unexplained.information_beyond / size[:, None] / size)
    kept = combinations[:, fractions > _CONFOUNDED]
    return np.asarray(unexplained.beyond[:, place] / size @ kept)


def _delayed_inputs(fit: Fit, number: int) -> np.ndarray:
    """Return a constant and the inputs of a record at several delays, (N, c).

    Inputs that are constant in all records are left out.
    """
    records = fit.search.records
    varies = np.any([np.ptp(record.inputs, axis=0) > 0.0 for record in records], axis=0)
    time, moving = records[number].time, records[number].inputs[:, varies].T
    most_delays = len(time) // (_SAMPLES * max(len(moving), 1))
    count = max(1, min(_DELAYS, most_delays))
    delays = np.linspace(0.0, _SPAN * (time[-1] - time[0]), count)
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
    without = _squared_prediction_error(past, now)
    with_driven = _squared_prediction_error(np.hstack([past, driven[_PAST:]]), now)
    statistic = (without - with_driven) / d * degrees_of_freedom / max(with_driven, 1e-300)
    return float(fdtrc(d, degrees_of_freedom, statistic))


def _squared_prediction_error(known: np.ndarray, now: np.ndarray) -> float:
    """Return the sum of squared errors of a linear prediction of `now` (N,) from `known` (N, c)."""
    prediction = known @ np.linalg.lstsq(known, now)[0]
    return float(np.sum((now - prediction) ** 2))
