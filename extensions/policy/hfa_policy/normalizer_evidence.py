"""What the file of a policy shows of the normalizer in its training, and whether the card has that."""

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

#: Observations that show whether they lie on a line, and how far from it they may be, as a part of
#: what they span: they are single precision, and those a sample apart are off by a thousandth.
_ON_A_LINE = 3
_STRAIGHT = 1e-4
#: Rates of change, in nominal rates, that no aircraft has from one sample to the next.
_JUMP = 20.0
#: What the count of a VecNormalize begins with.
_COUNT_AT_FIRST = 1e-4


def mistakes_of_normalizer(
    deployed: Deployed, stored: Zip, normalizer: Normalizer | None
) -> Iterator[Mistake]:
    """None where there was one, one where there was none, and that of another checkpoint."""
    given = deployed.deployment.policy.get("normalizer")
    if given is None:
        training = _normalizer_in_training(deployed, stored)
        if training is not _Training.NONE:
            is_proved = training is _Training.NORMALIZED
            yield Mistake("no normalizer", is_proved, _says_no_normalizer(training))
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


class _Training(Enum):
    """What the file of a policy shows of a VecNormalize in its training."""

    NONE = "none, or none that normalized observations"
    LIKELY = "changes from sample to sample that no aircraft has"
    NORMALIZED = "one"


def _says_no_normalizer(training: _Training) -> str:
    """That the card has no normalizer, and what to give."""
    text = (
        "the policy was trained behind a VecNormalize and the card has no normalizer: give "
        f'its file (normalizer = "{NONE}" where it normalized rewards alone)'
    )
    if training is _Training.LIKELY:
        text += "; or what it was trained on had other units or scales than the card has"
    return text


def _normalizer_in_training(deployed: Deployed, stored: Zip) -> _Training:
    """Whether the training had a VecNormalize. PPO and A2C store an original observation only then.

    SAC and TD3 always store one: behind a VecNormalize that which the last one was made of, column
    by column on a line, else the one a sample before. Less than three environments show no line."""
    if stored.last is None or stored.last_original is None:
        return _Training.NONE
    if stored.on_policy:
        return _Training.NORMALIZED
    if np.array_equal(stored.last, stored.last_original):
        return _Training.NONE
    if len(stored.last) >= _ON_A_LINE:
        is_normalized = _lie_on_lines(stored.last_original, stored.last)
        return _Training.NORMALIZED if is_normalized else _Training.NONE
    return _Training.LIKELY if _jumps(deployed, stored) else _Training.NONE


def _lie_on_lines(original: np.ndarray, last: np.ndarray) -> bool:
    """Whether each column of the last observations (E, k) that varies is a line of the original
    ones, but for those that are clipped: the largest of all. False where no column shows it."""
    clip = np.abs(last).max()
    distances = []
    for before, after in zip(original.T, last.T, strict=True):
        is_free = np.abs(after) < clip
        span = np.ptp(after[is_free]) if is_free.sum() >= _ON_A_LINE else 0.0
        if span > 0.0:
            x = before[is_free] - before[is_free].mean()
            y = after[is_free] - after[is_free].mean()
            slope = x @ y / max(x @ x, np.finfo(float).tiny)
            distances.append(np.abs(y - slope * x).max() / span)
    return bool(distances) and max(distances) < _STRAIGHT


def _jumps(deployed: Deployed, stored: Zip) -> bool:
    """Whether most states change between the two observations as no aircraft does in a sample."""
    assert stored.last is not None
    assert stored.last_original is not None
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
