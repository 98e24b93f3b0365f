"""Mistakes of a deployment: those that the files prove, and what it would fly better with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.deployment import NONE, Deployment
from hfa_policy.normalizer import Normalizer
from hfa_policy.stable_baselines import Zip
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_policy.assessment import AssessedPoint, Assessor

#: How far, in standard deviations of what the normalizer has seen, the trim may lie from the mean:
#: farther at every trim is another observation, nearer fits.
_FAR = 4.0
_FITS = 2.0
#: How many ranges of a state what was observed may span, beyond which it is no such state.
_SPANS = 1.5
#: Rates of change, in nominal rates, that no aircraft has from one sample to the next.
_JUMP = 20.0
#: What the count of a VecNormalize begins with.
_COUNT_AT_FIRST = 1e-4


class Mistake(NamedTuple):
    """A mistake of a deployment.

    kind: which.
    proved: whether the files prove it; else the policy costs clearly less where it is undone.
    text: a sentence.
    """

    kind: str
    proved: bool
    text: str


def mistakes_of(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """The mistakes that the files prove; where they prove none, those whose undoing
    lets it fly clearly better."""
    proved = list(proved_mistakes(assessor.deployed, assessor.points))
    yield from proved
    if not proved and assessor.samples:
        from hfa_policy.repair_trial import better_repairs

        yield from better_repairs(assessor, assessed)


def proved_mistakes(deployed: Deployed, points: Sequence[OperatingPoint]) -> Iterator[Mistake]:
    """The mistakes that the policy's files prove."""
    stored = deployed.deployment.actor.stored
    normalizer = deployed.deployment.normalizer
    if stored is not None and stored.timesteps > 0:
        yield from _of_the_normalizer(deployed, stored, normalizer)
    yield from _of_observations(deployed, stored, normalizer, points)


# The normalizer.


def _of_the_normalizer(
    deployed: Deployed, stored: Zip, normalizer: Normalizer | None
) -> Iterator[Mistake]:
    """None where there was one, one where there was none, and that of another checkpoint."""
    given = deployed.deployment.policy.get("normalizer")
    if given is None and _was_normalized(deployed, stored):
        text = (
            "the policy was trained behind a VecNormalize and the card has no normalizer: give "
            f'its file (normalizer = "{NONE}" where it normalized rewards alone)'
        )
        if not stored.on_policy:
            text += "; or what it was trained on had other units or scales than the card has"
        yield Mistake("no normalizer", True, text)
        return
    if normalizer is None:
        return
    had_none = stored.on_policy and stored.last_original is None and stored.last is not None
    if had_none:
        yield Mistake(
            "a normalizer too many",
            True,
            f"the policy was trained without a VecNormalize; leave {normalizer.origin} out",
        )
        return
    if is_of_another_checkpoint(stored, normalizer):
        yield Mistake(
            "another checkpoint's normalizer",
            True,
            f"{normalizer.origin} has seen {normalizer.count:.0f} observations, the policy "
            f"{stored.timesteps + stored.environments}: it is of another checkpoint",
        )


def _was_normalized(deployed: Deployed, stored: Zip) -> bool:
    """Whether the training had a VecNormalize. PPO and A2C store an original observation only then;
    SAC and TD3 store two that are equal or a sample apart where there was none."""
    if stored.last is None or stored.last_original is None:
        return False
    if stored.on_policy:
        return True
    change = np.abs(stored.last - stored.last_original).max(axis=0)
    model = deployed.model
    jumps = []
    cards = deployed.deployment.observation.items()
    for (name, card), step in zip(cards, change.tolist(), strict=True):
        state = card.get("formula", name)
        if state in model.states:
            moved = step * abs(card.get("scale", 1.0))
            jumps.append(moved > _JUMP * model.rate_scale(state) * deployed.deployment.dt)
    return bool(jumps) and 2 * sum(jumps) > len(jumps)


def is_of_another_checkpoint(stored: Zip, normalizer: Normalizer) -> bool:
    """Whether a VecNormalize and a policy that was trained behind one cannot be a pair.

    At the same checkpoint the normalizer has seen one observation of each environment more than the
    policy has taken steps. A second call of `learn` counts the steps anew: so nothing is said where
    the last observations show that they are a pair."""
    if not math.isfinite(normalizer.count) or stored.last is None:
        return False
    for original in (normalizer.last, stored.last_original):
        if original is not None and original.shape == stored.last.shape:
            again = normalizer.normalized(original)
            if np.allclose(again, stored.last, rtol=1e-2, atol=1e-2):
                return False
    expected = stored.timesteps + stored.environments + _COUNT_AT_FIRST
    return abs(normalizer.count - expected) > 0.5


