"""Contradictions between the files of a policy and its deployment file."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import NONE
from hfa_flight.policies.deployment.normalizer import Normalizer
from hfa_flight.policies.deployment.stable_baselines import Zip
from hfa_support.units import conversion

#: Least number of observations to recognize a line, and the largest distance from it, relative to
#: their range. Observations are in single precision. Those one sample apart differ by about 1e-3.
_ON_A_LINE = 3
_STRAIGHT = 1e-4
#: Largest standard deviation of a state in training, in ranges of the state, and least number of
#: observations of a normalizer's statistics.
_SPANS = 1.5
_MANY = 1000.0
#: Initial count of a VecNormalize.
_COUNT_AT_FIRST = 1e-4


def notes_on_files(deployed: Deployed) -> list[str]:
    """Return a sentence for each contradiction between the policy's files and its deployment file.

    A warning is added if the files leave open whether a normalizer is missing. The list is empty
    for a policy that uses earlier samples.
    """
    if deployed.past:
        return []
    stored, normalizer = deployed.deployment.actor.stored, deployed.deployment.normalizer
    notes = _notes_on_gain(deployed)
    if stored is not None and stored.timesteps > 0:
        of_normalizer = _note_on_normalizer(deployed, stored, normalizer)
        if of_normalizer:
            return [of_normalizer]  # its statistics are not those of this training
    if normalizer is not None:
        notes += _impossible_spreads(deployed, normalizer)
    return notes


def _notes_on_gain(deployed: Deployed) -> list[str]:
    """Return a sentence for each contradiction between a gain's file and the deployment file."""
    deployment = deployed.deployment
    said = deployment.actor.of_gain
    observed = [entry.get("formula", name) for name, entry in deployment.observation.items()]
    notes = []
    for key, table, listed in (
        ("states", "observation", observed),
        ("inputs", "action", [*deployment.action]),
    ):
        of_file = [str(name) for name in said.get(key, ())]
        if of_file and of_file != listed:
            notes.append(
                f"K is a gain of the {key} {', '.join(of_file)}, but [{table}] lists "
                f"{', '.join(listed)}"
            )
    if not notes:
        notes += _notes_on_units(
            deployed, observed, [str(unit) for unit in said.get("state_units", ())]
        )
    dt = said.get("dt")
    if dt not in (None, True) and not math.isclose(float(dt), deployment.dt, rel_tol=1e-6):
        notes.append(f"K is a gain for dt = {float(dt):g} s, but timing.dt is {deployment.dt:g} s")
    return notes


def _notes_on_units(deployed: Deployed, observed: list[str], units: list[str]) -> Iterator[str]:
    """Yield a sentence for each observation in another unit than its column of K."""
    entries = deployed.deployment.observation.values()
    for name, entry, unit in zip(observed, entries, units, strict=False):
        if name not in deployed.model.states:
            continue
        own = deployed.model.unit(name)
        expected = conversion(unit, own)
        scale = float(entry.get("scale", 1.0))
        if expected is not None and not math.isclose(scale, expected, rel_tol=1e-3):
            yield (
                f"K is a gain per {unit} of {name}, but the deployment file divides {name} in "
                f"{own} by {scale:g}; scale = {expected:.6g} gives {unit}"
            )


def _note_on_normalizer(deployed: Deployed, stored: Zip, normalizer: Normalizer | None) -> str:
    """Return a sentence on an omitted, superfluous or other checkpoint's normalizer, or ""."""
    was_normalized = _was_normalized(stored)
    if deployed.deployment.policy.get("normalizer") is None:
        if was_normalized:
            return (
                "the policy was trained with a VecNormalize that the deployment file omits: give "
                f'its file as normalizer, or normalizer = "{NONE}" where it normalized only rewards'
            )
        if was_normalized is None:
            return (
                f"the file of the {stored.algorithm} does not show whether it was trained with a "
                "VecNormalize, and the deployment file has no normalizer: if it was, give its "
                f'file; else normalizer = "{NONE}"'
            )
        return ""
    if normalizer is None:
        return ""
    has_records = stored.last is not None and (stored.on_policy or stored.last_original is not None)
    if has_records and was_normalized is False:
        return f"the policy was trained without a VecNormalize; leave {normalizer.origin} out"
    if is_of_another_checkpoint(stored, normalizer):
        return (
            f"{normalizer.origin} has counted {normalizer.count:.0f} observations, the policy "
            f"{stored.timesteps + stored.environments}: it belongs to another checkpoint"
        )
    return ""


def _impossible_spreads(deployed: Deployed, normalizer: Normalizer) -> Iterator[str]:
    """Yield a sentence for each state whose spread in training exceeds its limits."""
    model = deployed.model
    if normalizer.count <= _MANY:
        return
    entries = deployed.deployment.observation.items()
    for (name, entry), variance in zip(entries, normalizer.variance.tolist(), strict=True):
        state = entry.get("formula", name)
        low, high = model.limits.get(state, (-math.inf, math.inf))
        spread = math.sqrt(variance) * abs(float(entry.get("scale", 1.0)))
        if state in model.states and spread > _SPANS * (high - low):
            yield (
                f"{name}: with this scale its spread in training was "
                f"{model.describe(state, spread)}, more than its limits allow: its unit or scale "
                "differs from the training"
            )


def _was_normalized(stored: Zip) -> bool | None:
    """Return whether the training normalized observations by a VecNormalize, None if unknown."""
    # PPO and A2C store an original observation only with a VecNormalize. SAC and TD3 always store
    # an original observation. With a VecNormalize, each column of the last observation is a linear
    # function of the original one. Without a VecNormalize, the original is the observation one
    # sample earlier. Too few environments show no linear function.
    if stored.last is None or stored.last_original is None:
        return False
    if stored.on_policy:
        return True
    if np.array_equal(stored.last, stored.last_original):
        return False
    distance = _distance_from_lines(stored.last_original, stored.last)
    return distance < _STRAIGHT if math.isfinite(distance) else None


def _distance_from_lines(original: np.ndarray, last: np.ndarray) -> float:
    """Return the distance of the last observations from a linear function of the original ones."""
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
