"""Mistakes of a deployment that its files prove or make likely."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from hfa_policy.deployed import Deployed
from hfa_policy.mistake import Mistake
from hfa_policy.normalizer_evidence import mistakes_of_normalizer, unknown_normalizer
from hfa_policy.observation_evidence import mistakes_of_observations
from trim.point.operating_point import OperatingPoint


def mistakes_in_files(deployed: Deployed, points: Sequence[OperatingPoint]) -> Iterator[Mistake]:
    """Yield the mistakes of a deployment that are proved by its files, or likely from its files."""
    stored = deployed.deployment.actor.stored
    normalizer = deployed.deployment.normalizer
    if stored is not None and stored.timesteps > 0:
        of_the_normalizer = list(mistakes_of_normalizer(deployed, stored, normalizer))
        yield from of_the_normalizer
        if any(mistake.proved for mistake in of_the_normalizer):
            normalizer = None  # it is not from this training
    yield from mistakes_of_observations(deployed, stored, normalizer, points)


def notes_on_files(deployed: Deployed, points: Sequence[OperatingPoint]) -> list[str]:
    """Return a sentence for each mistake that the policy's files show.

    A warning is added if the files leave open whether a normalizer is missing. The list is empty
    for a policy that uses earlier samples.
    """
    if deployed.past:
        return []
    notes = [mistake.sentence for mistake in mistakes_in_files(deployed, points)]
    of_normalizer = unknown_normalizer(deployed)
    if of_normalizer:
        notes.append(of_normalizer)
    return notes
