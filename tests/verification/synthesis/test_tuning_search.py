"""A search begins with its design and makes as many evaluations as it is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from servo_cases import write_tuning

from hfa_model import Aircraft
from verification.synthesis import tuning_search
from verification.synthesis.tuning import Evaluation
from verification.synthesis.tuning_file import load_tuning


@pytest.mark.parametrize("asked", [5, 12, 40])
def test_it_makes_no_more_evaluations_than_asked_and_begins_with_the_design(
    asked: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft
) -> None:
    monkeypatch.setattr(
        tuning_search.DesignEvaluation, "at", lambda _, values: Evaluation(float(np.log(values / 60.0) @ values), -1.0)
    )
    tuning = load_tuning(str(write_tuning(tmp_path, evaluations=asked)))
    found = tuning_search.tune(published_aircraft, tuning, tmp_path / "record")
    assert asked / 2 < len(found.seen) <= asked
    first = tuning.first_values()
    np.testing.assert_array_equal(found.first, first)
    assert found.seen[0] == found.first_evaluation
    assert found.first_evaluation.cost == pytest.approx(np.log(first / 60.0) @ first, rel=1e-12)
    assert found.best_evaluation.cost == min(each.cost for each in found.seen)
