"""Right and mistaken deployments: none of the right ones is accused, and each mistake is visible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from forty_deployments import AIRCRAFT, MISTAKES, RIGHT, deployment, mistaken, trimmed

from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.notes import notes_on_files
from hfa_policy.assessor import Assessor

#: An action with a larger or smaller effect than the exact gain's, in this ratio, is conspicuous,
#: and an observation that is farther from the training's mean, in its standard deviations.
_RATIO = 5.0
_FAR = 6.0


def conspicuous(name: str, given: Deployment) -> list[str]:
    """Return the rows of the tables that a person sees as wrong, and the notes on the files."""
    model, point, *_ = trimmed(name)
    deployed = Deployed(given, model)
    (found,) = Assessor(deployed, (point,), samples=1).assessed()
    rows = list(notes_on_files(deployed))
    for action in found.actions:
        ratio = action.effect / action.exact_effect
        if not 1.0 / _RATIO < ratio < _RATIO:
            rows.append(f"action {action.action}: {ratio:.3g}")
    for seen in found.observations:
        if np.nan_to_num(seen.farthest) > _FAR:
            rows.append(f"observation {seen.observation}: {seen.farthest:.3g}")
    return rows


def cases(kinds: dict[str, tuple[str, ...]], fast: set[tuple[str, str]]) -> list[object]:
    """Return the test cases (aircraft, kind). Those that are not in `fast` are slow."""
    return [
        pytest.param(name, kind, marks=[] if (name, kind) in fast else [pytest.mark.slow])
        for name, each in kinds.items()
        for kind in each
    ]


@pytest.mark.parametrize(
    ("name", "kind"),
    cases(dict.fromkeys(AIRCRAFT, RIGHT), {("gtm", "normalizer")}),
)
def test_no_right_deployment_is_accused(name: str, kind: str, tmp_path: Path) -> None:
    """The exact gain in a right deployment has no note and no conspicuous row."""
    assert conspicuous(name, deployment(name, kind, tmp_path)) == []


@pytest.mark.parametrize(
    ("name", "mistake"),
    cases(
        MISTAKES,
        {("gtm", "reversed"), ("gtm", "degrees of the file")},
    ),
)
def test_each_mistake_is_visible(name: str, mistake: str, tmp_path: Path) -> None:
    """A deployment with one mistake has a note or a conspicuous row."""
    assert conspicuous(name, mistaken(name, mistake, tmp_path)) != []
