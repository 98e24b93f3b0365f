"""Figures of a verdict beside the errors: L2 gain and disk margins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from known_models import game_at

import hfa
from controller import bounded_real_gain, disk_margin
from hfa import solve, verify


def test_a_gain_above_delta_fails_and_margins_are_of_both_policies() -> None:
    """The LQR gain does not attenuate disturbances to a delta close to delta_min: it fails, though
    it stabilizes. The margins are those of the learned and of the exact policy.
    """
    game = game_at(15.0)
    game = game.with_delta(1.01 * solve(game).delta_min)
    K = solve(game.with_delta(math.inf)).K
    verdict = verify(game, hfa.from_gain(game, K))
    (gain,) = [check for check in verdict.checks if check.name == "l2_gain"]
    assert gain.value == pytest.approx(bounded_real_gain(game, K), rel=1e-9)
    assert gain.value > gain.limit == game.delta
    assert (gain.ok, verdict.stabilizing, verdict.grade) == (False, True, "fail")
    assert replace(verdict, cost_lost=0.1).grade == "fail"
    data = verdict.as_data()
    assert data["disk_margin"] == pytest.approx(disk_margin(game, K).disk)
    assert data["disk_margin_exact"] == pytest.approx(disk_margin(game, solve(game).K).disk)
    assert data["disk_margin"] != pytest.approx(data["disk_margin_exact"], rel=1e-3)


def test_a_wide_limit_permits_its_error_of_a_semidefinite_value() -> None:
    """With a limit of 1 %, P may be indefinite by as much; with the usual limit it may not."""
    game = hfa.Game(
        np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]]), Q=np.diag([1.0, 0.0]), R=[[1.0]]
    )
    P = solve(game).P - np.diag([0.0, 1e-4 * solve(game).P.max()])
    for limit, is_ok in ((1e-2, True), (1e-6, False)):
        checks = verify(game, hfa.from_value(game, P), limit=limit).checks
        (least,) = [check for check in checks if check.name == "P_smallest_eigenvalue"]
        assert least.ok is is_ok
