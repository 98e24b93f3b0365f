"""Search for faults of records that explain large residuals.

The faults are outliers, bias, scale error and delay of a sensor, a wrong sign or unit of a column,
and exchanged columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.bands import BAND, covariance, unexplained, white_covariance
from hfa_identify.column_errors import ColumnError
from hfa_identify.fit import Fit
from hfa_identify.records import Record, columns_of, is_near_limits, with_columns
from hfa_identify.search import Search
from hfa_identify.sensors import sensor_errors

#: Distance of an outlier from the neighboring residuals, in robust standard deviations.
_OFF = 8.0
#: A column error is examined if its estimate exceeds _SEEN standard deviations. It is reported if
#: the probability of an estimate of this size is less than _CHANCE for all errors of a record
#: together.
_SEEN = 2.5
_CHANCE = 0.005
#: A column error matters if it shifts an estimate by the fraction _MATTERS of its band for white
#: residuals, or if its estimate exceeds _OBVIOUS standard deviations.
_MATTERS = 0.3
_OBVIOUS = 8.0
#: Largest number of column errors, and of corrections of columns, that are examined.
_TRIED = 3
#: Two faults explain the records equally well if L per sample differs by less.
_ALIKE = 0.02
#: Two column errors explain the records equally well if 2 L differs by less than this, times the
#: factor by which colored residuals increase the variance.
_LIKELIER = 6.0
#: Whether stepwise inputs were assumed -> advice if the other interpolation fits better.
_OF_STEPS = {
    False: "inputs are constant between samples; add --inputs steps",
    True: "inputs are linear between samples; leave out --inputs steps",
}
_KNOT = 0.514444  # m/s
_FOOT = 0.3048  # m
_POUND = 4.448222  # N
#: Unit -> factor by which a column may have been multiplied -> description of the fault.
_UNITS = {
    "rad": {
        math.degrees(1.0): "is in degrees, read as radians",
        math.radians(1.0): "is in radians, read as degrees",
    },
    "rad/s": {
        math.degrees(1.0): "is in deg/s, read as rad/s",
        math.radians(1.0): "is in rad/s, read as deg/s",
    },
    "m": {1.0 / _FOOT: "is in ft"},
    "ft": {_FOOT: "is in m"},
    "m/s": {1.0 / _FOOT: "is in ft/s", 1.0 / _KNOT: "is in knots", 3.6: "is in km/h"},
    "ft/s": {_FOOT: "is in m/s", _FOOT / _KNOT: "is in knots", 3.6 * _FOOT: "is in km/h"},
    "1": {
        9.80665: "is in m/s^2, read as g",
        100.0: "is in percent",
        0.01: "is a fraction, read as percent",
    },
    "m/s^2": {1.0 / 9.80665: "is in g, read as m/s^2"},
    "s": {1.0 / 60.0: "is in min"},
    "N": {1.0 / _POUND: "is in lbf", 0.001: "is in kN"},
    "lbf": {_POUND: "is in N"},
}
#: Gauss-Newton steps and windows in which the correction of each fault is tried, and steps in which
#: the most likely ones must converge.
_TRIAL = 5
_WINDOWS = 24
_STEPS = 10
#: Steps and windows of a first trial, and number of faults that are tried further.
_FIRST_TRIAL = 2
_FIRST_WINDOWS = 12
_GO_ON = 8
#: A change of a parameter is suspicious beyond a factor of 8, or if the sign changes. Factors up to
#: 2 are usual.
_USUAL_CHANGE = math.log(2.0)
_LARGE_CHANGE = math.log(8.0) - _USUAL_CHANGE
_CHANGED_SIGN = math.log(100.0)


def faults_of(
    search: Search,
    fit: Fit,
    errors: Mapping[str, ColumnError],
    given: Sequence[str],
    progress: Callable[[float, float], None] | None,
) -> Iterator[str]:
    """Yield sentences on faults of the records, or wrong given parameters, that explain residuals.

    There are four cases:
    - A fault of a column explains the residuals: one sentence on this fault.
    - Otherwise with outliers: a sentence for each record and quantity with outliers.
    - Otherwise a column error or given parameter explains the residuals: one sentence on it.
    - Otherwise no sentence.

    errors: name of a column error -> its estimate by one Newton step from 0
    given: names of the parameters with given values
    """
    spikes = list(outliers(search, fit))
    # A column in a wrong unit leaves residuals that look like outliers. A fault of a column must
    # explain more than another value of a given parameter does.
    freed = {} if spikes else dict(_clear(search, fit, given, len(errors) + len(given)))
    best = min(freed.values(), key=lambda each: each.fit.likelihood, default=None)
    wider = (best.search, best.fit) if best else (search, fit)
    column = fault_of_columns(*wider, errors, progress)
    if spikes and not column:
        yield from spikes
        return
    sensor = "" if column else sensor_fault(search, fit, errors, freed)
    if column or sensor:
        yield column or sensor


def outliers(search: Search, fit: Fit) -> Iterator[str]:
    """Yield a sentence for each record and quantity with outliers.

    An outlier is a sample whose residual is far from the mean of the residuals before and after it.
    At most one sample in 50, or a single one, can be an outlier. Quantities whose motion the model
    contradicts are not searched.
    """
    explained = ~unexplained(fit)
    for place in np.flatnonzero(explained):
        name = search.responses.measured[place]
        for record, residual, present in zip(
            search.records, fit.residuals, fit.present, strict=True
        ):
            values = residual[present[:, place], place]
            times = record.time[present[:, place]]
            beside = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
            far = np.flatnonzero(beside > _OFF * 1.4826 * np.median(beside))
            # An outlier also changes the differences of its neighbors, by half as much.
            far = far[beside[far] > 0.7 * beside.max()] if len(far) else far
            if 0 < len(far) <= max(1, len(values) // 50):
                count = f"{len(far)} outliers" if len(far) > 1 else "an outlier"
                yield f"{count} of {name} at {times[far[0] + 1]:g} s; leave such samples empty"


# Errors of columns, found by a test of the score.


@dataclass(frozen=True, eq=False)
class _Freed:
    """Fit with one additional unknown: a given parameter or an error of a column."""

    search: Search
    fit: Fit
    value: float  # estimate of the additional unknown
    widened: float  # ratio of the variance of this estimate to its variance for white residuals


def sensor_fault(
    search: Search, fit: Fit, errors: Mapping[str, ColumnError], freed: Mapping[str, _Freed]
) -> str:
    """Return a sentence on the column error or given parameter that explains residuals best, or "".

    A column error is considered in two cases:
    - The estimate exceeds `_OBVIOUS` standard deviations.
    - The estimate exceeds `_SEEN` standard deviations and shifts a parameter by more than
      `_MATTERS` of the parameter's band.

    The sentence also names an alternative that explains the residuals equally well. If a delay is
    considered and the other interpolation of the inputs fits better, the sentence recommends this
    interpolation.

    errors: name of a column error -> its estimate by one Newton step from 0
    freed: given parameter -> fit in which it is an unknown, if the records contradict its value
    """
    suspects = [
        name
        for name, each in errors.items()
        if each.clear > _OBVIOUS or (each.clear > _SEEN and each.shift > _MATTERS)
    ]
    suspects.sort(key=lambda name: -errors[name].clear)
    found = dict(freed)
    for name, each in _clear(search, fit, suspects[:_TRIED], len(errors)):
        if _is_plausible(search, name, each.value):
            found[name] = each
    if not found:
        return ""
    names = sorted(found, key=lambda name: found[name].fit.likelihood)
    best = found[names[0]].fit.likelihood
    if any(name.startswith("delay") for name in names):
        other = _other_inputs(search, fit)
        if other.likelihood < best:
            return _OF_STEPS[search.records[0].has_steps]
    alike = [
        name
        for name in sorted(names[1:], key=lambda name: name not in freed)
        if 2.0 * (found[name].fit.likelihood - best) < _LIKELIER * found[name].widened
    ]
    value = found[names[0]].value
    if names[0] in freed:
        stated = f"{names[0]} = {value:.3g} instead of the given value"
    else:
        stated = _with_value(search, names[0], value)
    if alike:
        other_name = f"another value of {alike[0]}" if alike[0] in freed else alike[0]
        return f"{stated}, or {other_name}, explains the residuals"
    return f"{stated} explains the residuals; add it to --free"


def _other_inputs(search: Search, fit: Fit) -> Fit:
    """Return the fit with inputs in steps if they were linear between samples, or vice versa."""
    # The original fit is returned if the search diverges or does not converge.
    records = [replace(record, has_steps=not record.has_steps) for record in search.records]
    try:
        found = Search(search.responses, records, search.held).whole(fit.theta, fit.starts)
    except FloatingPointError:
        return fit
    return found if found.converged else fit


def _with_value(search: Search, name: str, value: float) -> str:
    """Return a column error with its value and unit as text, such as "bias_alpha of 0.02 rad"."""
    model = search.responses.calm.model
    unit = sensor_errors(model, (name.partition("_")[2],))[name].signal(model).unit
    return f"{name} of {value:.3g}" + (f" {unit}" if unit not in ("", "1") else "")


def _is_plausible(search: Search, name: str, value: float) -> bool:
    """Return whether an error of a column may be caused by a sensor."""
    # The following errors may be caused by a sensor:
    # - a bias smaller than the largest magnitude of the column
    # - a scale error between -0.5 and 1
    # - any delay
    # A greater error indicates motion that the model lacks.
    error = sensor_errors(search.responses.model, (name.partition("_")[2],))[name]
    if error.kind == "scale":
        return -0.5 < value < 1.0
    if error.kind == "delay":
        return True
    model = search.responses.calm.model
    tables = [columns_of(model, record) for record in search.records]
    columns = [table[error.column] for table in tables if error.column in table]
    return abs(value) < max(float(np.nanmax(np.abs(column))) for column in columns)


def _clear(
    search: Search, fit: Fit, names: Sequence[str], tests: int
) -> Iterator[tuple[str, _Freed]]:
    """Yield (name, fit) of each additional unknown with a significant estimate."""
    # The estimate differs from the initial value of the unknown. The probability that chance causes
    # such a difference in any of `tests` unknowns is at most `_CHANCE`. Nothing is yielded if `fit`
    # did not converge.
    from scipy.special import ndtri

    least = -float(ndtri(0.5 * _CHANCE / max(tests, 1)))
    for name in names if fit.converged else ():
        wider = Search(search.responses.wider([name]), search.records, search.held)
        before = float(wider.begin[-1])
        try:
            found = wider.whole(np.append(fit.theta, before), fit.starts)
        except FloatingPointError:
            continue
        value = float(found.theta[-1])
        variance = max(float(covariance(found)[-1, -1]), 1e-300)
        if found.converged and abs(value - before) > least * math.sqrt(variance):
            widened = variance / float(white_covariance(found)[-1, -1])
            yield name, _Freed(wider, found, value, widened)


# Wrong signs and units of columns, and exchanged columns.


@dataclass(frozen=True)
class _Undone:
    """Correction of a faulty column."""

    column: str  # the faulty column
    factor: float  # factor on the column, not applied if columns are exchanged
    # whether the factor applies to the deviation from the first value of the column
    is_about_first: bool
    text: str  # description of the fault, for the report
    other: str = ""  # column with which `column` is exchanged, or "" for a correction by a factor

    def on(self, model: Model, record: Record) -> Record:
        """Return the record with the correction applied."""
        columns = columns_of(model, record)
        values = columns[self.column]
        if self.other:
            changed = {self.column: columns[self.other], self.other: values}
        else:
            first = values[np.isfinite(values)][0] if self.is_about_first else 0.0
            changed = {self.column: first + self.factor * (values - first)}
        return with_columns(model, record, changed)


def fault_of_columns(
    search: Search,
    fit: Fit | None,
    errors: Mapping[str, ColumnError],
    progress: Callable[[float, float], None] | None,
) -> str:
    """Return the faults of columns that explain the records, joined by "or", or "".

    A fault is a wrong sign or unit of a column, or the exchange of two columns. It explains the
    records if the fit after its correction converges and does not contradict the measured motion.
    With a fit of the uncorrected records, the corrected records must also be clearly more likely,
    or nearly as likely with parameters closer to their initial values. Only faults that explain the
    records equally well are returned. The result is "" if the fit shows no sign of a faulty column.

    fit: fit of the uncorrected records, or None if their simulation diverges
    errors: name of a column error -> its estimate by one Newton step from 0
    """
    if fit is not None and not _suspicious(search, fit, errors):
        return ""
    explained: dict[str, float] = {}
    for undone, corrected, begin in _likeliest(search, progress):
        try:
            found = corrected.whole(begin, most_steps=_STEPS)
        except FloatingPointError:
            continue
        likelihood = _compared(search, undone, found)
        explains = not unexplained(found).any() and found.converged
        if fit is not None:
            likelier = likelihood - fit.likelihood
            nearer = _change(search, found.theta) < 0.5 * _change(search, fit.theta)
            explains &= likelier < -0.05 * fit.samples.sum() or (likelier < 5.0 and nearer)
        if explains:
            explained[f"{undone.column} {undone.text}"] = likelihood
            samples = found.samples.sum()
    if not explained:
        return ""
    alike = min(explained.values()) + _ALIKE * samples
    return ", or ".join(text for text, level in explained.items() if level < alike)


def _likeliest(
    search: Search, progress: Callable[[float, float], None] | None
) -> list[tuple[_Undone, Search, np.ndarray]]:
    """Return the corrections with which the model fits the records best, the best first."""
    # At most `_TRIED` corrections are returned, each with the search on the corrected records and
    # initial unknowns (p,) for this search. The corrections are compared after a few Gauss-Newton
    # steps on short windows of the records. Corrections that move a record far beyond the limits of
    # the model are omitted.
    model = search.responses.calm.model
    turbulence = search.begin[: search.responses.turbulent]
    candidates: list[tuple[_Undone, Search]] = []
    for undone in _candidates(search):
        records = [undone.on(model, record) for record in search.records]
        if all(is_near_limits(model, record) for record in records):
            candidates.append((undone, Search(search.responses, records, search.held)))
    first = _tried(search, candidates, _FIRST_TRIAL, _FIRST_WINDOWS, progress)
    going_on = [(undone, corrected) for _, undone, corrected, _ in first[:_GO_ON]]
    tried = _tried(search, going_on, _TRIAL, _WINDOWS, None)
    likeliest: dict[tuple[str, str], tuple[_Undone, Search, np.ndarray]] = {}
    for _, undone, corrected, theta in tried:
        begin = np.concatenate([turbulence, theta])
        likeliest.setdefault((undone.column, undone.text), (undone, corrected, begin))
    return list(likeliest.values())[:_TRIED]


def _tried(
    search: Search,
    candidates: Sequence[tuple[_Undone, Search]],
    steps: int,
    windows: int,
    progress: Callable[[float, float], None] | None,
) -> list[tuple[float, _Undone, Search, np.ndarray]]:
    """Return (level, correction, search, unknowns in calm air) of each candidate."""
    # The level is the negative log-likelihood L after a few Gauss-Newton steps on short windows,
    # plus a penalty on the change of the parameters. The lowest level is first. Candidates whose
    # simulation diverges are omitted.
    tried = []
    for number, (undone, corrected) in enumerate(candidates, start=1):
        if progress is not None:
            progress(number, len(candidates))
        try:
            rough = corrected.rough(most_steps=steps, most_windows=windows)
        except FloatingPointError:
            continue
        level = _compared(search, undone, rough) + _change(search, rough.theta)
        tried.append((level, undone, corrected, rough.theta))
    return sorted(tried, key=lambda each: each[0])


def _suspicious(search: Search, fit: Fit, errors: Mapping[str, ColumnError]) -> bool:
    """Return whether a faulty column may have caused this fit."""
    # Any of these conditions is sufficient:
    # - The fit did not converge, or contradicts the measured motion.
    # - Parameters are far from their initial values.
    # - A scale error is significant and too large for a sensor.
    half = BAND * np.sqrt(np.diag(white_covariance(fit)))
    nearest = np.clip(search.begin, fit.theta - half, fit.theta + half)
    far = _change(search, nearest, _USUAL_CHANGE) > _LARGE_CHANGE**2
    for name, each in errors.items():
        if name.startswith("scale") and each.value is not None and each.clear > _OBVIOUS:
            far |= not _is_plausible(search, name, each.value)
    return far or not fit.converged or bool(unexplained(fit).any())


def _change(search: Search, theta: np.ndarray, usual: float = 0.0) -> float:
    """Return the penalty Σ max(|ln r| - usual, 0)² on the change of the parameters."""
    # r is the ratio of a parameter to its initial value. If r is negative, the term is at least (ln
    # 100)². Parameters that are or were 0 are omitted.
    # theta (p,)
    total = 0.0
    # Turbulence and sensor noise come first in the unknowns.
    names, begin = search.responses.free[-len(theta) :], search.begin[-len(theta) :]
    parameters = search.responses.calm.model.parameters
    for name, value, before in zip(names, theta, begin, strict=True):
        if name not in parameters or before == 0.0 or value == 0.0:
            continue
        size = _CHANGED_SIGN if value * before < 0.0 else 0.0
        total += max(size, abs(math.log(abs(value / before))) - usual, 0.0) ** 2
    return total


def _compared(search: Search, undone: _Undone, fit: Fit) -> float:
    """Return the negative log-likelihood L of a fit to corrected records."""
    # L is converted to the units of the uncorrected records, so that the values of different
    # corrections can be compared.
    if undone.column not in search.responses.measured:
        return fit.likelihood
    place = search.responses.measured.index(undone.column)
    return float(fit.likelihood - fit.samples[place] * math.log(abs(undone.factor)))


def _candidates(search: Search) -> Iterator[_Undone]:
    """Yield the corrections to be tried, each for one possible fault of the columns."""
    # - another sign or unit of a column that moves
    # - another unit of the time
    # - the exchange of two inputs, or of two measured quantities
    model = search.responses.model
    for factor, text in _UNITS[model.time_unit].items():
        yield _Undone("time", 1.0 / factor, False, text)
    for name in (*search.moving_inputs(), *search.responses.measured):
        for is_about_first in (False, True):
            yield _Undone(name, -1.0, is_about_first, "has the wrong sign")
        for factor, text in _UNITS.get(model.unit(name), {}).items():
            yield _Undone(name, 1.0 / factor, False, text)
    for columns in (search.moving_inputs(), search.responses.measured):
        for one, other in combinations(columns, 2):
            in_all = all({one, other} <= {*record.measured} for record in search.records)
            if one in model.inputs or in_all:
                yield _Undone(one, 1.0, False, f"and {other} are exchanged", other)
