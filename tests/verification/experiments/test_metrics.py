"""Metrics of a flight as plain values."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from verification.experiments.metrics import FlightMetrics, LearningMetrics


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
