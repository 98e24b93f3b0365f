"""A main job without games: both pairs, five angles, one of them without a trim."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model.parameters import ParameterSet
from verification.page.main_job import MainJob, main_job


@pytest.fixture(scope="session")
def job(parameter_set: ParameterSet) -> MainJob:
    return main_job(parameter_set, "published", asked=(), swept=np.radians([5.0, 10.0, 15.0, 20.0, 59.0]))
