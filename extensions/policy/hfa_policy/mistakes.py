"""Mistakes of a deployment that its files show, or whose correction improves the flights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from hfa_policy.assessment import AssessedPoint, Assessor
from hfa_policy.mistake import Mistake
from hfa_policy.mistakes_in_files import mistakes_in_files
from hfa_policy.observation_evidence import UNCLEAR
from hfa_policy.repair_trial import better_repairs


def mistakes_of(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """Yield the mistakes of a deployment.

    - First, the mistakes that the files show.
    - If flights were simulated, and the files show no mistake or only unclear ones: changes that
      clearly improve the flights.

    Nothing is yielded for a policy that uses earlier samples.
    """
    if assessor.deployed.past:
        return
    shown_by_files = list(mistakes_in_files(assessor.deployed, assessor.points))
    yield from shown_by_files
    is_unnamed = all(mistake.kind == UNCLEAR for mistake in shown_by_files)
    if is_unnamed and assessor.samples:
        yield from better_repairs(assessor, assessed)
