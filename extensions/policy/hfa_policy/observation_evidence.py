"""Comparison of the observations in a policy's training with those of the deployment file."""

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

#: How far, in standard deviations of what the normalizer has seen, the trim may lie from the mean:
#: farther at every trim is another observation, nearer fits.
_FAR = 4.0
_FITS = 2.0
#: How many ranges of a state what was observed may span, beyond which it is no such state.
_SPANS = 1.5
#: The kind of a mistake of which the files prove that it is there and not which it is.
UNCLEAR = "observations"


class _Record(NamedTuple):
    """The record of one observation in the training.

    centre, spread: mean and standard deviation.
    is_of_many: True for the statistics of a normalizer, False for those of the last few
        observations.
    """

    centre: float
    spread: float
    is_of_many: bool


class _Observed(NamedTuple):
    """One observation of the deployment at the trims.

    name: its name in the deployment file.
    state: the observed state, or "" for a formula.
    about, scale: its entries in the deployment file.
    values: (N,), values of its formula at the trims.
    model: the aircraft.
    """

    name: str
    state: str
    about: Any
    scale: float
    values: np.ndarray
    model: Model

    def given(self, is_absolute: bool) -> np.ndarray:
        """Return the observations at the trims, (N,): absolute values, or deviations."""
        if not is_absolute:
            return np.zeros(len(self.values))
        about = 0.0 if self.about == "trim" else float(self.about)
        return (self.values - about) / self.scale

    @property
    def is_absolute(self) -> bool:
        """True if the deployment file declares absolute values."""
        return bool(self.about != "trim")

    def contradicts(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the record of the training excludes this observation."""
        if record.is_of_many:
            return self._deviations(record, is_absolute) > _FAR
        return self._leaves_limits(record, is_absolute)

    def fits(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the training may have seen the observation."""
        if record.is_of_many:
            return self._deviations(record, is_absolute) < _FITS
        return not self._leaves_limits(record, is_absolute)

    def is_of_any_scale_as_it_is(self, record: _Record) -> bool:
        """Return whether the training may have seen it with the given `about` and another scale.

        Deviations of any scale lie about 0. So do absolute values of a state that may be 0, unlike
        those of a speed, whose spread is far below its mean.
        """
        is_seen_about_0 = abs(record.centre) < _FITS * record.spread
        if not self.is_absolute:
            return is_seen_about_0
        low, high = self.model.limits.get(self.state, (-math.inf, math.inf))
        return low <= 0.0 <= high or not is_seen_about_0

    def agrees(self, record: _Record) -> bool:
        """Return whether the training may have seen the observation as the deployment declares
        it."""
        return self.fits(record, self.is_absolute) and not self.wrong_scale(record)

    def _deviations(self, record: _Record, is_absolute: bool) -> float:
        """Return the distance of the nearest trim from the mean, in standard deviations."""
        if record.spread == 0.0:
            return 0.5 * (_FITS + _FAR)
        return float(np.abs(self.given(is_absolute) - record.centre).min() / record.spread)

    def _leaves_limits(self, record: _Record, is_absolute: bool) -> bool:
        """Return whether the last observations of the training are clearly outside a state's
        limits."""
        if self.state not in self.model.states:
            return False
        seen = self.values + self.scale * (record.centre - self.given(is_absolute))
        return _outside(seen, *self.model.limits[self.state])

    def wrong_scale(self, record: _Record) -> str:
        """Return the reason why its scale is not that of the training, or "" if it may be."""
        if not record.is_of_many:
            return ""
        return _wrong_scale(self.model, self.state, self.scale, record.spread)


def mistakes_of_observations(
    deployed: Deployed,
    stored: Zip | None,
    normalizer: Normalizer | None,
    points: Sequence[OperatingPoint],
) -> Iterator[Mistake]:
    """Yield mistakes of observations that the record of the training shows.

    These are absolute values instead of deviations or the reverse, and wrong scales. Any other
    difference has several possible reasons.
    """
    seen = _seen(stored, normalizer)
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
    """Return the names of observations that may be exchanged with this one."""
    names = []
    for place, other in enumerate(observed):
        fit = observed[number].agrees(records[place]) and other.agrees(records[number])
        if place != number and fit:
            names.append(other.name)
    return names


def _unclear(one: _Observed, record: _Record, exchanged: Sequence[str]) -> Mistake:
    """Return the mistake of an observation that differs from the training's for one of several
    reasons."""
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
    """Yield the observations whose record only the other `about` explains."""
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


def _seen(
    stored: Zip | None, normalizer: Normalizer | None
) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Return center and spread of the training's observations, (k,) each, or None if unknown.

    Whether they are statistics of many observations is returned too.
    """
    if normalizer is not None:
        has_statistics = not math.isfinite(normalizer.count) or normalizer.count > 1000.0
        return normalizer.mean, np.sqrt(normalizer.variance), has_statistics
    if stored is None or stored.timesteps == 0 or stored.last is None:
        return None
    original = stored.last_original if stored.last_original is not None else stored.last
    return original.mean(axis=0), original.std(axis=0), False


def observations_of_training(deployment: Deployment) -> tuple[np.ndarray, np.ndarray] | None:
    """Return mean and size of the training's observations, (k,) each, or None if unknown.

    The size is the root mean square about the mean. Without a normalizer the last few observations
    are used, with an assumed mean of 0.
    """
    seen = _seen(deployment.actor.stored, deployment.normalizer)
    if seen is None:
        return None
    centre, spread, is_statistics = seen
    if is_statistics:
        return centre, spread
    return np.zeros_like(centre), np.hypot(centre, spread)


def _observed_at(deployed: Deployed, index: int, points: Sequence[OperatingPoint]) -> _Observed:
    """Return an observation of the deployment file at the trims."""
    name = list(deployed.deployment.observation)[index]
    entry = deployed.deployment.observation[name]
    state = entry.get("formula", name)
    about = entry.get("about", "trim")
    scale = float(entry.get("scale", 1.0))
    values = np.array([_value_at(deployed, index, point) for point in points])
    return _Observed(name, state, about, scale, values, deployed.model)


def _value_at(deployed: Deployed, index: int, point: OperatingPoint) -> float:
    """Return the value of an observation's formula at a trim."""
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
    """Return whether all values lie clearly outside the limits of a state."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return False
    room = 0.25 * (high - low)
    return bool(np.all((values < low - room) | (values > high + room)))


def _wrong_scale(model: Model, name: str, scale: float, spread: float) -> str:
    """Return the reason why the scale of an observation is not that of the training, or "" if it
    may be."""
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
