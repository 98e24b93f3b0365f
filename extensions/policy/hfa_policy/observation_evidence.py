"""Comparison of the observations in training with those of the deployment file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.mistake import Mistake
from hfa_policy.normalizer import Normalizer
from hfa_policy.stable_baselines import Zip
from trim.point.operating_point import OperatingPoint

#: Distance of the trim from the mean, in standard deviations of the training. If it is larger than
#: the first value at every trim, the observation is another one. If it is smaller than the second,
#: the observation fits.
_FAR = 4.0
_FITS = 2.0
#: Largest standard deviation of a state in training, in ranges of the state.
_SPANS = 1.5
#: Kind of a mistake that the files prove without showing which mistake it is.
UNCLEAR = "observations"


class _Record(NamedTuple):
    """Statistics of one observation in the training.

    centre: mean.
    spread: standard deviation.
    is_of_many: True for the statistics of many observations, False for the last few observations.
    """

    centre: float
    spread: float
    is_of_many: bool


class _Observed(NamedTuple):
    """Observation that the deployment file specifies, evaluated at the N trims.

    name: name in the deployment file.
    state: observed state, or the formula.
    about, scale: entries of the deployment file.
    values: (N,), values of the formula at the trims.
    model: the aircraft.
    """

    name: str
    state: str
    about: Any
    scale: float
    values: np.ndarray
    model: Model

    def given(self, is_absolute: bool) -> np.ndarray:
        """Return the values that the policy receives for this observation at the N trims, (N,).

        is_absolute: True for absolute values, False for deviations from the trim, which are 0
        """
        if not is_absolute:
            return np.zeros(len(self.values))
        about = 0.0 if self.about == "trim" else float(self.about)
        return (self.values - about) / self.scale

    @property
    def is_absolute(self) -> bool:
        """True if the deployment file specifies absolute values.

        False means deviations from the trim.
        """
        return bool(self.about != "trim")

    def contradicts(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the values at the trims contradict the statistics in the training.

        record: the statistics
        is_absolute: True if absolute values are observed, False for deviations
        """
        if record.is_of_many:
            return self._deviations(record, is_absolute) > _FAR
        return self._leaves_limits(record, is_absolute)

    def fits(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the values at the trims fit the statistics in the training.

        record: the statistics
        is_absolute: True if absolute values are observed, False for deviations
        """
        if record.is_of_many:
            return self._deviations(record, is_absolute) < _FITS
        return not self._leaves_limits(record, is_absolute)

    def is_of_any_scale_as_it_is(self, record: _Record) -> bool:
        """Return whether another scale would make the observation consistent with the training.

        The observation remains absolute or a deviation, as the deployment file declares.

        - Deviations are consistent if the mean in the training is near 0.
        - Absolute values of a formula, or of a state that can be 0, are always consistent.
        - Absolute values of another state, such as a speed, are consistent if the mean is far from
          0.

        record: statistics in the training
        """
        is_seen_about_0 = abs(record.centre) < _FITS * record.spread
        if not self.is_absolute:
            return is_seen_about_0
        low, high = self.model.limits.get(self.state, (-math.inf, math.inf))
        return low <= 0.0 <= high or not is_seen_about_0

    def agrees(self, record: _Record) -> bool:
        """Return whether the statistics in the training agree with the deployment file.

        Both the kind of values (absolute or deviations) and the scale must agree.

        record: the statistics
        """
        return self.fits(record, self.is_absolute) and not self.wrong_scale(record)

    def _deviations(self, record: _Record, is_absolute: bool) -> float:
        """Return the distance of the observation from its mean in the training.

        The distance is that of the nearest trim, in standard deviations. If the standard deviation
        is 0, a value is returned that counts neither as a fit nor as a contradiction.

        record: statistics in the training
        is_absolute: True if absolute values are observed, False for deviations
        """
        if record.spread == 0.0:
            return 0.5 * (_FITS + _FAR)
        return float(np.abs(self.given(is_absolute) - record.centre).min() / record.spread)

    def _leaves_limits(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the mean in the training is a state clearly outside its limits.

        The result is False for an observed formula.

        record: statistics in the training
        is_absolute: True if absolute values are observed, False for deviations
        """
        if self.state not in self.model.states:
            return False
        seen = self.values + self.scale * (record.centre - self.given(is_absolute))
        return _outside(seen, *self.model.limits[self.state])

    def wrong_scale(self, record: _Record) -> str:
        """Return the reason why the scale in the deployment file differs from that in the training.

        The result is "" if both scales may be equal.

        record: statistics in the training
        """
        if not record.is_of_many:
            return ""
        return _wrong_scale(self.model, self.state, self.scale, record.spread)


def mistakes_of_observations(
    deployed: Deployed,
    stored: Zip | None,
    normalizer: Normalizer | None,
    points: Sequence[OperatingPoint],
) -> Iterator[Mistake]:
    """Yield the mistakes of observations that the statistics in the training prove.

    For an observation that contradicts its statistics, the first of these conditions decides:
    - The observation may be exchanged with another observation: an unclear mistake.
    - The scale contradicts the statistics: a wrong scale.
    - The other kind of values (absolute or deviations) does not fit the statistics: nothing.
    - Another scale would also explain the statistics: an unclear mistake.
    - Otherwise: absolute values in place of deviations, or the reverse.

    stored: settings in the policy's zip, or None
    normalizer: normalizer of the training, or None
    """
    seen = _training_statistics(stored, normalizer)
    if seen is None:
        return
    centre, spread, is_of_many = seen
    records = [_Record(*pair, is_of_many) for pair in zip(centre, spread, strict=True)]
    observed = [_observed_at(deployed, index, points) for index in range(len(records))]
    absolute: list[str] = []
    deviations: list[str] = []
    for number, (one, record) in enumerate(zip(observed, records, strict=True)):
        wrong_scale = one.wrong_scale(record)
        if not wrong_scale and not one.contradicts(record, one.is_absolute):
            continue
        exchanged = _exchanged_with(number, observed, records)
        if exchanged:
            yield _unclear(one, record, exchanged)
        elif wrong_scale:
            yield Mistake("scale", True, f"{one.name}: {wrong_scale}")
        elif not one.fits(record, not one.is_absolute):
            continue
        elif one.is_of_any_scale_as_it_is(record):
            yield _unclear(one, record, exchanged)
        elif one.is_absolute:
            deviations.append(one.name)
        else:
            absolute.append(one.name)
    yield from _of_abouts(absolute, deviations)


def _exchanged_with(
    number: int, observed: Sequence[_Observed], records: Sequence[_Record]
) -> list[str]:
    """Return the names of the observations that may have been exchanged with one observation.

    Two observations may have been exchanged if each agrees with the statistics of the other.

    number: index of the one observation
    observed: all observations of the deployment file
    records: statistics of each observation in the training
    """
    names = []
    for place, other in enumerate(observed):
        fit = observed[number].agrees(records[place]) and other.agrees(records[number])
        if place != number and fit:
            names.append(other.name)
    return names


def _unclear(one: _Observed, record: _Record, exchanged: Sequence[str]) -> Mistake:
    """Return the mistake of an observation that contradicts its statistics for an unclear reason.

    one: the observation
    record: statistics of the observation in the training
    exchanged: names of observations that may be exchanged with this observation
    """
    given = ", ".join(f"{value:.3g}" for value in one.given(one.is_absolute))
    causes = "its scale or its about"
    if exchanged:
        causes = f"its scale, its about or its place (with {' or '.join(exchanged)})"
    text = (
        f"{one.name}: the policy receives {given} at the trim; in training the mean was "
        f"{record.centre:.3g} and the spread {record.spread:.3g}: {causes} differs"
    )
    return Mistake(UNCLEAR, True, text)


def _of_abouts(absolute: list[str], deviations: list[str]) -> Iterator[Mistake]:
    """Yield the mistakes of observations that are absolute in place of deviations, or the reverse.

    absolute: names of observations whose training used absolute values
    deviations: names of observations whose training used deviations
    """
    if absolute:
        yield Mistake(
            "deviations for absolute values",
            True,
            f"{', '.join(absolute)}: the training used absolute values, but the "
            "deployment file uses deviations from trim; give about = 0.0",
        )
    if deviations:
        yield Mistake(
            "absolute values for deviations",
            True,
            f"{', '.join(deviations)}: the training used deviations from trim, but the "
            'deployment file uses absolute values; give about = "trim"',
        )


def _training_statistics(
    stored: Zip | None, normalizer: Normalizer | None
) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Return mean (k,) and standard deviation (k,) of the observations in the training.

    The third result is True if these are statistics of many observations. The result is None if
    nothing is known.

    stored: settings in the policy's zip, or None
    normalizer: normalizer of the training, or None. If given, its statistics are used
    """
    if normalizer is not None:
        has_statistics = not math.isfinite(normalizer.count) or normalizer.count > 1000.0
        return normalizer.mean, np.sqrt(normalizer.variance), has_statistics
    if stored is None or stored.timesteps == 0 or stored.last is None:
        return None
    original = stored.last_original if stored.last_original is not None else stored.last
    return original.mean(axis=0), original.std(axis=0), False


def observations_of_training(deployment: Deployment) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the mean and the size of the observations in the training, (k,) each, or None.

    The size is the root mean square about the mean. Without statistics of many observations, the
    mean is assumed to be 0. None means that nothing is known.
    """
    seen = _training_statistics(deployment.actor.stored, deployment.normalizer)
    if seen is None:
        return None
    centre, spread, is_statistics = seen
    if is_statistics:
        return centre, spread
    return np.zeros_like(centre), np.hypot(centre, spread)


def _observed_at(deployed: Deployed, index: int, points: Sequence[OperatingPoint]) -> _Observed:
    """Return one observation of the deployment file, with its values at the trims.

    index: index of the observation
    """
    name = list(deployed.deployment.observation)[index]
    entry = deployed.deployment.observation[name]
    state = entry.get("formula", name)
    about = entry.get("about", "trim")
    scale = float(entry.get("scale", 1.0))
    values = np.array([_value_at(deployed, index, point) for point in points])
    return _Observed(name, state, about, scale, values, deployed.model)


def _value_at(deployed: Deployed, index: int, point: OperatingPoint) -> float:
    """Return the value of an observation's formula at a trim, without `about` and `scale`.

    For a deviation from the trim, the value is known only if the formula is a single name.
    Otherwise the result is 0.

    index: index of the observation
    """
    formula = deployed.observed[index]
    trim = deployed.trim_vector(point)
    n, m = len(deployed.model.states), len(deployed.model.inputs)
    observed = float(np.array(deployed.observe(trim[:n], trim[n : n + m], trim)).ravel()[index])
    card: Any = list(deployed.deployment.observation.values())[index]
    about = card.get("about", "trim")
    if about != "trim":
        return observed * float(card.get("scale", 1.0)) + float(about)
    if formula.text.strip() in deployed.names:
        values = {**point.states._asdict(), **point.inputs._asdict()}
        if formula.text.strip() in values:
            return float(values[formula.text.strip()])
        return float(point.model.outputs_at(point.states, point.inputs)[formula.text.strip()])
    return 0.0


def _outside(values: np.ndarray, low: float, high: float) -> bool:
    """Return whether all values are outside the limits of a state by a quarter of the range.

    The result is False if a limit is infinite.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return False
    room = 0.25 * (high - low)
    return bool(np.all((values < low - room) | (values > high + room)))


def _wrong_scale(model: Model, name: str, scale: float, spread: float) -> str:
    """Return the reason why a scale differs from that in the training, or "".

    The result is "" if both scales may be equal, for a formula, and for a state without two finite
    limits.

    name: observed state, or a formula
    scale: scale in the deployment file
    spread: standard deviation of the observation in training
    """
    if name not in model.states:
        return ""
    low, high = model.limits[name]
    unit = model.unit(name)
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    spans = spread * abs(scale) / (high - low)
    if spans <= _SPANS:
        return ""
    seen = model.describe(name, spread * abs(scale))
    text = f"with this scale its spread in training was {seen}, more than its limits allow"
    if unit.startswith("rad") and spans < 60.0 * _SPANS:
        text += "; it may have been in degrees"
    return text
