"""Mistakes of a deployment: those that the files prove or make likely, and what it would fly better
with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from hfa_policy.deployed import Deployed
from hfa_policy.mistake import Mistake
from hfa_policy.normalizer_evidence import mistakes_of_normalizer, unknown_normalizer
from hfa_policy.observation_evidence import UNCLEAR, mistakes_of_observations
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_policy.assessment import AssessedPoint, Assessor


def mistakes_of(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """The mistakes that the files show; where they name none, those whose undoing lets it fly
    clearly better. None is looked for of a policy that takes several samples."""
    if assessor.deployed.past:
        return
    shown_by_files = list(mistakes_in_files(assessor.deployed, assessor.points))
    yield from shown_by_files
    is_unnamed = all(mistake.kind == UNCLEAR for mistake in shown_by_files)
    if is_unnamed and assessor.samples:
        from hfa_policy.repair_trial import better_repairs

        yield from better_repairs(assessor, assessed)


def mistakes_in_files(deployed: Deployed, points: Sequence[OperatingPoint]) -> Iterator[Mistake]:
    """The mistakes that the policy's files prove, or make likely."""
    stored = deployed.deployment.actor.stored
    normalizer = deployed.deployment.normalizer
    if stored is not None and stored.timesteps > 0:
        of_the_normalizer = list(mistakes_of_normalizer(deployed, stored, normalizer))
        yield from of_the_normalizer
        if any(mistake.proved for mistake in of_the_normalizer):
            normalizer = None  # it says nothing of this training
    yield from mistakes_of_observations(deployed, stored, normalizer, points)


def notes_on_card(deployed: Deployed, points: Sequence[OperatingPoint]) -> list[str]:
    """Return the mistakes that a policy's files show, for a flight or an export: a sentence each;
    none of a policy that takes several samples."""
    if deployed.past:
        return []
    notes = [mistake.sentence for mistake in mistakes_in_files(deployed, points)]
    of_normalizer = unknown_normalizer(deployed)
    if of_normalizer:
        notes.append(of_normalizer)
    return notes
