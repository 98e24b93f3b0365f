"""Comparison of a deployment's normalizer with evidence of a normalizer in the policy's file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum

import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.deployment import NONE
from hfa_policy.mistake import Mistake
from hfa_policy.normalizer import Normalizer
from hfa_policy.stable_baselines import Zip

#: Least number of observations to recognize a line, and the largest distance from it, relative to
#: their range. Observations are in single precision. Those one sample apart differ by about 1e-3.
_ON_A_LINE = 3
_STRAIGHT = 1e-4
#: Median of the rates of change, in nominal rates, that is impossible for an aircraft. Without a
#: normalizer, 63 of 64 records of one environment are below 2.2, and one is 3.4.
_JUMP = 5.0
#: Initial count of a VecNormalize.
_COUNT_AT_FIRST = 1e-4


def mistakes_of_normalizer(
    deployed: Deployed, stored: Zip, normalizer: Normalizer | None
) -> Iterator[Mistake]:
    """Yield the mistake of the normalizer, if any: omitted, superfluous, or of another checkpoint.

    stored: settings in the policy's zip
    normalizer: normalizer of the deployment, or None
    """
    given = deployed.deployment.policy.get("normalizer")
    if given is None:
        training = _normalizer_in_training(deployed, stored)
        if training in (_Training.LIKELY, _Training.NORMALIZED):
            is_proved = training is _Training.NORMALIZED
            yield Mistake("no normalizer", is_proved, _no_normalizer_message(training))
        return
    if normalizer is None:
        return
    has_records = stored.last is not None and (stored.on_policy or stored.last_original is not None)
    if has_records and _normalizer_in_training(deployed, stored) is _Training.NONE:
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
            f"{normalizer.origin} has counted {normalizer.count:.0f} observations, the policy "
            f"{stored.timesteps + stored.environments}: it belongs to another checkpoint",
        )


class _Training(Enum):
    """Evidence in a policy's file of a VecNormalize in the training.

    NONE: no VecNormalize normalized observations.
    UNKNOWN: the file does not show whether a VecNormalize was used.
    LIKELY: observations change more from sample to sample than those of an aircraft.
    NORMALIZED: a VecNormalize was used.
    """

    NONE = "none, or none that normalized observations"
    UNKNOWN = "nothing"
    LIKELY = "changes from sample to sample that no aircraft has"
    NORMALIZED = "one"


def _no_normalizer_message(training: _Training) -> str:
    """Return the message for a normalizer that the deployment file omits, with the remedy.

    training: LIKELY or NORMALIZED
    """
    text = (
        "the policy was trained with a VecNormalize that the deployment file omits: give its "
        f'file as normalizer, or normalizer = "{NONE}" where it normalized only rewards'
    )
    if training is _Training.LIKELY:
        text += "; or its training had other units or scales than the deployment file"
    return text


def unknown_normalizer(deployed: Deployed) -> str:
    """Return a warning that the training may have used a normalizer, or "".

    The warning is returned if the deployment file declares no normalizer and the policy's zip
    leaves open whether the training used one.
    """
    stored = deployed.deployment.actor.stored
    if stored is None or stored.timesteps == 0 or "normalizer" in deployed.deployment.policy:
        return ""
    if _normalizer_in_training(deployed, stored) is not _Training.UNKNOWN:
        return ""
    return (
        f"the file of the {stored.algorithm} does not show whether it was trained with a "
        "VecNormalize, and the deployment file has no normalizer: if it was, give its file; "
        "else "
        f'normalizer = "{NONE}"'
    )


def _normalizer_in_training(deployed: Deployed, stored: Zip) -> _Training:
    """Return the evidence on whether the training used a VecNormalize.

    PPO and A2C store an original observation only with a VecNormalize. SAC and TD3 always store an
    original observation. With a VecNormalize, each column of the last observation is a linear
    function of the original one. Without a VecNormalize, the original is the observation one sample
    earlier. With too few environments for a linear function, only implausibly large changes are
    evidence. The result is NONE if the last or the original observation is not stored, or if both
    are equal.
    """
    if stored.last is None or stored.last_original is None:
        return _Training.NONE
    if stored.on_policy:
        return _Training.NORMALIZED
    if np.array_equal(stored.last, stored.last_original):
        return _Training.NONE
    distance = _distance_from_lines(stored.last_original, stored.last)
    if math.isfinite(distance):
        return _Training.NORMALIZED if distance < _STRAIGHT else _Training.NONE
    return _Training.LIKELY if _jumps(deployed, stored) else _Training.UNKNOWN


def _distance_from_lines(original: np.ndarray, last: np.ndarray) -> float:
    """Return the distance of the last observations from a linear function of the original ones.

    The distance is the largest over the columns, relative to the range of the column. Clipped
    values are omitted. The result is nan if all columns have too few values or no range.

    original, last: (E, k), for E environments
    """
    clip = np.abs(last).max()
    distances = []
    for before, after in zip(original.T, last.T, strict=True):
        is_free = np.abs(after) < clip
        span = np.ptp(after[is_free]) if is_free.sum() >= _ON_A_LINE else 0.0
        if span > 0.0:
            x = before[is_free] - before[is_free].mean()
            y = after[is_free] - after[is_free].mean()
            slope = x @ y / max(x @ x, np.finfo(float).tiny)
            distances.append(float(np.abs(y - slope * x).max() / span))
    return max(distances, default=math.nan)


def _jumps(deployed: Deployed, stored: Zip) -> bool:
    """Return whether the observed states change faster in one sample than an aircraft can.

    The changes are those from the original to the last observations in the policy's zip. The median
    over the observed states is compared with `_JUMP`. The result is False if no observation is a
    state.
    """
    assert stored.last is not None
    assert stored.last_original is not None
    changes = np.abs(stored.last - stored.last_original).max(axis=0)
    model = deployed.model
    rates = []
    cards = deployed.deployment.observation.items()
    for (name, card), change in zip(cards, changes.tolist(), strict=True):
        state = card.get("formula", name)
        if state in model.states:
            rate = change * abs(card.get("scale", 1.0)) / deployed.deployment.dt
            rates.append(rate / model.rate_scale(state))
    return bool(rates) and float(np.median(rates)) > _JUMP


def is_of_another_checkpoint(stored: Zip, normalizer: Normalizer) -> bool:
    """Return whether normalizer and policy are from different checkpoints.

    At equal checkpoints, the normalizer has counted one observation per environment more than the
    policy. A second call of `learn` restarts the policy's count. The result is therefore False if
    the normalized last observations agree with those of the policy. The result is also False if the
    normalizer's count or the policy's last observations are unknown.
    """
    if not math.isfinite(normalizer.count) or stored.last is None:
        return False
    for original in (normalizer.last, stored.last_original):
        if original is not None and original.shape == stored.last.shape:
            again = normalizer.normalized(original)
            if np.allclose(again, stored.last, rtol=1e-2, atol=1e-2):
                return False
    expected = stored.timesteps + stored.environments + _COUNT_AT_FIRST
    return abs(normalizer.count - expected) > 0.5
