"""The parts of Section 5 of the paper."""

from __future__ import annotations

import numpy as np

from hfa_model.published import published_models
from verification.experiments.experiment import CASE_I, CASE_II


def test_the_cases_are_the_printed_pairs() -> None:
    np.testing.assert_allclose([CASE_I, CASE_II], [model.dihedral_deg for model in published_models()])
