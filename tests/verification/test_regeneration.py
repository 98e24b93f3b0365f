"""Checks of regenerated linear models against the printed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import hfa
from hfa_model import published_models
from trim import regenerate
from verification.regeneration import check_pair


def test_a_slow_mode_that_moves_fails_its_check_alone() -> None:
    """If all eigenvalues move by 0.002 1/s, only the slow ones differ from the print."""
    published = published_models()[0]
    model = regenerate(hfa.aircraft(), published)
    assert check_pair(model, published).ok
    moved = replace(model, A=model.A + 2e-3 * np.eye(len(model.A)))
    failed = {check.name for check in check_pair(moved, published).checks if not check.ok}
    assert "slow eigenvalues, absolute error, 1/s" in failed
    assert "fast eigenvalues, relative error" not in failed