# The observations.


def _of_observations(
    deployed: Deployed,
    stored: Zip | None,
    normalizer: Normalizer | None,
    points: Sequence[OperatingPoint],
) -> Iterator[Mistake]:
    """Absolute values for deviations or the reverse, and scales that do not fit, as far as what the
    training saw shows it."""
    seen = _seen(stored, normalizer)
    if seen is None:
        return
    centre, spread, is_statistics = seen
    absolute: list[str] = []
    deviations: list[str] = []
    scaled: list[tuple[str, str]] = []
    for index, (name, card) in enumerate(deployed.deployment.observation.items()):
        about = card.get("about", "trim")
        scale = float(card.get("scale", 1.0))
        values = np.array([_value_at(deployed, index, point) for point in points])
        known = card.get("formula", name)
        if is_statistics and spread[index] > 0.0:
            wrong_scale = _wrong_scale(deployed, known, scale, spread[index], centre[index], about)
            if wrong_scale:
                scaled.append((name, wrong_scale))
                continue
            flipped = values / scale if about == "trim" else np.zeros(len(values))
            given = np.zeros(len(values)) if about == "trim" else (values - about) / scale
            off = np.abs(given - centre[index]).min() / spread[index]
            off_flipped = np.abs(flipped - centre[index]).min() / spread[index]
            if off > _FAR and off_flipped < _FITS:
                (absolute if about == "trim" else deviations).append(name)
        elif not is_statistics and known in deployed.model.states:
            low, high = deployed.model.limits[known]
            offset = values if about == "trim" else np.full(len(values), float(about))
            other = np.zeros(len(values)) if about == "trim" else values
            if _outside(centre[index] * scale + offset, low, high) and not _outside(
                centre[index] * scale + other, low, high
            ):
                (absolute if about == "trim" else deviations).append(name)
    yield from _said(absolute, deviations, scaled)


def _said(
    absolute: list[str], deviations: list[str], scaled: list[tuple[str, str]]
) -> Iterator[Mistake]:
    if absolute:
        yield Mistake(
            "deviations for absolute values",
            True,
            f"{', '.join(absolute)}: the training saw absolute values, the card takes deviations "
            "from trim; give about = 0.0",
        )
    if deviations:
        yield Mistake(
            "absolute values for deviations",
            True,
            f"{', '.join(deviations)}: the training saw deviations from trim, the card takes "
            'absolute values; give about = "trim"',
        )
    for name, why in scaled:
        yield Mistake("scale", True, f"{name}: {why}")


def _seen(
    stored: Zip | None, normalizer: Normalizer | None
) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Centre and spread of the observations of the training, (k,) each, and whether they are the
    statistics of many; None where nothing is known."""
    if normalizer is not None:
        has_statistics = not math.isfinite(normalizer.count) or normalizer.count > 1000.0
        return normalizer.mean, np.sqrt(normalizer.variance), has_statistics
    if stored is None or stored.timesteps == 0 or stored.last is None:
        return None
    original = stored.last_original if stored.last_original is not None else stored.last
    return original.mean(axis=0), original.std(axis=0), False


def observations_of_training(deployment: Deployment) -> tuple[np.ndarray, np.ndarray] | None:
    """Mean and size (root mean square about it) of the observations of the training, (k,) each;
    None where nothing is known.

    Without a normalizer they are the last ones, a few, and their mean is taken to be 0."""
    seen = _seen(deployment.actor.stored, deployment.normalizer)
    if seen is None:
        return None
    centre, spread, is_statistics = seen
    if is_statistics:
        return centre, spread
    return np.zeros_like(centre), np.hypot(centre, spread)


def _value_at(deployed: Deployed, index: int, point: OperatingPoint) -> float:
    """The value of an observation's formula at a trim."""
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
    """Whether all lie clearly outside of the limits of a state."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return False
    room = 0.25 * (high - low)
    return bool(np.all((values < low - room) | (values > high + room)))


def _wrong_scale(
    deployed: Deployed, name: str, scale: float, spread: float, centre: float, about: Any
) -> str:
    """Why the scale of an observation cannot be that of the training; "" where it can."""
    if name not in deployed.model.states:
        return ""
    low, high = deployed.model.limits[name]
    unit = deployed.model.unit(name)
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    spans = spread * abs(scale) / (high - low)
    if spans <= _SPANS:
        return ""
    seen = deployed.model.describe(name, spread * abs(scale))
    text = f"with this scale the training saw it spread by {seen}, more than its limits allow"
    if unit.startswith("rad") and spans < 60.0 * _SPANS:
        text += "; it may have been in degrees"
    return text
