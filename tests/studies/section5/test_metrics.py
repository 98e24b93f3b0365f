"""Metrics of a flight as plain values."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from controller import basis
from studies.section5.flown_laws import Critic
from studies.section5.metrics import FlightMetrics, LearningMetrics, learning_metrics


def metrics(learning: LearningMetrics | None) -> dict[str, Any]:
    values: dict[str, Any] = {field.name: number for number, field in enumerate(fields(FlightMetrics))}
    return FlightMetrics(**(values | {"lost_at": None, "learning": learning})).to_dict()


def test_learning_is_left_out_where_nothing_learns_and_nothing_else_is() -> None:
    names = [field.name for field in fields(FlightMetrics)]
    assert list(metrics(None)) == names[:-1]
    assert metrics(None)["lost_at"] is None
    learned = LearningMetrics(**{field.name: 1.5 for field in fields(LearningMetrics)})  # type: ignore[arg-type]
    assert list(metrics(learned)) == names
    assert metrics(learned)["learning"]["late_update"] == 1.5


def critic_of(weights: np.ndarray) -> Critic:
    return Critic(basis("quadratic", 1), weights, np.arange(len(weights)) + 1.0, {"law": 1})


def test_learning_before_and_after_its_time() -> None:
    """Ticks of 0.1 s, T_w = 1 s, its end begins at 0.9 s."""
    W = np.array([0.0, 1.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 9.5, 10.0, 10.0, 12.0, 11.0, 11.0])[:, None]
    residual = np.array([-3.0, *[1.0] * 9, -2.0, 0.5, 0.5, 0.7, 0.5])
    found = learning_metrics(0.1 * np.arange(len(W)), critic_of(W), residual, 1.0, np.inf)
    shares = (found.path_share, found.late_update, found.end_update, found.late_change, found.end_change)
    assert shares == pytest.approx((10.0 / 13.0, 1.0, 0.25, 0.2, 0.05))
    assert found.stack_residual == (1.0, 11.0, 15.0)
    assert found.flown_residual == (3.0, 3.0, 2.0)
    still = learning_metrics(0.1 * np.arange(len(W)), critic_of(0.0 * W + 1.0), residual, 1.0, np.inf)
    assert (still.path_share, still.late_change) == (0.0, 0.0)
    assert learning_metrics(np.zeros(1), critic_of(W), residual, 1.0, 0.5).path_share == np.inf
